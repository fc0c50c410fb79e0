"""Compiled flights of a campaign: those that decide are flown by JSBSim too, and compared."""

import pytest
from dispersed import plan_of, uniform

import flighttune as ft
from flighttune.campaigns.flying import rows
from flighttune.flight.loop import aircraft, loop

pytest.importorskip("numba")


def bounded(settling_s):
    """Two flights whose settling time is bounded."""
    nominal = ft.load_scenario("exact_law").as_dict()
    nominal |= {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}], "law": ["exact"]}
    nominal["flight"]["duration_s"] = 10.0
    nominal["expect"] = [{"at_most": {"chi": {"settling_s": settling_s}}}]
    return plan_of(nominal, uniform("flight.V_a_mps", 24.0, 26.0), runs=2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settling_s", "again"), [(9.9, [0]), (0.5, [0, 1])], ids=["far inside", "outside"]
)
def test_flights_that_decide_and_one_in_a_hundred_are_flown_again(monkeypatch, settling_s, again):
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    checked, check = [], rows.check_compiled
    monkeypatch.setattr(rows, "check_compiled", lambda *x, **o: checked.append(x) or check(*x, **o))

    for run in range(2):
        rows.fly_runs(bounded(settling_s), [run])

    assert len(checked) == len(again)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "differ"), [(lambda x: -x, 0), (lambda x: x + 5e-324, 1)], ids=["sign", "value"]
)
def test_a_row_flown_again_may_have_a_zero_of_the_other_sign(change, differ):
    north = {"key": "flight.chi_deg", "distribution": "choice", "values": [0.0]}
    plan = plan_of(ft.load_scenario("exact_law").as_dict(), north, runs=1)
    (row,) = rows.fly_runs(plan, [0]).to_pylist()

    found = rows.row_differences(plan, 0, row | {"flight.chi_deg": change(row["flight.chi_deg"])})

    assert [x.what for x in found] == ["flight.chi_deg"] * differ


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
