"""Figures 7, 13, 9 and 10: measures of the flights against R_K, I_K and the disturbance."""

from collections.abc import Sequence

import numpy as np

from flighttune.paper.items.base import (
    AMPLITUDE_COLOURS,
    CHANNEL_LABELS,
    CHI,
    GAMMA,
    INDICATOR_LABELS,
    Made,
    marked_line,
    sheet,
)
from flighttune.paper.items.histories import PROFILES, at_ends, measures_of, measures_table
from flighttune.paper.study import Study, rank_correlation
from flighttune.present.chart import DASHED, Chart, LegendEntry, Sheet

# The hue tells the angle; dashes, with hollow dots, are for rates.
LOOKS = {
    channel: (CHI if "chi" in channel else GAMMA, DASHED if channel.endswith("dot") else "")
    for channel in CHANNEL_LABELS
}

FIG_7 = {"ITAE": "ITAE [rad s², rad s]", "MO_rad": "MO [rad, rad/s]", "PT_s": "PT [s]"}
FIG_13 = {"MS_rad": "MS [rad]", "ST_rad": "ST [rad]"}
FIG_9 = (
    ("mean", ("chi", "gamma"), "mean of e", "mean [rad]"),
    ("std", ("chi", "gamma"), "deviation of e", "deviation [rad]"),
    ("mean", ("chi_dot", "gamma_dot"), "mean of ė", "mean [rad/s]"),
    ("std", ("chi_dot", "gamma_dot"), "deviation of ė", "deviation [rad/s]"),
)

# Panels: the measure, its channels where they differ, the title, and the label of the axis.
FIG_10 = (
    ("ITAE", ("chi", "gamma"), "ITAE of e", "ITAE [rad s²]"),
    ("MS_rad", ("s_chi", "s_gamma"), "MS of s", "MS [rad]"),
    ("ST_rad", ("s_chi", "s_gamma"), "ST of s", "ST [rad]"),
)


def _over(
    study: Study, indicator: str, measure: str, channels: Sequence[str], *, title: str, y: str
) -> Chart:
    """A measure of some channels over an indicator, gain sets in its order."""
    values = study.indicator(indicator).sort_values()
    chart = Chart(title=title, x=INDICATOR_LABELS[indicator], y=y, x_room=0.05)
    for channel in channels:
        colour, dash = LOOKS[channel]
        of_channel = study.of_gains(channel, measure).loc[values.index]
        marked_line(chart, values, of_channel, colour, dash=dash, run=CHANNEL_LABELS[channel][1])
    return chart


def _legend(channels: Sequence[str]) -> list[LegendEntry]:
    return [(CHANNEL_LABELS[channel][1], *LOOKS[channel]) for channel in channels]


def _over_R_K(study: Study, measures: dict[str, str], channels: Sequence[str]) -> Sheet:
    """Panels of measures over R_K, with the names of the gain sets along the top."""
    charts = []
    for measure, label in measures.items():
        title = f"{label.split()[0]} against R_K"
        chart = _over(study, "R_K", measure, channels, title=title, y=label)
        top = 1.15 * chart.y_ends()[1]
        for name, row in study.indicators.items():
            chart.text(row.R_K, top, name, anchor="middle")
        charts.append(chart)
    return sheet(charts, legend=_legend(channels))


def fig7(study: Study) -> Made:
    """Draw ITAE, MO and PT against R_K."""
    R_K = study.indicator("R_K")
    trends = {
        measure: {
            channel: rank_correlation(R_K, study.of_gains(channel, measure)) for channel in PROFILES
        }
        for measure in FIG_7
    }
    return Made(
        figures={"fig7": _over_R_K(study, FIG_7, PROFILES)},
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
        figures={"fig13": _over_R_K(study, FIG_13, channels)},
        tables={"fig13": measures_table(study.by_gains.loc[(slice(None), channels), :])},
        values={
            name: {channel: values[channel] for channel in channels}
            for name, values in measures_of(study.by_gains).items()
        },
        numbers=at_ends(study.of_gains("s_gamma", "MS_rad")),
    )


def fig9(study: Study) -> Made:
    """Draw means and deviations over the whole flight, against R_K above and I_K below."""
    charts = [
        _over(study, indicator, measure, channels, title=f"{title} against {indicator}", y=label)
        for indicator in INDICATOR_LABELS
        for measure, channels, title, label in FIG_9
    ]
    spread, deviations = {}, {}
    for channel in ("chi_dot", "gamma_dot"):
        spread[channel] = float(np.ptp(study.of_gains(channel, "mean")))
        deviation = study.of_gains(channel, "std").to_list()
        deviations[channel] = deviation[0], min(deviation), deviation[-1]
    return Made(
        figures={"fig9": sheet(charts, legend=_legend(PROFILES))},
        tables={"fig9": measures_table(study.by_gains)},
        values={"measures": measures_of(study.by_gains), "spread_of_mean_rates": spread},
        numbers=deviations,
    )


def fig10(study: Study) -> Made:
    """Draw ITAE, MS and ST of K*: hue for the amplitude, dashes for the channel."""
    charts, legend = [], []
    for measure, channels, title, label in FIG_10:
        chart = Chart(title=f"{title} with K*", x="ω_d [rad/s]", y=label, x_room=0.05)
        for channel, symbol, dash in zip(channels, "χγ", ("", DASHED), strict=True):
            table = study.of_disturbances(channel, measure)
            for L_d, colour in AMPLITUDE_COLOURS.items():
                name = f"{symbol}, L_d {L_d:g}"
                marked_line(chart, table.columns, table.loc[L_d], colour, dash=dash, run=name)
                if not charts:
                    legend.append((name, colour, dash))
        chart.y_range = 0.0, chart.y_ends()[1]
        charts.append(chart)
    growth = {channel: study.growth_of_ST(channel) for channel in ("s_chi", "s_gamma")}
    return Made(
        figures={"fig10": sheet(charts, legend=legend)},
        tables={"fig10": measures_table(study.by_disturbance)},
        values={
            "measures": measures_of(study.by_disturbance),
            "largest_growth_of_ST_rad": growth,
        },
        numbers={"released": {name: flight.released for name, flight in study.disturbed.items()}},
    )
