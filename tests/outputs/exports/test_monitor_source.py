"""The monitor in C, compiled by the system's compiler: score and alarm of the program."""

import ctypes
import re
from pathlib import Path

import numpy as np
import pytest
from commands import answer
from watched import flown, turn

import flighttune as ft
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
