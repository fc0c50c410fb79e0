"""What a lane says of a run: limits that hold its commands, and the bound of a law."""

import numpy as np
import pytest

from flighttune.gaps.mismatch import mismatch
from flighttune.recording.entities import runs_to_draw
from flighttune.recording.plots import PARTS, with_derived


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
