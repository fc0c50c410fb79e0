"""Errors of columns are said with what mends them, or why they cannot be told."""

import re

import numpy as np
import pytest
from fuzzing import slow
from log_columns import ERRORS, RIGHT, outer_loop, sampled
from log_files import heavy_cessna
from scipy import constants

import flighttune as ft
from flighttune.logs import checks, relations
from flighttune.logs.relations import STEEP, Motion, _body_rate, _lift

FEW = ("p sign", "n_z without gravity", "V_a in kn", "V_err sign")
MORE = (
    *("phi and theta", "phi and phi_cmd", "n_z and n_z_cmd", "theta as 1/57", "commands 1 s late"),
    *("p is another", "psi rests", "V_a of the ground", "clock times 1.1", "chi magnetic"),
    "psi by 90",
)
UNLIKE = 0.005
"""Less correlation of columns that are apart by a sample of 0.1 s."""
FLIGHTS = {
    "still air": RIGHT["turns and climbs"],
    "wind": RIGHT["wind of 0.4 of the airspeed"],
    "Cessna": lambda: of_run(heavy_cessna(150.0)),
}


def of_run(run):
    """Columns of a simulated flight; its velocity over ground is the slope of its path."""
    names = "phi theta psi p q r n_z V_a north east phi_cmd n_z_cmd h"
    columns = {name: run.signals[name].to_numpy() for name in names.split()}
    over = {"v_north": run.signals["north"], "v_east": run.signals["east"], "v_down": -columns["h"]}
    return {"t_s": run.t, **columns, **{x: np.gradient(y, run.t) for x, y in over.items()}}


@pytest.fixture(scope="session")
def log_of(tmp_path_factory):
    """What is said of a table of a flight at a rate, with a change."""
    flown, path = {}, tmp_path_factory.mktemp("columns") / "flight.csv"

    def said(make, rate, change=lambda _: {}):
        if make not in flown:
            flown[make] = make()
        log = sampled(flown[make], rate)
        log.assign(**change(log)).to_csv(path, index=False)
        return ft.load_log(path).provenance.log

    return said


def check_error(log_of, flight, rate, name):
    change, says = ERRORS[name]

    log = log_of(FLIGHTS[flight], rate, change)

    assert any(re.search(says, line) for line in log["checks"]), log["checks"]


@pytest.mark.parametrize("name", [*FEW, *slow(*MORE)])
@pytest.mark.slow
def test_an_error_of_a_column_is_said_with_its_cure(log_of, name):
    check_error(log_of, "still air", 25, name)


@pytest.mark.soak
@pytest.mark.parametrize("name", [*ERRORS])
def test_every_error_is_said_in_wind(log_of, name):
    check_error(log_of, "wind", 25, name)


NOT_THERE = ("V_err sign", "V_err is another", "phi and psi")
"""On the Cessna: it has no error of speed, and its heading read as roll lies where degrees do."""


@pytest.mark.counts
@pytest.mark.parametrize("rate", [10, 25, 50])
@pytest.mark.parametrize("name", [name for name in ERRORS if name not in NOT_THERE])
@pytest.mark.parametrize("flight", [*FLIGHTS])
def test_every_error_is_said_of_every_flight_at_every_rate(log_of, flight, name, rate):
    check_error(log_of, flight, rate, name)


@pytest.mark.parametrize("flight", ["turns and climbs", *slow("long inverted", "loops in wind")])
def test_a_right_log_is_not_accused(log_of, flight):
    log = log_of(RIGHT[flight], 25)

    assert log["wrong"] == []
    assert any(line.startswith("These agree: ") for line in log["checks"])


@pytest.mark.counts
@pytest.mark.parametrize("rate", [10, 25, 50])
@pytest.mark.parametrize("make", [*RIGHT.values(), FLIGHTS["Cessna"]], ids=[*RIGHT, "Cessna"])
def test_no_right_log_is_accused_at_any_rate(log_of, make, rate):
    assert log_of(make, rate)["wrong"] == []


@pytest.mark.parametrize("course", [0.4, 2.0, -1.0])
def test_a_velocity_that_is_rotated_keeps_its_size_and_turns_clockwise(course):
    given = {"v_north": 20.0 * np.cos([course]), "v_east": 20.0 * np.sin([course])}

    found = checks._rotated(0.7)(given)

    velocity = complex(found["v_north"][0], found["v_east"][0])
    assert velocity == pytest.approx(20.0 * np.exp(1j * (course + 0.7)), rel=1e-12)


@pytest.mark.parametrize("nose", [False, True])
@pytest.mark.parametrize("wind", [(6.0, -3.0), (-2.0, 7.0)])
def test_a_circle_shows_wind_and_unit_of_the_airspeed_with_and_without_a_nose(nose, wind):
    dt, factor, V_a = 0.1, 1.2, 20.0
    psi = 0.1 * dt * np.arange(1200)
    north, east = (
        factor * V_a * part + air
        for part, air in zip((np.cos(psi), np.sin(psi)), wind, strict=True)
    )
    given = {"phi": 0.2 + 0.0 * psi, "V_a": V_a + 0.0 * psi, "v_north": north, "v_east": east}
    given |= {"psi": np.angle(np.exp(1j * psi))} if nose else {}

    found = relations.wind_triangle(relations.Motion(given, dt))

    assert not isinstance(found, str)
    # A mean over 1.1 s shortens an arc of 0.1 rad/s by 0.05 %.
    assert found[0] == pytest.approx(factor, rel=1e-3)
    assert found[1] == pytest.approx(wind, abs=0.01)


@pytest.mark.parametrize(
    ("factor", "told"), [(0.51, False), (0.9, True), (1.2, True), (1.94, False)]
)
def test_a_wind_is_compared_only_where_airspeeds_are_nearly_those_over_ground(factor, told):
    dt, V_a, wind = 0.1, 20.0, (6.0, -3.0)
    psi = 0.1 * dt * np.arange(1200)
    given = {"phi": 0.2 + 0.0 * psi, "V_a": V_a + 0.0 * psi, "psi": np.angle(np.exp(1j * psi))}
    for name, part, air in zip(("north", "east"), (np.cos(psi), np.sin(psi)), wind, strict=True):
        given |= {f"v_{name}": factor * V_a * part + air, f"wind_{name}": air + 0.0 * psi}

    found = relations._wind(relations.Motion(given, dt))

    assert isinstance(found, str) != told
    if told:
        assert found[1] == pytest.approx(np.tile(wind, (1200, 1)), abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["phi and phi_cmd", "n_z and n_z_cmd"])
def test_a_command_in_the_place_of_its_response_is_not_identified(tmp_path, log_of, name):
    log = sampled(FLIGHTS["still air"](), 25)
    log.assign(**ERRORS[name][0](log)).to_csv(tmp_path / "flight.csv", index=False)

    with pytest.raises(ft.InputError, match="exchanged would do"):
        ft.identify(tmp_path / "flight.csv")


@pytest.mark.slow
def test_a_flight_that_is_inverted_for_most_of_its_time_is_identified_or_said_why(tmp_path):
    """It has no commands, which is the reason, and no other."""
    sampled(RIGHT["long inverted"](), 25).to_csv(tmp_path / "flight.csv", index=False)

    found = ft.identify(tmp_path / "flight.csv")

    assert "no roll commands" in str(found.answer().failure)


def test_any_columns_are_judged_whatever_they_hold():
    """Subsets of columns at random sizes, with gaps, zeros, drifts and nothing at all."""
    random = np.random.default_rng(1)
    for _ in range(40):
        t = random.choice([0.02, 0.1, 0.2]) * np.arange(random.integers(200, 800))
        columns = {"phi": random.standard_normal(len(t))}
        for name in (name for name in relations.KIND if name != "phi" and random.random() < 0.5):
            column = 10.0 ** random.integers(-3, 8) * random.standard_normal(len(t))
            gaps = np.where(random.random(len(t)) < 0.3, np.nan, column)
            kinds = [column, gaps, 0.0 * column, np.nan * column, np.cumsum(column)]
            columns[name] = kinds[random.integers(len(kinds))]

        values, _, _ = checks.checked(columns, t, {})

        assert set(columns) <= set(values)


@pytest.mark.parametrize(
    ("V_a", "V_g", "same"),
    [
        (20.0, 20.0, True),
        (20.0, 21.0, False),
        (21.0, 20.0, False),
        (0.5, 0.5, False),  # it stands on the ground all the time
    ],
)
def test_an_airspeed_is_copied_where_it_is_the_ground_speed_in_flight(V_a, V_g, same):
    t = np.arange(400.0)
    on_ground = t < 100.0
    columns = {"phi": 0.0 * t, "chi": 0.0 * t, "V_g": np.where(on_ground, 0.4, V_g)}
    columns["V_a"] = np.where(on_ground, 0.9, V_a)

    assert relations.copied(relations.Motion(columns, 0.1)) == same


@pytest.mark.parametrize("heading", [True, False])
def test_pitch_rates_of_a_steep_climb_are_judged_by_a_heading_alone(heading):
    """A pull-up at 0.1 rad/s without a turn; a course says nothing of a path steeper than STEEP."""
    dt, theta = 0.1, 0.01 * np.arange(150)
    columns = {
        "phi": 0.0 * theta,
        "theta": theta,
        "p": 0.0 * theta,
        "q": 0.1 + 0.0 * theta,
        "r": 0.0 * theta,
        "v_north": 25.0 * np.cos(theta),
        "v_east": 0.0 * theta,
        "v_down": -25.0 * np.sin(theta),
    } | ({"psi": 0.0 * theta} if heading else {})

    given, expected = _body_rate(1)(Motion(columns, dt))

    judged = np.ones(len(theta), bool) if heading else np.cos(theta) > STEEP + 0.01
    judged[[0, -1]] = False
    assert expected[judged] == pytest.approx(given[judged], rel=1e-3)
    assert np.isnan(expected[np.cos(theta) < STEEP - 0.01]).all() == (not heading)


def test_units_that_are_mistaken_have_the_factors_of_their_definitions():
    units = {"kn": constants.knot, "km/h": constants.kmh, "ft/s": constants.foot}
    units |= {"cm/s": constants.centi, "mph": constants.mph}
    lengths = {"ft": constants.foot, "cm": constants.centi, "mm": constants.milli, "km": 1000.0}

    speeds = {f"{unit} read as m/s": pytest.approx(size) for unit, size in units.items()}
    assert speeds == checks.MISTAKEN["speed"] == checks.MISTAKEN["wind"]
    read = {f"{unit} read as m": pytest.approx(size) for unit, size in lengths.items()}
    assert checks.MISTAKEN["length"] == read
    for kind in ("angle", "rate"):
        assert checks.MISTAKEN[kind] == {"deg read as rad": pytest.approx(constants.degree)}


@pytest.mark.parametrize(
    ("columns", "by", "as_alike"),
    [("pqr", 1, False), (("v_north", "v_east", "v_down"), 1, False), (("phi_cmd",), -3, True)],
)
def test_columns_of_motion_are_alike_at_their_time_and_commands_at_their_delay(
    columns, by, as_alike
):
    given = {name: column[::10].copy() for name, column in outer_loop(60.0, seed=1).items()}
    del given["t_s"]

    right, moved = (
        checks._Judgement(x, 0.1).likeness for x in (given, checks._moved(columns, by)(given))
    )

    assert (abs(moved - right) < UNLIKE) == as_alike
    assert moved < right + UNLIKE


@pytest.mark.parametrize(("theta", "load"), [({}, 2.0), ({"theta": 30.0}, 4.0 / 3.0**0.5)])
def test_without_a_velocity_the_load_factor_is_that_which_carries_the_weight(theta, load):
    """At 60 deg of roll the lift is twice the weight, and more where its axis is pitched."""
    angles = {"phi": 60.0, **theta}
    given = {name: np.full(50, np.radians(angle)) for name, angle in angles.items()}

    lift = _lift(Motion({**given, "V_a": np.full(50, 25.0)}, 0.1))

    assert lift == pytest.approx(np.full(50, load))
