"""Compiled flights of a campaign: those that decide are flown by JSBSim too, and compared."""

import pytest
from dispersed import plan_of, uniform
from flown_campaigns import flown_here

import flighttune as ft
from flighttune.campaigns.flying import rows
from flighttune.flight.loop import aircraft, loop

pytest.importorskip("numba")


@pytest.fixture(autouse=True)
def _own_starts():
    """Starts of tests that make them wrong are theirs alone."""
    aircraft._kept_start.cache_clear()
    yield
    aircraft._kept_start.cache_clear()


def bounded(settling_s):
    """Two flights whose settling time is bounded."""
    nominal = ft.load_scenario("exact_law").as_dict()
    nominal |= {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}], "law": ["exact"]}
    nominal["flight"]["duration_s"] = 10.0
    nominal["expect"] = [{"at_most": {"chi": {"settling_s": settling_s}}}]
    return plan_of(nominal, uniform("flight.V_a_mps", 24.0, 26.0), runs=2)


def in_wind():
    """One draw of an aircraft in turbulence, and of a point mass that meets its wind."""
    nominal = ft.load_scenario("exact_law").as_dict()
    nominal |= {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}, {"kind": "kinematic"}]}
    nominal |= {"law": ["exact"], "turbulence": {"intensity": "light"}, "expect": []}
    nominal["flight"]["duration_s"] = 4.0
    return plan_of(nominal, uniform("flight.V_a_mps", 24.0, 26.0), runs=2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settling_s", "again"), [(9.9, [0]), (0.5, [0, 1])], ids=["far inside", "outside"]
)
def test_flights_that_decide_and_one_in_a_hundred_are_flown_again(monkeypatch, settling_s, again):
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    checked, check = [], rows.check_compiled
    monkeypatch.setattr(rows, "check_compiled", lambda *x: checked.append(x) or check(*x))

    for run in range(2):
        rows.fly_runs(bounded(settling_s), [run])

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
    (row,) = rows.fly_runs(bounded(9.9), [0]).to_pylist()

    assert row["status"] == "invalid"
    assert "must be that of JSBSim" in row["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("right", [True, False])
def test_flights_that_decide_a_count_are_flown_by_jsbsim_too(monkeypatch, right):
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    made, few = aircraft.motion_of, {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 9}

    def off(*given):
        motion = made(*given)
        motion.states[:] *= 1.0 if right else 1.0 + 1e-7
        return motion

    monkeypatch.setattr(aircraft, "motion_of", off)
    # only draw 0 is flown again for its number; it is among those learned from
    monkeypatch.setattr(rows, "check_compiled", lambda *_: None)
    turn = ft.load_scenario("level_turn", changes={"flight.duration_s": 4.0}).as_dict()
    turn |= {"plant": [x for x in turn["plant"] if x["kind"] == "jsbsim"], "expect": []}

    def count():
        with flown_here():
            return ft.band(ft.scenario_from(turn), start_deg=2.0, **few)

    if right:
        assert count().claims
    else:
        with pytest.raises(ft.loop.PlantError, match="must be that of JSBSim"):
            count()


@pytest.mark.slow
def test_others_of_a_draw_meet_the_wind_of_jsbsim_after_a_wrong_flight(monkeypatch):
    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    made, plan = aircraft.motion_of, in_wind()
    right = rows.fly_runs(plan, [0, 1]).to_pylist()
    aircraft._kept_start.cache_clear()

    def wrong(*given):
        motion = made(*given)
        motion.states[:] *= 1.0 + 1e-7
        return motion

    monkeypatch.setattr(aircraft, "motion_of", wrong)
    flown, replayed = rows.fly_runs(plan, [0, 1]).to_pylist()

    assert flown["status"] == "invalid"
    assert {**replayed, "wall_s": 0.0} == {**right[1], "wall_s": 0.0}


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
