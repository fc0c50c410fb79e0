"""The monitor in C, compiled by the system's compiler: score and alarm of the program."""

import ctypes
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import answer
from made_up import made_up_run
from watched import flown, turn

import flighttune as ft
from flighttune.claims.monitor import Watching
from flighttune.gaps import watch
from flighttune.outputs.exports.export import monitor_source
from tests.outputs.exports.test_c_source import library, needs_compiler

pytestmark = needs_compiler

SAME = 1e-9
DT = 0.04


class State(ctypes.Structure):
    """The beginning of `struct ft_monitor`, and room for its rest."""

    _fields_ = (
        *((name, ctypes.c_double) for name in ("score", "at")),
        ("why", ctypes.c_int),
        ("rest", ctypes.c_double * 2000),
    )


def in_c(source, run, folder):
    """Scores of the samples of a run by a C file, and its alarm."""
    loaded, state, number = library(source, folder), State(), ctypes.c_double
    loaded.ft_monitor_step.restype, loaded.ft_monitor_name.restype = number, ctypes.c_char_p
    names = re.search(r"struct ft_monitor_sample \{\s+double (.*?);", source)[1].split(", ")
    loaded.ft_monitor_start(ctypes.byref(state))
    scores = [
        loaded.ft_monitor_step(ctypes.byref(state), (number * len(names))(*row))
        for row in run.signals[names].to_numpy().tolist()
    ]
    name = loaded.ft_monitor_name(state.why).decode() if state.why >= 0 else ""
    return np.array(scores), (state.at, name)


class MadeUp(Watching):
    sentence = "a */ claim"

    def __init__(self, models, count, from_s):
        rng = np.random.default_rng(8)
        self._watches = tuple(
            watch.Watch(
                models=tuple(
                    replace(model, weights=tuple(rng.normal(size=len(model.terms))))
                    for model in models
                ),
                middle=rng.normal(size=len(models)),
                half=rng.uniform(5.0, 50.0, len(models)),
                from_s=from_s,
            )
            for _ in range(count)
        )

    @property
    def watches(self):
        return self._watches


@pytest.mark.parametrize("models", [watch.MODELS, watch.OF_LOGS[:6]], ids=["of flights", "of logs"])
@pytest.mark.parametrize(("count", "from_s"), [(1, 0.0), (3, 1.0)])
def test_any_model_scores_as_in_the_program(models, count, from_s, tmp_path):
    monitor = MadeUp(models, count, from_s)
    names = watch.signals_of(models)
    walks = np.cumsum(0.05 * np.random.default_rng(9).normal(size=(len(names), 400)), axis=1)
    level = [[20.0 * (name in ("V_a", "V_g"))] for name in names]
    run = made_up_run(dict(zip(names, walks + level, strict=True)), DT * np.arange(400))

    scores, alarm = in_c(monitor_source(monitor, title="t", dt=DT), run, tmp_path)

    expected = watch.score_so_far(monitor.watches, run)
    assert scores[-len(expected) :] == pytest.approx(expected, abs=SAME, rel=SAME)
    assert not scores[: -len(expected)].any()
    at_s, why = monitor.alarm(run) or (-1.0, "")
    assert alarm == (pytest.approx(at_s), why)


def test_a_file_says_why_its_claim_does_not_cover_a_scenario():
    monitor = MadeUp(watch.MODELS, 1, 0.0)

    of_others = monitor_source(monitor, title="t", dt=DT, no_claim="other air")

    said = "No claim about flights of this scenario: other air. It was counted on others: a * / cla"
    assert said in of_others
    assert "No claim" not in monitor_source(monitor, title="t", dt=DT)


FLIGHT_S, FAULT_S = 12.0, 3.0


@pytest.mark.soak
def test_the_file_beside_the_loop_alarms_as_the_recorded_flight_does(tmp_path):
    few = {"epsilon": 0.3, "confidence": 0.9, "learn": 20, "workers": 1}
    changes = {"flight.duration_s": FLIGHT_S}
    monitor = ft.monitor("level_turn", start_deg=2.0, changes=changes, **few)
    monitor.save(tmp_path / "m.npz")
    options = "--gains", "paper", "--format", "c", "--claim", tmp_path / "m.npz"
    made = answer("export", "level_turn", *options, "--out", tmp_path / "out")
    source = Path(made["monitor"]).read_text(encoding="utf-8")
    for engine in ({}, {"throttle_max": 0.06, "throttle_max_from_s": FAULT_S}):
        run = flown(turn(FLIGHT_S, 0.3, -0.3, **engine))

        scores, (at_s, why) = in_c(source, run, tmp_path)

        claim = monitor.on(run)
        assert scores == pytest.approx(claim.signals["alarm_score"], abs=SAME)
        assert (scores[-1] > 1.0) == (claim.alarm is not None) == bool(engine)
        if engine:
            assert (at_s, why) == (pytest.approx(claim.alarm.at_s), claim.alarm.why)
            assert FAULT_S <= at_s < FLIGHT_S
        else:
            assert why == ""


@pytest.mark.parametrize("claim", [MadeUp(watch.MODELS, 1, 0.0), 1.0], ids=["made up", "a number"])
def test_a_claim_that_is_no_monitor_is_refused(tmp_path, claim):
    with pytest.raises(ft.InputError, match="`claim` must be a Monitor or a LogMonitor or"):
        ft.export("level_turn", "paper", out=tmp_path, form="c", claim=claim)
