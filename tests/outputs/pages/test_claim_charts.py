"""Charts of claims and of runs show both errors in degrees, with the legend of their runs."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.flight.loop.run import Bounds
from flighttune.outputs.pages.tube import tube_charts

T = 0.1 * np.arange(31)


def test_a_tube_is_drawn_between_its_bounds_in_degrees():
    low = np.column_stack([-0.1 - 0.01 * T, 5.0 + T, -0.2 + 0.0 * T])
    high = np.column_stack([0.3 + 0.02 * T, 6.0 + T, 0.4 + 0.0 * T])
    bounds = Bounds(T, low, high, ("gamma_err", "V_a", "chi_err"))

    course, path_angle = tube_charts(SimpleNamespace(bounds=bounds))

    for chart, title, i in ((course, "Course error", 2), (path_angle, "Path-angle error", 0)):
        assert chart.title == title
        assert chart.x_range == (0.0, pytest.approx(3.0))
        (_, zero), *curves = chart._seen
        assert zero.tolist() == [0.0]
        for (x, y), wanted in zip(curves, (low, high) * 2, strict=True):
            assert x == pytest.approx(T)
            assert y == pytest.approx(np.degrees(wanted[:, i]))
        assert [name for name, *_ in chart.legend] == ["tube"]


def test_a_plot_of_runs_has_their_errors_and_angles_with_those_that_flew_in_the_legend():
    names = ("chi_err", "gamma_err", "phi", "n_z")
    flown, other, none = (
        made_up_run(dict.fromkeys(names, 0.1 * T[:n]), T[:n], gains_name=gains)
        for n, gains in ((31, "paper"), (11, "K1"), (1, "K2"))
    )

    charts = ft.plot([flown, other, none]).charts

    assert [chart.title for chart in charts] == [
        "Course error", "Path-angle error", "Roll", "Load factor"
    ]  # fmt: skip
    for chart, factor in zip(charts, [*np.degrees([1.0] * 3), 1.0], strict=True):
        first, second = (y for _, y in chart._seen if len(y) > 1)
        assert (first[-1], second[-1]) == pytest.approx((0.3 * factor, 0.1 * factor))
        assert [name for name, *_ in chart.legend] == [flown.label, other.label]
    with pytest.raises(ft.InputError, match="must have a run that flew"):
        ft.plot(none)
