"""Gains beside the guidance that a user flies now, on the same draws."""

import math

import numpy as np
import pytest
from commands import flighttune

import flighttune as ft

CORNERS = (0.0, 0.0), (100.0, 0.0), (150.0, 50.0)
SHORT = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in CORNERS]}
FEW = {"flights": 2, "workers": 1, "changes": SHORT}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("now") / "plane.parm"
    of_guidance = "NAVL1_PERIOD 14\nNAVL1_DAMPING 0.8\nTECS_THR_DAMP 0.5\nROLL_LIMIT_DEG 45\n"
    path.write_text(of_guidance + "RC1_MIN 1000\n")
    return path


@pytest.fixture(scope="module")
def comparison(file):
    return ft.compare("circuit_in_wind", autopilot=file, **FEW)


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


@pytest.mark.soak
def test_a_scenario_without_draws_is_flown_once_by_both(file):
    alone = ft.compare("level_turn@paper", autopilot=file, workers=1, seed=7)

    assert [*alone.rows["gains"]] == ["yours", "ours"]
    assert alone.plan.groups[-1].gains == "paper"
    assert alone.plan.campaign.seed == 7
