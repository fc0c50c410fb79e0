"""Charts of a campaign's report: success rates, distributions, pairs, convergence."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.findings import Findings
from flighttune.campaign.statistics.intervals import Estimate
from flighttune.campaign.statistics.paired import scores
from flighttune.campaign.statistics.summary import ConvergenceCurve
from flighttune.present.chart import HEAD_AND_FOOT, WIDTH, Chart
from flighttune.present.names import metric_label
from flighttune.present.palette import NEUTRAL, LineStyle, line_styles

NAME, STEP = 20.0, 10.0
"""Height of the name of a row and of each of its dots, pixels."""

SPREAD = ("chi.ITAE", "gamma.ITAE", "chi.MO_rad", "gamma.MO_rad")
"""Measures whose distributions are drawn."""

MANY_TIMES = 30.0
"""Ratio of the largest to the smallest value from which on an axis is logarithmic."""

DOTS = 400
"""Flights of a group in a chart of dots."""

MAX_PAIRS = 4


def styles_of(findings: Findings) -> dict[str, LineStyle]:
    """Line style of every group by its label, as in the report of its scenario."""
    plan = findings.flights.plan
    pairs = [(plant.label, name) for plant in plan.scenario.plant for name in plan.gain_sets]
    return {Group(*pair).label: style for pair, style in line_styles(pairs).items()}


def rows_chart(title: str, x: str, names: Sequence[str], dots: int = 1) -> Chart:
    """A chart with a row for each of `names`, from the top, and its dots at `places` below."""
    row = NAME + STEP * dots
    chart = Chart(
        title=title,
        x=x,
        height=HEAD_AND_FOOT + row * len(names),
        y_range=(0.0, float(len(names)) or 1.0),
        y_ticks=(),
        downwards=True,
    )
    for place, name in enumerate(names):
        chart.name_row(place + 0.72 * NAME / row, name)
    return chart


def places(dots: int) -> list[float]:
    """Position of each dot in a row of a `rows_chart`."""
    row = NAME + STEP * dots
    return [(NAME + STEP * (place + 0.3)) / row for place in range(dots)]


def dot(
    chart: Chart, y: float, estimate: Estimate, style: LineStyle, run: str, *, filled: bool = True
) -> None:
    """A number with its interval in a row."""
    chart.line([estimate.lo, estimate.hi], [y, y], style.colour, run=run, hover=False)
    tip = f"{run}: {estimate.value:.3g} [{estimate.lo:.3g}, {estimate.hi:.3g}]"
    chart.points(estimate.value, y, style.colour, run=run, size=4.0, filled=filled, tips=[tip])


def arrays_of(estimates: Sequence[Estimate], factor: float) -> FloatArray:
    """Values, lower and upper ends of estimates times a factor, shape (3, n)."""
    return factor * np.array([(e.value, e.lo, e.hi) for e in estimates]).T


def flight_tips(rows: "pd.DataFrame", url: str) -> list[str]:
    """Commands that fly each row again, as tips under the pointer."""
    return [f"run {run}: flighttune campaign fly {url} --run {run}" for run in rows["run"]]


def rates(findings: Findings) -> list[Chart]:
    """Success rate of every group, and how often the certified set held."""
    styles = styles_of(findings)
    charts = [
        _shares("Flights that succeed", {g.group.label: g.success for g in findings.groups}, styles)
    ]
    kept = {g.group.label: g.certified.of_all for g in findings.groups if g.certified is not None}
    if kept:
        charts.append(_shares("Flights in which the certified set held", kept, styles))
    return charts


def distributions(findings: Findings) -> list[Chart]:
    """Cumulative distribution of a metric over all flights, a panel a metric."""
    wanted = dict.fromkeys([findings.measure, *SPREAD])
    measures = [name for name in wanted if name and name in findings.flights.measures]
    return [_distribution(findings, name) for name in measures]


def against(findings: Findings) -> list[Chart]:
    """One gain set over another, a dot a draw."""
    styles, charts = styles_of(findings), []
    for pair in findings.paired[:MAX_PAIRS]:
        how = metric_label(pair.measure)
        rows = findings.flights.rows
        on_plant = rows.loc[(rows["plant"] == pair.plant).to_numpy()]
        values = on_plant.assign(score=scores(on_plant, pair.measure))
        table = values.pivot(index="draw", columns="gains", values="score")[[pair.a, pair.b]]
        both = table.to_numpy(dtype=float)
        finite = np.isfinite(both).all(axis=1)
        both, draws = how.factor * both[finite], table.index[finite]
        if not len(both):
            continue
        ends, log = _scale(both.ravel())
        chart = Chart(
            title=f"{pair.plant}: {how.name}, a dot a draw",
            x=f"{pair.a} [{how.unit}]",
            y=f"{pair.b} [{how.unit}]",
            height=WIDTH * 0.75,
            log="xy" if log else "",
            x_range=ends,
            y_range=ends,
        )
        some = slice(None, None, len(both) // DOTS + 1)
        style = styles[f"{pair.plant} / {pair.b}"]
        tips = [f"draw {draw}" for draw in draws[some]]
        across, up = both[some].T
        chart.points(across, up, style.colour, size=2.8, opacity=0.6, tips=tips)
        chart.line(ends, ends, NEUTRAL, width=1.0)
        charts.append(chart)
    return charts


def convergence(findings: Findings) -> list[Chart]:
    """Success rate and the 95th percentile of the measure from the first flights on."""
    if not findings.convergence:
        return []
    how = metric_label(findings.convergence[0].measure)
    title = f"95th percentile of {how.name}"
    return [
        _convergence(findings, "Success rate", "flights that succeed [%]", "success", 100.0),
        _convergence(findings, title, how.heading, "p95", how.factor),
    ]


def _shares(title: str, of: dict[str, Estimate], styles: dict[str, LineStyle]) -> Chart:
    chart = rows_chart(title, "share [%], with interval", list(of))
    (below,) = places(1)
    for place, (label, estimate) in enumerate(of.items()):
        dot(chart, place + below, estimate.scaled(100.0), styles[label], label)
    low = 100.0 * min(estimate.lo for estimate in of.values())
    high = 100.0 * max(estimate.hi for estimate in of.values())
    room = 0.06 * max(high - low, 1.0)
    chart.x_range = (max(-2.0, low - room), min(102.0, high + 2.5 * room))
    return chart


def _distribution(findings: Findings, measure: str) -> Chart:
    """Curves end below 100 % where flights were not completed or have no value."""
    how, styles = metric_label(measure), styles_of(findings)
    curves = {}
    for group, rows in findings.flights.groups():
        values = np.sort(how.factor * scores(rows, measure))
        share = 100.0 * np.arange(1, len(values) + 1) / len(values)
        kept = np.isfinite(values)
        if kept.any():
            curves[group.label] = values[kept], share[kept]
    chart = Chart(
        title=f"Flights by {how.name}", x=how.heading, y="flights at or below [%]", y_range=(0, 102)
    )
    if curves:
        chart.x_range, log = _scale(np.concatenate([values for values, _ in curves.values()]))
        chart.log = "x" if log else ""
    for label, (values, share) in curves.items():
        # a step at every value, from the share of the value before
        x, y = np.repeat(values, 2), np.repeat(np.append(0.0, share), 2)[1:-1]
        chart.run_line(x, y, styles[label], label)
    return chart


def _convergence(findings: Findings, title: str, y: str, name: str, factor: float) -> Chart:
    styles = styles_of(findings)
    chart = Chart(title=title, x="flights of a group", y=y, log="x")
    for curve in findings.convergence:
        label = curve.group.label
        n = np.array(curve.n, dtype=float)
        value, lo, hi = arrays_of(_estimates(curve, name), factor)
        bounded = np.isfinite(lo) & np.isfinite(hi)
        low, high = (np.where(bounded, side, np.nan) for side in (lo, hi))
        chart.band(n, low, high, styles[label].colour, run=label)
        chart.run_line(n, value, styles[label], label)
    return chart


def _estimates(curve: ConvergenceCurve, name: str) -> Sequence[Estimate]:
    return {"success": curve.success, "p95": curve.p95}[name]


def _scale(values: FloatArray) -> tuple[tuple[float, float], bool]:
    """Ends without the outer 0.5 %, and whether the values span decades."""
    low, high = (float(end) for end in np.quantile(values, [0.005, 0.995]))
    if low > 0.0 and high / low > MANY_TIMES:
        return (low / 1.1, high * 1.1), True
    room = 0.04 * (high - low) or 0.1 * abs(high) or 1.0
    return (low - room, high + room), False
