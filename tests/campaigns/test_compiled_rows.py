"""Compiled flights of a campaign: those that decide are flown by JSBSim too, and compared."""

import pytest

import flighttune as ft
from flighttune.campaigns.flying import rows
from flighttune.flight.loop import aircraft, loop

pytest.importorskip("numba")


def plan_of(settling_s):
    """Two flights whose settling time is bounded."""
    nominal = ft.load_scenario("exact_law").as_dict()
    nominal |= {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}], "law": ["exact"]}
    nominal["flight"]["duration_s"] = 10.0
    nominal["expect"] = [{"at_most": {"chi": {"settling_s": settling_s}}}]
    table = {
        "title": "compiled", "scenario": "exact_law", "seed": 1, "runs": 2,
        "disperse": [{"key": "flight.V_a_mps", "distribution": "uniform",
                      "lower": 24.0, "upper": 26.0}],
    }  # fmt: skip
    from flighttune.campaigns.planning.plan import plan_campaign
    from flighttune.campaigns.planning.schema import Campaign, CampaignTable

    scenario = ft.scenario_from(nominal)
    checked = CampaignTable.model_validate(table)
    return plan_campaign(Campaign.of(checked, nominal=scenario, central=scenario))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settling_s", "again"), [(9.9, [0]), (0.5, [0, 1])], ids=["far inside", "outside"]
)
def test_flights_that_decide_and_one_in_a_hundred_are_flown_again(monkeypatch, settling_s, again):
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    checked, check = [], rows.check_compiled
    monkeypatch.setattr(rows, "check_compiled", lambda *x: checked.append(x) or check(*x))

    for run in range(2):
        rows.fly_runs(plan_of(settling_s), [run])

    assert len(checked) == len(again)


@pytest.mark.slow
def test_a_wrong_number_of_the_compiled_step_ends_the_run(monkeypatch):
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    made = aircraft.motion_of

    def wrong(*given):
        motion = made(*given)
        motion.states[:] *= 1.0 + 1e-12
        return motion

    monkeypatch.setattr(aircraft, "motion_of", wrong)
    (row,) = rows.fly_runs(plan_of(9.9), [0]).to_pylist()

    assert row["status"] == "invalid"
    assert "must be that of JSBSim" in row["reason"]


@pytest.mark.slow
def test_refly_flies_jsbsim_itself(monkeypatch):
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    made = ft.load_scenario("exact_law").as_dict()
    made |= {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}], "law": ["exact"]}
    made["flight"]["duration_s"] = 1.0
    runs = ft.fly(ft.scenario_from(made)).runs

    def refused(*_):
        raise AssertionError("a compiled step flies")

    monkeypatch.setattr(aircraft, "motion_of", refused)

    assert all(run.compiled for run in runs)
    assert ft.refly(runs).equal
