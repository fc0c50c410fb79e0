"""A figure of what the controller's rate does, predicted and flown."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from flighttune.palette import HUES, NEUTRAL
from flighttune.report.sampling import SampledStep, overshoot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CHANNELS = "course", "flight-path angle"


def sampling_figure(
    steps: Mapping[str, Sequence[SampledStep]], *, shown_s: float = 6.0
) -> "Figure":
    """Overshoot over the rate, and the steps at the slowest and the fastest rate.

    Parameters
    ----------
    steps : mapping of str to sequence of SampledStep
        By gain set, rates rising.
    shown_s : float, s
        Length of the steps drawn.

    Returns
    -------
    Figure
        One column a channel; not saved.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 10.0), layout="constrained")
    rows = figure.subplots(1 + len(steps), 2, squeeze=False)
    for channel in range(2):
        _over_rate(rows[0][channel], steps, channel)
        for row, (name, found) in enumerate(steps.items(), start=1):
            _in_time(rows[row][channel], name, (found[0], found[-1]), channel, shown_s)
    return figure


def _over_rate(axes: "Axes", steps: Mapping[str, Sequence[SampledStep]], channel: int) -> None:
    for (name, found), ((colour, _), _) in zip(steps.items(), HUES, strict=False):
        rates = [step.rate for step in found]
        exact, delayed, flown = (
            [100.0 * overshoot(getattr(step, kind))[channel] for step in found]
            for kind in ("exact", "delayed", "flown")
        )
        axes.plot(rates, exact, color=colour, lw=1.6, label=f"{name}: sampled loop")
        axes.plot(rates, delayed, color=colour, lw=1.2, ls="--", label="half a sample late")
        axes.plot(rates, flown, "o", color=colour, ms=5, label="flown")
    axes.set_xscale("log")
    ticks = [10, 20, 50, 100]
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("rate of the controller in Hz")
    axes.set_ylabel("overshoot in % of the step")
    axes.set_ylim(bottom=0.0)
    _dress(axes, f"Step of {CHANNELS[channel]}", columns=len(steps), rows=3)


def _in_time(
    axes: "Axes", name: str, found: Sequence[SampledStep], channel: int, shown_s: float
) -> None:
    for step, ((colour, _), _) in zip(found, (HUES[1], HUES[2]), strict=True):
        kept = step.t <= shown_s
        every = max(1, round(step.rate / 10.0))
        response = 1.0 - step.flown[kept, channel]
        axes.plot(
            step.t[kept], 1.0 - step.exact[kept, channel], color=colour, lw=1.4,
            label=f"{step.rate:g} Hz: sampled loop",
        )  # fmt: skip
        axes.plot(
            step.t[kept][::every], response[::every], "o", ms=3.5, color=colour, label="flown"
        )
    axes.axhline(1.0, color=NEUTRAL, lw=0.8, ls="--")
    axes.set_xlabel("t in s")
    axes.set_ylabel("response over the step")
    axes.set_yticks(np.arange(0.0, 2.1, 0.5))
    _dress(axes, f"{name}: {CHANNELS[channel]}", columns=2, rows=2)


def _dress(axes: "Axes", title: str, *, columns: int, rows: int) -> None:
    """Title, and the legend between it and the axes, where no curve can run."""
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(title, loc="left", fontsize=10, pad=14 + 13 * rows)
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, fontsize=8, frameon=False,
        borderaxespad=0.2,
    )  # fmt: skip
