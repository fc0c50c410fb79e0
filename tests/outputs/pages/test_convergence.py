"""Convergence as the report understands it, and its panels, bars and words."""

import math
import re

import numpy as np
import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.outputs.drawing.palette import LineStyle
from flighttune.outputs.pages import campaign_charts, meet, panels
from flighttune.outputs.pages.panels import final_errors
from flighttune.studies.meeting import Trial


@pytest.mark.parametrize(
    ("first", "last", "status", "converges"),
    [
        (1.0, 0.04, "completed", True),
        (1.0, 0.06, "completed", False),
        (0.01, 0.008, "completed", True),
        (1.0, 0.04, "left_envelope", False),
    ],
)
def test_a_run_converges_if_the_last_quarter_is_within_5_percent_or_half_a_degree(
    first, last, status, converges
):
    errors = np.full(1001, first)
    errors[700:] = last
    columns = {"chi_err": errors, "gamma_err": errors}

    late = final_errors(made_up_run(columns, np.arange(1001) * 0.01, status=status))

    assert late["converges"] is converges
    assert late["residual"]["chi"] == pytest.approx(last)
    assert late["allowed"]["gamma"] == pytest.approx(max(0.05 * first, np.deg2rad(0.5)))


@pytest.mark.parametrize(
    ("pairs", "spans"),
    [
        ([(10.0, 11.0), (20.0, 21.0)], [(10.0, 11.0), (20.0, 21.0)]),
        ([(10.0, 11.0), (11.2, 12.0)], [(10.0, 12.0)]),  # less than 1/300 of 90 s apart
        ([(10.0, 11.0), (11.4, 12.0), (12.1, 13.0)], [(10.0, 11.0), (11.4, 13.0)]),
        ([(80.0, 91.0)], [(80.0, 90.0)]),
        ([], []),
    ],
)
def test_bars_of_a_limited_command_are_joined_over_gaps_too_narrow_to_see(pairs, spans):
    t = 0.1 * np.arange(901)
    flag = np.any([(t > low - 0.05) & (t < high - 0.05) for low, high in pairs] or [t < 0], axis=0)

    assert panels._spans(t, flag) == [pytest.approx(span) for span in spans]


@pytest.mark.parametrize(
    ("start", "reference", "words"),
    [
        (10.0, [10.0, 10.04, 9.96], "stays at 10°"),
        (0.0, [20.0, 60.0], "goes from 0° to 60°"),
        (60.0, [60.0, 20.0, 0.0], "goes from 60° to 0°"),
        (0.0, [30.0, 0.0], "goes from 0° to 30° and back"),
        (0.0, [-30.04, 0.0], "goes from 0° to -30° and back"),
        (0.0, [-30.0, 30.0, 0.0], "moves between -30° and 30°"),
        (5.0, [-30.0, 30.0, 0.0], "moves between -30° and 30°"),
    ],
)
def test_a_reference_is_said_by_its_ends_and_extremes_in_tenths_of_a_degree(
    start, reference, words
):
    said = panels._moves("course", np.radians(start), np.radians(reference))

    assert said == f"the course {words}"


def test_successes_are_counted_by_plant():
    counts = [("kinematic", 1, 2), ("jsbsim:x", 0, 2), ("kinematic", 1, 1)]

    assert panels.by_plant(counts) == "kinematic 2/3, jsbsim:x 0/2"
    assert [panels.most_points(runs) for runs in (1, 4, 5, 8, 600)] == [600, 600, 480, 300, 4]


LINE = LineStyle("#1F78B4", "blue", 2.0, dashed=False)


def flights(*columns, scenario=None, **more):
    """Runs of these signals at 10 Hz with a line each."""
    times = [0.1 * np.arange(len(next(iter(each.values())))) for each in columns]
    return [
        (made_up_run(each, t, scenario=scenario, **more), LINE)
        for each, t in zip(columns, times, strict=True)
    ]


def test_a_panel_reaches_to_the_end_of_the_longest_flight_and_of_the_longest_reference():
    short, long = np.full(100, 0.5), np.full(301, 0.2)
    both = flights({"phi": long}, {"phi": short, "phi_cmd": short})

    chart = panels.panel(both, "phi", "; note", reference="phi_cmd", zero=True)

    assert chart.x_range == (0.0, pytest.approx(30.0))
    assert chart.title.endswith("; note")
    (x, reference), (_, zero), *lines = chart._seen
    assert x[-1] == pytest.approx(9.9)
    assert reference == pytest.approx(np.degrees(short))
    assert zero.tolist() == [0.0]
    assert [len(y) for _, y in lines] == [301, 100]


@pytest.mark.parametrize(("north", "east"), [(500.0, 80.0), (80.0, 500.0)])
def test_the_longer_way_of_a_path_is_drawn_across(north, east):
    t = np.linspace(0.0, 1.0, 50)
    places = {"north": north * t, "east": east * t, "down": -30.0 * t}

    above, height = panels.paths(flights(places, {"phi": t}))

    across, up = ("north", "east") if north > east else ("east", "north")
    assert (above.x, above.y) == (f"{across} [m]", f"{up} [m]")
    assert above.downwards == (across == "north")
    (x, y), (x_0, y_0) = above._seen
    assert (x, y) == (pytest.approx(places[across]), pytest.approx(places[up]))
    assert (x_0.tolist(), y_0.tolist()) == ([0.0], [0.0])
    assert height._seen[0][1] == pytest.approx(30.0 * t)
    assert panels.paths(flights({"phi": t})) == []


def test_commands_have_bars_below_their_lines_while_they_are_limited():
    command, limited = np.linspace(0.0, 1.0, 101), np.arange(101) >= 50
    names = {"phi_cmd": command, "phi_limited": limited}
    limits = {"limits": {"phi_deg": [-45.0, 45.0]}}

    (chart,) = panels.commands(flights(names, names, scenario=limits))

    bars = np.array(re.findall(r'd="M([\d.]+),([\d.]+)H([\d.]+)" stroke', chart.svg()), dtype=float)
    starts, lanes, _ = bars[-2:].T
    assert starts == pytest.approx([196.0, 196.0], abs=0.1)  # the middle of 392 pixels
    low, high = chart.y_range
    lowest_line = 192.0 * (high + 45.0) / (high - low)  # the limit, pixels from the top
    # strokes of 4 pixels meet neither each other nor the line nor the edge
    assert np.diff([lowest_line, *sorted(lanes), 192.0]).min() > 4.0


def test_runs_that_did_not_fly_come_last_and_have_no_metrics():
    signals = {name: np.zeros(3) for name in ("V_a", "n_z", "phi", "gamma", "chi")}
    (flown, _), (begun, _) = flights(signals, {name: x[:1] for name, x in signals.items()})

    first, last = panels.runs_table([begun, flown]).records

    assert (first["flown_s"], last["flown_s"]) == (pytest.approx(0.2), 0.0)
    assert set(first) > set(last) == {"run", "flown_s", "outcome"}


@pytest.mark.parametrize(
    ("values", "bounds", "shown", "log"),
    [
        ([2.0, 4.0, 12.0], [8.0], (2.0, 12.0), ""),
        ([2.0, 4.0], [12.0], (2.0, 12.0), ""),
        ([4.0, 12.0], [2.0], (2.0, 12.0), ""),
        ([2.0, 61.0], [], (2.0, 61.0), "x"),
        ([2.0, 60.0], [], (2.0, 60.0), ""),
        ([-2.0, 90.0], [], (-2.0, 90.0), ""),
        ([], [5.0], (5.0, 5.0), ""),
        ([0.0], [], (0.0, 0.0), ""),
        # of 100 times 1001 values the outer 500 of each side are left out
        (np.arange(1001.0) - 500.0, [], (-495.0, 495.0), ""),
    ],
)
def test_an_axis_of_a_distribution_holds_bounds_and_all_but_its_outermost_values(
    values, bounds, shown, log
):
    """0.5 % at either end; logarithmic where the largest is over 30 times the smallest."""
    each = [np.full(100, value) for value in values]

    (low, high), axes = campaign_charts._scale(each, bounds)

    assert axes == log
    assert low < shown[0] <= shown[1] < high
    # a distribution fills most of its axis
    wide = (
        (math.log(high / low), math.log(shown[1] / shown[0]))
        if log
        else (high - low, np.ptp(shown))
    )
    assert wide[1] == 0.0 or wide[0] < 1.1 * wide[1]


@pytest.mark.parametrize(
    ("values", "row", "ends"),
    [
        # bound, start and result span 4, by which the axis goes on to both sides at most
        ([3.0, 8.0], {"bound": 4.0, "start": 6.0, "value": 2.0}, (2.0 - 0.3, 8.0 + 0.3)),
        ([-90.0, 90.0], {"bound": 4.0, "start": 6.0, "value": 2.0}, (-2.0 - 0.6, 10.0 + 0.6)),
        ([np.nan], {"bound": 4.0, "start": np.inf, "value": np.nan}, (0.0, 8.0)),
        ([np.nan], {"bound": 0.0, "start": np.inf, "value": np.nan}, (-1.0, 1.0)),
    ],
)
def test_an_axis_of_candidates_has_what_is_marked_and_as_much_beyond(values, row, ends):
    assert meet._range(np.array(values), row) == pytest.approx(ends)


def test_candidates_are_drawn_in_their_order_by_the_share_of_draws_without_an_excess():
    excess = [[0.1, 0.0, -1.0, 2.0], [-1.0] * 4]  # of one requirement on four draws
    trials = [
        Trial(gains=ft.PAPER_GAINS, excess=np.transpose([of_trial]), checks=())
        for of_trial in excess
    ]

    chart = meet.share_chart(trials, 0.9)

    (order, shares), (_, wanted) = chart._seen
    assert (order.tolist(), shares.tolist()) == ([1.0, 2.0], [50.0, 100.0])
    assert wanted == pytest.approx(90.0)
