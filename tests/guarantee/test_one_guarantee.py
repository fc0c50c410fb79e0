"""Report, recording and campaign state one bound and one verdict about the same flight."""

import numpy as np
import pytest
from dispersed import plan_of, uniform

from flighttune.campaign.flying.alone import nominal_flights
from flighttune.campaign.flying.claim import claims
from flighttune.flight.fly import fly
from flighttune.guarantee.flight_check import flight_check
from flighttune.recording.parquet import load_recording
from flighttune.recording.record import record
from flighttune.scenario import load_scenario, scenario_from

pytestmark = pytest.mark.slow

SAME = 1e-12


def disturbed():
    """Eight seconds of the paper's manoeuvre with its gains on a disturbed law."""
    whole = load_scenario("paper").as_dict()
    flight = whole["flight"] | {"duration_s": 8.0}
    swing = {"chi_amplitude": 0.03, "chi_omega_rad_s": 0.8}
    plant = {"disturbance": swing, "gains": ["paper"], "plant": [{"kind": "kinematic"}]}
    return scenario_from({**whole, "flight": flight, "expect": [], **plant})


def test_report_recording_and_campaign_state_one_bound_and_one_verdict(tmp_path):
    scenario = disturbed()
    flown = fly(scenario)
    files = record(flown, tmp_path, name="flown")
    (recorded,) = load_recording(files.recording.parent).runs
    plan = plan_of(scenario.as_dict(), uniform("flight.chi_deg", 10.0, 30.0), runs=12)

    ((group, claim),) = claims(plan).items()
    check, before = flight_check(recorded), flight_check(flown.runs[0])

    settled, outcome = check.settled
    for name in ("L_d", "tube", "commanded", "vacuous"):
        assert getattr(claim, name) == pytest.approx(getattr(settled, name), rel=SAME)
    assert claim.outcome(nominal_flights(plan)[group]) == outcome
    assert np.array_equal(before.bound, check.bound, equal_nan=True)
    assert np.isfinite(before.bound).any()
    assert before.t_broken == check.t_broken
