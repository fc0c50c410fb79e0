"""Figures 5, 12, 8 and 11: the manoeuvre over time; 7, 13, 9 and 10: its measures."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray
from flighttune.outputs.drawing.chart import DASHED, DOTTED, LONG, Chart, LegendEntry, Sheet
from flighttune.outputs.drawing.palette import INK, LIMIT, NEUTRAL
from flighttune.outputs.paper.items import base
from flighttune.outputs.paper.items.base import CHI, GAMMA, GREEN, Look, Made, marked_line, sheet
from flighttune.studies.paper import parameters as printed
from flighttune.studies.paper.flight import PaperFlight
from flighttune.studies.paper.parameters import AFTERWARDS, DURATION, STAR, TABLE_3, printed_limits
from flighttune.studies.paper.study import Study, rank_correlation

# Name, symbol and unit of each channel.
CHANNEL_LABELS = {
    "chi": ("course error", "e_χ", "rad"),
    "gamma": ("path-angle error", "e_γ", "rad"),
    "chi_dot": ("rate of the course error", "ė_χ", "rad/s"),
    "gamma_dot": ("rate of the path-angle error", "ė_γ", "rad/s"),
    "s_chi": ("course error and its rate", "s_χ", "rad"),
    "s_gamma": ("path-angle error and its rate", "s_γ", "rad"),
}

# The errors and their rates, panels (a) to (d) of figures 5, 8 and 11.
PROFILES = ("chi", "gamma", "chi_dot", "gamma_dot")

MEASURES = ["ITAE", "MO_rad", "PT_s", "MS_rad", "ST_rad", "mean", "std"]

# Drawn readings of the limits; without any limit the loop diverges.
READING_LOOKS = {
    "ranges only": (INK, ""),
    "ranges and rate limits": (GAMMA, ""),
    "with rate limits and anti-windup": (GREEN, ""),
}
PRINTED_RANGE = ("printed range", LIMIT, LONG)

# Columns of a flight in a file: errors, their rates, commands after and before the limits.
COLUMNS = (
    *("e_chi_rad", "e_gamma_rad", "e_chi_dot_radps", "e_gamma_dot_radps"),
    *("phi_rad", "n_z", "phi_wanted_rad", "n_z_wanted"),
)

# The hue tells the angle; dashes, with hollow dots, are for rates.
LOOKS = {
    channel: (CHI if "chi" in channel else GAMMA, DASHED if channel.endswith("dot") else "")
    for channel in CHANNEL_LABELS
}

# For disturbances the hue tells the amplitude L_d, and the dashes the frequency omega_d.
AMPLITUDE_COLOURS = {0.1: CHI, 0.2: GREEN, 0.3: base.MAGENTA}
OMEGA_DASHES = {0.1: "", 0.15: DASHED, 0.2: DOTTED}

FIG_7 = {"ITAE": "ITAE [rad s², rad s]", "MO_rad": "MO [rad, rad/s]", "PT_s": "PT [s]"}
FIG_13 = {"MS_rad": "MS [rad]", "ST_rad": "ST [rad]"}

# Panels: the measure, its channels if they differ, the title, and the label of the axis.
FIG_9 = (
    ("mean", PROFILES[:2], "mean of e", "mean [rad]"),
    ("std", PROFILES[:2], "deviation of e", "deviation [rad]"),
    ("mean", PROFILES[2:], "mean of ė", "mean [rad/s]"),
    ("std", PROFILES[2:], "deviation of ė", "deviation [rad/s]"),
)
FIG_10 = (
    ("ITAE", ("chi", "gamma"), "ITAE of e", "ITAE [rad s²]"),
    ("MS_rad", ("s_chi", "s_gamma"), "MS of s", "MS [rad]"),
    ("ST_rad", ("s_chi", "s_gamma"), "ST of s", "ST [rad]"),
)


def _history(flights: Mapping[str, PaperFlight], *, commands: bool = True) -> pd.DataFrame:
    """Errors, rates, and commands after and before the limits, flights side by side."""
    table = {"t_s": next(iter(flights.values())).t}
    for name, flight in flights.items():
        signals = np.hstack([flight.error, flight.error_rate, flight.u, flight.unlimited]).T
        for column, values in zip(COLUMNS if commands else COLUMNS[:4], signals, strict=False):
            table[f"{name}_{column}" if name else column] = values
    return pd.DataFrame(table)


def _measures_of(table: pd.DataFrame) -> dict[str, dict[str, dict[str, float]]]:
    """Measures by name and channel as plain numbers, from an index (name, channel)."""
    return {
        str(name): rows.droplevel(0).to_dict("index")
        for name, rows in table[MEASURES].groupby(level=0, sort=False)
    }


def _measures_table(table: pd.DataFrame) -> pd.DataFrame:
    """Measures as rows of name and channel, for a file."""
    return table[MEASURES].rename_axis(["name", "channel"]).reset_index()


def _at_ends(from_high_to_low: pd.Series) -> dict[str, float]:
    """A measure of the gain sets with the highest and the lowest R_K."""
    first, *_, last = from_high_to_low
    return {"at_highest_R_K": first, "at_lowest_R_K": last}


def _over_time(
    flights: Mapping[str, PaperFlight],
    looks: Mapping[str, Look],
    channels: Sequence[str],
    *,
    x_range: tuple[float, float] = (0.0, DURATION),
    y_range: tuple[float, float] | None = None,
) -> list[Chart]:
    """Each channel of all flights over time, in the style of its name."""
    charts = []
    for channel in channels:
        name, symbol, unit = CHANNEL_LABELS[channel]
        chart = Chart(title=name, y=f"{symbol} [{unit}]", x_range=x_range, y_range=y_range)
        for label, flight in flights.items():
            colour, dash = looks[label]
            chart.line(flight.t, flight.channels[channel], colour, dash=dash, run=label)
        charts.append(chart)
    return charts


def fig3(study: Study) -> Made:
    """Draw errors and rates with K*, and the peaks against the values in the text."""
    flight, looks = study.flights[STAR], {STAR: (INK, "")}
    profiles, peaks = (_over_time({STAR: flight}, looks, x) for x in (PROFILES, ("chi", "gamma")))
    for chart, (channel, overshoot) in zip(peaks, printed.LARGEST_OVERSHOOT.items(), strict=True):
        chart.level(overshoot, name="stated: overshoot and peak time below")
        chart.upright(printed.LARGEST_PEAK_TIME, LIMIT, dash=DASHED)
        height, when = flight.peak(channel)
        chart.points(when, height, CHI, size=4.5, name=f"peak {height:.3f} rad at {when:.2f} s")
    return Made(
        figures={"fig3": sheet(profiles), "fig3_peak_time": sheet(peaks)},
        tables={"fig3": _history({"": flight})},
        values=flight.measures.loc[list(PROFILES), MEASURES].to_dict("index"),
    )


def fig4(study: Study) -> Made:
    """Draw the commands with K*, and the effect of the printed rate limits."""
    flight, readings = study.flights[STAR], {name: study.readings[name] for name in READING_LOOKS}
    looks = {"after limits": (INK, ""), "before limits": (NEUTRAL, "")}
    commands = {"before limits": flight.unlimited, "after limits": flight.u}
    read_commands = {name: reading.u for name, reading in readings.items()}
    read = _over_time(readings, READING_LOOKS, ("chi", "gamma"))
    read += _command_charts(flight.t, read_commands, READING_LOOKS)
    phi, n_z = np.max(np.abs(flight.u), axis=0).tolist()
    phi_rate, n_z_rate = np.max(np.abs(flight.command_rates), axis=0).tolist()
    rate_limited = readings["ranges and rate limits"].converged
    anti_windup = readings["with rate limits and anti-windup"].converged
    return Made(
        figures={
            "fig4": sheet(
                _command_charts(flight.t, commands, looks), legend=[*_named(looks), PRINTED_RANGE]
            ),
            "fig4_rate_limits": sheet(read, legend=[*_named(READING_LOOKS), PRINTED_RANGE]),
        },
        tables={
            "fig4": _history({"": flight}),
            "fig4_rate_limits": _history({k.replace(" ", "_"): x for k, x in readings.items()}),
        },
        values={
            "largest_phi_rad": phi,
            "largest_n_z": n_z,
            "largest_phi_rate_radps": phi_rate,
            "largest_n_z_rate_1_per_s": n_z_rate,
            "readings": {
                name: {
                    "status": reading.status,
                    "converged": reading.converged,
                    **reading.measures.loc[["chi", "gamma"], ["MO_rad", "PT_s"]].to_dict("index"),
                }
                for name, reading in study.readings.items()
            },
        },
        numbers={
            "rate_limits": printed_limits().rate_upper,
            "rate_limited": "converges" if rate_limited else "does not converge",
            "anti_windup": "does" if anti_windup else "does not",
        },
    )


def _named(looks: Mapping[str, Look]) -> list[LegendEntry]:
    """A legend of lines by their names."""
    return [(name, *look) for name, look in looks.items()]


def _command_charts(
    t: FloatArray, commands: Mapping[str, FloatArray], looks: Mapping[str, Look]
) -> list[Chart]:
    """Roll and load factor of commands, shape (k, 2), with their printed ranges."""
    limits, charts = printed_limits(), []
    for i, (name, label) in enumerate((("roll", "φ [rad]"), ("load factor", "n_z [1]"))):
        chart = Chart(title=f"commanded {name}", y=label, x_range=(0.0, DURATION))
        for run, command in commands.items():
            chart.line(t, command[:, i], looks[run][0], run=run)
        for end in (limits.lower[i], limits.upper[i]):
            chart.level(float(end))
        charts.append(chart)
    return charts


def fig5(study: Study) -> Made:
    """Draw errors and rates with K1 to K6 and K*."""
    looks = {name: (base.GAIN_COLOURS[name], "") for name in study.flights}
    rows = study.indicators.items()
    legend = [(f"{name}: R_K {x.R_K:.3f}, I_K {x.I_K:.2f}", *looks[name]) for name, x in rows]
    return Made(
        figures={"fig5": sheet(_over_time(study.flights, looks, PROFILES), legend=legend)},
        tables={
            "fig5": _history(study.flights, commands=False),
            "fig5_measures": _measures_table(study.by_gains),
        },
        values=_measures_of(study.by_gains),
        numbers=_at_ends(study.of_gains("chi", "ITAE")),
    )


def fig9(study: Study) -> Made:
    """Draw errors and rates with K* under d1 to d9, and the errors after 20 s enlarged."""
    flights = study.disturbed
    looks = {name: (AMPLITUDE_COLOURS[L], OMEGA_DASHES[w]) for name, (L, w) in TABLE_3.items()}
    legend = [(f"{name}: L_d {L:g}, ω_d {w:g}", *looks[name]) for name, (L, w) in TABLE_3.items()]
    whole = _over_time(flights, looks, PROFILES, x_range=(0.0, AFTERWARDS))
    for chart in whole:
        chart.upright(DURATION)
    ends = DURATION, AFTERWARDS
    later = _over_time(flights, looks, PROFILES[:2], x_range=ends, y_range=(-0.08, 0.08))
    values = _measures_of(study.by_disturbance)
    for name, flight in flights.items():
        for channel in ("chi", "gamma"):
            values[name][channel]["largest_after_20_s_rad"] = flight.after(channel, DURATION)
    return Made(
        figures={"fig9": sheet(whole, legend=legend), "fig9_after": sheet(later, legend=legend)},
        tables={
            "fig9": _history(flights, commands=False),
            "fig9_measures": _measures_table(study.by_disturbance),
        },
        values=values,
    )


def _over(
    study: Study, indicator: str, measure: str, channels: Sequence[str], *, title: str, y: str
) -> Chart:
    """A measure of some channels over an indicator, which orders the gain sets."""
    values, label = study.indicator(indicator).sort_values(), base.INDICATOR_LABELS[indicator]
    chart = Chart(title=f"{title} against {indicator}", x=label, y=y, x_room=0.05)
    for channel in channels:
        row = study.of_gains(channel, measure).loc[values.index]
        marked_line(chart, values, row, LOOKS[channel], run=CHANNEL_LABELS[channel][1])
    return chart


def _legend(channels: Sequence[str]) -> list[LegendEntry]:
    return [(CHANNEL_LABELS[channel][1], *LOOKS[channel]) for channel in channels]


def _over_R_K(study: Study, measures: dict[str, str], channels: Sequence[str]) -> Sheet:
    """Panels of measures over R_K, with the names of the gain sets along the top."""
    charts = []
    for measure, label in measures.items():
        chart = _over(study, "R_K", measure, channels, title=label.split()[0], y=label)
        top = 1.15 * chart.y_ends()[1]
        for name, row in study.indicators.items():
            chart.text(row.R_K, top, name, anchor="middle")
        charts.append(chart)
    return sheet(charts, legend=_legend(channels))


def fig6(study: Study) -> Made:
    """Draw ITAE, MO and PT against R_K."""
    R_K = study.indicator("R_K")
    trends = {
        measure: {
            channel: rank_correlation(R_K, study.of_gains(channel, measure)) for channel in PROFILES
        }
        for measure in FIG_7
    }
    return Made(
        figures={"fig6": _over_R_K(study, FIG_7, PROFILES)},
        tables={"fig6": _measures_table(study.by_gains)},
        values={"measures": _measures_of(study.by_gains), "rank_correlation_with_R_K": trends},
    )


def fig7(study: Study) -> Made:
    """Draw MS and ST of s_chi and s_gamma against R_K."""
    channels = ["s_chi", "s_gamma"]
    of_both = study.by_gains.loc[(slice(None), channels), :]
    return Made(
        figures={"fig7": _over_R_K(study, FIG_13, channels)},
        tables={"fig7": _measures_table(of_both)},
        values=_measures_of(of_both),
        numbers=_at_ends(study.of_gains("s_gamma", "MS_rad")),
    )


def fig8(study: Study) -> Made:
    """Draw means and deviations over the whole flight, against R_K above and I_K below."""
    charts = [
        _over(study, indicator, measure, channels, title=title, y=label)
        for indicator in base.INDICATOR_LABELS
        for measure, channels, title, label in FIG_9
    ]
    spread, deviations = {}, {}
    for channel in ("chi_dot", "gamma_dot"):
        spread[channel] = float(np.ptp(study.of_gains(channel, "mean")))
        deviation = study.of_gains(channel, "std").to_list()
        deviations[channel] = deviation[0], min(deviation), deviation[-1]
    return Made(
        figures={"fig8": sheet(charts, legend=_legend(PROFILES))},
        tables={"fig8": _measures_table(study.by_gains)},
        values={"measures": _measures_of(study.by_gains), "spread_of_mean_rates": spread},
        numbers=deviations,
    )


def fig10(study: Study) -> Made:
    """Draw ITAE, MS and ST of K*, with hue for the amplitude and dashes for the channel."""
    charts, legend = [], []
    for measure, channels, title, label in FIG_10:
        chart = Chart(title=f"{title} with K*", x="ω_d [rad/s]", y=label, x_room=0.05)
        for channel, symbol, dash in zip(channels, "χγ", ("", DASHED), strict=True):
            table = study.of_disturbances(channel, measure)
            for L_d, colour in AMPLITUDE_COLOURS.items():
                name = f"{symbol}, L_d {L_d:g}"
                marked_line(chart, table.columns, table.loc[L_d], (colour, dash), run=name)
                if not charts:
                    legend.append((name, colour, dash))
        chart.y_range = 0.0, chart.y_ends()[1]
        charts.append(chart)
    growth = {channel: study.growth_of_ST(channel) for channel in ("s_chi", "s_gamma")}
    return Made(
        figures={"fig10": sheet(charts, legend=legend)},
        tables={"fig10": _measures_table(study.by_disturbance)},
        values={"measures": _measures_of(study.by_disturbance), "largest_growth_of_ST_rad": growth},
        numbers={"released": {name: flight.released for name, flight in study.disturbed.items()}},
    )
