"""Panels of a campaign's report: success rates, distributions, pairs, convergence."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.campaign.statistics.findings import Findings
from flighttune.campaign.statistics.intervals import Estimate
from flighttune.campaign.statistics.paired import scores
from flighttune.campaign.statistics.summary import ConvergenceCurve
from flighttune.present.figures import FAINT, INK, NEUTRAL, line, on_white, panel
from flighttune.present.frame import Picture, pictured
from flighttune.present.names import metric_label
from flighttune.present.palette import LineStyle
from flighttune.report.campaign.words import styles_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAME, STEP = 0.27, 0.105
"""Height of the name of a row and of each of its dots, inches."""

HEAD = 0.85
"""Height of title and axis of such a panel, inches."""

SPREAD = ("chi.ITAE", "gamma.ITAE", "chi.MO_rad", "gamma.MO_rad")
"""Measures whose distributions are drawn."""

MANY_TIMES = 30.0
"""Ratio of the largest to the smallest value from which on an axis is logarithmic."""

DOTS = 400
"""Flights of a group in a panel of dots."""

MOST_PAIRS = 4


@contextmanager
def rows_panel(title: str, x: str, names: Sequence[str], dots: int = 1) -> "Iterator[Axes]":
    """A panel with a row for each of `names`, from the top: its name, and dots below.

    Parameters
    ----------
    title, x : str
        Title and label of the axis.
    names : sequence of str
    dots : int
        Dots of a row; those of row k are at `places`.
    """
    row = NAME + STEP * dots
    with panel(title, "", x, height=HEAD + row * len(names)) as axes:
        axes.set_ylim(len(names), 0.0)
        axes.set_yticks([])
        axes.grid(visible=False, axis="y")
        axes.spines["left"].set_visible(False)
        for place, name in enumerate(names):
            text = axes.text(0.0, place + 0.68 * NAME / row, name, fontsize=8, color=INK, zorder=4)
            text.set_transform(axes.get_yaxis_transform())
            text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 1.0})
        yield axes


def places(dots: int) -> list[float]:
    """Where in a row of a `rows_panel` each of its dots stands."""
    row = NAME + STEP * dots
    return [(NAME + STEP * (place + 0.2)) / row for place in range(dots)]


def dot(axes: "Axes", y: float, one: Estimate, style: LineStyle, *, filled: bool = True) -> None:
    """A number with its interval in a row."""
    colour = on_white(style.colour)
    axes.plot([one.lo, one.hi], [y, y], color=colour, lw=1.6, solid_capstyle="butt")
    axes.plot(one.value, y, "o", ms=5.5, color=colour, mfc=colour if filled else "white")


def arrays_of(estimates: Sequence[Estimate], factor: float) -> FloatArray:
    """Values, lower and upper ends of estimates times a factor, shape (3, n)."""
    return factor * np.array([(one.value, one.lo, one.hi) for one in estimates]).T


def rates(found: Findings) -> list[Picture]:
    """Success rate of every group, and how often the certified set held."""
    styles = styles_of(found)
    pictures = [
        _shares("Flights that succeed", {g.group.label: g.success for g in found.groups}, styles)
    ]
    held = {g.group.label: g.certified.of_all for g in found.groups if g.certified is not None}
    if held:
        pictures.append(_shares("Flights in which the certified set held", held, styles))
    return pictures


def distributions(found: Findings) -> list[Picture]:
    """Cumulative distribution of a metric over all flights, a panel a metric."""
    wanted = dict.fromkeys([found.measure, *SPREAD])
    known = [name for name in wanted if name and name in found.flights.measures]
    return [_distribution(found, name) for name in known]


def against(found: Findings) -> list[Picture]:
    """One gain set over another, a dot a draw."""
    styles, pictures = styles_of(found), []
    for one in found.paired[:MOST_PAIRS]:
        how = metric_label(one.measure)
        rows = found.flights.rows
        on_plant = rows.loc[(rows["plant"] == one.plant).to_numpy()]
        values = on_plant.assign(score=scores(on_plant, one.measure))
        table = values.pivot(index="draw", columns="gains", values="score")[[one.a, one.b]]
        both = table.to_numpy(dtype=float)
        both = how.factor * both[np.isfinite(both).all(axis=1)]
        if not len(both):
            continue
        title = f"{one.plant}: {how.name}, a dot a draw"
        with panel(title, f"{one.b} [{how.unit}]", f"{one.a} [{how.unit}]", height=3.6) as axes:
            some = both[:: len(both) // DOTS + 1]
            style = styles[f"{one.plant} / {one.b}"]
            axes.plot(*some.T, "o", ms=3.5, color=on_white(style.colour), alpha=0.6, mew=0.0)
            ends = [both.min(), both.max()]
            axes.plot(ends, ends, color=NEUTRAL, lw=1.0)
            _scale(axes, both.ravel(), both=True)
            pictures.append(pictured(axes, f"{title}; below the line {one.b} is lower"))
    return pictures


def convergence(found: Findings) -> list[Picture]:
    """Success rate and the 95th percentile of the measure from the first flights on."""
    if not found.convergence:
        return []
    how = metric_label(found.convergence[0].measure)
    title = f"95th percentile of {how.name}"
    return [
        _convergence(found, "Success rate", "flights that succeed [%]", "success", 100.0),
        _convergence(found, title, how.heading, "p95", how.factor),
    ]


def _shares(title: str, of: dict[str, Estimate], styles: dict[str, LineStyle]) -> Picture:
    with rows_panel(title, "share [%], with interval", list(of)) as axes:
        (below,) = places(1)
        for place, (label, one) in enumerate(of.items()):
            dot(axes, place + below, one.scaled(100.0), styles[label])
        low = 100.0 * min(one.lo for one in of.values())
        high = 100.0 * max(one.hi for one in of.values())
        room = 0.06 * max(high - low, 1.0)
        axes.set_xlim(max(-1.0, low - room), min(104.0, high + 2.5 * room))
        return pictured(axes, title)


def _distribution(found: Findings, measure: str) -> Picture:
    """Curves end below 100 % where flights were not completed or have no value."""
    how, styles = metric_label(measure), styles_of(found)
    with panel(f"Flights by {how.name}", "flights at or below [%]", how.heading) as axes:
        finite = []
        for group, rows in found.flights.groups():
            values = np.sort(how.factor * scores(rows, measure))
            share = 100.0 * np.arange(1, len(values) + 1) / len(values)
            kept = np.isfinite(values)
            if kept.any():
                finite.append(values[kept])
                x, y = np.append(values[kept], values[kept][-1]), np.append(share[kept], np.nan)
                line(axes, x, y, styles[group.label], drawstyle="steps-post")
        if finite:
            _scale(axes, np.concatenate(finite))
        axes.set_ylim(0.0, 102.0)
        return pictured(axes, f"Flights at or below each {how.name}")


def _convergence(found: Findings, title: str, y: str, name: str, factor: float) -> Picture:
    styles = styles_of(found)
    with panel(title, y, "flights of a group", height=3.0) as axes:
        tallest = []
        for one in found.convergence:
            style = styles[one.group.label]
            n = np.array(one.n, dtype=float)
            value, lo, hi = arrays_of(_estimates(one, name), factor)
            line(axes, n, value, style)
            bounded = np.isfinite(lo) & np.isfinite(hi)
            region = n[bounded], lo[bounded], hi[bounded]
            axes.fill_between(*region, color=on_white(style.colour), alpha=FAINT, lw=0.0)
            tallest += [value, hi[bounded], lo[bounded]]
        axes.set_xscale("log")
        within_a_decade = all(one.n[-1] < 10 * one.n[0] for one in found.convergence)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("{x:g}" if within_a_decade else "")
        finite = np.concatenate(tallest)
        finite = finite[np.isfinite(finite)]
        if len(finite) and np.ptp(finite) > 0.0:
            room = 0.05 * np.ptp(finite)
            axes.set_ylim(finite.min() - room, finite.max() + room)
        return pictured(axes, f"{title} over the number of flights")


def _estimates(one: ConvergenceCurve, name: str) -> Sequence[Estimate]:
    return {"success": one.success, "p95": one.p95}[name]


def _scale(axes: "Axes", values: FloatArray, *, both: bool = False) -> None:
    """Limits without the outer 0.5 %, logarithmic where the values span decades."""
    low, high = np.quantile(values, [0.005, 0.995])
    logarithmic = low > 0.0 and high / low > MANY_TIMES
    room = 0.04 * (high - low) or 0.1 * abs(high) or 1.0
    limits = (low / 1.1, high * 1.1) if logarithmic else (low - room, high + room)
    for axis in "xy" if both else "x":
        if logarithmic:
            getattr(axes, f"set_{axis}scale")("log")
        getattr(axes, f"set_{axis}lim")(*limits)
