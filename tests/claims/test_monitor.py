"""The count of a monitor: its claim, its file, a forgery, and a fault that it finds."""

from dataclasses import replace
from pathlib import Path

import pytest
from commands import answer, flighttune
from made_up import scenario_file
from plans import plan_file, waypoint
from watched import flown, stuck, turn

import flighttune as ft
from flighttune.claims import counting, mission
from flighttune.claims.rates_keys import load_rates

pytestmark = pytest.mark.slow

FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 20, "workers": 1}


@pytest.fixture(scope="module")
def monitor():
    return ft.monitor("level_turn", start_deg=2.0, changes={"flight.duration_s": 4.0}, **FEW)


HEALTHY = turn(4.0, 0.3, -0.3)
FAULTY = turn(4.0, 0.3, -0.3, **stuck(1.0))


@pytest.mark.soak
def test_the_limits_are_those_that_the_count_allows(monitor):
    # the largest k of which a binomial of 29 and 0.3 has k or fewer with at most 0.1
    assert (len(monitor.scores), monitor.outside) == (29, 5)
    assert "raises an alarm with probability at most 0.3" in monitor.sentence


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
    tables = HEALTHY.as_dict() | {"turbulence": {"intensity": "severe"}}
    file = scenario_file(tmp_path / "s.toml", ft.scenario_from(tables))
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


@pytest.mark.soak
def test_its_file_is_verified_and_other_weights_are_not(monitor, tmp_path):
    monitor.save(tmp_path / "monitor.npz")
    read = ft.load(tmp_path / "monitor.npz")
    assert read.sha256 == monitor.sha256
    assert ft.verify(read, count=2).valid

    first, *others = read.about.models
    weights = tuple(1.001 * weight for weight in first.weights)
    models = (replace(first, weights=weights), *others)
    forged = replace(read, about=replace(read.about, models=models))

    verified = ft.verify(forged, count=2)

    assert not verified.valid
    assert "airspeed" in verified.reason or "equal to the bit" in verified.reason


@pytest.mark.soak
def test_models_of_other_signals_are_refused(monitor, tmp_path):
    changed = replace(monitor, about=replace(monitor.about, models=monitor.about.models[1:]))
    changed.save(tmp_path / "monitor.npz")

    with pytest.raises(ft.InputError, match=r"`models` .* of the `signals`"):
        ft.load(tmp_path / "monitor.npz")


def test_too_few_flights_to_learn_weights_and_limits_from_are_refused_before_any_flies():
    with pytest.raises(ft.InputError, match="at least 20, got 19"):
        ft.monitor("level_turn", start_deg=2.0, **{**FEW, "learn": 19})


@pytest.mark.soak
def test_a_monitor_of_a_mission_with_another_aircraft_ends_its_flights_and_no_others(tmp_path):
    file = plan_file(tmp_path / "m.plan", waypoint(47.4, 8.5, 300), waypoint(47.404, 8.5, 300))
    ft.monitor(file, aircraft="c172p", flights=7, out=tmp_path / "m.npz", **FEW)
    rates = tmp_path / "rates.toml"
    stated = '[ending]\nmonitor = "m.npz"\n[[fault]]\nkind = "engine"\nper_hour = 1e-3\n'
    rates.write_text(f'{stated}source = "a log"\n')

    def alarms(aircraft):
        plan = counting.drawn(ft.flights(file, aircraft=aircraft).knowing(None))
        return mission._alarms(rates, load_rates(rates), plan)

    assert len(alarms("c172p").models) == 8
    with pytest.raises(
        ft.InputError, match="must be of the aircraft, law and gains of the mission"
    ):
        alarms("aerosonde")
