"""Charts over time and of the path: tracking, commands with limits, paths, certificates."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.claims.linear_loop import LinearBound
from flighttune.flight.expectations import envelopes
from flighttune.present.chart import DASHED, DOTTED, MAX_DRAWN, Chart
from flighttune.present.names import shown_unit
from flighttune.present.palette import LIMIT, NEUTRAL, LineStyle
from flighttune.recording.plots import displayed, limits_of
from flighttune.references.follow import ROUTE_SIGNALS
from flighttune.simulate.run import SIGNAL_UNITS, Run, claims_around

ANGLES = (
    ("chi", "Course; reference grey", "χ [deg]"),
    ("gamma", "Path angle; reference grey", "γ [deg]"),
    ("V_a", "Airspeed; reference grey", "V [m/s]"),
)
ERRORS = (
    ("chi_err", "Course error", "e_χ [deg]"),
    ("gamma_err", "Path-angle error", "e_γ [deg]"),
    ("V_err", "Airspeed error", "e_V [m/s]"),
)
COMMANDS = (
    ("phi", "Roll command; limits dashed, bars: limited", "φ_cmd [deg]"),
    ("n_z", "Load-factor command; limits dashed, bars: limited", "n_z,cmd [1]"),
    ("n_x", "Longitudinal load-factor command; limits dashed, bars: limited", "n_x,cmd [1]"),
)
FLOWN = (("phi", "Roll", "φ [deg]"), ("n_z", "Load factor", "n_z [1]"))

# Height of the bar of one run as a part of the panel.
LANE = 0.035

FEW_RUNS = 4

# An envelope is drawn where its bound is at most so many times the largest error.
FAR = 2.0

# Lower end of the logarithmic axis of ``||s||``.
FLOOR = 1e-4

TINY = 1e-9

# Bars that fit next to each other in a flight.
FINEST = 300


# Runs that flew and are drawn together, each with its line.
Drawn: TypeAlias = Sequence[tuple[Run, LineStyle]]


def most_points(runs: int) -> int:
    """Points a line may have, so that the page of many long runs stays small."""
    return MAX_DRAWN * FEW_RUNS // max(FEW_RUNS, runs)


def tracking(flights: Drawn) -> list[Chart]:
    """Course and path angle with their references."""
    longest = max((run for run, _ in flights), key=lambda run: run.duration)
    charts = []
    for signal, title, unit in ANGLES:
        followed = "V_ref" if signal == "V_a" else f"{signal}_ref"
        if followed not in longest.signals:
            continue
        chart = over_time(flights, title, unit)
        reference = displayed(longest.signals, followed)
        chart.line(longest.t, reference, NEUTRAL, width=2.2, most=most_points(len(flights)))
        charts.append(_with_runs(chart, flights, signal))
    return charts


def errors(flights: Drawn) -> list[Chart]:
    """Both errors with what is claimed of them, and other signals of which something is claimed."""
    charts = []
    for signal, title, unit in ERRORS:
        if not any(signal in run.signals for run, _ in flights):
            continue  # logs of real flights, which may not say what they follow
        chart = over_time(flights, title, unit)
        chart.level(0.0, NEUTRAL, dash="")
        for run, style in flights:
            draw_bounds(chart, run, run.t, signal, style.colour)
        charts.append(_with_runs(chart, flights, signal))
    with_charts = {*ROUTE_SIGNALS, *(signal for signal, *_ in ERRORS)}
    claimed = {
        name: claim.units[name]
        for run, _ in flights
        for claim in run.claims
        for name in claim.bounds.names
        if name not in with_charts
    }
    for signal, si_unit in claimed.items():
        bounded = [(run, style) for run, style in flights if any(claims_around(run.claims, signal))]
        chart = over_time(bounded, signal, f"{signal} [{shown_unit(si_unit)[0]}]")
        for run, style in bounded:
            draw_bounds(chart, run, run.t, signal, style.colour)
        charts.append(_with_runs(chart, bounded, signal))
    return charts


def draw_bounds(chart: Chart, run: Run, x: FloatArray, signal: str, colour: str) -> None:
    """Bounds of a signal: a tube in the colour of its run, a band grey, envelopes required red."""
    for claim, ends in claims_around(run.claims, signal):
        low, high = shown_unit(claim.units[signal])[1] * ends
        counted = claim.kind == "counted"
        chart.band(x, low, high, NEUTRAL if counted else colour, run=run.label, name=claim.title)
        for edge in (low, high) if counted else ():
            chart.line(x, edge, NEUTRAL, run=run.label, dash=DOTTED, width=1.2, hover=False)
    for bound in envelopes(run, signal):
        factor = shown_unit(SIGNAL_UNITS[signal])[1]
        error = run.signals[signal].abs().max()
        # A bound far beyond all errors would leave no room for them.
        shown = factor * np.where(bound > FAR * max(error, bound.min()), np.nan, bound)
        for edge in (-shown, shown):
            chart.line(x, edge, LIMIT, run=run.label, dash=DASHED, width=1.2, hover=False)
        if (entry := ("required envelope", LIMIT, DASHED)) not in chart.legend:
            chart.legend.append(entry)


def commands(flights: Drawn) -> list[Chart]:
    """Commands after their limits, the limits, and bars while a command is limited."""
    charts = []
    for name, title, unit in COMMANDS:
        if not all(f"{name}_cmd" in run.signals for run, _ in flights):
            continue
        chart = _with_runs(over_time(flights, title, unit), flights, f"{name}_cmd")
        limits = limits_of(flights[0][0].provenance.scenario, name) or ()
        for limit in limits:
            chart.level(limit)
        low, high = chart.y_ends()
        room = LANE * (len(flights) + 1)
        chart.y_range = low - room / (1.0 - room) * (high - low), high
        for place, (run, style) in enumerate(flights):
            limited = run.signals[f"{name}_limited"].to_numpy() != 0.0
            chart.spans(_spans(run.t, limited), LANE * (place + 0.8), style.colour, run=run.label)
        charts.append(chart)
    return charts


def paths(flights: Drawn) -> list[Chart]:
    """The paths from above, and their heights."""
    height = over_time(flights, "Height over the start", "height [m]")
    for run, style in flights:
        down = run.signals["down"].to_numpy()
        height.run_line(run.t, -down, style, run.label, most=most_points(len(flights)))
    return [_from_above(flights), height]


def flown_signals(
    flights: Drawn, signals: Sequence[tuple[str, str, str]] = FLOWN
) -> Iterator[Chart]:
    """Signals (name, title and unit) of flights over time, with their limits."""
    for name, title, unit in signals:
        chart = over_time(flights, title, unit)
        for limit in limits_of(flights[0][0].provenance.scenario, name) or ():
            chart.level(limit)
        having = [(run, style) for run, style in flights if name in run.signals]
        yield _with_runs(chart, having, name)


def certificate_panels(flights: Drawn, bounds: Mapping[str, LinearBound]) -> list[Chart]:
    """The norm of s against its bound on the linear loop, a chart per gain set."""
    charts = []
    for name in dict.fromkeys(run.provenance.gains_name for run, _ in flights):
        compared = [
            (run, style, bounds[run.label])
            for run, style in flights
            if run.provenance.gains_name == name and run.label in bounds
        ]
        if not compared:
            continue
        chart = Chart(
            title=f"{name}: ‖s‖ of the law, bound of the linear loop dashed",
            y="‖(e′, e)‖ [rad/s, rad]",
            x_range=(0.0, max(run.duration for run, *_ in compared)),
            log="y",
            linked=True,
        )
        look: dict[str, Any] = {"most": most_points(len(flights))}
        for run, style, curve in compared:
            label = run.label
            chart.run_line(curve.t, np.maximum(curve.size, TINY), style, label, dash="", **look)
            chart.run_line(curve.t, curve.bound, style, label, dash=DASHED, width=1.2, **look)
            if curve.radius > 0.0:
                chart.level(curve.radius, style.colour, dash=DOTTED, run=label)
        low, high = chart.y_ends()
        chart.y_range = max(low, FLOOR), high
        charts.append(chart)
    return charts


def over_time(flights: Drawn, title: str, unit: str) -> Chart:
    """An empty chart over the longest flight."""
    longest = max(run.duration for run, _ in flights)
    return Chart(title=title, y=unit, x_range=(0.0, longest), linked=True)


def _with_runs(chart: Chart, flights: Drawn, signal: str) -> Chart:
    for run, style in flights:
        if signal not in run.signals:
            continue
        chart.run_line(
            run.t, displayed(run.signals, signal), style, run.label, most=most_points(len(flights))
        )
    return chart


def _from_above(flights: Drawn) -> Chart:
    """North up, or to the right where the flight is longer that way."""
    points = np.vstack([run.signals[["north", "east"]].to_numpy() for run, _ in flights])
    north, east = np.ptp(points, axis=0)
    x, y = ("north", "east") if north > east else ("east", "north")
    chart = Chart(
        title="From above, start at the cross",
        x=f"{x} [m]",
        y=f"{y} [m]",
        equal=True,
        downwards=y == "east",  # with north to the right, east is down
    )
    for run, style in flights:
        across, up = (run.signals[name].to_numpy() for name in (x, y))
        chart.run_line(across, up, style, run.label, most=most_points(len(flights)))
    chart.points(0.0, 0.0, NEUTRAL, shape="plus", size=6)
    return chart


def _spans(t: FloatArray, flag: np.ndarray) -> Sequence[tuple[float, float]]:
    """Start and end of every stretch in which `flag` is true; close ones are joined."""
    edges = np.flatnonzero(np.diff(flag.astype(int), prepend=0, append=0))
    ends = np.append(t, t[-1])[edges].tolist()
    spans: list[tuple[float, float]] = []
    for start, end in zip(ends[::2], ends[1::2], strict=True):
        if spans and start - spans[-1][1] < t[-1] / FINEST:
            start = spans.pop()[0]
        spans.append((start, end))
    return spans
