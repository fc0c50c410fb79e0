"""Aircraft and arrows that move in a recording."""

from dataclasses import replace

import numpy as np
import pytest

from flighttune.recording.record import write_recording
from flighttune.recording.scene import INSTANTS, REACH, WIND_TIMES

from .test_rrd import Contents


def gusty(run):
    t = run.signals.index.to_numpy()
    gust = np.where(np.abs(t - 8.0) < 2.0, 2.0 * (1.0 + np.cos(np.pi * (t - 8.0) / 2.0)), 0.0)
    wind = {"wind_north": 3.0 + gust, "wind_east": 0.0 * t, "wind_down": 0.0 * t}
    return replace(run, signals=run.signals.assign(**wind))


@pytest.fixture(scope="module")
def contents(four_runs, tmp_path_factory):
    path = tmp_path_factory.mktemp("motion") / "gust.rrd"
    write_recording([gusty(run) for run in four_runs], path, page="", title="Gust")
    return Contents(path)


def test_arrows_show_velocity_and_wind_to_one_scale(contents, four_runs):
    frame = "/world/aircraft/kinematic_paper"
    velocity = contents.values(f"{frame}/velocity", "Arrows3D:vectors")[:, 0]
    wind = contents.values(f"{frame}/wind", "Arrows3D:vectors")[:, 0]
    run = gusty(four_runs[0]).signals
    scale = np.linalg.norm(velocity[0]) / run["V_a"].iloc[0]

    assert len(velocity) == INSTANTS
    assert REACH > 0.0
    assert np.linalg.norm(velocity, axis=1) == pytest.approx(scale * 25.0, rel=1e-5)
    assert -velocity[:, 2] / np.linalg.norm(velocity, axis=1) == pytest.approx(
        np.sin(run["gamma"].to_numpy()[np.unique(np.linspace(0, 1000, INSTANTS).astype(int))]),
        abs=1e-5,
    )
    assert np.linalg.norm(wind[0]) == pytest.approx(WIND_TIMES * scale * 3.0, rel=1e-5)
