"""What a user gives is checked where it is given: both ends of a range, the kind, and the shape."""

import inspect
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import flighttune as ft

BEYOND = 1e-6
"""Relative, or of a range that ends at 0."""

# Key of a scenario | lowest | highest value, as releases have had them; > stands for "more than".
RANGES = """
flight.V_a_mps | 1 | 1000
flight.h_m | -500 | 30000
flight.chi_deg | -3600 | 3600
flight.gamma_deg | -89 | 89
flight.phi_deg | -89 | 89
flight.n_z | -50 | 50
flight.g_mps2 | 0.1 | 100
disturbance.chi_amplitude | -1e4 | 1e4
disturbance.chi_omega_rad_s | 0 | 1000
disturbance.chi_phase_deg | -180 | 180
plant.0.roll_lag_rad_s | 0.05 | 200
plant.0.roll_damping | 0.05 | 5
plant.0.roll_delay_s | 0 | 2
plant.1.airframe.mass_factor | 0.01 | 100
plant.1.airframe.cg_aft_m | -10 | 10
limits.phi_rate_dps | >0 | 1e4
controller.tracking_time_s | 1e-3 | 1e4
tuning.gain_max | >0 | 1e6
wind.speed_mps | 0 | 200
wind.from_deg | -3600 | 3600
"""


def scenario_with(key, value):
    """A scenario in which one key has a value."""
    tables = {
        "title": "x",
        "gains": ["paper"],
        "flight": {"V_a_mps": 25.0, "duration_s": 1.0},
        "reference": {"chi_deg": 0.0, "gamma_deg": 0.0},
        "wind": {"speed_mps": 3.0, "from_deg": 0.0},
        "plant": [
            {"kind": "point_mass_lag", "roll_lag_rad_s": 4.0, "n_z_lag_rad_s": 4.0},
            {"kind": "jsbsim", "aircraft": "aerosonde"},
        ],
    }
    *above, name = key.split(".")
    at = tables
    for part in above:
        at = at[int(part)] if isinstance(at, list) else at.setdefault(part, {})
    at[name] = value
    return ft.scenario_from(tables)


def refused(key, value):
    """Whether a value is refused by its key."""
    try:
        scenario_with(key, value)
    except ft.InputError as error:
        return f"`{key.rpartition('.')[2]}`" in str(error) and "must be" in str(error)
    return False


@pytest.mark.parametrize("row", RANGES.strip().splitlines())
def test_a_key_takes_both_ends_of_its_range_and_nothing_beyond(row):
    key, low, high = row.split(" | ")
    for end, outwards in ((low, -1.0), (high, 1.0)):
        value = float(end.removeprefix(">"))
        assert refused(key, value) == end.startswith(">"), (key, value)
        assert refused(key, value + outwards * BEYOND * max(abs(value), 1e-3)), (key, value)
    assert refused(key, math.nan)
    assert refused(key, "x")


@pytest.mark.parametrize(
    ("key", "value", "good"),
    [
        ("limits.n_z", [-1.0, 2.0], True),
        ("limits.n_z", [2.0, -1.0], False),
        ("limits.n_z", [2.0, 2.0], False),
        ("limits.n_z", [-1.0, 2.0, 3.0], False),
        ("limits.n_z", [-51.0, 2.0], False),
        ("envelope.V_a_mps", [0.5, 10.0], False),
        ("envelope.gamma_deg", [-10.0, 90.0], False),
    ],
)
def test_a_range_rises_within_its_quantity(key, value, good):
    assert refused(key, value) != good


LIMITS = {"lower": [-1, 0], "upper": [1, 2], "rate_lower": [-1, -1], "rate_upper": [1, 1]}
HUGE = 10**400
NUMBERS = [np.float32(1.0), np.int64(2), 3, 0.5]
NOT_NUMBERS = {
    math.nan: "nan", math.inf: "inf", "1": "'1'", True: "True", 1j: "1j", HUGE: "401 digits",
    "a" * 79: f"'{'a' * 39} ...", object: "",
}  # fmt: skip

# A call, the argument, values that it takes, and others that it refuses with words
CALLS = [
    (ft.loop.FlightCondition, "V_a", [*NUMBERS, 1e-300], {0.0: "positive, got 0.0", -1: "-1 m/s"}),
    (lambda **x: ft.loop.FlightCondition(V_a=25.0, **x), "h", [*NUMBERS, -2.5], {None: "None"}),
    (lambda **x: ft.loop.InnerLag(order=1, **x), "natural_frequency", [5, 0.5], {0: "0", -1: "-1"}),
    (lambda **x: ft.loop.MimoPI(ft.PAPER_GAINS, **x), "dt", [0.02], {0.0: "0.0", -0.1: "-0.1"}),
    (lambda **x: ft.loop.kinematic_model(gamma=0.0, g=9.8, **x), "V_a", [25], {0.0: "positive"}),
    (lambda **x: ft.loop.kinematic_model(V_a=25.0, g=9.8, **x), "gamma", [-1.57, 0, 1.57], {
        math.pi / 2: "inside +-90 deg, got 90.0 deg", -2.0: "got -114.59",
    }),
]  # fmt: skip


@pytest.mark.parametrize(("call", "name", "taken", "others"), CALLS, ids=[x[1] for x in CALLS])
def test_a_number_has_its_range_and_a_refusal_its_name_and_value(call, name, taken, others):
    for value in taken:
        call(**{name: value})
    for value, words in {**NOT_NUMBERS, **others}.items():
        with pytest.raises(ft.InputError) as refusal:
            call(**{name: value})
        said = str(refusal.value)
        assert re.match(rf"`{name}` must ", said), said
        assert words in said
        assert "\n" not in said
        assert len(said) < 200


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ft.loop.indicators([1.0]), "`A_K` must have 2 axes, got shape (1,)"),
        (lambda: ft.loop.indicators([[1.0, 2.0]]), "got (1, 2)"),
        (lambda: ft.loop.indicators(np.zeros((0, 0))), "got (0, 0)"),
        (lambda: ft.loop.indicators([[math.nan]]), "must be finite, got [[nan]]"),
        (lambda: ft.loop.indicators([[1.0], [1.0, 2.0]]), "`A_K` must be numbers"),
        (lambda: ft.loop.indicators_batch(np.ones((2, 3))), "`A_K` must"),
        (lambda: ft.PIGains(K_P=[1.0], K_I=np.eye(2)), "`K_P` must have"),
        (lambda: ft.PIGains(K_P=[[math.inf]], K_I=[[1.0]]), "`K_P` must be finite"),
        (lambda: ft.loop.Limits(**LIMITS | {"lower": [2, 0]}), "`lower` must"),
        (lambda: ft.loop.Limits(**LIMITS | {"upper": [1]}), "one length"),
        (
            lambda: ft.loop.Limits(**LIMITS | {"rate_lower": [0.5, -1]}),
            "hold zero, got [0.5, -1.0]",
        ),
    ],
)
def test_an_array_has_its_shape_and_finite_numbers(call, words):
    with pytest.raises(ft.InputError) as refusal:
        call()
    assert words in str(refusal.value)


def test_matrices_of_a_value_are_its_own_and_cannot_be_changed():
    given = np.eye(2)
    gains = ft.PIGains(K_P=given, K_I=[[1, 2], [3, 4]])
    limits = ft.loop.Limits(**LIMITS)
    given[0, 0] = 7.0

    assert gains.K_P.tolist() == np.eye(2).tolist()
    assert gains.K_I.dtype == float
    for array in (gains.K_P, gains.K_I, limits.lower, limits.rate_upper):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


# A function, one of its arguments, values of its kind, and others with words of the refusal.
WORD, LONG_PATH = "x" * 255, "x/" * 2047
ARGUMENTS = [
    (ft.band, "source", ["nowhere", Path("nowhere"), WORD, LONG_PATH], [
        (WORD + "x", "a name or path that files can have"), (LONG_PATH + "x/", "a name or path"),
        ("a\0b", "a name or path"), (3, "text or a path, got 3."), (None, "got None"),
        (pd.DataFrame(), "got a DataFrame"), (10**20, "a whole number of 21 digits"),
        (10**19, "got 1" + "0" * 19), (np.zeros(3), "got an array"), (object(), "got an object"),
        ([1], "got a list"), (2.5, "got 2.5"), (1j, "got 1j"), (True, "got True"),
    ]),
    (ft.band, "flights", [None, 3, np.int64(3), 2**31 - 1], [
        (2**31, "a whole number or None, got 2147483648"), (-(2**31), "got -2147483648"),
        (True, "got True"), (3.0, "got 3.0"), ("a" * 78, repr("a" * 78)),
        ("a" * 79, "'" + "a" * 39 + " ..."),
    ]),
    (ft.band, "epsilon", [None, 0.5, np.float32(0.5), 1], [("1", "a number or None"), (1j, "1j")]),
    (ft.band, "signals", [None, ["h"], ("h",), iter(["h"]), {"h"}, iter([3])], [
        ("h", "a list, each text or None, got 'h'"), (b"h", "got b'h'"), ([3], "got a list"),
        ({3}, "got a set"), (3, "got 3"),
    ]),
    (ft.band, "predicted_from", [None, "wind"], [("air", "'wind' or None, got 'air'"), (["wind"],
                                                                                      "a list")]),
    (ft.band, "changes", [None, {}, {"seed": 3}], [
        ({3: 1}, "text, got 3."), ([("a", 1)], "a dictionary or None, got a list"),
    ]),
    (ft.band, "workers", [None, 2], [("2", "a whole number or None, got '2'")]),
    (ft.band, "observer", [None, ft.CampaignObserver()], [(3, "a CampaignObserver"), ("x", "'x'")]),
    (ft.mission, "until_sure", [True, np.bool_(False)], [(1, "true or false, got 1."), (0, "0")]),
    (ft.mission, "fences", [(), ["x"], (Path("x"),)], [
        ("x", "a list, each a path or text, got 'x'"), ([3], "got a list"), (iter(["x"]), "got a"),
        (["x", None], "got a list"),
    ]),
    (ft.mission, "navigation", ["rtk", None], [("gps", "'exact' or 'rtk' or"), (3, "got 3")]),
    (ft.fly, "progress", [None, print], [(3, "a function or None, got 3")]),
    (ft.certify, "lag", [[0.1, 0.2], [[0.1], [0.2]]], [("12", "a list, each"), (3, "got 3")]),
]  # fmt: skip


def said_of(call, options):
    try:
        call(**options)
    except ft.InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("function", "name", "taken", "others"), ARGUMENTS)
def test_an_argument_is_of_its_kind_before_anything_is_read(function, name, taken, others):
    first = next(iter(inspect.signature(function).parameters))
    for value in taken:
        said = said_of(function, {first: "nowhere", name: value})
        assert said
        assert not re.match(rf"`{name}` must be (a |text|true|')", said), said
    for value, words in others:
        said = said_of(function, {first: "nowhere", name: value})
        assert re.match(rf"(each name in )?`{name}` must be ", said.replace("in `", "in `")), said
        assert words in said, said
        assert len(said) < 1100


def test_another_name_or_number_of_arguments_is_a_type_error_of_the_call():
    for call in (lambda: ft.band("x", unknown=3), lambda: ft.band(), lambda: ft.band("x", "y", 3)):
        with pytest.raises(TypeError, match=r"^band\(\) "):
            call()


@pytest.mark.parametrize("faults", [1, 2, 5, 6, 12])
def test_as_many_mistakes_are_told_as_fit_a_line_and_the_others_are_counted(faults):
    wrong = {f"unknown_{i}": 1 for i in range(faults)}
    with pytest.raises(ft.ScenarioError) as refused:
        ft.scenario_from({**scenario_with("title", "x").as_dict(), **wrong})
    told, more = len(re.findall("`unknown_", str(refused.value))), re.findall(
        r"and (\d+) more", str(refused.value))  # fmt: skip
    assert told + sum(map(int, more)) == faults
    assert bool(more) == (faults > told)
    assert told == min(faults, 5)
    assert str(refused.value).endswith(".")
