"""Figures 7, 13, 9 and 10: measures of the flights against R_K, I_K and the disturbance."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flighttune.paper import style
from flighttune.paper.items.base import Made
from flighttune.paper.items.histories import PROFILES, at_ends, measures_of, measures_table
from flighttune.paper.parameters import TABLE_3
from flighttune.paper.study import Study, rank_correlation
from flighttune.present.palette import NEUTRAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CHI: dict[str, Any] = {"color": style.CHI, "marker": "o"}
_GAMMA: dict[str, Any] = {"color": style.GAMMA, "marker": "s"}
_RATE: dict[str, Any] = {"ls": "--", "markerfacecolor": "white"}
LINES = {
    "chi": _CHI,
    "gamma": _GAMMA,
    "chi_dot": _CHI | _RATE,
    "gamma_dot": _GAMMA | _RATE,
    "s_chi": _CHI,
    "s_gamma": _GAMMA,
}
"""Line of each channel."""

FIG_7 = {"ITAE": "ITAE [rad s², rad s]", "MO_rad": "MO [rad, rad/s]", "PT_s": "PT [s]"}
FIG_13 = {"MS_rad": "MS [rad]", "ST_rad": "ST [rad]"}
FIG_9 = (
    ("mean", ("chi", "gamma"), "mean of e", "rad"),
    ("std", ("chi", "gamma"), "deviation of e", "rad"),
    ("mean", ("chi_dot", "gamma_dot"), "mean of ė", "rad/s"),
    ("std", ("chi_dot", "gamma_dot"), "deviation of ė", "rad/s"),
)
FIG_10 = (
    ("ITAE", ("chi", "gamma"), "ITAE of e", "ITAE [rad s²]"),
    ("MS_rad", ("s_chi", "s_gamma"), "MS of $s$", "MS [rad]"),
    ("ST_rad", ("s_chi", "s_gamma"), "ST of $s$", "ST [rad]"),
)
"""Panels: the measure, its channels where they differ, the title, and the label of the axis."""


def _draw(
    panel: "Axes", study: Study, measure: str, channels: Sequence[str], *, over: str = "R_K"
) -> None:
    """Draw a measure of some channels over an indicator, gain sets in its order."""
    indicator = study.indicator(over).sort_values()
    for channel in channels:
        values = study.of_gains(channel, measure).loc[indicator.index]
        panel.plot(indicator, values, label=style.LABELS[channel], **LINES[channel])
    panel.set_xlabel(style.AXES[over])


def _over_R_K(
    study: Study, measures: dict[str, str], channels: Sequence[str], *, width: float
) -> "Figure":
    """Panels of measures over R_K, with the names of the gain sets along the top."""
    titles = [label.split()[0] for label in measures.values()]
    figure, panels = style.grid(1, len(measures), size=(width, 3.4), titles=titles)
    for panel, (measure, label) in zip(panels, measures.items(), strict=True):
        _draw(panel, study, measure, channels)
        top = 1.1 * panel.get_ylim()[1]
        panel.set(ylabel=label, ylim=(-0.03 * top, top))
        for name, found in study.indicators.items():
            panel.annotate(
                name,
                (found.R_K, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(0, -9),
                textcoords="offset points",
                ha="center",
                fontsize=7.5,
                color=NEUTRAL,
            )
    style.legend_above(figure, panels[0], columns=4)
    return figure


def fig7(study: Study) -> Made:
    """Draw ITAE, MO and PT against R_K."""
    figure = _over_R_K(study, FIG_7, PROFILES, width=9.6)
    R_K = study.indicator("R_K")
    trends = {
        measure: {
            channel: rank_correlation(R_K, study.of_gains(channel, measure)) for channel in PROFILES
        }
        for measure in FIG_7
    }
    return Made(
        figures={"fig7": figure},
        tables={"fig7": measures_table(study.by_gains)},
        values={
            "measures": measures_of(study.by_gains),
            "rank_correlation_with_R_K": trends,
        },
    )


def fig13(study: Study) -> Made:
    """Draw MS and ST of s_chi and s_gamma against R_K."""
    channels = ["s_chi", "s_gamma"]
    return Made(
        figures={"fig13": _over_R_K(study, FIG_13, channels, width=8.0)},
        tables={"fig13": measures_table(study.by_gains.loc[(slice(None), channels), :])},
        values={
            name: {channel: found[channel] for channel in channels}
            for name, found in measures_of(study.by_gains).items()
        },
        numbers=at_ends(study.of_gains("s_gamma", "MS_rad")),
    )


def fig9(study: Study) -> Made:
    """Draw means and deviations over the whole flight, against R_K above and I_K below."""
    titles = [title for _, _, title, _ in FIG_9]
    figure, panels = style.grid(2, 4, size=(11.0, 5.4), titles=2 * titles)
    for k, panel in enumerate(panels):
        measure, channels, _, unit = FIG_9[k % 4]
        _draw(panel, study, measure, channels, over="R_K" if k < 4 else "I_K")
        panel.set_ylabel(unit)
        if measure == "std":
            panel.set_ylim(0.0, 1.08 * panel.get_ylim()[1])
    style.legend_above(figure, panels[0], panels[2], columns=4)
    spread, deviations = {}, {}
    for channel in ("chi_dot", "gamma_dot"):
        spread[channel] = float(np.ptp(study.of_gains(channel, "mean")))
        deviation = study.of_gains(channel, "std").to_list()
        deviations[channel] = deviation[0], min(deviation), deviation[-1]
    return Made(
        figures={"fig9": figure},
        tables={"fig9": measures_table(study.by_gains)},
        values={"measures": measures_of(study.by_gains), "spread_of_mean_rates": spread},
        numbers=deviations,
    )


def fig10(study: Study) -> Made:
    """Draw ITAE, MS and ST of K*: hue for the amplitude, dashes for the channel."""
    titles = [title for _, _, title, _ in FIG_10]
    figure, panels = style.grid(1, 3, size=(9.6, 3.4), titles=titles)
    for panel, (measure, channels, _, label) in zip(panels, FIG_10, strict=True):
        for channel, symbol, look in zip(channels, "χγ", ("o-", "s--"), strict=True):
            table = study.of_disturbances(channel, measure)
            for L_d, colour in style.AMPLITUDE_COLOURS.items():
                line_label = f"{symbol}, $L_d$ {L_d:g}"
                panel.plot(table.columns, table.loc[L_d], look, color=colour, label=line_label)
        panel.set(xlabel=r"$\omega_d$ [rad/s]", ylabel=label)
        panel.set_xticks(sorted({omega for _, omega in TABLE_3.values()}))
        panel.set_ylim(bottom=0.0)
    style.legend_above(figure, panels[0], columns=6)
    growth = {channel: study.growth_of_ST(channel) for channel in ("s_chi", "s_gamma")}
    return Made(
        figures={"fig10": figure},
        tables={"fig10": measures_table(study.by_disturbance)},
        values={
            "measures": measures_of(study.by_disturbance),
            "largest_growth_of_ST_rad": growth,
        },
        numbers={"released": {name: one.released for name, one in study.disturbed.items()}},
    )
