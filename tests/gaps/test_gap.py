"""The ladder: one law on four plants, and parts that add up to the whole."""

import math
from copy import copy
from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.flight.loop.run import Bounds, RunClaim

SENTENCE = "of 9 flights 1 lies outside"


def claimed(run: ft.Run, kind: str = "counted", title: str = "counted band", **ends) -> ft.Run:
    """The run with lower and upper bounds (SI, constants or arrays) around some signals."""
    low, high = (
        np.column_stack([np.broadcast_to(pair[side], len(run.t)) for pair in ends.values()])
        for side in (0, 1)
    )
    claim = RunClaim(
        kind=kind,
        title=title,
        sentence=SENTENCE,
        bounds=Bounds(run.t, low, high, tuple(ends)),
        units={name: SIGNAL_UNITS[name] for name in ends},
    )
    return replace(run, claims=(*run.claims, claim))


ROUNDING = 1e-12
LIMITS_IN_RADIANS = 1e-9
"""What the rounding of a limit from deg and from rad/s may do to a course, rad."""
IN_TIME = 1e-9
"""What the rounding of a time does to a wind, m/s."""
RUNGS = ["kinematic", "point_mass", "point_mass_lag", "jsbsim:aerosonde"]
SLOW = pytest.mark.slow
WIND = ["wind_north", "wind_east", "wind_down"]


def changed(name, **tables):
    return ft.scenario_from(ft.load_scenario(name).as_dict() | tables)


@pytest.fixture(scope="module")
def paper_gap():
    """The paper's manoeuvre, explained once for all tests."""
    return ft.gap(ft.load_scenario("paper"), ft.PAPER_GAINS, name="paper")


@pytest.fixture(scope="module")
def windy_gap():
    air = {"wind": {"speed_mps": 8.0, "from_deg": 270.0}, "turbulence": {"intensity": "moderate"}}
    flight = ft.load_scenario("level_turn").as_dict()["flight"] | {"duration_s": 12.0}
    gains = [{"name": "own", "law": "exact", **ft.PAPER_GAINS.as_lists()}]
    return ft.gap(changed("level_turn", law=["exact"], gains=gains, flight=flight, **air))


def test_what_the_steps_do_not_explain_is_the_largest_of_all_differences(paper_gap):
    moved = copy(paper_gap.whole)
    moved.gamma = moved.gamma - 0.25

    found = replace(paper_gap, whole=moved)
    assert found.residual == pytest.approx(0.25)
    assert found.answer().values["largest_residual"] == found.residual


@pytest.mark.slow
def test_first_and_last_rung_are_the_flights_of_fly(paper_gap):
    flown = {run.label: run.signals for run in ft.fly(paper_gap.scenario).runs}

    first, last = paper_gap.runs[0], paper_gap.runs[-1]
    signals = flown[last.label]
    assert np.array_equal(last.signals[signals.columns].to_numpy(), signals.to_numpy())
    assert first.signals["chi"].to_numpy() == pytest.approx(
        flown[first.label]["chi"].to_numpy(), abs=LIMITS_IN_RADIANS
    )


@pytest.mark.slow
@pytest.mark.parametrize("gap_name", ["paper_gap", "windy_gap"])
def test_the_steps_add_up_to_the_whole(gap_name, request):
    gap = request.getfixturevalue(gap_name)
    first, last = gap.runs[0], gap.runs[-1]

    for channel in ("chi", "gamma"):
        added = sum(getattr(step, channel) for step in gap.steps)
        apart = (last.signals[channel] - first.signals[channel]).to_numpy()
        assert added == pytest.approx(apart, abs=ROUNDING)
    ends = [ft.loop.channel_metrics(run) for run in (first, last)]
    for metric in ends[0]:
        added = sum(step.metrics[metric].to_numpy() for step in gap.steps)
        apart = (ends[1] - ends[0])[metric].to_numpy()
        assert added == pytest.approx(apart, abs=ROUNDING, nan_ok=True)
    assert gap.residual < ROUNDING


@pytest.mark.parametrize("gap_name", ["paper_gap", pytest.param("windy_gap", marks=SLOW)])
def test_the_mismatch_is_what_was_flown_beyond_the_law(gap_name, request):
    gap, dt = request.getfixturevalue(gap_name), 0.02
    signals, found, g = gap.aircraft.signals, gap.mismatch, gap.scenario.flight.g_mps2
    phi, n_z = (signals[name].to_numpy()[:-1] for name in ("phi_cmd", "n_z_cmd"))
    ends = np.cos(signals["gamma"].to_numpy())
    level = 0.5 * (ends[1:] + ends[:-1])
    V_a = 25.0 if gap_name == "paper_gap" else signals["V_a"].to_numpy()[:-1]
    turn = np.tan(phi) if gap_name == "paper_gap" else n_z * np.sin(phi) / level
    law = g / V_a * np.array([turn, n_z * np.cos(phi) - level])
    flown = np.diff(signals[["chi", "gamma"]].to_numpy(), axis=0) / dt

    assert found.d == pytest.approx(flown - law.T, abs=1e-9)
    assert found.d_dot == pytest.approx(np.diff(found.d, axis=0) / dt, abs=1e-6)
    assert found.t == pytest.approx(signals.index[:-1])
    assert found.bound == pytest.approx(max(map(math.hypot, *found.d.T)))
    assert found.L_d == pytest.approx(max(map(math.hypot, *found.d_dot.T)))
    shown = signals[["mismatch_chi", "mismatch_gamma"]].to_numpy()
    assert np.array_equal(shown, [*found.d, found.d[-1]])


def test_a_gap_has_the_lags_of_the_model_the_indicators_of_the_law_and_the_largest_cause(paper_gap):
    lags = ft.loop.load_identified("aerosonde").nearest(25.0, math.radians(15.0)).lags
    law = ft.loop.kinematic_model(V_a=25.0, gamma=math.radians(15.0), g=9.81)

    assert [lag for lag, _ in paper_gap.lags.values()] == [*lags]
    assert all(99.0 < share < 100.0 for _, share in paper_gap.lags.values())
    expected = ft.loop.indicators(ft.loop.closed_loop(law, ft.PAPER_GAINS))
    assert str(paper_gap.indicators) == str(expected)
    for channel in ("chi", "gamma"):
        changes = {x.adds: x.metrics.loc[channel, "ITAE"] for x in paper_gap.steps}
        largest = max(changes, key=lambda name: abs(changes[name]))
        assert paper_gap.cause(channel) == (largest, changes[largest])


def test_without_lift_the_course_waits_and_the_papers_law_does_not(paper_gap):
    law, point = paper_gap.runs[:2]
    pushing_over = law.signals.index < 1.5
    sideways = point.signals["n_z"] * np.sin(point.signals["phi"])

    assert sideways[pushing_over].abs().max() < 0.2
    assert law.signals["chi"][pushing_over].iloc[-1] < math.radians(50.0)
    assert point.signals["chi"][pushing_over].iloc[-1] > math.radians(57.0)


@pytest.mark.soak
def test_the_lag_comes_from_the_model_file_or_from_the_flight(paper_gap):
    fitted = ft.gap(paper_gap.scenario, ft.PAPER_GAINS, name="paper", lag="fitted")

    assert paper_gap.lag_source == "identified"
    assert fitted.lag_source == "fitted"
    for channel in ("phi", "n_z"):
        (_, identified), (_, best) = paper_gap.lags[channel], fitted.lags[channel]
        assert 99.0 < identified <= best


@pytest.mark.slow
def test_all_rungs_fly_in_the_air_that_the_aircraft_met(windy_gap):
    met = windy_gap.runs[-1].signals[WIND].to_numpy()

    assert np.ptp(met, axis=0).min() > 0.5
    for rung in windy_gap.runs[:-1]:
        assert rung.signals[WIND].to_numpy() == pytest.approx(met, abs=IN_TIME)
        assert rung.signals["chi"].iloc[0] == pytest.approx(
            windy_gap.runs[-1].signals["chi"].iloc[0], abs=1e-9
        )


@pytest.mark.slow
def test_the_aircrafts_own_limits_hold_on_every_rung():
    flight = ft.load_scenario("paper").as_dict()["flight"] | {"duration_s": 4.0}
    gap = ft.gap(changed("paper", limits={}, flight=flight), ft.PAPER_GAINS)

    for rung in gap.runs:
        phi_cmd = rung.signals["phi_cmd"].to_numpy()
        assert np.abs(phi_cmd).max() <= math.radians(45.0) + ROUNDING
        assert np.abs(np.diff(phi_cmd)).max() <= math.radians(30.0) * 0.02 + ROUNDING


def test_a_course_error_that_goes_around_is_no_overshoot(paper_gap):
    run = paper_gap.runs[0]
    around = np.linspace(0.0, 2.0 * math.pi, len(run.signals))
    wrapped = (around + math.pi) % (2.0 * math.pi) - math.pi
    spun = replace(run, signals=run.signals.assign(chi_err=wrapped))

    gap = replace(paper_gap, runs=(spun, *paper_gap.runs[1:]))

    assert gap.failed == {"kinematic": "diverged (course error past 180 deg)"}


def test_an_aircraft_that_cannot_begin_is_not_flown_and_says_why():
    flight = ft.load_scenario("paper").as_dict()["flight"] | {"gamma_deg": 85.0}

    gap = ft.gap(changed("paper", flight=flight), ft.PAPER_GAINS)

    assert gap.status == "not_flown"
    assert gap.reason.startswith("jsbsim:aerosonde / gains: ")
    assert gap.steps == ()


def test_a_scenario_without_aircraft_has_no_gap():
    with pytest.raises(ft.InputError, match=r"`plant`.*jsbsim"):
        ft.gap(changed("level_turn", plant=[{"kind": "kinematic"}]), ft.PAPER_GAINS)


class AboutAircraft:
    """A claim about flights on some plants, around the error of their course."""

    sentence = "the course stays within 0.1 rad of itself"

    def __init__(self, *plants):
        self.plants = plants

    def why_not(self, run):
        return "" if run.provenance.plant in self.plants else "it is another plant"

    def on(self, run):
        error = run.signals["chi_err"]
        return claimed(run, chi_err=(error - 0.1, error + 0.1)).claims[0]


def test_a_gap_has_claims_about_the_flight_of_the_aircraft_alone(paper_gap):
    bounded = paper_gap.within(AboutAircraft(*RUNGS))

    assert [len(run.claims) for run in bounded.runs] == [0, 0, 0, 1]
    assert bounded.aircraft.claims[0].contains(bounded.aircraft.signals)
    with pytest.raises(ft.InputError, match="it is another plant"):
        paper_gap.within(AboutAircraft(*RUNGS[:-1]))


@pytest.mark.slow
def test_the_airspeed_has_a_table_where_it_is_a_channel():
    gap = ft.gap("speed_change_in_turn", changes={"flight.duration_s": 12.0})

    (table,) = (table for table in gap.answer().tables if table.title == "airspeed")
    assert [column.unit for column in table.columns][1:3] == ["m/s\u00a0s²", "m/s"]
    for record, run in zip(table.records, gap.runs, strict=True):
        measured = record["metrics"]["V"]
        after = run.signals[run.t >= 8.0]  # of the step from 25 to 30 m/s
        assert measured["min_mps"] == run.signals["V_a"].min()
        assert measured["MO_mps"] == pytest.approx(after["V_a"].max() - 30.0, abs=1e-9)
