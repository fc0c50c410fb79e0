"""Whatever a user gives to a public name from Python, what comes back is one line in our words."""

import inspect
import math
import os
import random
import signal
import sys
import warnings
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import flighttune as ft

VALUES = {
    "400 digits": 10**400,
    "minus 400 digits": -(10**400),
    "NaN": math.nan,
    "inf": math.inf,
    "1e308": 1e308,
    "-1e308": -1e308,
    "5e-324": 5e-324,
    "zero": 0,
    "minus": -1,
    "a half": 0.5,
    "complex": 1j,
    "none": None,
    "text": "nowhere",
    "no text": "",
    "NUL": "a\0b",
    "long": "x" * 5000,
    "bytes": b"x",
    "true": True,
    "list": [1.0, 2.0],
    "ragged": [[0.1, 0.2], [0.1]],
    "no list": [],
    "nested": [[[1.0]]],
    "array": np.zeros(3),
    "objects": np.array([None, "x"]),
    "large array": np.full((2, 2), 1e308),
    "table": pd.DataFrame({"a": [1.0]}),
    "dictionary": {"a": 1},
    "set": {1, 2},
    "object": object(),
    "class": int,
    "function": len,
    "decimal": Decimal("1.0"),
    "path": Path("/nowhere/at/all"),
    "folder": Path("/"),
    "numbers": iter([1.0]),
    "gains": ft.PAPER_GAINS,
}


def usual(tmp_path):
    """Calls that are right, by name: a function, and its arguments by keyword."""
    scenario = ft.load_scenario("paper_as_printed")
    model = ft.loop.kinematic_model(V_a=25.0, gamma=0.0, g=9.80665)
    limits = ft.loop.Limits(lower=[-1, 0], upper=[1, 2], rate_lower=[-1, -1], rate_upper=[1, 1])
    lag = ft.loop.InnerLag(order=1, natural_frequency=5.0)
    calls = {
        "adopt": {"model": "c172p", "folder": tmp_path / "a", "V_a": 50.0, "h": 1000.0},
        "band": {"source": "level_turn", "flights": 93, "learn": 20, "epsilon": 0.05},
        "certify": {"source": scenario, "gains": ft.PAPER_GAINS, "L_d": 0.1, "lag": None},
        "compare": {"a": "level_turn"},
        "design": {"aircraft": "aerosonde"},
        "export": {"scenario": "level_turn", "gains": "paper", "out": tmp_path / "e"},
        "flights": {"source": "level_turn", "aircraft": None, "changes": {}},
        "fly": {"scenario": "paper_as_printed", "gains": ["paper"], "changes": {}},
        "frontier": {"source": scenario, "points": 3},
        "gap": {"scenario": "level_turn", "gains": "paper", "plant": None},
        "identify": {"source": "aerosonde", "V_a": [25.0], "gamma": [0.0], "h": 1000.0, "seed": 0},
        "load": {"path": "nowhere"},
        "load_campaign": {"path": "first_campaign", "until_sure": None, "gains": []},
        "load_gains": {"path": "nowhere.json"},
        "load_log": {"path": "nowhere.csv", "start": 0.0, "end": 1.0, "mode": ""},
        "load_scenario": {"path": "level_turn", "changes": {}, "gains": []},
        "meet": {"scenario": "level_turn", "budget": 10, "metric": "ITAE"},
        "mission": {"source": "nowhere.plan", "epsilon": 0.05, "fences": []},
        "monitor": {"source": "level_turn", "epsilon": 0.05, "learn": 20},
        "open": {"source": "nowhere", "gains": None, "port": None, "budget": 10},
        "plan_campaign": {"campaign": ft.load_campaign("first_campaign"), "runs": 8},
        "plot": {"value": "nowhere"},
        "record": {"flown": None, "folder": tmp_path, "name": "x"},
        "refly": {"source": "nowhere", "run": None, "count": None},
        "report": {"source": "nowhere", "path": None, "claims": []},
        "residual": {"source": "level_turn", "epsilon": 0.01, "flights": 500, "learn": 20},
        "route": {"source": "nowhere.plan", "aircraft": None, "terrain": None},
        "run_campaign": {"campaign": "nowhere", "out": tmp_path / "o", "runs": 8, "workers": 1},
        "scenario_from": {"tables": scenario.as_dict()},
        "show": {"flown": None, "width": 10, "height": 10},
        "trim": {"aircraft": "aerosonde", "V_a": [25.0], "gamma": [0.0], "phi": 0.0, "h": 1000.0},
        "tube": {"scenario": "paper_as_printed", "start": 0.01, "disturbance": 0.01},
        "tune": {"source": "paper_as_printed", "starts": 1, "lag": None},
        "verify": {"claim": "nowhere", "count": None},
        "worst": {"source": "level_turn", "budget": 10, "metric": None},
        "Scenario": scenario.as_dict(),
        "Campaign": {"title": "x", "scenario": "level_turn", "seed": 1, "runs": 8},
        "PIGains": {"K_P": np.eye(2), "K_I": np.eye(2), "inputs": ("phi", "n_z")},
        "Recording": {"path": tmp_path, "runs": ()},
        "Run": {"signals": pd.DataFrame(), "status": "completed", "reason": "", "provenance": None},
        "Flights": {"place": "x", "scenario": scenario, "start_deg": 0.0},
    }
    loop = {
        "CommandLimiter": {"limits": limits, "dt": 0.02},
        "ExactLaw": {"gains": ft.PAPER_GAINS, "limits": limits, "dt": 0.02, "lift_floor": 0.1},
        "FlightCondition": {
            "V_a": 25.0,
            "h": 0.0,
            "chi": 0.0,
            "gamma": 0.0,
            "phi": 0.0,
            "n_z": 1.0,
        },
        "InnerLag": {
            "order": 1,
            "natural_frequency": 5.0,
            "damping": 1.0,
            "lag": 1.0,
            "delay": 0.0,
        },
        "JSBSimPlant": {"aircraft": "aerosonde", "steps": 1, "seed": 0, "ground": 0.0},
        "LaggedPlant": {"plant": ft.loop.PointMassPlant(), "lags": (lag, lag)},
        "LawSetup": {"dt": 0.02, "limits": limits, "gains": ft.PAPER_GAINS, "g": 9.8},
        "Limits": {"lower": [-1, 0], "upper": [1, 2], "rate_lower": [-1, -1], "rate_upper": [1, 1]},
        "LinearModel": {"A": model.A, "B": model.B, "C": model.C, "inputs": model.inputs}
        | {"errors": model.errors},
        "MimoPI": {"gains": ft.PAPER_GAINS, "limits": limits, "dt": 0.02, "wrapped": ("chi",)},
        "PointMassPlant": {"lags": (lag, lag), "g": 9.8},
        "PoweredPointMass": {"n_x": (-0.5, 0.5), "lags": (lag, lag)},
        "Reference": {"chi": 0.0, "gamma": 0.0, "g": 9.8, "V": None, "chi_segments": ()},
        "Sensors": {"bias": (0.0, 0.0, 0.0), "late": (0.0, 0.0), "time_constant": 0.0, "seed": 0},
        "TuningProblem": {"model": model, "I_star": 5.0, "E_star": 1.0, "x_0": None},
        "channel_metrics": {"run": None},
        "closed_loop": {"model": model, "gains": ft.PAPER_GAINS},
        "command_gains": {"gains": ft.PAPER_GAINS, "V_a": 25.0, "g": 9.8},
        "flight_metrics": {"run": None},
        "indicators": {"A_K": -np.eye(2), "scaling": None},
        "indicators_batch": {"A_K": -np.eye(2)[None], "scaling": None},
        "kinematic_model": {"V_a": 25.0, "gamma": 0.0, "phi": 0.0, "n_z": 1.0, "g": 9.8},
        "load_identified": {"source": "nowhere"},
        "rate_gains": {"gains": ft.PAPER_GAINS, "V_a": 25.0, "g": 9.8},
        "tuning_problem": {"scenario": scenario, "law": None},
    }
    named = [(getattr(ft, name), name, given) for name, given in calls.items()]
    named += [(getattr(ft.loop, name), name, given) for name, given in loop.items()]
    return named


def wrong(call, options):
    """What is wrong with what a user reads; nothing if a call is refused in a line, or runs."""
    try:
        call(**options)
    except ft.FlightTuneError as error:
        text = str(error)
        return f"several lines: {text[:200]!r}" if "\n" in text or len(text) > 2000 else ""
    except TypeError as error:
        of_python = "unexpected keyword argument" in str(error) or "missing" in str(error)
        return "" if of_python else f"TypeError: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:200]}"
    return ""


def misused(tmp_path):
    """Each right call with one of its arguments changed to each of `VALUES`."""
    for call, name, given in usual(tmp_path):
        names = [*given]
        if name not in ("Scenario",):
            stated = inspect.signature(call).parameters.values()
            names += [x.name for x in stated if x.kind in (x.KEYWORD_ONLY, x.POSITIONAL_OR_KEYWORD)]
            names = [*dict.fromkeys(names)]
        for key in names:
            for kind, value in VALUES.items():
                yield f"{name}({key}={kind})", call, {**given, key: value}


class TooLongError(BaseException):
    """A call that was right after all, and flies."""


def too_long(*_):
    raise TooLongError


@pytest.mark.parametrize(
    "cases",
    [pytest.param(60, marks=pytest.mark.slow), pytest.param(1500, marks=pytest.mark.counts)],
)
def test_a_misused_call_is_refused_in_one_line(tmp_path, monkeypatch, cases):
    """From a fixed seed; what is accepted and takes long is left after some seconds."""
    monkeypatch.chdir(tmp_path)
    calls = [*misused(tmp_path)]
    random.Random(cases).shuffle(calls)
    said = {}
    before = signal.signal(signal.SIGALRM, too_long)
    try:
        for name, call, options in calls[:cases]:
            signal.alarm(5)
            try:
                with warnings.catch_warnings(action="ignore"):
                    said |= {name: what} if (what := wrong(call, options)) else {}
            except TooLongError:
                said |= {}
            finally:
                signal.alarm(0)
    finally:
        signal.signal(signal.SIGALRM, before)
    sys.stdout.write(f"{cases} of {len(calls)} misused calls, in process {os.getpid()}\n")
    assert said == {}


HUGE = 10**400
GAINS = {"K_P": np.eye(2), "K_I": np.eye(2)}
LAG = ft.loop.InnerLag(order=1, natural_frequency=9.0)


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (
            lambda: ft.band("level_turn", flights=np.nan),
            "`flights` must be a whole number or None, got nan.",
        ),
        (lambda: ft.worst("level_turn", budget=None), "`budget` must be a whole number, got None."),
        (
            lambda: ft.worst("level_turn", budget=HUGE),
            "`budget` must be a whole number, got a whole number of 401 digits.",
        ),
        (
            lambda: ft.fly(pd.DataFrame()),
            "`scenario` must be a Scenario or text or a path, got a DataFrame.",
        ),
        (lambda: ft.load_scenario("a\0b"), "`path` must be a name or path that files can have"),
        (lambda: ft.certify("paper", lag=[(0.1, 0.2), (0.1,)]), "`lag` must be "),
        (
            lambda: ft.loop.FlightCondition(V_a=HUGE),
            "`V_a` must be positive, got a whole number of 401 digits.",
        ),
        (lambda: ft.loop.FlightCondition(V_a=25.0, h=1j), "`h` must be a finite number, got 1j."),
        (lambda: ft.loop.FlightCondition(V_a=25.0, chi=None), "`chi` must be a finite number"),
        (
            lambda: ft.loop.FlightCondition(V_a=25.0, n_z=np.ones(2)),
            "`n_z` must be a finite number, got an array.",
        ),
        (lambda: ft.PIGains(**{**GAINS, "K_P": None}), "`K_P` must be real numbers in rows of "),
        (lambda: ft.PIGains(**{**GAINS, "K_P": [[1], [1, 2]]}), "`K_P` must be real numbers in "),
        (lambda: ft.PIGains(**{**GAINS, "K_I": [[HUGE]]}), "`K_I` must be real numbers in rows "),
        (lambda: ft.loop.indicators("x"), "`A_K` must be numbers, got 'x'."),
        (lambda: ft.Scenario(title=1), "Scenario: `title` must be a valid string, got 1; "),
        (lambda: ft.Campaign(runs=1.5), "Campaign: `runs` must be a valid integer, got 1.5; "),
        (lambda: ft.certify("paper_as_printed", ft.PAPER_GAINS, L_d=1e308), "`L_d` must be at "),
        (lambda: ft.loop.Sensors(bias="x" * 5000), "`bias` must be 3 finite numbers, got xxx"),
        (
            lambda: ft.loop.Sensors(noise_sd=np.full((2, 2), 1e308)),
            "`noise_sd` must be 3 finite numbers, got [[1.e+308 1.e+308] [1.e+308 1.e+308]].",
        ),
        (lambda: ft.loop.LaggedPlant(object(), ()), "`plant` must be a Plant, got an object."),
        (
            lambda: replace(ft.loop.Limits.none(2), lower=np.zeros((1, 2))),
            "`lower` must have 1 axis, ",
        ),
        (
            lambda: ft.loop.CommandLimiter(ft.loop.Limits.none(2), 0.1).start([0.0]),
            "`u` must be 2 finite numbers, got [0.0].",
        ),
        (
            lambda: ft.loop.CommandLimiter(ft.loop.Limits.none(2), 0.1).start([0.0, np.nan]),
            "`u` must be 2 finite numbers, got [0.0, nan].",
        ),
        (
            lambda: ft.plan_campaign(ft.load_campaign("first_campaign"), runs=4).values_of(9),
            "`draw` must be 0 to ",
        ),
    ],
)
def test_a_call_of_another_kind_says_name_demand_and_value(call, line):
    with pytest.raises(ft.InputError) as refusal:
        call()

    assert str(refusal.value).startswith(line)
    assert "\n" not in str(refusal.value)


def test_numbers_of_numpy_and_paths_are_taken_as_those_of_python(tmp_path):
    scenario = ft.load_scenario("level_turn", changes={"flight.V_a_mps": np.float64(25.0)})

    assert ft.plan_campaign(ft.load_campaign("first_campaign"), runs=np.int64(4)).runs == 4
    assert ft.loop.FlightCondition(V_a=np.float32(25.0), h=np.int64(3)).V_a == 25.0
    assert ft.flights(scenario).scenario.title == scenario.title
    with pytest.raises(ft.ScenarioError, match="must be readable"):
        ft.load_gains(tmp_path / "gone.json")
