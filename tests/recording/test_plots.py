"""Axes of plots reach over all that is drawn, and far enough for two labels."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from flighttune.recording.plots import LABELS, TABS, limits_of, shown_plots, value_range

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


@pytest.mark.parametrize(
    ("values", "share", "ends"),
    [((-2.0, 9.0), SHARE, (-2.0, 10.0)), ((-10.0, 14.0), 4.0 / LABELS, (-10.0, 14.0))],
    ids=["to the next label", "not where that costs too much"],
)
def test_an_axis_is_not_longer_than_it_must_be(four_runs, values, share, ends):
    limits = value_range(PLOTS["V_a"], [with_signal(four_runs[0], V_a=values)], share=share)

    room = 0.05 * (ends[1] - ends[0])
    assert limits == pytest.approx((ends[0] - room, ends[1] + room))


def test_an_axis_reaches_over_limits_and_reference(four_runs):
    small = with_signal(four_runs[0], phi=[0.0, 0.1], phi_cmd=[0.0, 0.1])
    low, high = value_range(PLOTS["phi"], [small], share=SHARE)

    assert low < -45.0
    assert high > 45.0
    course = with_signal(four_runs[0], chi=[0.0, 0.1], chi_ref=[1.0, 1.0])
    assert value_range(PLOTS["chi"], [course], share=SHARE)[1] > np.rad2deg(1.0)


@pytest.mark.parametrize("values", [[25.0, 25.0], [np.nan, np.nan], [0.0, 0.0]])
def test_what_does_not_vary_is_left_to_the_viewer(four_runs, values):
    assert value_range(PLOTS["V_a"], [with_signal(four_runs[0], V_a=values)], share=SHARE) is None


def test_a_scenario_without_limits_has_none():
    assert limits_of({}, "phi") is None
    assert limits_of({"limits": {"phi_rate_dps": 60.0, "phi_deg": None}}, "phi") is None
    assert limits_of({"limits": {"phi_deg": [-45, 45]}}, "phi") == (-45.0, 45.0)


def test_calm_air_has_no_tab_of_its_own(four_runs, in_sinusoid):
    assert "Weather" not in shown_plots(four_runs)
    assert "Weather" in shown_plots([*four_runs, in_sinusoid])


SEEN = {"chi": "chi_meas", "gamma": "gamma_meas", "V_a": "V_a_meas"}


def plots_of(runs):
    return {plot.signal: plot for plots in shown_plots(runs).values() for plot in plots}


def test_what_sensors_showed_stands_behind_the_true_signals_where_there_are_sensors(
    four_runs, sensed
):
    usual, found = plots_of(four_runs), plots_of([four_runs[0], sensed])

    assert all(plot == PLOTS[signal] for signal, plot in usual.items())
    for signal, plot in found.items():
        assert plot.measured == SEEN.get(signal)
        assert plot.heading.endswith("], measured faint" if signal in SEEN else "]")
    assert {signal: plot for signal, plot in found.items() if signal not in SEEN} == {
        signal: plot for signal, plot in usual.items() if signal not in SEEN
    }


def test_an_axis_reaches_over_what_sensors_showed(sensed):
    low, high = value_range(plots_of([sensed])["V_a"], [sensed], share=SHARE)

    assert low < sensed.signals["V_a_meas"].min() < sensed.signals["V_a"].min()
    assert high > sensed.signals["V_a_meas"].max() > sensed.signals["V_a"].max()
