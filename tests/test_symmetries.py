"""Whole flights have the symmetries of the world: no direction, side or hour is special.

A scenario that is turned about the vertical is flown to the same signals, turned; one that is
mirrored, to mirrored ones; one whose reference begins later, to later ones.
"""

import copy
from functools import cache

import numpy as np
import pytest
from made_up import scenario_tables

import flighttune as ft

pytestmark = pytest.mark.slow


DIGITS = 1e-5
"""Tolerance, as a share of the largest value of a signal: each direction has its own trim."""

NOTHING = 1e-6
"""Numbers of an answer that differ by less are equal."""

SMALL = 0.01
"""Largest value of a signal below which the tolerance does not shrink further."""

TURN = 70.0
"""Degrees by which a scenario is turned."""

LATER = 2.0
"""Seconds by which a reference begins later: a hundred samples."""

LAW = {"kind": "kinematic"}
LAGGED = {"kind": "point_mass_lag", "roll_lag_rad_s": 8.0, "n_z_lag_rad_s": 6.0}
AIRCRAFT = {"kind": "jsbsim", "aircraft": "aerosonde"}
COUPLED = {"name": "coupled", "K_P": [[0.9, 0.15], [-0.1, 1.6]], "K_I": [[0.12, 0.02], [0.03, 0.3]]}
LIMITS = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 30.0, "n_z": [-2.1, 2.1], "n_z_rate_per_s": 1.0}
CORNERS = [(0.0, 0.0, 0.0), (300.0, 60.0, 10.0), (420.0, 380.0, 10.0), (180.0, 480.0, 0.0)]


def turned_by(angle, north, east):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return c * north - s * east, s * north + c * east


def turn_in_wind(plant, *, by=0.0, side=1.0, later=0.0):
    """A climbing turn with coupled gains in wind; an aircraft meets a gust and more wind above."""
    gains = copy.deepcopy(COUPLED)
    for K in (gains["K_P"], gains["K_I"]):  # bank is turned to the other side, load factor is not
        K[0][1] *= side
        K[1][0] *= side
    ramp = {"shape": "ramp", "start_s": 1.0 + later, "duration_s": 6.0, "rate_dps": 8.0 * side}
    step = {"shape": "step", "start_s": 9.0 + later, "change_deg": -25.0 * side}
    climb = {"shape": "step", "start_s": 2.0 + later, "change_deg": 4.0}
    gust = {"axis": "right", "peak_mps": 3.0 * side, "start_s": 5.0 + later, "length_m": 40.0}
    below, above = (by + 250.0 * side) % 360.0, (by + 265.0 * side) % 360.0
    wind = {"speed_mps": 5.0, "from_deg": below}
    of_aircraft = {}
    if plant is AIRCRAFT:  # the others meet neither
        of_aircraft = {"gust": gust}
        levels = (500.0, 5.0, below), (530.0, 8.0, above)
        keys = "h_m", "speed_mps", "from_deg"
        wind = {"level": [dict(zip(keys, level, strict=True)) for level in levels]}
    return scenario_tables(
        **of_aircraft,
        gains=[gains],
        flight={"h_m": 500.0, "chi_deg": by + 20.0 * side, "duration_s": 14.0 + later},
        reference={"chi_deg": [ramp, step], "gamma_deg": [climb]},
        limits=LIMITS,
        controller={"rate_hz": 50.0, "anti_windup": "conditional", "feed_forward": True},
        wind=wind,
        plant=[plant],
    )


def flown(tables):
    (run,) = ft.fly(ft.scenario_from(tables)).runs
    assert run.status == "completed", run.reason
    return run.signals


@cache
def unchanged(flight):
    """Signals of one of `FLIGHTS` to the right in its own direction."""
    made, plant = FLIGHTS[flight]
    return flown(made(plant))


def route(plant, *, by=0.0, side=1.0):
    """Four legs and half a circle in a steady wind."""
    places = [turned_by(by, north, side * east) for north, east, _ in CORNERS]
    waypoints = [
        {"north_m": float(north), "east_m": float(east), "up_m": up}
        for (north, east), (*_, up) in zip(places, CORNERS, strict=True)
    ]
    waypoints[2] |= {"turns": 0.5 * side, "radius_m": 155.0}
    tables = scenario_tables(
        gains=["tuned_fed_back"],
        law="exact",
        flight={"h_m": 500.0, "duration_s": 200.0},
        route={"waypoint": waypoints, "wind_mps": 8.0},
        limits=LIMITS,
        controller={"rate_hz": 50.0, "anti_windup": "conditional", "feed_forward": True},
        wind={"speed_mps": 5.0, "from_deg": (by + 250.0 * side) % 360.0},
        tuning={"identified": "aerosonde"},
        plant=[plant],
    )
    return {key: table for key, table in tables.items() if key != "reference"}


TO_THE_SIDE = {
    *("chi", "phi", "east", "beta", "psi", "p", "r", "n_y", "aileron", "rudder", "wind_east"),
    *("d_chi", "chi_ref", "chi_err", "phi_cmd", "phi_unlimited", "phi_integral"),
    *("cross_track", "chi_dot_cmd", "chi_dot_integral", "chi_dot_unlimited"),
}
"""Signals that change their sign in the mirror; all others are the same on both sides."""


def assert_same(these, those, name):
    these, those = np.asarray(these), np.asarray(those)
    largest = max(np.abs(these).max(), SMALL)
    assert those == pytest.approx(these, rel=0.0, abs=DIGITS * largest), name


FLIGHTS = {
    "law": (turn_in_wind, LAW),
    "lagged": (turn_in_wind, LAGGED),
    "aircraft": (turn_in_wind, AIRCRAFT),
    "route": (route, AIRCRAFT),
}


@pytest.mark.soak
@pytest.mark.parametrize("flight", FLIGHTS)
def test_a_scenario_that_is_turned_is_flown_turned(flight):
    made, plant = FLIGHTS[flight]
    here, there = unchanged(flight), flown(made(plant, by=TURN))

    back = {name: there[name].to_numpy().copy() for name in there}
    for north, east in (("north", "east"), ("wind_north", "wind_east")):
        back[north], back[east] = turned_by(-TURN, back[north], back[east])
    for name in {"chi", "psi", "chi_ref"} & back.keys():
        back[name] -= np.radians(TURN)
        if made is route:  # a course of a route counts from wherever it begins
            back[name] = (
                here[name] + np.remainder(back[name] - here[name] + np.pi, 2 * np.pi) - np.pi
            )
    for name in here:
        assert_same(here[name], back[name], name)


@pytest.mark.soak
@pytest.mark.parametrize("flight", FLIGHTS)
def test_a_scenario_that_is_mirrored_is_flown_mirrored(flight):
    made, plant = FLIGHTS[flight]
    right, left = unchanged(flight), flown(made(plant, side=-1.0))

    assert np.abs(right["phi"]).max() > 0.4
    for name in right:
        assert_same(right[name], left[name] * (-1.0 if name in TO_THE_SIDE else 1.0), name)


@pytest.mark.soak
@pytest.mark.parametrize("flight", ["law", "lagged"])
def test_a_reference_that_begins_later_is_followed_later(flight):
    now, then = unchanged(flight), flown(turn_in_wind(FLIGHTS[flight][1], later=LATER))
    late = then.iloc[len(then) - len(now) :]

    assert len(then) - len(now) == LATER * 50.0
    for name in {*now} - {"north", "east", "down"}:
        assert_same(now[name], late[name], name)
    for name in ("north", "east", "down"):
        assert_same(np.diff(now[name]), np.diff(late[name]), name)


def numbers(value, name=""):
    """All numbers of an answer, by their place in it."""
    if isinstance(value, dict):
        value = value.items()
    elif isinstance(value, list):
        value = enumerate(value)
    elif isinstance(value, float | int):
        return {name: float(value)}
    else:
        return {}
    return {key: x for at, part in value for key, x in numbers(part, f"{name}.{at}").items()}


FEW = {"start_deg": 2.0, "plant": "kinematic", "epsilon": 0.5, "confidence": 0.9, "learn": 10}
VERBS = {
    "certify": (lambda scenario: ft.certify(scenario, "coupled"), LAW),
    "gap": (lambda scenario: ft.gap(scenario, "coupled"), AIRCRAFT),
    "gradient": (
        lambda scenario: ft.gradient(scenario, by=["K_P.phi.chi", "K_I.n_z.gamma"]),
        AIRCRAFT,
    ),
    "band": (lambda scenario: ft.band(scenario, **FEW), LAW),
    "tube": (lambda scenario: ft.tube(scenario, "coupled"), LAW),
}


OTHERS = {"turned": {"by": TURN}, "mirrored": {"side": -1.0}}
CASES = [(verb, other) for verb in VERBS for other in OTHERS]
CASES.remove(("band", "mirrored"))  # its drawn starts are not mirrored


@pytest.mark.soak
@pytest.mark.parametrize(("verb", "other"), CASES)
def test_an_answer_has_the_same_numbers_in_any_direction_and_on_both_sides(verb, other):
    here, there = answered(verb), answered(verb, other)

    assert here.keys() == there.keys()
    assert len(here) > 10
    for name, x in here.items():
        same = pytest.approx(abs(x), rel=DIGITS, abs=NOTHING, nan_ok=True)
        assert abs(there[name]) == same, name


@cache
def answered(verb, other=None):
    """The numbers of an answer without the scenario that was asked about."""
    call, plant = VERBS[verb]
    values = call(ft.scenario_from(asked(verb, plant, **OTHERS.get(other, {})))).answer().values
    return numbers({key: part for key, part in values.items() if key != "scenario"})


def asked(verb, plant, **change):
    """The scenario of a verb: a tube encloses no wind, and takes long for long flights."""
    tables = turn_in_wind(plant, **change)
    if verb == "tube":
        del tables["wind"]
        tables["flight"]["duration_s"] = 3.0
        tables["reference"]["chi_deg"].pop()
    return tables
