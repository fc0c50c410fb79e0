"""The count of a monitor: its claim, its file, a forgery, and a fault that it finds."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import answer, flighttune
from flown_campaigns import flown_here
from made_up import made_up_scenario, scenario_file
from made_up_band import count_of, plan_of_paper, scores_of
from plans import plan_file, waypoint
from watched import flown, stuck, turn

import flighttune as ft
from flighttune.base.files.code import JSBSIM
from flighttune.campaigns.flying.rows import fly_group, scenario_of_run
from flighttune.claims import counted_flights, counting, mission
from flighttune.claims.band import RecordedSignals
from flighttune.claims.rates_keys import load_rates
from flighttune.flight.entry import entry_of
from flighttune.flight.fly import fly_alone
from flighttune.gaps import watch as watching

pytestmark = pytest.mark.slow

FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 20, "workers": 1}

SECONDS = 2.5
OF_TURN = {"changes": {"flight.duration_s": SECONDS}}
STUCK_S = 1.0


@pytest.fixture(scope="module", autouse=True)
def flights_here():
    """JSBSim flies in this process."""
    with pytest.MonkeyPatch.context() as patch, flown_here():
        patch.setenv(JSBSIM, "1")
        yield


@pytest.fixture(scope="module")
def monitor(flights_here):
    return ft.monitor("level_turn", start_deg=2.0, flights=12, **OF_TURN, **FEW)


HEALTHY = turn(SECONDS, 0.3, -0.3)
FAULTY = turn(SECONDS, 0.3, -0.3, **stuck(STUCK_S))
SEVERE = ft.scenario_from(HEALTHY.as_dict() | {"turbulence": {"intensity": "severe"}})


@pytest.fixture(scope="module")
def runs():
    """A healthy flight, and one with a fault."""
    return flown(HEALTHY), flown(FAULTY)


def test_the_limits_are_those_that_the_count_allows(monitor):
    # the largest k of which a binomial of 12 and 0.3 has k or fewer with at most 0.1
    assert (len(monitor.scores), monitor.outside) == (12, 1)
    assert "raises an alarm with probability at most 0.3" in monitor.sentence
    watch, said = monitor.watch, monitor.answer()
    second = np.sort(monitor.scores)[-2]
    assert watch.half == pytest.approx(second * monitor.about.half[0])
    ends = [(row["low"], row["high"]) for row in monitor.sizes()]
    middles = zip(watch.middle, watch.half, strict=True)
    assert ends == [pytest.approx((middle - half, middle + half)) for middle, half in middles]
    models = said.values["models"]
    assert [x["name"] for x in models] == [*monitor.about.signals]
    assert all(len(x["weights"]) == len(x["terms"]) for x in models)


def test_weights_are_those_of_the_first_half_of_the_learning_flights(monitor):
    plan, models = counted_flights.plan_of(monitor), monitor.about.models
    runs = [fly_group(plan, scenario_of_run(plan, n), plan.groups[0]) for n in range(10)]

    taught = watching.taught(
        models, [watching.moments(watching.columns_of(models, run)) for run in runs]
    )

    for model, other in zip(models, taught, strict=True):
        assert model.weights == pytest.approx(other.weights, rel=1e-6)


def test_the_score_rises_above_its_limit_at_the_alarm_of_a_fault(monitor, runs):
    healthy, faulty = (monitor.on(run) for run in runs)
    alarm = monitor.alarm(runs[1])

    assert (healthy.alarm, healthy.no_claim, faulty.no_claim) == (None, "", "")
    assert faulty.alarm == alarm
    for run, claim in zip(runs, (healthy, faulty), strict=True):
        assert (claim.kind, claim.sentence) == ("counted", monitor.sentence)
        assert (claim.bounds.t == run.t).all()
        assert (claim.bounds.pairs == [0.0, 1.0]).all()
    assert STUCK_S < alarm.at_s < STUCK_S + 0.5
    assert alarm.why in ("roll", "turn")
    for run, claim in zip(runs, (healthy, faulty), strict=True):
        score = claim.signals["alarm_score"]
        assert len(score) == len(run.signals)
        assert (np.diff(score) >= 0.0).all()
    assert healthy.signals["alarm_score"].max() <= 1.0
    above = faulty.signals["alarm_score"] > 1.0
    assert runs[1].t[above.argmax()] == pytest.approx(alarm.at_s)


def test_a_monitor_says_which_flights_it_does_not_score_and_which_are_not_in_its_claim(
    monitor, runs
):
    healthy, faulty = runs
    made = healthy.provenance
    soft = ft.PIGains(K_P=0.5 * np.eye(2), K_I=0.1 * np.eye(2))
    of_log = {**made.scenario, "log": {"file": "x.csv"}}
    log = replace(healthy, provenance=replace(made, scenario=of_log, plant="log"))
    scored = replace(healthy, signals=healthy.signals.assign(alarm_score=0.0))
    both = ft.scenario_from(
        HEALTHY.as_dict() | {"plant": [{"kind": "kinematic"}, *HEALTHY.as_dict()["plant"]]}
    )
    law = fly_alone(entry_of(both, "paper", ft.PAPER_GAINS))

    assert [monitor.why_not(run) for run in (healthy, faulty, log)] == [""] * 3
    assert monitor.why_not(scored) == "another monitor has scored it"
    lacking = replace(healthy, signals=healthy.signals.drop(columns=["r", "p"]))
    assert monitor.why_not(lacking) in (f"it must have {x} to be watched" for x in ("p, r", "r, p"))
    assert "counted on jsbsim:aerosonde" in monitor.why_not(law)
    other = replace(healthy, provenance=replace(made, gains=soft))
    assert "gains are not those counted on, paper" in monitor.why_not(other)

    assert [monitor.not_about(run) for run in runs] == ["", ""]
    assert "log of a real flight" in monitor.not_about(log)
    assert monitor.on(log).alarm is None
    severe = "turbulence is severe, counted on none"
    assert monitor.not_about(flown(SEVERE)) == severe

    def said(scenario, gains=ft.PAPER_GAINS, plant=0):
        entry = entry_of(scenario, "paper", gains)
        return monitor.not_counted(replace(entry, plant=scenario.plant[plant]))

    assert [said(HEALTHY), said(FAULTY), said(SEVERE)] == ["", "", severe]
    assert "gains are not those" in said(HEALTHY, soft)
    assert said(both, plant=1) == ""
    assert said(both).startswith("plant is no aircraft, counted on jsbsim:aerosonde")


def test_the_monitor_of_declared_rates_is_of_the_aircraft_and_gains_of_the_mission(
    monitor, runs, tmp_path
):
    rates = tmp_path / "rates.toml"
    fault = '[[fault]]\nkind = "engine"\nper_hour = 1e-3\nsource = "a log"\n'
    rates.write_text(f'[ending]\nmonitor = "m.npz"\n{fault}')
    monitor.save(tmp_path / "m.npz")

    def alarms(gains, file=rates):
        flights = ft.flights("level_turn", **OF_TURN)
        plan = counting.drawn(flights, plant="jsbsim:aerosonde", gains=gains)
        return mission._alarms(file, load_rates(file), plan)

    kept = alarms("paper")
    assert (kept.middle, kept.half) == (tuple(monitor.watch.middle), tuple(monitor.watch.half))
    firsts = [kept.first(run) for run in runs]
    assert firsts == [math.inf, monitor.alarm(runs[1]).at_s]
    of_mission = "`monitor` must be of the aircraft, law and gains of the mission: its gains"
    with pytest.raises(ft.InputError, match=of_mission):
        alarms("tuned_identified")
    measured = RecordedSignals(units={"chi_err": "rad"})
    band = count_of(ft.Band, plan_of_paper(made_up_scenario()), measured, 1.0, scores_of(1.0))
    band.save(tmp_path / "m.npz")
    with pytest.raises(ft.InputError, match=r"m\.npz: `monitor` must be a monitor counted on"):
        alarms("paper")
    rates.write_text(fault)
    assert alarms("paper") is None


@pytest.mark.soak
@pytest.mark.parametrize(("scenario", "status"), [(HEALTHY, 0), (FAULTY, 1)])
def test_fly_records_the_score_and_says_whether_when_and_why_it_alarms(
    monitor, scenario, status, tmp_path
):
    monitor.save(tmp_path / "m.npz")
    file, runs = scenario_file(tmp_path / "s.toml", scenario), tmp_path / "runs"

    said = answer("fly", file, "--claim", tmp_path / "m.npz", "--out", runs, status=status)

    (claim,) = said["claims"]  # of the gains counted, on the plant counted
    (run,) = (run for run in ft.load(runs).runs if "alarm_score" in run.signals)
    assert claim["run"] == run.label == "jsbsim:aerosonde / paper"
    alarm = monitor.alarm(flown(scenario))
    assert claim["alarm"] == (alarm and alarm._asdict())
    assert claim["inside"] == (alarm is None) == (status == 0)
    score = run.signals["alarm_score"]
    assert (score.diff().dropna() >= 0.0).all()
    assert run.claims[0].alarm == alarm
    if alarm is not None:
        assert 1.0 <= alarm.at_s < 2.0
        assert alarm.why in ("roll", "turn")
        assert score[score > 1.0].index[0] == pytest.approx(alarm.at_s)
        assert f"Alarm at {alarm.at_s:.2f} s: the {alarm.why} differs" in " ".join(said["notes"])
        page = answer("report", runs, "--out", tmp_path / "page.html", status=1)
        assert f"Alarm at {alarm.at_s:.2f} s" in " ".join(page["summary"])
    assert answer("verify", runs)["equal"]
    assert monitor.why_not(run) == "another monitor has scored it"


@pytest.mark.soak
def test_an_alarm_of_a_flight_that_it_is_not_about_is_none_and_the_first_line_says_so(
    monitor, tmp_path
):
    monitor.save(tmp_path / "m.npz")
    file = scenario_file(tmp_path / "s.toml", SEVERE)
    fly = "fly", file, "--claim", tmp_path / "m.npz", "--out", tmp_path / "runs"
    said = "no claim about this flight: turbulence is severe, counted on none"

    printed, line = flighttune(*fly, status=2)
    (claim,) = answer(*fly, status=2)["claims"]
    page = answer("report", tmp_path / "runs", "--out", tmp_path / "page.html", status=2)

    assert said in printed.splitlines()[0]
    assert said in line
    assert said in page["summary"][0]
    assert (claim["alarm"], claim["inside"], claim["no_claim"] in said) == (None, False, True)
    assert "raises an alarm" not in printed
    (run,) = (run for run in ft.load(tmp_path / "runs").runs if "alarm_score" in run.signals)
    assert run.claims[0].no_claim == claim["no_claim"]
    c = "--format", "c", "--claim", tmp_path / "m.npz", "--out", tmp_path / "c"
    made = answer("export", file, "--gains", "paper", *c)
    assert "turbulence is severe, counted on none" in made["notes"][0]
    assert "No claim about flights of this scenario" in Path(made["monitor"]).read_text()


def test_its_file_is_verified_and_other_weights_are_not(monitor, tmp_path):
    monitor.save(tmp_path / "monitor.npz")
    read = ft.load(tmp_path / "monitor.npz")
    assert read.sha256 == monitor.sha256
    assert ft.verify(read, count=1).valid

    first, *others = read.about.models
    weights = tuple(1.001 * weight for weight in first.weights)
    models = (replace(first, weights=weights), *others)
    forged = replace(read, about=replace(read.about, models=models))

    verified = ft.verify(forged, count=1)

    assert not verified.valid
    assert f"`weights` of {first.name} must be those" in verified.reason
    units = dict.fromkeys(read.about.signals, "m")
    other = ft.verify(replace(read, about=replace(read.about, signals=units)), count=1)
    assert not other.valid
    assert "`signals` must have the units of the flights" in other.reason


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (lambda first, *others: others, "`models` must be those of the `signals`"),
        (
            lambda first, *others: (replace(first, weights=first.weights[1:]), *others),
            "`models` must be those that flighttune monitor counts, with a weight for each",
        ),
        (
            lambda first, *others: (replace(first, room=2.0 * first.room), *others),
            "`models` must be those that flighttune monitor counts",
        ),
    ],
)
def test_models_that_are_not_counted_are_refused(monitor, tmp_path, changed, said):
    models = changed(*monitor.about.models)
    replace(monitor, about=replace(monitor.about, models=models)).save(tmp_path / "monitor.npz")

    with pytest.raises(ft.InputError, match=said):
        ft.load(tmp_path / "monitor.npz")


def test_too_few_flights_to_learn_weights_and_limits_from_are_refused_before_any_flies():
    with pytest.raises(ft.InputError, match="at least 20, got 19"):
        ft.monitor("level_turn", start_deg=2.0, **{**FEW, "learn": 19})


@pytest.mark.soak
def test_a_monitor_of_a_mission_with_another_aircraft_ends_its_flights_and_no_others(tmp_path):
    file = plan_file(tmp_path / "m.plan", waypoint(47.4, 8.5, 300), waypoint(47.4015, 8.5, 300))
    ft.monitor(file, aircraft="x8", flights=7, out=tmp_path / "m.npz", **FEW)
    rates = tmp_path / "rates.toml"
    stated = '[ending]\nmonitor = "m.npz"\n[[fault]]\nkind = "engine"\nper_hour = 1e-3\n'
    rates.write_text(f'{stated}source = "a log"\n')

    def alarms(aircraft):
        plan = counting.drawn(ft.flights(file, aircraft=aircraft).knowing(None))
        return mission._alarms(rates, load_rates(rates), plan)

    assert len(alarms("x8").models) == 8
    with pytest.raises(
        ft.InputError, match="must be of the aircraft, law and gains of the mission"
    ):
        alarms("aerosonde")
