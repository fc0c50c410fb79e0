"""Flights by the compiled step of an aircraft: their tables are those of JSBSim, to the bit."""

from copy import deepcopy
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import jsbsim
import numpy as np
import pandas as pd
import pytest
from airframes import fdm_of

import flighttune as ft
from flighttune.base.arrays import same_bits
from flighttune.base.files.code import JSBSIM
from flighttune.base.units import FT
from flighttune.flight.conditions import start_condition, weather_of
from flighttune.flight.fly import plant_of
from flighttune.flight.loop import aircraft, compiled, loop
from flighttune.flight.loop.aircraft import CompiledAircraft
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.compiled import face, motion
from flighttune.vehicles.compiled.face import compiled as compiled_step

pytest.importorskip("numba")

TURBULENCE = {"turbulence": {"intensity": "moderate"}}
WIND = {"wind": {"speed_mps": 4.0, "from_deg": 70.0}}
LEVELS = [(900.0, 3.0, 10.0), (1000.0, 5.0, 40.0), (1100.0, 6.0, 60.0)]
SHEAR = {
    "wind": {"level": [dict(zip(("h_m", "speed_mps", "from_deg"), x, strict=True)) for x in LEVELS]}
}
OSCILLATION = {
    "chi_amplitude": 0.03, "chi_omega_rad_s": 0.5,
    "gamma_amplitude": 0.02, "gamma_omega_rad_s": 0.4, "as_wind": True,
}  # fmt: skip
GUST = {"axis": "right", "peak_mps": 3.0, "start_s": 1.0, "length_m": 20.0}
AIRFRAME = {
    "mass_factor": 1.05, "cg_aft_m": 0.004, "lift_factor": 0.97, "drag_factor": 1.1,
    "pitch_moment_factor": 1.05, "actuator_lag_factor": 1.2, "thrust_factor": 0.9,
    "ixx_factor": 1.1, "coefficient_factors": {"Cm_alpha": 1.1},
}  # fmt: skip


def fault(**of):
    """Keys of an aircraft on which something fails after a second."""
    return {"plant": {"airframe": {"fault": {"from_s": 1.0} | of}}}


def tables(name="exact_law", *, aircraft="aerosonde", duration_s=4.0, plant=None, **changes):
    """A shipped scenario on one aircraft, shortened."""
    made = ft.load_scenario(name).as_dict()
    made["plant"] = [{"kind": "jsbsim", "aircraft": aircraft, **(plant or {})}]
    made["expect"] = []
    made["flight"] |= {"duration_s": duration_s, **changes.pop("flight", {})}
    made["controller"] |= changes.pop("controller", {})
    return made | changes


def flown(monkeypatch, made):
    """The runs by the compiled step and by JSBSim, and why any was refused."""
    started, start = [], CompiledAircraft.start

    def noted(self, condition):
        start(self, condition)
        started.append(self)

    monkeypatch.setattr(CompiledAircraft, "start", noted)
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    compiled = ft.fly(ft.scenario_from(made)).runs
    monkeypatch.setenv(JSBSIM, "1")
    by_jsbsim = ft.fly(ft.scenario_from(made)).runs
    return compiled, by_jsbsim, started


def assert_same(compiled, by_jsbsim):
    for first, second in zip(compiled, by_jsbsim, strict=True):
        assert (first.status, first.reason) == (second.status, second.reason)
        pd.testing.assert_frame_equal(first.signals, second.signals, check_exact=True)
        assert same_bits(*(x.signals.to_numpy(dtype=float) for x in (first, second))).all()


CASES = {
    "still air": {},
    "turbulence": TURBULENCE,
    "first-order turbulence": {"turbulence": {"intensity": "light", "model": "milspec"}},
    "turbulence in wind": TURBULENCE | WIND,
    "gust": {"gust": GUST},
    "gust in turbulence": {"gust": GUST} | TURBULENCE,
    "wind over height": SHEAR,
    "wind that oscillates": {"disturbance": OSCILLATION},
    "path through the air": {"disturbance": OSCILLATION | {"path": "air"}},
    "sensors": {"sensors": {"chi_noise_sd_deg": 0.5, "V_a_noise_sd_mps": 0.3, "chi_bias_deg": 1.0}},
    "navigation": {"navigation": {"grade": "poor"}, "sensors": {"chi_bias_deg": 1.0}} | WIND,
    "airframe": {"plant": {"airframe": AIRFRAME}},
    "throttle fails": {"plant": {"throttle_max": 0.2, "throttle_max_from_s": 1.0}},
    "actuators slow down": fault(actuator_lag_factor=4.0),
    "rudder stuck": fault(rudder_stuck_deg=2.0),
    "engine fails between two samples": fault(throttle_factor=0.1, from_s=1.007),
    "long samples": {"controller": {"rate_hz": 10.0}},
    "ground": {"flight": {"ground_m": 400.0}},
    "near the ground": {"flight": {"h_m": 425.0, "ground_m": 400.0}} | TURBULENCE,
}  # fmt: skip


LAWS = {
    "paper": {"law": ["paper"], "gains": ["paper"]},
    "exact": {"law": ["exact"], "gains": ["tuned_identified"]},
    "fed back": {"law": ["exact"], "gains": ["tuned_fed_back"]},
}


# A gentle turn that every aircraft flies at its own airspeed
TURN = {"reference": {"chi_deg": 0.0, "gamma_deg": 1.0},
        "limits": {"phi_deg": [-25.0, 25.0], "phi_rate_dps": 10.0, "n_z": [0.7, 1.4],
                   "n_z_rate_per_s": 0.5}}  # fmt: skip


def turning(aircraft, case):
    """A case of the turn on another aircraft, which has no coefficient of the Aerosonde's name."""
    design, changes = load_aircraft(aircraft).design, deepcopy(CASES[case])
    airframe = changes.get("plant", {}).get("airframe", {})
    airframe.pop("coefficient_factors", None)
    if aircraft == "x8":  # it has no rudder
        airframe.get("fault", {}).pop("rudder_stuck_deg", None)
    start = {"V_a_mps": design.V_a, "h_m": design.h, "chi_deg": 8.0, "gamma_deg": 0.0}
    flight = start | changes.pop("flight", {})
    return TURN | changes | {"aircraft": str(aircraft), "flight": flight}


def assert_compiled(monkeypatch, made):
    compiled, by_jsbsim, started = flown(monkeypatch, made)

    assert [plane.refused for plane in started if plane.compiles] == [""] * len(compiled)
    assert all(run.compiled for run in compiled)
    assert_same(compiled, by_jsbsim)
    assert all(len(run.signals) > 20 for run in compiled)
    assert all(np.isfinite(run.signals.to_numpy()).all() for run in compiled)


@pytest.mark.slow
def test_a_flight_four_metres_above_the_ground_is_that_of_jsbsim(monkeypatch):
    low = {"flight": {"h_m": 404.0, "ground_m": 400.0}}

    assert_compiled(monkeypatch, tables(**low, **LAWS["exact"]))


SHIPPED = ("aerosonde", "x8", "a4", "c172p")
IN_TEST = {("x8", "turbulence in wind"), ("a4", "gust"), ("c172p", "sensors")}

# Cases whose step or start is compiled for them alone, and those of `make soak` among them.
COMPILED_ALONE = {
    "turbulence", "first-order turbulence", "turbulence in wind", "gust", "gust in turbulence",
    "airframe", "actuators slow down", "rudder stuck", "engine fails between two samples",
    "long samples", "ground", "near the ground",
}  # fmt: skip
IN_SOAK = {("x8", "airframe"), ("a4", "rudder stuck"), ("c172p", "near the ground")}


def cases_and_laws():
    """Each aircraft in each case with one of the laws, and each law in each third case.

    The Aerosonde flies its other laws in `make soak`. The others fly theirs, and cases that are
    compiled for them alone, in `make counts`.
    """
    for (i, name), (j, case), (k, law) in product(*map(enumerate, (SHIPPED, CASES, LAWS))):
        own, chosen = name == "aerosonde", (i + j + k) % len(LAWS) == 0
        in_test = chosen and (own or (name, case) in IN_TEST)
        in_soak = own or (chosen and (case not in COMPILED_ALONE or (name, case) in IN_SOAK))
        later = pytest.mark.soak if in_soak else pytest.mark.counts
        yield pytest.param(name, case, law, marks=pytest.mark.slow if in_test else later)


@pytest.mark.parametrize(("name", "case", "law"), [*cases_and_laws()])
def test_a_flight_is_that_of_jsbsim(monkeypatch, name, case, law):
    made = CASES[case] if name == "aerosonde" else turning(name, case)

    assert_compiled(monkeypatch, tables(**made, **LAWS[law]))


ADOPTED = Path(__file__).parents[2] / "adopted"

# A jet with the step of still air, which test_aircraft.py has compiled; the others are flown in
# `make counts`.
ONE = "T38", "navigation"


@pytest.mark.parametrize(
    ("aircraft", "case"),
    [
        pytest.param(*x, marks=pytest.mark.soak if x == ONE else pytest.mark.counts)
        for x in product(
            ["J3Cub", "T38", "B747", "DHC6"],
            ["wind over height", "navigation", "turbulence in wind", "gust", "actuators slow down"],
        )
    ],
)
def test_so_is_that_of_adopted_ones(monkeypatch, aircraft, case):
    assert_compiled(monkeypatch, tables(**turning(ADOPTED / aircraft, case), **LAWS["exact"]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "starts"),
    [
        ({"reference": {"chi_deg": 20.0, "gamma_deg": 0.0}}, 1),
        ({"seed": 2}, 2),
        ({"flight": {"V_a_mps": 26.0}}, 2),
        ({"wind": {"speed_mps": 4.0, "from_deg": 71.0}}, 2),
        ({"plant": {"airframe": {"mass_factor": 1.01}}}, 2),
        ({"turbulence": {"intensity": "moderate", "model": "milspec"}}, 2),
    ],
    ids=["reference", "seed", "airspeed", "wind", "mass", "turbulence"],
)
def test_flights_that_begin_alike_are_started_once(monkeypatch, change, starts):
    started, start = [], CompiledAircraft._compiled_start
    monkeypatch.setattr(
        CompiledAircraft, "_compiled_start", lambda *x: started.append(x) or start(*x)
    )
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    aircraft._kept_start.cache_clear()
    cases = [tables(duration_s=1.0, **TURBULENCE, **WIND, **LAWS["exact"])]
    cases.append(tables(duration_s=1.0, **{**TURBULENCE, **WIND, **LAWS["exact"], **change}))
    flights = [ft.fly(ft.scenario_from(case)).runs for case in (*cases, *cases)]

    assert len(started) == starts
    assert_same(flights[0], flights[2])
    monkeypatch.setenv(JSBSIM, "1")
    assert_same(flights[3], ft.fly(ft.scenario_from(cases[1])).runs)


@pytest.mark.slow
def test_a_flight_that_leaves_its_envelope_ends_at_the_same_sample(monkeypatch):
    severe = {"turbulence": {"intensity": "severe"}, "seed": 3}
    made = tables(duration_s=100.0, **severe)

    compiled, by_jsbsim, _ = flown(monkeypatch, made)

    assert {run.status for run in by_jsbsim} == {"left_envelope"}
    assert_same(compiled, by_jsbsim)


def test_a_flight_whose_hidden_start_is_not_found_is_flown_by_jsbsim(monkeypatch):
    compiled_step(load_aircraft("aerosonde"))  # its check flight starts, too
    monkeypatch.setattr(motion, "AT_START", np.eye(3).tolist())
    monkeypatch.setattr(face, "evaluated", lambda *_, **__: None)  # JSBSim starts

    compiled, by_jsbsim, _ = flown(monkeypatch, tables(duration_s=1.0))

    assert {run.why_jsbsim for run in compiled} == {
        "its loop does not know the attitude at this start"
    }
    assert_same(compiled, by_jsbsim)


@pytest.mark.slow
def test_a_flight_that_comes_near_the_ground_is_that_of_jsbsim(monkeypatch):
    dive = {"flight": {"h_m": 70.0}, "reference": {"chi_deg": 20.0, "gamma_deg": -30.0}}
    compiled, by_jsbsim, _ = flown(monkeypatch, tables(duration_s=20.0, **dive))

    assert {run.status for run in by_jsbsim} == {"ground_contact"}
    assert {run.why_jsbsim for run in compiled} == {"flights near the ground are not compiled"}
    assert {run.why_jsbsim for run in by_jsbsim} == {""}
    assert_same(compiled, by_jsbsim)


def test_other_laws_are_flown_by_jsbsim_which_says_so(monkeypatch):
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    made = ft.scenario_from(tables(duration_s=1.0) | {"law": ["paper"], "gains": ["paper"]})

    class Own(ft.loop.MimoPI):
        """A law that may do something else."""

    def law(setup):
        return Own(setup.gains, setup.limits, dt=setup.dt)

    flown = ft.fly(made, laws={"mine": law})

    reason = "laws other than the paper's and the exact one are not compiled"
    assert [run.why_jsbsim for run in flown.runs] == ["", reason]
    assert f"{flown.runs[1].label}: flown by JSBSim itself: {reason}." in flown.answer().notes


def test_an_aircraft_reaches_as_far_down_as_its_farthest_contact_is_from_its_centre_of_gravity():
    """The contacts of the c172p in its file, in inches; the reach is in feet."""
    file = Path(jsbsim.get_default_root_dir()) / "aircraft/c172p/c172p.xml"
    places = ElementTree.parse(file).findall("ground_reactions/contact/location")
    contacts = [[float(place.findtext(axis)) for axis in "xyz"] for place in places]
    fdm = fdm_of("c172p")
    fdm.evaluate()
    cg = [fdm.reader(f"inertia/cg-{axis}-in")() for axis in "xyz"]

    expected = np.linalg.norm(np.array(contacts) - cg, axis=1).max() / 12.0
    assert aircraft._lowest_reach(fdm) == pytest.approx(expected, rel=1e-9)


BY_AIR = {"disturbance": OSCILLATION | {"path": "air"}}  # which is steered sample by sample


ONE_BY_ONE = {
    "through the air with feedback": BY_AIR | LAWS["fed back"],
    "an airspeed and sensors": LAWS["exact"] | {
        "reference": {"chi_deg": 30.0, "gamma_deg": 20.0, "V_mps": 25.0},
        "limits": {"n_x": [-0.3, 0.3]}, "navigation": {"grade": "poor"},
    },
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", ONE_BY_ONE)
def test_samples_that_are_flown_one_by_one_are_those_of_jsbsim(monkeypatch, case):
    assert_compiled(monkeypatch, tables(duration_s=2.0, **ONE_BY_ONE[case]))


@pytest.mark.slow
def test_a_path_through_the_air_that_meets_the_ground_is_flown_again_by_jsbsim(monkeypatch):
    dive = {"flight": {"h_m": 30.0}, "reference": {"chi_deg": 20.0, "gamma_deg": -30.0}}
    compiled, by_jsbsim, _ = flown(monkeypatch, tables(duration_s=20.0, **BY_AIR, **dive))

    assert {run.status for run in by_jsbsim} == {"ground_contact"}
    assert {run.why_jsbsim for run in compiled} == {"flights near the ground are not compiled"}
    assert_same(compiled, by_jsbsim)


def test_a_command_that_is_no_number_is_left_to_jsbsim():
    condition = ft.loop.FlightCondition(V_a=25.0, h=1000.0)
    plant = ft.loop.JSBSimPlant("aerosonde")
    plane = CompiledAircraft(ft.loop.JSBSimPlant("aerosonde"))
    plane.compiles = True

    stops = []
    for each in (plant, plane):
        each.start(condition)
        for k in range(5):
            each.observe()
            assert each.advance(0.05 * k, 1.1, 0.02) is None
        assert each is plant or each.compiled
        stops.append(each.advance(np.nan, 1.1, 0.02))

    assert not plane.compiled
    assert plane.refused == aircraft.NOT_FINITE
    assert stops[0] == stops[1]
    np.testing.assert_array_equal(plane.observe(), plant.observe())


@pytest.mark.parametrize("h", [500.0, 900.0, 950.0, 1000.0, 1090.0, 1100.0, 1500.0])
def test_the_wind_of_compiled_steps_is_that_of_the_weather_at_every_height(h):
    """Beyond the levels that of the nearest one."""
    own = {"as_wind": True, "chi_amplitude": 0.1, "chi_omega_rad_s": 0.5,
           "gamma_amplitude": 0.07, "gamma_omega_rad_s": 0.4}  # fmt: skip
    scenario = ft.scenario_from(tables(**SHEAR, disturbance=own))
    plane = plant_of(scenario.plant[0], scenario, compiled=True)
    plane.compiles = True
    plane.start(start_condition(scenario))
    _, motion = plane.sampled(0.02)

    found = [compiled._wind_at(motion, t, h / FT) for t in (0.0, 3.7, 11.0)]

    weather = weather_of(scenario)
    expected = [np.divide(weather.deterministic(t, h), FT) for t in (0.0, 3.7, 11.0)]
    assert np.array(found) == pytest.approx(np.array(expected), abs=1e-9)
