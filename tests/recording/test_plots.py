"""Axes of plots reach over all that is drawn, and far enough for two labels."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from flighttune.recording.plots import LABELS, TABS, value_range

ROOM_FOR = 7.0  # labels
SHARE = (ROOM_FOR + 2.0) / LABELS
PLOTS = {plot.signal: plot for plots in TABS.values() for plot in plots}


def with_signal(run, **values):
    size = len(next(iter(values.values())))
    index = pd.Index(np.arange(size) * 0.02, name="t")
    return replace(run, signals=pd.DataFrame(values, index=index, dtype=float))


@pytest.mark.parametrize(
    "values",
    [
        [-9.0, 9.0],
        [-2.0, 9.0],
        [0.11, 0.19],
        [1001.0, 1009.0],
        [-0.004, 0.0003],
        [3.0, 3.2],
        [1.22, 1.300665539522204],
        [0.0, np.inf, 10.0],
    ],
)
def test_an_axis_has_two_labels_and_all_values(four_runs, values):
    low, high = value_range(PLOTS["V_a"], [with_signal(four_runs[0], V_a=values)], share=SHARE)
    values = [value for value in values if math.isfinite(value)]
    span = max(values) - min(values)
    step = next(10.0**k for k in range(-9, 9) if 10.0**k * ROOM_FOR >= span)

    assert low < min(values)
    assert high > max(values)
    assert math.floor(high / step) - math.ceil(low / step) >= 1


def test_an_axis_reaches_over_limits_and_reference(four_runs):
    small = with_signal(four_runs[0], phi=[0.0, 0.1], phi_cmd=[0.0, 0.1])
    low, high = value_range(PLOTS["phi"], [small], share=SHARE)

    assert low < -45.0
    assert high > 45.0
    course = with_signal(four_runs[0], chi=[0.0, 0.1], chi_ref=[1.0, 1.0])
    assert value_range(PLOTS["chi"], [course], share=SHARE)[1] > np.rad2deg(1.0)
