"""What a lane says of a run: limits that hold its commands, and the bound of a law."""

from dataclasses import replace

import numpy as np
import pytest

from flighttune.gaps.mismatch import mismatch
from flighttune.recording.entities import runs_to_draw
from flighttune.recording.lanes import SHORTEST, lane
from flighttune.recording.plots import PARTS, with_derived

from .conftest import DT


def held(run, phi, n_z):
    """The run with its commands held from and to the times given (s), by kind of limit."""
    signals = run.signals.assign(phi_limited=0.0, n_z_limited=0.0)
    for name, spans in (("phi_limited", phi), ("n_z_limited", n_z)):
        for begin, end, kind in spans:
            signals.loc[begin : end - DT / 2.0, name] = kind
    return replace(run, signals=signals)


def at(states, t):
    begun, words = states
    return words[int(np.searchsorted(begun, t, side="right")) - 1]


def test_a_lane_names_the_limits_that_hold(four_runs):
    short = 6.0, 6.0 + SHORTEST / 2.0, 1.0  # left out: nobody would see it
    run = held(four_runs[1], phi=[(1.0, 3.0, 2.0), (3.0, 4.0, 1.0), short], n_z=[(2.0, 3.5, 1.0)])
    states = lane(run)

    wanted = {
        0.5: "within limits",
        1.5: "roll rate",
        2.5: "roll rate, n_z",
        3.2: "roll, n_z",
        3.8: "roll",
        5.0: "within limits",
        6.1: "within limits",
    }
    assert {t: at(states, t) for t in wanted} == wanted


def test_the_parts_of_the_gap_add_up_to_what_the_law_leaves_out(four_runs):
    kinematic, aircraft = with_derived(runs_to_draw(four_runs[:2]))
    d = mismatch(aircraft.run).d
    for i, channel in enumerate(("chi", "gamma")):
        parts = sum(aircraft.run.signals[f"{part}_{channel}"] for part in PARTS).to_numpy()
        # d is a mean over an interval, the parts are at its ends: half a sample apart
        assert parts[:-1] == pytest.approx(d[:, i], abs=0.05)
        assert np.abs(d[:, i]).max() > 0.1
    assert "distance" not in kinematic.run.signals
    apart = aircraft.run.signals[["north", "east", "down"]].to_numpy()
    apart = apart - kinematic.run.signals[["north", "east", "down"]].to_numpy()
    distance = aircraft.run.signals["distance"].to_numpy()
    assert distance == pytest.approx(np.linalg.norm(apart, axis=1))
    height = kinematic.run.signals["h"].to_numpy() + kinematic.run.signals["down"].to_numpy()
    assert height == pytest.approx(1000.0)
