"""Flights by the compiled step of an aircraft: their tables are those of JSBSim, to the bit."""

from itertools import product

import pytest
from made_up import made_up_scenario

import flighttune as ft

pytest.importorskip("numba")
pytestmark = pytest.mark.slow

TURBULENCE = {"turbulence": {"intensity": "moderate"}}
WIND = {"wind": {"speed_mps": 4.0, "from_deg": 70.0}}
GUST = {"gust": {"axis": "right", "peak_mps": 3.0, "start_s": 1.0, "length_m": 20.0}}
LEVELS = [{"h_m": h, "speed_mps": V, "from_deg": 10.0 + h / 30.0} for h, V in ((0, 3), (2000, 9))]
OFF = {"mass_factor": 1.05, "drag_factor": 1.1, "ixx_factor": 1.1, "actuator_lag_factor": 1.2}
FAULT = {"from_s": 1.007, "throttle_factor": 0.1, "actuator_lag_factor": 4.0}
CASES = {
    "still air": {},
    "wind over height": {"wind": {"level": LEVELS}},
    "navigation": {"navigation": {"grade": "poor"}, "sensors": {"chi_bias_deg": 1.0}} | WIND,
    "turbulence in wind": TURBULENCE | WIND,
    "gust in turbulence": GUST | TURBULENCE,
    "airframe": {"airframe": OFF},
    "fault": {"airframe": {"fault": FAULT}},
    "long samples": {"controller": {"rate_hz": 10.0}},
}
LAWS = {
    "paper": {"law": "paper", "gains": ["paper"]},
    "exact": {"law": "exact", "gains": ["tuned_identified"]},
    "fed back": {"law": "exact", "gains": ["tuned_fed_back"]},
}
AIRCRAFT = {"aerosonde": 25.0, "x8": 18.0, "a4": 190.0, "c172p": 50.0}
IN_TEST = {
    ("aerosonde", "navigation", "fed back"), ("x8", "wind over height", "exact"),
    ("aerosonde", "airframe", "paper"),
}  # fmt: skip


def scenario(aircraft, case, law, **more):
    """A turn and a climb of two seconds."""
    made = dict(CASES[case])
    plant = {"kind": "jsbsim", "aircraft": aircraft}
    plant |= {"airframe": made.pop("airframe")} if "airframe" in made else {}
    limits = {"phi_deg": [-25.0, 25.0], "phi_rate_dps": 10.0, "n_z": [0.7, 1.4]}
    flight = {"V_a_mps": AIRCRAFT[aircraft], "chi_deg": 8.0, "duration_s": 2.0}
    made |= {"reference": {"gamma_deg": 1.0}, "limits": limits | {"n_z_rate_per_s": 0.5}}
    made |= {"flight": flight | more.pop("flight", {}), "tuning": {"identified": aircraft}}
    return made_up_scenario(**made | LAWS[law] | more, plant=[plant])


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """A process that has flown so much that it compiles flights; this one soon hits the ground."""
    dive = {"flight": {"duration_s": 400.0, "h_m": 20.0}, "reference": {"gamma_deg": -20.0}}
    ft.fly(scenario("aerosonde", "still air", "paper", **dive))


def both(monkeypatch, made):
    """The flight by the compiled step, which is equal to that of JSBSim."""
    (run,) = ft.fly(made).runs
    with monkeypatch.context() as by_jsbsim:
        by_jsbsim.setenv("FLIGHTTUNE_JSBSIM", "1")
        (other,) = ft.fly(made).runs
    assert (run.status, run.reason) == (other.status, other.reason)
    assert [*run.signals] == [*other.signals]
    assert run.signals.to_numpy().tobytes() == other.signals.to_numpy().tobytes()
    assert (other.compiled, other.why_jsbsim) == (False, "")
    return run


def cases():
    for (i, aircraft), (j, case), (k, law) in product(*map(enumerate, (AIRCRAFT, CASES, LAWS))):
        row = aircraft, case, law
        if row not in IN_TEST and (i + j + k) % len(LAWS):
            continue
        own = aircraft == "aerosonde" or case in ("still air", "navigation")
        later = pytest.mark.soak if own else pytest.mark.counts
        yield pytest.param(*row, marks=[later] * (row not in IN_TEST))


@pytest.mark.parametrize(("aircraft", "case", "law"), [*cases()])
def test_a_flight_is_that_of_jsbsim(monkeypatch, aircraft, case, law):
    run = both(monkeypatch, scenario(aircraft, case, law))

    assert run.compiled, run.why_jsbsim
    assert run.status == "completed"


def test_a_flight_that_meets_the_ground_is_flown_again_by_jsbsim_which_says_so(monkeypatch):
    dive = {"flight": {"h_m": 20.0, "duration_s": 10.0}, "reference": {"gamma_deg": -20.0}}

    run = both(monkeypatch, scenario("aerosonde", "still air", "exact", **dive))

    assert run.status == "ground_contact"
    assert not run.compiled
    assert "ground" in run.why_jsbsim


@pytest.mark.soak
def test_a_flight_that_leaves_its_envelope_ends_at_the_same_sample(monkeypatch):
    severe = {"turbulence": {"intensity": "severe"}, "seed": 3}
    steep = {"flight": {"duration_s": 100.0, "V_a_mps": 16.0}}

    run = both(monkeypatch, scenario("aerosonde", "still air", "paper", **severe, **steep))

    assert run.status == "left_envelope"
