"""Signals that a recording derives: the parts of the gap, and the distance from the law."""

import numpy as np
import pytest

from flighttune.gaps.residual import mismatch
from flighttune.outputs.recording import plots
from flighttune.outputs.recording.entities import runs_to_draw

HALF_A_SAMPLE = 0.006
"""Part of a mean over an interval from the value at its end, rad/s."""


def test_the_parts_of_the_gap_add_up_to_what_the_law_leaves_out(four_runs):
    kinematic, aircraft = plots.with_derived(runs_to_draw(four_runs[:2]))
    d = mismatch(aircraft.run).d
    for i, channel in enumerate(("chi", "gamma")):
        parts = sum(aircraft.run.signals[f"{part}_{channel}"] for part in plots.PARTS).to_numpy()
        assert parts[:-1] == pytest.approx(d[:, i], abs=HALF_A_SAMPLE)
        assert np.abs(d[:, i]).max() > 10.0 * HALF_A_SAMPLE
    assert "distance" not in kinematic.run.signals
    apart = aircraft.run.signals[["north", "east", "down"]].to_numpy()
    apart = apart - kinematic.run.signals[["north", "east", "down"]].to_numpy()
    distance = aircraft.run.signals["distance"].to_numpy()
    assert distance == pytest.approx(np.linalg.norm(apart, axis=1))
    height = kinematic.run.signals["h"].to_numpy() + kinematic.run.signals["down"].to_numpy()
    assert height == pytest.approx(1000.0)
