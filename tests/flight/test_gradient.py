"""Slopes of flights against central differences of flights by JSBSim."""

import math

import numpy as np
import pytest
from fuzzing import marked

import flighttune as ft
from flighttune.base.files.code import JSBSIM
from flighttune.flight.fly import fly_alone
from flighttune.flight.gradient import _measured, _value, _with
from flighttune.flight.load import chosen_entry
from flighttune.flight.loop import duals

# Five digits, and by how much differences of these widths differ among themselves: narrow ones are
# noise, as JSBSim keeps positions at 2e9 ft, and in wide ones a limit is met at another sample.
DIGITS, WIDTHS = 1e-5, (3e-4, 1e-4, 3e-5, 1e-5)

MEASURES = [
    *("chi.ITAE", "gamma.ITAE", "chi.MO_deg", "gamma.MO_deg", "chi.rise_s", "chi.MS_rad"),
    *("gamma.ST_rad", "chi.effort_rms", "flight.n_z_max", "flight.V_a_dev_mps"),
]
TURBULENCE = {"turbulence": {"intensity": "light"}}
LEVELS = [{"h_m": h, "speed_mps": V, "from_deg": 30.0} for h, V in ((900.0, 2.0), (1200.0, 6.0))]
OSCILLATION = {
    "chi_amplitude": 0.03, "chi_omega_rad_s": 0.5,
    "gamma_amplitude": 0.02, "gamma_omega_rad_s": 0.4, "as_wind": True,
}  # fmt: skip
FED_BACK = {"law": ["exact"], "gains": ["tuned_fed_back"]}


def scenario(aircraft="aerosonde", V_a_mps=25.0, h_m=1000.0, duration_s=6.0, **changes):
    """A turn into a climb that meets no limit."""
    made = ft.load_scenario("exact_law").as_dict()
    made["plant"] = [{"kind": "jsbsim", "aircraft": aircraft}]
    made["flight"] = {"V_a_mps": V_a_mps, "h_m": h_m, "duration_s": duration_s}
    made["reference"] = {"chi_deg": 3.0, "gamma_deg": 0.5}
    return ft.scenario_from(made | {"expect": []} | changes)


CASES = {
    "the paper's law in still air": ({}, ["K_P", "K_I", "flight.V_a_mps"]),
    "the exact law in turbulence": (
        TURBULENCE | {"law": ["exact"]},
        ["K_P", "K_I", "plant.airframe.mass_factor"],
    ),
    "feedback in turbulence": (
        TURBULENCE | FED_BACK | {"wind": {"speed_mps": 3.0, "from_deg": 70.0}},
        ["feedback.phi", "K_P.chi_dot.chi"],
    ),
    "a jet": (
        {"aircraft": "a4", "V_a_mps": 190.0, **FED_BACK},
        ["K_P", "plant.airframe.actuator_lag_factor", "reference.chi_deg"],
    ),
    "a propeller aircraft": (
        {"aircraft": "c172p", "V_a_mps": 50.0, "law": ["exact"]},
        ["K_P", "plant.airframe.cg_aft_m", "plant.airframe.mass_factor"],
    ),
    "a flying wing": ({"aircraft": "x8", "V_a_mps": 18.0, **FED_BACK}, ["K_P", "K_I"]),
    "wind over height": ({"wind": {"level": LEVELS}}, ["K_P"]),
    "wind that oscillates": (
        {"disturbance": OSCILLATION},
        ["K_P.n_z.gamma", "disturbance.chi_amplitude"],
    ),
    "sensors": ({"sensors": {"gamma_noise_sd_deg": 0.02, "chi_bias_deg": 0.2}}, ["K_P.phi.chi"]),
}

QUICK = "the paper's law in still air", "sensors"
REST = "a propeller aircraft", "a jet", "the exact law in turbulence"


def differences(entry, name, value, width):
    """Slopes of measures by flights on both sides."""
    half = width * (abs(value) or 1.0)
    ends = [fly_alone(_with(entry, name, value + side)).signals for side in (-half, half)]
    low, high = (_measured(entry, signals) for signals in ends)
    return [(_value(x, high) - _value(x, low)) / (2.0 * half) for x in MEASURES]


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        *marked([case for case in CASES if case not in REST], pytest.mark.soak, but=QUICK),
        *marked(REST, pytest.mark.counts, but=()),
    ],
)
def test_slopes_are_central_differences_where_those_are_good(case):
    changes, by = CASES[case]
    flown = scenario(**changes)
    entry = chosen_entry(flown, None)

    gradient = ft.gradient(flown, by=by, measures=MEASURES)

    good = 0
    for name in dict.fromkeys(row["parameter"] for row in gradient.slopes):
        rows = [row for row in gradient.slopes if row["parameter"] == name]
        slopes, value = np.array([row["slope"] for row in rows]), rows[0]["value"]
        tried = np.array([differences(entry, name, value, width) for width in WIDTHS])
        spread, size = np.ptp(tried, axis=0), np.abs(slopes)
        off = np.abs(tried - slopes).min(axis=0)
        assert (off <= DIGITS * size + spread)[np.isfinite(slopes)].all()
        good += int(np.count_nonzero((off <= DIGITS * size) & (size > 0.0)))
    assert good > 0.3 * len(gradient.slopes)


REFUSED = {
    "a measure that counts samples": ({}, {"measures": ["chi.settling_s"]}, "must have slopes"),
    "one of the linear loop": ({}, {"measures": ["loop.R_K"]}, "of the linear loop"),
    "an unknown measure": ({}, {"measures": ["chi.wobble"]}, "got chi.wobble"),
    "an unknown gain": ({}, {"by": ["K_P.phi.V"]}, "got K_P.phi.V"),
    "feedback that is zero": ({}, {"by": ["feedback"]}, "a gain that is not zero, got feedback"),
    "no number": ({}, {"by": ["title"]}, "title must be one number"),
    "a count": ({}, {"by": ["seed"]}, "and not a count, got 1"),
    "a key that is not there": ({}, {"by": ["flight.wings"]}, "got nothing"),
    "a time of samples": ({}, {"by": ["flight.duration_s"]}, "rounded to samples"),
    "an error of sensors": (
        {"sensors": {"chi_bias_deg": 0.2}},
        {"by": ["sensors.chi_bias_deg"]},
        "the errors that the law sees",
    ),
    "another plant": ({}, {"plant": "kinematic"}, "must be an aircraft"),
    "a third command": (
        {
            "reference": {"chi_deg": 3.0, "gamma_deg": 0.5, "V_mps": 25.0},
            "limits": {"n_x": [-0.3, 0.3]},
        },
        {},
        "must be compiled to have slopes",
    ),
    "a path through the air": (
        {"disturbance": OSCILLATION | {"path": "air"}},
        {},
        "must be compiled to have slopes",
    ),
    "a flight that ends early": (
        {"h_m": 60.0, "reference": {"chi_deg": 0.0, "gamma_deg": -30.0}},
        {},
        "must be completed, got ground contact",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_slope_is_refused(case):
    changes, asked, message = REFUSED[case]
    with pytest.raises(ft.InputError, match=message):
        ft.gradient(scenario(**changes), **asked)


def test_a_value_that_is_set_is_that_of_the_rows_of_all_slopes():
    array = duals.Rows(np.array([1.0, 2.0]), np.array([[1.0, 0.0], [0.0, 1.0], [3.0, 4.0]]))

    array[1] = duals.Dual(7.0, np.array([5.0, 6.0, 8.0]))
    array.share()

    assert array.rows.tolist() == [[1.0, 7.0, 1.0, 5.0], [1.0, 7.0, 0.0, 6.0], [1.0, 7.0, 3.0, 8.0]]


def test_slopes_need_compiled_code(monkeypatch):
    monkeypatch.setenv(JSBSIM, "1")
    with pytest.raises(ft.InputError, match=f"{JSBSIM} must be absent"):
        ft.gradient(scenario(duration_s=2.0))


def test_the_answer_has_a_table_for_each_measure():
    measures = ["chi.ITAE", "gamma.peak_rad"]
    gradient = ft.gradient(scenario(duration_s=2.0), by=["K_P"], measures=measures)

    answer = gradient.answer()

    assert [len(table.records) for table in answer.tables] == [2, 2]
    assert answer.values["values"].keys() == set(measures)


STEP = 1e-6
TRUNCATED = 1e-8
"""Error of central differences over that step, of functions whose third derivatives are about 1."""

# Functions of two numbers as laws use them, and places on each of their branches.
FORMULAS = [
    (lambda m, x, y: 3.0 * x - y / 2.0 + (1.0 - x) * y - (y - 4.0) + 2.0 + x, (0.3, -1.2)),
    (lambda m, x, y: x / y + 2.0 / y - x * y / 5.0, (0.3, -1.2)),
    (lambda m, x, y: abs(x) + abs(y) * abs(-y), (0.3, -1.2)),
    (lambda m, x, y: x % 2.0 + (-y) % m.tau, (5.3, 1.2)),
    (lambda m, x, y: m.sin(x) * m.cos(y) + m.tan(x) - m.atan(y), (0.3, -1.2)),
    (lambda m, x, y: m.asin(x) + m.acos(y) * m.sqrt(x), (0.3, -0.6)),
    (lambda m, x, y: m.atan2(y, x) + m.atan2(x, 2.0) - m.atan2(3.0, y), (0.3, -1.2)),
    (lambda m, x, y: m.copysign(x, y) + m.copysign(y, x) * x + m.copysign(2.0, y), (0.3, -1.2)),
    (lambda m, x, y: x * x if x < y else y * x, (0.3, -1.2)),
    (lambda m, x, y: -x * 2.0 if y <= x else y, (0.3, -1.2)),
]


@pytest.mark.parametrize(("formula", "at"), FORMULAS)
def test_a_dual_has_the_value_and_the_slopes_of_its_formula(formula, at):
    x, y = (duals.Dual(value, row) for value, row in zip(at, np.eye(2), strict=True))

    found = formula(duals._MATH, x, y)

    def value(a, b):
        return formula(math, a, b)

    assert found.x == value(*at)
    (a, b) = at
    slopes = [
        (value(a + STEP, b) - value(a - STEP, b)) / (2.0 * STEP),
        (value(a, b + STEP) - value(a, b - STEP)) / (2.0 * STEP),
    ]
    assert found.d == pytest.approx(slopes, abs=TRUNCATED)


def test_a_dual_is_compared_by_its_number_and_has_no_slope_where_there_is_none():
    low, high, same = (duals.Dual(x, np.array([1.0])) for x in (-2.5, 3.0, 3.0))

    assert [low < high, low <= 3.0, high >= same, high > -1.0, high == same, high <= 3] == [
        True
    ] * 6
    assert [low >= high, high < same, high > 3.0, low == -2.0, high <= low] == [False] * 5
    assert (int(low), bool(low), bool(low - low)) == (-2, True, False)
    of = duals._MATH
    ends = [of.asin(x).d[0] for x in (duals.Dual(1.0, low.d), duals.Dual(-1.0, low.d))]
    ends += [of.acos(duals.Dual(1.0, low.d)).d[0], of.sqrt(duals.Dual(0.0, low.d)).d[0]]
    assert ends == [0.0] * 4
    assert of.atan2(duals.Dual(0.0, low.d), duals.Dual(0.0, low.d)).d[0] == 0.0
    assert (of.atan2(1.0, 1.0), of.sin(0.5)) == (math.pi / 4.0, math.sin(0.5))
    assert [of.isnan(x) for x in (duals.Dual(math.nan, low.d), low, math.nan)] == [
        True,
        False,
        True,
    ]
    assert [of.isfinite(x) for x in (duals.Dual(math.inf, low.d), low)] == [False, True]


def test_an_element_of_an_array_of_duals_keeps_its_slopes_and_a_part_shares_them():
    array = duals.DualArray(np.arange(6.0).reshape(2, 3), np.arange(12.0).reshape(2, 2, 3))

    taken, row = array[1, 2], array[1]
    array[1, 2] = duals.Dual(9.0, np.array([7.0, 8.0]))
    array[0, 1] = 4.0

    assert (taken.x, taken.d.tolist()) == (5.0, [5.0, 11.0])
    assert (row.values.tolist(), row.slopes.tolist()) == ([3, 4, 9], [[3, 4, 7], [9, 10, 8]])
    assert array.slopes[:, 0, 1].tolist() == [0.0, 0.0]
    assert (len(array), len(row), row[2].x) == (2, 3, 9.0)


@pytest.mark.slow
def test_parameters_that_are_not_stated_are_nominal_and_what_has_no_effect_has_no_slope():
    made = scenario(duration_s=2.0, **FED_BACK)
    by = ["feedback.phi", *(f"plant.airframe.{x}" for x in ("mass_factor", "cg_aft_m"))]
    by.append("limits.n_z_rate_per_s")  # which is not met
    measures = ["chi.ITAE", "gamma.ITAE"]

    found = ft.gradient(made, by=by, measures=measures)

    fed = chosen_entry(made, None).gains.feedback[0]
    rows = {(row["parameter"], row["measure"]): row for row in found.slopes}
    values = {parameter: row["value"] for (parameter, _), row in rows.items()}
    assert values == dict(zip(by, (fed, 1.0, 0.0, made.limits.n_z_rate_per_s), strict=True))
    assert [(rows[by[-1], x]["slope"], rows[by[-1], x]["why"]) for x in measures] == [(0.0, "")] * 2
    assert all(rows[name, x]["slope"] != 0.0 for name in by[:-1] for x in measures)
    entry = chosen_entry(made, None)
    near = 1e-4
    ends = [
        _value("chi.ITAE", _measured(changed, fly_alone(changed).signals))
        for changed in (_with(entry, by[0], fed + side) for side in (-near, near))
    ]
    expected = (ends[1] - ends[0]) / (2.0 * near)
    assert rows[by[0], "chi.ITAE"]["slope"] == pytest.approx(expected, rel=1e-3)
