"""Convergence as the report understands it, and its panels, bars and words."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from made_up import made_up_run

from flighttune.outputs.drawing.palette import LineStyle
from flighttune.outputs.pages import campaign_charts, meet, panels
from flighttune.outputs.pages.panels import final_errors


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
def test_bars_of_a_limited_command_join_those_that_nobody_could_tell_apart(pairs, spans):
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

    # two bars and a half of 0.035 below lines from -45 to 57.3 deg with a twentieth of room
    most, room = np.degrees(1.0), 0.105
    low, high = -45.0 - 0.05 * (most + 45.0), most + 0.05 * (most + 45.0)
    assert chart.y_range == pytest.approx((low - room / (1.0 - room) * (high - low), high))
    bars = re.findall(r'd="M([\d.]+),([\d.]+)H([\d.]+)" stroke', chart.svg())
    lanes = np.array(bars, dtype=float)[-2:]
    assert lanes[:, 0] == pytest.approx([196.0, 196.0], abs=0.1)
    assert lanes[:, 1] == pytest.approx(192.0 * (1.0 - 0.035 * np.array([0.8, 1.8])), abs=0.1)


def test_runs_that_did_not_fly_come_last_and_have_no_metrics():
    signals = {name: np.zeros(3) for name in ("V_a", "n_z", "phi", "gamma", "chi")}
    (flown, _), (begun, _) = flights(signals, {name: x[:1] for name, x in signals.items()})

    first, last = panels.runs_table([begun, flown]).records

    assert (first["flown_s"], last["flown_s"]) == (pytest.approx(0.2), 0.0)
    assert set(first) > set(last) == {"run", "flown_s", "outcome"}


@pytest.mark.parametrize(
    ("values", "bounds", "ends", "log"),
    [
        ([2.0, 4.0, 12.0], [8.0], (1.6, 12.4), ""),
        ([2.0, 4.0], [12.0], (1.6, 12.4), ""),
        ([4.0, 12.0], [2.0], (1.6, 12.4), ""),
        ([2.0, 61.0], [], (2.0 / 1.1, 67.1), "x"),
        ([2.0, 60.0], [], (2.0 - 2.32, 60.0 + 2.32), ""),
        ([-2.0, 90.0], [], (-2.0 - 3.68, 90.0 + 3.68), ""),
        ([], [5.0], (4.5, 5.5), ""),
        ([0.0], [], (-1.0, 1.0), ""),
        # of 100 times 1001 values the outer 500 of each side are left out
        (np.arange(1001.0) - 500.0, [], (-495.0 - 39.6, 495.0 + 39.6), ""),
    ],
)
def test_an_axis_of_a_distribution_holds_bounds_and_all_but_its_outermost_values(
    values, bounds, ends, log
):
    """0.5 % at either end; logarithmic where the largest is over 30 times the smallest."""
    each = [np.full(100, value) for value in values]

    found, axes = campaign_charts._scale(each, bounds)

    assert found == pytest.approx(ends)
    assert axes == log


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


def test_candidates_are_drawn_by_their_share_in_their_order():
    trials = [SimpleNamespace(worst=np.array(x)) for x in ([0.1, 0.0, -1.0, 2.0], [-1.0] * 4)]

    chart = meet.share_chart(trials, 0.9)

    (order, shares), (_, wanted) = chart._seen
    assert (order.tolist(), shares.tolist()) == ([1.0, 2.0], [50.0, 100.0])
    assert wanted == pytest.approx(90.0)
