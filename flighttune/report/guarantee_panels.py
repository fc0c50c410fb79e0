"""Panels of what is guaranteed and where the aircraft parts from it."""

from typing import TYPE_CHECKING

import numpy as np

from flighttune.flight.gap import Gap
from flighttune.present.figures import (
    FAINT,
    INK,
    PANEL,
    RC,
    line,
    on_white,
    panel,
    svg_uri,
    thinned,
)
from flighttune.present.frame import Picture, pictured
from flighttune.present.names import CHANNEL_NAMES, CHANNEL_SYMBOLS
from flighttune.present.palette import LIMIT
from flighttune.report.facts import Facts
from flighttune.tuning.frontier import frontier_figure
from flighttune.units import DEG_PER_RAD

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEP_STYLES = ((":", 1.5), ("--", 1.5), ("-", 1.8))
FLOOR = 1e-4
"""Lower end of the logarithmic axis of ``||s||``."""

TINY = 1e-9

LEGEND_ROOM = 0.24
"""Part of an axis that is added for a legend of two lines."""

LONGEST_TITLE = 64
"""Letters that a title has room for at its usual size."""


def certificate_panels(facts: Facts) -> list[Picture]:
    """The norm of s against what is guaranteed, a panel a gain set."""
    pictures = []
    for one in facts.gains:
        own = [run for run in facts.runs if run.provenance.gains_name == one.name]
        drawn = [(run, facts.checks[run.label]) for run in own if run.label in facts.checks]
        if not drawn:
            continue
        title = f"{one.name}: ‖s‖, and dashed what is guaranteed"
        with panel(title, "‖(e′, e)‖ [rad/s, rad]", height=3.1) as axes:
            for run, one in drawn:
                style = facts.styles[run.label]
                line(axes, one.t, np.maximum(one.size, TINY), style, ls="-", most=facts.points)
                line(axes, one.t, one.bound, style, ls=(0, (5, 3)), lw=1.2, most=facts.points)
                if one.settled is not None:
                    axes.axhline(
                        one.settled.claim.radius, color=on_white(style.colour), lw=1.1, ls=":"
                    )
                if one.t_broken is not None:
                    at = float(np.interp(one.t_broken, one.t, one.size))
                    axes.plot(one.t_broken, at, "x", color=LIMIT, ms=9, mew=2.2)
            axes.set_yscale("log")
            axes.set_ylim(bottom=FLOOR)
            axes.set_xlim(0.0, max(run.duration for run, _ in drawn))
            pictures.append(pictured(axes, title))
    return pictures


def frontier_panel(facts: Facts) -> list[Picture]:
    """R_K against I_K with the gains of the runs marked; nothing where no loop is stable."""
    import matplotlib as mpl

    if "frontier" not in set(facts.frontier["name"]):
        return []
    with mpl.rc_context(RC):
        figure = frontier_figure(facts.frontier)
    figure.set_size_inches(PANEL[0], 3.1)
    axes = figure.axes[0]
    low, high = axes.get_xlim()
    axes.set_xlim(0.9 * low, high)
    for text in axes.texts:
        if text.get_text() == "K*":
            text.set_text("paper")
    return [Picture(uri=svg_uri(figure), alt="Largest R_K for every I_K, gains marked")]


def gap_panels(facts: Facts, gap: Gap) -> list[Picture]:
    """What each step of the ladder adds, and the flight in its certified tube."""
    return [_steps(facts, gap, channel) for channel in CHANNEL_SYMBOLS] + [
        _tube(facts, gap, channel) for channel in CHANNEL_SYMBOLS
    ]


def _steps(facts: Facts, gap: Gap, channel: str) -> Picture:
    t = gap.aircraft.t
    title = f"{gap.name}: what each step adds to the {CHANNEL_NAMES[channel]}"
    with panel(title, f"Δ{CHANNEL_SYMBOLS[channel]} [deg]", height=3.1) as axes:
        _fit_title(axes, title)
        for step, (dashes, width) in zip(gap.steps, STEP_STYLES, strict=True):
            style = facts.styles[gap.aircraft.label]
            values = getattr(step, channel) * DEG_PER_RAD
            line(axes, t, values, style, ls=dashes, lw=width, label=step.adds)
        total = np.sum([getattr(step, channel) for step in gap.steps], axis=0) * DEG_PER_RAD
        axes.plot(*thinned(t, total), color=INK, lw=0.9, label="total")
        axes.set_xlim(0.0, t[-1])
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + LEGEND_ROOM * (high - low))
        axes.legend(loc="upper right", ncols=2, fontsize=8, borderaxespad=0.1)
        return pictured(axes, title)


def _tube(facts: Facts, gap: Gap, channel: str) -> Picture:
    style, signals = facts.styles[gap.aircraft.label], gap.aircraft.signals
    title = f"{gap.name}: error on the aircraft"
    if gap.verdict is not None:
        title += f"; dashed: ultimate set, {gap.verdict.outcome}"
        title += ", but too loose to be useful" if gap.verdict.claim.vacuous else ""
    with panel(title, rf"$e_\{channel}$ [deg]") as axes:
        _fit_title(axes, title)
        t = gap.aircraft.t
        line(axes, t, signals[f"{channel}_err"].to_numpy() * DEG_PER_RAD, style)
        if gap.check is not None and gap.verdict is not None:
            column = list(CHANNEL_SYMBOLS).index(channel)
            times, half = thinned(gap.check.t, gap.check.error_bounds[:, column] * DEG_PER_RAD)
            axes.fill_between(times, -half, half, color=LIMIT, alpha=FAINT, lw=0.0)
            width = gap.verdict.claim.tube[column] * DEG_PER_RAD
            for side in (-width, width):
                axes.axhline(side, color=LIMIT, lw=1.0, ls=(0, (4, 2)))
        axes.set_xlim(0.0, t[-1])
        return pictured(axes, title)


def _fit_title(axes: "Axes", title: str) -> None:
    """Write a title that is longer than the panel smaller."""
    if len(title) > LONGEST_TITLE:
        size = float(axes.title.get_fontsize())
        axes.set_title(title, fontsize=size * LONGEST_TITLE / len(title))
