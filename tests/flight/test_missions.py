"""The scenario that flies a mission: airspeeds, limits and notes, of an aircraft or lags alone."""

import math

import pytest
from plans import PATROL, item, plan_file

import flighttune as ft
from flighttune.flight import load
from flighttune.routes.mission import read_route
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.identification.file import LogEvidence


def speed(value):
    return item(178, 0, value, -1, 0, 0, 0, 0, frame=2)


@pytest.fixture
def lags(tmp_path):
    """The file of a model, which flies as its lags."""
    ft.loop.load_identified("aerosonde").save(tmp_path / "lags.json")
    return str(tmp_path / "lags.json")


@pytest.fixture
def made(tmp_path):
    """The scenario of some items."""

    def made(*items, aircraft="aerosonde", **changes):
        file = plan_file(tmp_path / "m.plan", *items)
        return load.route_scenario(file, read_route(file), aircraft, changes)

    return made


def test_a_mission_flies_an_aircraft_at_its_identified_airspeed_unless_it_states_one(made):
    first = ft.loop.load_identified("aerosonde").conditions[0]

    plain = made(*PATROL)
    assert (plain.flight.V_a_mps, plain.route.airspeed_assumed) == (first.V_a, True)
    assert plain.flight.duration_s == 10_000.0
    assert (plain.controller.schedule, plain.controller.feed_forward) == (False, True)
    assert plain.route.holds_airspeed is None
    assert (plain.plant[0].kind, plain.plant[0].aircraft) == ("jsbsim", "aerosonde")
    assert load.LAGS_ALONE not in plain.route.notes
    assert (plain.title, plain.gain_names) == ("m", ("exact:tuned_fed_back",))
    assert plain.tuning.identified == "aerosonde"
    assert plain.controller.speed_priority is True
    stated = made(*PATROL[:1], speed(22), *PATROL[1:])
    assert (stated.flight.V_a_mps, stated.route.airspeed_assumed) == (22.0, None)
    chosen = made(*PATROL, **{"flight.V_a_mps": 27.0})
    assert (chosen.flight.V_a_mps, chosen.route.airspeed_assumed) == (27.0, None)


def test_an_aircraft_whose_thrust_holds_the_airspeed_changes_it_with_gains_for_each(made):
    changing = made(*PATROL[:2], speed(31), *PATROL[2:])

    assert changing.route.holds_airspeed is True
    assert changing.controller.schedule is True
    assert changing.flight.V_a_mps == ft.loop.load_identified("aerosonde").conditions[0].V_a
    assert [row.V_mps for row in changing.route.waypoint].count(31.0) == 1
    left = made(*PATROL[:2], speed(31), *PATROL[2:], **{"flight.V_a_mps": 27.0})
    assert (left.route.holds_airspeed, left.controller.schedule) == (None, False)


def test_lags_alone_fly_the_fastest_airspeed_of_a_mission_from_the_start(made, lags):
    items = [*PATROL[:2], speed(31.5), PATROL[2], speed(28.0), PATROL[3]]

    fast = made(*items, aircraft=lags)
    assert (fast.flight.V_a_mps, fast.route.airspeed_assumed) == (31.5, None)
    assert fast.controller.schedule is False
    assert made(*items, aircraft=lags, **{"flight.V_a_mps": 27.0}).flight.V_a_mps == 27.0
    slow = made(*PATROL[:2], speed(16.0), *PATROL[2:], aircraft=lags)
    assert (slow.flight.V_a_mps, slow.route.airspeed_assumed) == (25.0, True)


def test_lags_alone_have_the_limits_of_their_aircraft_and_say_that_they_are_alone(made, lags):
    scenario, own = made(*PATROL, aircraft=lags), load_aircraft("aerosonde").limits

    assert (scenario.plant[0].kind, scenario.plant[0].identified) == ("point_mass_lag", lags)
    assert scenario.limits.phi_deg == pytest.approx([math.degrees(x) for x in own.phi])
    assert scenario.limits.phi_rate_dps == pytest.approx(math.degrees(own.phi_rate))
    assert tuple(scenario.limits.n_z) == tuple(own.n_z)
    assert scenario.limits.n_z_rate_per_s == own.n_z_rate
    assert scenario.route.notes[-1] == load.LAGS_ALONE
    assert scenario.speed_priority is False


def test_lags_of_a_log_have_the_limits_that_it_shows(made, tmp_path):
    intervals = {"phi": (1.0, 2.0), "n_z": (1.0, 2.0)}
    evidence = LogEvidence(
        logs=("a.csv",), assumed=(), frequency_95_rad_s=intervals, delay_95_s=intervals,
        stretches={"phi": 3, "n_z": 4}, phi_deg=(-31.0, 33.0), phi_rate_dps=47.0, n_z=(0.6, 1.7),
        n_z_rate_per_s=0.9,
    )  # fmt: skip
    model = ft.loop.load_identified("aerosonde").model_copy(update={"log": evidence})
    model.save(tmp_path / "of_log.json")

    limits = made(*PATROL, aircraft=str(tmp_path / "of_log.json")).limits

    assert (tuple(limits.phi_deg), limits.phi_rate_dps) == ((-31.0, 33.0), 47.0)
    assert (tuple(limits.n_z), limits.n_z_rate_per_s) == ((0.6, 1.7), 0.9)


def test_an_aircraft_is_a_model_by_the_ending_of_its_file():
    assert [load.is_model(x) for x in ("aerosonde", "m.json", "m.toml")] == [False, True, False]
