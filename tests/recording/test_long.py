"""Long flights: what a recording of them weighs, and that nothing of them is lost."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from flighttune.control.gains import PAPER_GAINS
from flighttune.present.thinning import MOST
from flighttune.recording.record import write_recording
from flighttune.simulate.run import SIGNAL_UNITS

from .conftest import fly
from .test_rrd import Contents

pytestmark = pytest.mark.slow

LARGEST = 30e6
"""Bytes of 600 s at 50 Hz with 40 signals."""


@pytest.fixture(scope="module")
def ten_minutes():
    """Signals that do not compress, on a flight of 600 s."""
    run = fly("kinematic", "paper", PAPER_GAINS, seconds=2.0)
    t = np.arange(30_001) * 0.02
    names = list(SIGNAL_UNITS)[:40]
    noise = 0.2 * np.random.default_rng(1).normal(size=(len(t), len(names)))
    signals = pd.DataFrame(noise, columns=names, index=pd.Index(t, name="t"))
    signals["V_a"] = 25.0
    signals["north"], signals["east"], signals["down"] = 20.0 * t, 5.0 * t, -t
    for name in ("phi_limited", "n_z_limited"):
        signals[name] = (np.sin(t) > 0.9).astype(float)
    return replace(run, signals=signals)


def test_ten_minutes_are_drawn_with_every_peak_in_thirty_megabytes(ten_minutes, tmp_path):
    path = tmp_path / "long.rrd"
    write_recording([ten_minutes], path, page="# Long\n", title="Long")
    drawn = Contents(path).values("/plots/alpha/kinematic_paper")[:, 0]
    alpha = np.rad2deg(ten_minutes.signals["alpha"].to_numpy())

    assert path.stat().st_size < LARGEST
    assert MOST <= len(drawn) <= 1.1 * MOST
    assert drawn.min() == alpha.min()
    assert drawn.max() == alpha.max()
