"""Whatever a user gives to a public name from Python, what comes back is one line in our words."""

import os
import random
import signal
import sys
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from misused import misused, wrong

import flighttune as ft


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
