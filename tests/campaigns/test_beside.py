"""Gains beside the guidance that a user flies now, on the same draws."""

import math
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import flighttune
from flown_campaigns import flown_here
from log_files import sampled, write_dataflash

import flighttune as ft

CORNERS = (0.0, 0.0), (100.0, 0.0), (150.0, 50.0)
SHORT = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in CORNERS]}
FEW = {"flights": 2, "workers": 1, "changes": SHORT}
LONG = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in ((0, 0), (500, 0), (700, 300))]}
LEG = [{"north_m": n, "east_m": 0.0} for n in (0.0, 120.0)]
PAPER = {"gains": ["paper"], "law": ["paper"]}  # which need no search
FOUR = {"flights": 4, "workers": 1, "changes": {"route.waypoint": LEG, **PAPER}}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("now") / "plane.parm"
    of_guidance = "NAVL1_PERIOD 14\nNAVL1_DAMPING 0.8\nTECS_THR_DAMP 0.5\nROLL_LIMIT_DEG 45\n"
    path.write_text(of_guidance + "RC1_MIN 1000\n")
    return path


@pytest.fixture(scope="module")
def comparison(file):
    with flown_here():
        return ft.compare("circuit_in_wind", autopilot=file, **FEW)


# Killed by itself once so many flights are there.
KILLED = f"""
import os, signal, sys
import flighttune as ft
class Killed(ft.CampaignObserver):
    def see(self, progress):
        if progress.flown >= 2:
            os.kill(os.getpid(), signal.SIGKILL)
more = {FOUR!r}
ft.compare("circuit_in_wind", autopilot=sys.argv[1], kept=sys.argv[2], observer=Killed(), **more)
"""


@pytest.mark.counts
def test_a_killed_comparison_goes_on_and_is_the_same_to_the_bit(file, tmp_path):
    kept = tmp_path / "runs" / "kept.jsonl"
    done = subprocess.run([sys.executable, "-c", KILLED, file, kept], check=False)
    assert done.returncode == -signal.SIGKILL
    (file_of_it,) = kept.parent.glob("kept-*.jsonl")
    flown = file_of_it.read_text().splitlines()
    assert len(flown) >= 2
    # half of the next line, and a flight of another comparison
    file_of_it.write_text(
        "\n".join([flown[0].replace('"of": "', '"of": "0'), *flown, flown[1][:50]])
    )

    said = []
    observer = ft.CampaignObserver()
    observer.hear = said.append
    on = ft.compare("circuit_in_wind", autopilot=file, kept=kept, observer=observer, **FOUR)
    whole = ft.compare("circuit_in_wind", autopilot=file, **FOUR)

    assert said[0] == f"{file_of_it}: {len(flown)} flights are flown already."
    assert not file_of_it.exists()
    rows = [x.rows.drop(columns="wall_s") for x in (on, whole)]
    pd.testing.assert_frame_equal(*rows, check_exact=True)


@pytest.mark.soak
def test_a_stopped_comparison_names_the_file_with_which_it_goes_on(file, tmp_path):
    kept, observer = tmp_path / "kept.jsonl", ft.CampaignObserver()
    observer.see = lambda progress: setattr(observer, "stopped", progress.flown >= 1)

    with pytest.raises(ft.FlightTuneError) as stopped:
        ft.compare("circuit_in_wind", autopilot=file, kept=kept, observer=observer, **FEW)

    (name,) = stopped.value.kept
    assert name.startswith(str(kept.with_suffix("")))
    assert 1 <= len(Path(name).read_text().splitlines()) < 2 * FEW["flights"]


@pytest.mark.slow
def test_both_fly_the_same_draws_and_the_answer_has_both(comparison, file):
    keys = [*comparison.plan.keys, "seed", "draw"]
    yours, ours = (
        comparison.rows.loc[comparison.rows["gains"] == x, keys] for x in ("yours", "ours")
    )
    assert yours.to_dict("records") == ours.to_dict("records")
    assert len(yours) == 2
    answer = comparison.answer()
    assert "jsbsim:aerosonde at 25 m/s" in answer.summary[1]
    assert [row["of"] for row in answer.values["accuracy"]] == [
        *("cross track", "height", "airspeed", "course", "path angle")
    ]
    assert "not the firmware; not checked against a log" in answer.summary[-1]
    assert answer.values["unused"] == ["TECS_THR_DAMP"]
    assert answer.values["rest"] == 1
    sources = {row["from"] for row in answer.values["parameters"]}
    assert sources == {file.name, "default of ArduPilot 4.5"}
    gains = comparison.plan.gain_sets[comparison.plan.groups[-1].gains]
    period = 4.0 * math.pi * 0.8 / gains.K_P[0, 0]
    said = f"{gains.K_P[0, 0]:.2f} 1/s, corresponds to NAVL1_PERIOD = {period:.1f} s (yours 14 s)"
    assert said in answer.summary[3]


@pytest.mark.slow
def test_margins_are_those_of_a_frequency_response(comparison):
    # L = G (a s + b) / s^2 with the identified roll behind half a sample
    (lag, _), omega = ft.loop.load_identified("aerosonde").nearest(25.0, 0.0).lags, 2.0 * math.pi
    a, b = 4.0 * math.pi * 0.8 / 14.0, (omega / 14.0) ** 2
    w = np.geomspace(1e-2, 60.0, 200_001)
    s = 1j * w
    second = s**2 / lag.natural_frequency**2 + 2.0 * lag.damping * s / lag.natural_frequency + 1.0
    G = np.exp(-s * (lag.delay + 0.01)) / ((1.0 + s * lag.lag) * second)
    L = G * (a * s + b) / s**2
    phase = np.unwrap(np.angle(L))
    crossing = np.flatnonzero((np.abs(L[:-1]) > 1.0) & (np.abs(L[1:]) <= 1.0))[-1]
    turn = np.flatnonzero((phase[:-1] > -np.pi) & (phase[1:] <= -np.pi))[-1]
    roll = comparison.margins["yours"][0]
    assert np.degrees(roll.phase_margin) == pytest.approx(
        np.degrees(phase[crossing]) + 180.0, abs=0.5
    )
    assert roll.gain_increase == pytest.approx(1.0 / np.abs(L[turn]), rel=0.03)


@pytest.mark.soak
def test_a_log_lies_among_the_flights_or_not(file, tmp_path):
    tables = ft.load_scenario("circuit", changes=LONG).as_dict()
    law = {"name": "l1", "kind": "autopilot", "parameters": {"NAVL1_PERIOD": 14.0}}
    flown = ft.fly(ft.scenario_from(tables | {"law": [law], "gains": ["paper"], "expect": []}))
    run = next(run for run in flown.runs if run.status == "completed")
    t, signals = sampled(run, noise=False, dropouts=False, late=False)
    near = write_dataflash(tmp_path / "near.bin", t, signals)
    off = {"cross_track": 0.0 * t + 50.0, "phi_cmd": 2.0 * signals["phi_cmd"]}
    far = write_dataflash(tmp_path / "far.bin", t, signals | off)
    for log, among in ((near, None), (far, "outside of")):
        of_log = {**FEW, "changes": LONG, "log": str(log)}
        answer = ft.compare("circuit_in_wind", autopilot=file, **of_log).answer()
        cross, height, roll = answer.values["tracking"]
        assert "not checked" not in answer.summary[3]
        if among is None:
            kept = np.quantile(np.abs(run.signals["height_err"]), 0.95)
            assert height["log"] == pytest.approx(kept, abs=0.05)
            kept = np.degrees(np.quantile(np.abs(run.signals["phi_cmd"]), 0.95))
            assert roll["log"] == pytest.approx(kept, abs=0.5)
            assert roll["low"] <= roll["log"] <= roll["high"]
        else:
            assert cross["log"] == pytest.approx(50.0)
            assert roll["log"] > roll["high"]
            (said,) = [note for note in answer.notes if among in note]
            assert re.search(r"outside of [a-z ]+ in cross track", said)
            assert "commanded roll, by the 95th percentile of the size" in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--with", "copter.param"], "parameters of an aeroplane"),
        (["--with", "missing.param"], "no such file"),
        (["--flights", "5"], "`flights` must be absent without the parameters of an autopilot"),
        (["paper@K1", "--with", "plane.param"], "one source of flights"),
        (["--with", "plane.param", "--out", "x.rrd"], ".html"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_line(tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "copter.param").write_text("ATC_RAT_RLL_P,0.1\n")
    (tmp_path / "plane.param").write_text("NAVL1_PERIOD,14\nROLL_LIMIT_DEG,45\n")
    _, failure = flighttune("compare", "paper@paper", *options, status=2)
    assert words in failure


@pytest.mark.slow
def test_a_scenario_without_draws_is_flown_once_by_both(file):
    with flown_here():
        alone = ft.compare("level_turn@paper", autopilot=file, workers=1, seed=7)

    assert [*alone.rows["gains"]] == ["yours", "ours"]
    assert alone.plan.groups[-1].gains == "paper"
    assert alone.plan.campaign.seed == 7


SPEEDS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.395\t8.55\t430\t1
1\t0\t3\t22\t15\t0\t0\t0\t47.3952\t8.5501\t60\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.398\t8.55\t60\t1
3\t0\t3\t178\t0\t20\t-1\t0\t0\t0\t0\t1
4\t0\t3\t16\t0\t0\t0\t0\t47.398\t8.553\t60\t1
5\t0\t0\t177\t2\t-1\t0\t0\t0\t0\t0\t1
"""


@pytest.mark.soak
def test_what_is_not_emulated_of_a_mission_is_named_with_the_keys_that_fly_it(file, tmp_path):
    mission = tmp_path / "m.waypoints"
    mission.write_text(SPEEDS)
    asked = ["compare", mission, "--with", file, "--flights", 1, "--workers", 1]

    said = flighttune(*asked, status=2)[1]
    assert "item 5 (DO_JUMP 177) must repeat at most 10 times" in said
    asked += re.search("--set route.skip=true", said)[0].split()
    said = flighttune(*asked, status=2)[1]
    assert "must be flown at one airspeed" in said
    assert "an airspeed of 20 m/s by item 3" in said
    asked += re.search(r"--set flight.V_a_mps=25", said)[0].split()
    assert "Neither lost an aircraft in 1 flight." in " ".join(flighttune(*asked)[0].split())
