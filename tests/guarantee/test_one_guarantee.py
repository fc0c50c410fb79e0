"""Gap, report and campaign state one bound and one verdict about the same flight."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from dispersed import plan_of, uniform

from flighttune.campaign.flying.alone import nominal_flights
from flighttune.campaign.flying.claim import claims
from flighttune.comparison import Source
from flighttune.flight.fly import fly
from flighttune.flight.gap import explain_gap
from flighttune.guarantee.flight_check import flight_check
from flighttune.recording.load import load_recording
from flighttune.recording.record import record
from flighttune.report.facts import facts_of
from flighttune.report.gap_tables import check_table, gap_values
from flighttune.scenario import load_scenario, scenario_from

pytestmark = pytest.mark.slow

SAME = 1e-12


def short(name, **tables):
    """Eight seconds of a shipped scenario with the paper's gains, on the law and the aerosonde."""
    whole = load_scenario(name).as_dict()
    flight = whole["flight"] | {"duration_s": 8.0}
    plant = [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}]
    return scenario_from(
        {**whole, "flight": flight, "gains": ["paper"], "plant": plant, "expect": [], **tables}
    )


@pytest.fixture(
    scope="module",
    params=[{}, {"tuning": {"model": "identified"}}],
    ids=["tuned on the law", "tuned on the identified model"],
)
def outputs(request, tmp_path_factory):
    """What gap, report and campaign say of one flight, in words and numbers."""
    scenario = short("paper", **request.param)
    flown = fly(scenario)
    run = flown.runs[-1]
    files = record(flown, tmp_path_factory.mktemp("flown"), name="flown")
    recorded = load_recording(files.recording.parent).runs
    plan = plan_of(scenario.as_dict(), uniform("flight.chi_deg", 10.0, 30.0), runs=12)
    group = next(one for one in plan.groups if one.plant == run.provenance.plant)
    claim, nominal = claims(plan)[group], nominal_flights(plan)[group]
    with pytest.MonkeyPatch.context() as patched:  # the frontier takes most of a report's time
        patched.setattr("flighttune.report.facts.frontier", lambda *_, **__: pd.DataFrame())
        facts = facts_of(Source(name="flown", runs=recorded))
    gap = explain_gap(scenario, run.provenance.gains, name="paper")
    return SimpleNamespace(
        gap=gap_values(gap, {})["mismatch"],
        check=facts.checks[run.label],
        report={record["check"]: record for record in check_table(facts.gaps).records},
        claim=claim,
        outcome=claim.outcome(nominal),
        way=(gap.check, facts.gaps[0].check, flight_check(recorded[-1])),
    )


def test_bound_and_L_d_of_the_second_half_are_the_same_in_all_three(outputs):
    gap, check, claim = outputs.gap["settled"], outputs.check.settled.claim, outputs.claim

    assert claim.L_d == gap["L_d"] == pytest.approx(check.L_d, rel=SAME)
    assert claim.radius == gap["radius"] == pytest.approx(check.radius, rel=SAME)
    assert claim.tube == tuple(gap["tube_rad"].values()) == pytest.approx(check.tube, rel=SAME)
    assert claim.commanded == pytest.approx(gap["asked_rad"], rel=SAME)
    assert outputs.report["ultimate set, second half"]["L_d"] == pytest.approx(claim.L_d, rel=SAME)


def test_outcome_and_vacuity_are_the_same_in_all_three(outputs):
    gap = outputs.gap["settled"]

    assert outputs.outcome == outputs.check.settled.outcome
    assert gap["held"] == (outputs.outcome == "held")
    assert outputs.claim.vacuous == gap["says_nothing"] == outputs.check.settled.claim.vacuous
    assert gap["sentence"] == outputs.check.settled.sentence
    assert gap["sentence"] == outputs.report["ultimate set, second half"]["sentence"]
    whole = outputs.report["ultimate set, whole flight"]
    assert outputs.gap["verdict"]["sentence"] == whole["sentence"]


def test_the_bound_on_the_way_is_the_same_in_gap_report_and_recording(outputs):
    gap, report, recording = outputs.way

    assert np.array_equal(gap.bound, report.bound, equal_nan=True)
    assert np.array_equal(gap.bound, recording.bound, equal_nan=True)
    assert np.isfinite(gap.bound).any()
    assert gap.t_broken == report.t_broken == recording.t_broken
    approach = outputs.gap["approach"]
    assert (approach["held"], approach["t_broken"]) == (gap.t_broken is None, gap.t_broken)
