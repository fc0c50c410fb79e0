"""The gap as one picture: rungs, what each step adds, the mismatch, and the certified tube."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.gap.certified_set import LoopFlown
from flighttune.gap.explain import Gap
from flighttune.palette import HUES, LIMIT, NEUTRAL
from flighttune.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = tuple(strong for (strong, _), _ in HUES[:4])
"""Of the rungs, lowest first; a step has the colour of its upper rung."""

SYMBOLS = {"chi": "χ", "gamma": "γ"}
NAMES = {"chi": "course", "gamma": "path angle"}
INK = "#3C3C3C"
MARGINS = {
    "left": 0.05, "right": 0.99, "top": 0.91, "bottom": 0.055, "hspace": 0.56, "wspace": 0.19,
}  # fmt: skip
DEGREES = 180.0 / math.pi


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
    from matplotlib.figure import Figure

    if gap.ladder is None:
        raise InputError(f"`gap` must have a ladder to be drawn, got none: {gap.reason}")
    figure = Figure(figsize=(15.0, 10.5))
    grid: Any = figure.add_gridspec(4, 3, width_ratios=(1.0, 1.0, 0.8), **MARGINS)
    for column, channel in enumerate(SYMBOLS):
        axes = [figure.add_subplot(grid[row, column]) for row in range(4)]
        _draw_rungs(axes[0], gap, channel)
        _draw_steps(axes[1], gap, channel)
        _draw_mismatch(axes[2], gap, channel)
        _draw_tube(axes[3], gap, channel)
        for each in axes:
            each.sharex(axes[0])
        axes[-1].set_xlabel("t [s]")
        _draw_itae(figure.add_subplot(grid[2 * column : 2 * column + 2, 2]), gap, channel)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    title = f"{gap.scenario.title}; gains {gap.runs[-1].provenance.gains_name}"
    figure.legend(
        handles, labels, title=title, title_fontsize=12,
        loc="upper center", ncols=5, frameon=False,
    )  # fmt: skip
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
    reference = top.signals[f"{channel}_ref"] * DEGREES
    axes.plot(top.signals.index, reference, color=NEUTRAL, lw=1.5, label="reference")
    for run, colour in zip(gap.runs, COLOURS, strict=True):
        values = run.signals[channel] * DEGREES
        axes.plot(run.signals.index, values, color=colour, lw=1.6, label=run.provenance.plant)
    _dress(axes, f"{NAMES[channel].capitalize()} flown", f"{SYMBOLS[channel]} [deg]")


def _draw_steps(axes: Axes, gap: Gap, channel: str) -> None:
    assert gap.ladder is not None
    t = gap.runs[0].signals.index
    for step, colour in zip(gap.ladder.steps, COLOURS[1:], strict=True):
        axes.plot(t, getattr(step, channel) * DEGREES, color=colour, lw=1.6)
    whole = getattr(gap.ladder.whole, channel) * DEGREES
    axes.plot(t, whole, color=INK, lw=1.0, ls=(0, (4, 2)))
    title = f"What each step adds to the {NAMES[channel]}; the sum dashed"
    _dress(axes, title, f"Δ{SYMBOLS[channel]} [deg]")


def _draw_mismatch(axes: Axes, gap: Gap, channel: str) -> None:
    assert gap.mismatch is not None
    d = gap.mismatch.d[:, list(SYMBOLS).index(channel)] * DEGREES
    axes.plot(gap.mismatch.t, d, color=COLOURS[-1], lw=1.6)
    title = f"Mismatch: {NAMES[channel]} rate flown minus that of the law"
    _dress(axes, title, f"d_{SYMBOLS[channel]} [deg/s]")


def _draw_tube(axes: Axes, gap: Gap, channel: str) -> None:
    run = gap.runs[-1]
    t = run.signals.index.to_numpy()
    axes.plot(t, run.signals[f"{channel}_err"] * DEGREES, color=COLOURS[-1], lw=1.6)
    if gap.loop is None or gap.verdict is None:
        _dress(axes, "Error; the linear loop has no certificate", f"e_{SYMBOLS[channel]} [deg]")
        return
    column = list(SYMBOLS).index(channel)
    tube: FloatArray = gap.loop.tube()[:, column] * DEGREES
    axes.fill_between(gap.loop.t, -tube, tube, color=LIMIT, alpha=0.14, lw=0.0)
    ultimate = gap.verdict.tube[column] * DEGREES
    for side in (-ultimate, ultimate):
        axes.axhline(side, color=LIMIT, lw=1.0, ls=(0, (4, 2)))
    title = f"Error. Dashed: ultimate set, {gap.verdict.sentence}\n{_promise(gap.loop, column)}"
    if gap.free is not None:
        centre, width = (each[:, column] * DEGREES for each in (gap.free.centre, gap.free.width))
        axes.fill_between(gap.free.t, centre - width, centre + width, color=INK, alpha=0.4, lw=0.0)
        title += (
            f"\nGrey: reach from {gap.free.t_from:.1f} s on, without limits: {gap.free.sentence}"
        )
    _dress(axes, title, f"e_{SYMBOLS[channel]} [deg]")


def _promise(loop: LoopFlown, column: int) -> str:
    """What became of the promised tube: s, which has rates too, may leave where an error stays."""
    t_s, t_error = loop.t_promise_broken(), loop.t_error_outside(column)
    if t_s is None:
        return "Red: promised tube, held"
    error = "never" if t_error is None else f"at {t_error:.2f} s"
    return f"Red: promised; ‖s‖ with rates left at {t_s:.2f} s, this error {error}"


def _draw_itae(axes: Axes, gap: Gap, channel: str) -> None:
    """A bar for the paper's law, one for what each step adds, one for the aircraft."""
    assert gap.ladder is not None
    title = f"ITAE of the {NAMES[channel]}"
    if gap.ladder.failed:
        lines = [f"{plant} {why}" for plant, why in gap.ladder.failed.items()]
        text = "\n".join(["none:", *lines])
        axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)
        _dress(axes, title, "ITAE [rad s²]")
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
    _dress(axes, title, "ITAE [rad s²]")


def _dress(axes: Axes, title: str, unit: str) -> None:
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_ylabel(unit)
    axes.grid(alpha=0.3, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
