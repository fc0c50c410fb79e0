"""Report, recording and campaign state one bound and one verdict about the same flight."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from dispersed import plan_of, uniform

from flighttune.campaign.flying.alone import nominal_flights
from flighttune.campaign.flying.claim import claims
from flighttune.comparison import Source
from flighttune.flight.fly import fly
from flighttune.guarantee.flight_check import flight_check
from flighttune.recording.load import load_recording
from flighttune.recording.record import record
from flighttune.report.facts import facts_of
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


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    """The check of a report and of a flight, and the claim of a campaign."""
    scenario = disturbed()
    flown = fly(scenario)
    files = record(flown, tmp_path_factory.mktemp("flown"), name="flown")
    (recorded,) = load_recording(files.recording.parent).runs
    plan = plan_of(scenario.as_dict(), uniform("flight.chi_deg", 10.0, 30.0), runs=12)
    ((group, claim),) = claims(plan).items()
    with pytest.MonkeyPatch.context() as patched:  # the frontier takes most of a report's time
        patched.setattr("flighttune.report.facts.frontier", lambda *_, **__: pd.DataFrame())
        (check,) = facts_of(Source(name="flown", runs=(recorded,))).checks.values()
    return SimpleNamespace(
        check=check,
        claim=claim,
        outcome=claim.outcome(nominal_flights(plan)[group]),
        flown=flight_check(flown.runs[0]),
    )


def test_bound_and_L_d_of_the_second_half_are_the_same(outputs):
    check, claim = outputs.check.settled[0], outputs.claim

    assert claim.L_d == pytest.approx(check.L_d, rel=SAME)
    assert claim.tube == pytest.approx(check.tube, rel=SAME)
    assert claim.commanded == pytest.approx(check.commanded, rel=SAME)


def test_outcome_and_vacuity_are_the_same(outputs):
    assert outputs.outcome == outputs.check.settled[1]
    assert outputs.claim.vacuous == outputs.check.settled[0].vacuous


def test_the_bound_on_the_way_is_that_of_the_flight_before_it_was_recorded(outputs):
    assert np.array_equal(outputs.flown.bound, outputs.check.bound, equal_nan=True)
    assert np.isfinite(outputs.flown.bound).any()
    assert outputs.flown.t_broken == outputs.check.t_broken
