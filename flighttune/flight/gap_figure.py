"""The gap as one picture: rungs, what each step adds, the mismatch, the error bounds and ITAE."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.flight.gap import Gap
from flighttune.guarantee.ultimate_set import held_or_broken
from flighttune.present.figures import FAINT, INK, RC, REFERENCE
from flighttune.present.names import CHANNEL_NAMES, CHANNEL_SYMBOLS
from flighttune.present.palette import HUES, LIMIT
from flighttune.units import DEG_PER_RAD
from flighttune.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = tuple(strong for (strong, _), _ in HUES[:4])
"""Of the rungs, lowest first; a step has the colour of its upper rung."""

MARGINS = {"left": 0.05, "right": 0.99, "bottom": 0.045, "top": 0.92}
MARGINS |= {"hspace": 0.42, "wspace": 0.22}
"""Parts of the figure, and of a panel between two of them: room for a title of three lines."""

LONG_TITLE = 7.5
"""Size of a title whose lines would run into the next panel at the usual one, points."""


def gap_figure(gap: Gap) -> Figure:
    """Draw a gap.

    Parameters
    ----------
    gap : Gap
        With a ladder.

    Returns
    -------
    Figure
        Two columns over time, for course and flight-path angle, and one of ITAE.

    Raises
    ------
    InputError
        If there is no ladder: the aircraft did not fly.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    if gap.ladder is None:
        raise InputError(f"`gap` must have a ladder to be drawn, got none: {gap.reason}")
    with mpl.rc_context(RC):
        # Margins that fit: to find them, matplotlib would lay out all texts three times more.
        figure = Figure(figsize=(15.0, 10.5))
        grid: Any = figure.add_gridspec(4, 3, width_ratios=(1.0, 1.0, 0.8), **MARGINS)
        for column, channel in enumerate(CHANNEL_SYMBOLS):
            axes = [figure.add_subplot(grid[row, column]) for row in range(4)]
            _draw_rungs(axes[0], gap, channel)
            _draw_steps(axes[1], gap, channel)
            _draw_mismatch(axes[2], gap, channel)
            _draw_bound(axes[3], gap, channel)
            for each in axes:
                each.sharex(axes[0])
            axes[-1].set_xlabel("t [s]")
            _draw_itae(figure.add_subplot(grid[2 * column : 2 * column + 2, 2]), gap, channel)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        title = f"{gap.scenario.title}; gains {gap.runs[-1].provenance.gains_name}"
        figure.legend(handles, labels, title=title, loc="upper center", ncols=5)
    return figure


def save_gap_figure(gap: Gap, path: Path, *, dpi: int = 110) -> None:
    """Write `gap_figure` to an image file, under a temporary name until it is whole.

    Raises
    ------
    InputError
        If the file cannot be written, or there is no ladder.
    """
    figure = gap_figure(gap)
    with whole_file(path) as part:
        figure.savefig(part, dpi=dpi, format=path.suffix.removeprefix(".") or "png")


def _draw_rungs(axes: Axes, gap: Gap, channel: str) -> None:
    top = gap.runs[-1]
    reference = top.signals[f"{channel}_ref"] * DEG_PER_RAD
    axes.plot(top.signals.index, reference, color=REFERENCE, lw=1.5, label="reference")
    for run, colour in zip(gap.runs, COLOURS, strict=True):
        values = run.signals[channel] * DEG_PER_RAD
        axes.plot(run.signals.index, values, color=colour, lw=1.6, label=run.provenance.plant)
    axes.set(
        title=f"{CHANNEL_NAMES[channel].capitalize()} flown",
        ylabel=f"{CHANNEL_SYMBOLS[channel]} [deg]",
    )


def _draw_steps(axes: Axes, gap: Gap, channel: str) -> None:
    assert gap.ladder is not None
    t = gap.runs[0].signals.index
    for step, colour in zip(gap.ladder.steps, COLOURS[1:], strict=True):
        axes.plot(t, getattr(step, channel) * DEG_PER_RAD, color=colour, lw=1.6)
    whole = getattr(gap.ladder.whole, channel) * DEG_PER_RAD
    axes.plot(t, whole, color=INK, lw=1.0, ls=(0, (4, 2)))
    title = f"What each step adds to the {CHANNEL_NAMES[channel]}; the sum dashed"
    axes.set(title=title, ylabel=f"Δ{CHANNEL_SYMBOLS[channel]} [deg]")


def _draw_mismatch(axes: Axes, gap: Gap, channel: str) -> None:
    assert gap.mismatch is not None
    d = gap.mismatch.d[:, list(CHANNEL_SYMBOLS).index(channel)] * DEG_PER_RAD
    axes.plot(gap.mismatch.t, d, color=COLOURS[-1], lw=1.6)
    title = f"Mismatch: {CHANNEL_NAMES[channel]} rate flown minus that of the law"
    axes.set(title=title, ylabel=f"d_{CHANNEL_SYMBOLS[channel]} [deg/s]")


def _draw_bound(axes: Axes, gap: Gap, channel: str) -> None:
    run = gap.runs[-1]
    t = run.t
    axes.plot(t, run.signals[f"{channel}_err"] * DEG_PER_RAD, color=COLOURS[-1], lw=1.6)
    if gap.check is None or gap.verdict is None:
        axes.set(
            title="Error; the linear loop has no certificate",
            ylabel=f"e_{CHANNEL_SYMBOLS[channel]} [deg]",
        )
        return
    column = list(CHANNEL_SYMBOLS).index(channel)
    bound: FloatArray = gap.check.error_bounds[:, column] * DEG_PER_RAD
    axes.fill_between(gap.check.t, -bound, bound, color=LIMIT, alpha=FAINT, lw=0.0)
    ultimate = gap.verdict.claim.tube[column] * DEG_PER_RAD
    for side in (-ultimate, ultimate):
        axes.axhline(side, color=LIMIT, lw=1.0, ls=(0, (4, 2)))
    title = (
        f"Error. Dashed: ultimate set, {gap.verdict.sentence}\n"
        f"Red: bound where no limit holds a command, {held_or_broken(gap.check.t_broken)}"
    )
    if gap.free is not None:
        centre, width = (
            each[:, column] * DEG_PER_RAD for each in (gap.free.centre, gap.free.width)
        )
        axes.fill_between(gap.free.t, centre - width, centre + width, color=INK, alpha=0.4, lw=0.0)
        title += (
            f"\nGrey: reach from {gap.free.t_from:.1f} s on, without limits: {gap.free.sentence}"
        )
    axes.set_title(title, fontsize=LONG_TITLE)
    axes.set_ylabel(f"e_{CHANNEL_SYMBOLS[channel]} [deg]")


def _draw_itae(axes: Axes, gap: Gap, channel: str) -> None:
    """A bar for the paper's law, one for what each step adds, one for the aircraft."""
    assert gap.ladder is not None
    title = f"ITAE of the {CHANNEL_NAMES[channel]}"
    if gap.ladder.failed:
        lines = [f"{plant} {why}" for plant, why in gap.ladder.failed.items()]
        text = "\n".join(["none:", *lines])
        axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)
        axes.set(title=title, ylabel="ITAE [rad s²]")
        return
    steps = [float(np.asarray(s.metrics.at[channel, "ITAE"])) for s in gap.ladder.steps]
    metrics = gap.flown().metrics["ITAE"]
    first, last = (
        float(np.asarray(metrics[run.label, channel])) for run in (gap.runs[0], gap.runs[-1])
    )
    ends = np.cumsum([first, *steps])
    bottoms = [0.0, *np.minimum(ends[:-1], ends[1:]), 0.0]
    heights = [first, *np.abs(steps), last]
    colours = [*COLOURS, COLOURS[-1]]
    names = ["paper's\nlaw", "+ exact\nlift", "+ inner\nloop", "+ six\nd.o.f.", "aircraft"]
    axes.bar(names, heights, bottom=bottoms, color=colours, width=0.62)
    shown = [f"{first:.2f}", *(f"{step:+.2f}" for step in steps), f"{last:.2f}"]
    for i, text in enumerate(shown):
        axes.annotate(
            text, (i, bottoms[i] + heights[i]), (0, 3), textcoords="offset points", ha="center"
        )
    for i, level in enumerate(ends):
        axes.plot([i - 0.31, i + 1.31], [level, level], color=INK, lw=0.7)
    axes.margins(y=0.12)
    axes.set(title=title, ylabel="ITAE [rad s²]")
