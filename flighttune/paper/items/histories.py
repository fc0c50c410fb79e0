"""Figures 5, 12, 8 and 11: the manoeuvre over time, with K*, K1 to K6 and under d1 to d9."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.flight import PaperFlight
from flighttune.paper.items.base import Made
from flighttune.paper.measures import CHANNELS
from flighttune.paper.parameters import AFTERWARDS, DURATION, STAR, printed_limits
from flighttune.paper.study import Study
from flighttune.present.palette import INK, NEUTRAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PROFILES = ("chi", "gamma", "chi_dot", "gamma_dot")
"""The errors and their rates, panels (a) to (d) of figures 5, 8 and 11."""

MEASURES = ["ITAE", "MO_rad", "PT_s", "MS_rad", "ST_rad", "mean", "std"]

READING_COLOURS = {
    "ranges only": INK,
    "ranges and rate limits": style.GAMMA,
    "with rate limits and anti-windup": style.GREEN,
}
"""Readings of the limits that are drawn; without any limit the loop diverges off the page."""

COLUMNS = (
    *("e_chi_rad", "e_gamma_rad", "e_chi_dot_radps", "e_gamma_dot_radps"),
    *("phi_rad", "n_z", "phi_wanted_rad", "n_z_wanted"),
)
"""Of a flight in a file: errors, their rates, commands after and before the limits."""

COMMAND_LABELS = "φ [rad]", "$n_z$ [1]"


def history_table(flights: Mapping[str, PaperFlight], *, commands: bool = True) -> pd.DataFrame:
    """Errors, rates, and commands after and before the limits, flights side by side."""
    table = {"t_s": next(iter(flights.values())).t}
    for name, flight in flights.items():
        signals = np.hstack([flight.error, flight.error_rate, flight.u, flight.unlimited]).T
        for column, values in zip(COLUMNS if commands else COLUMNS[:4], signals, strict=False):
            table[f"{name}_{column}" if name else column] = values
    return pd.DataFrame(table)


def profiles(
    flights: Mapping[str, PaperFlight],
    lines: Mapping[str, dict[str, Any]],
    *,
    end: float = DURATION,
    columns: int = 1,
    channels: Sequence[str] = PROFILES,
) -> "tuple[Figure, list[Axes]]":
    """Panels of errors and their rates, two a row, a line a flight, with one legend."""
    rows = len(channels) // 2
    titles = [style.LABELS[channel] for channel in channels]
    figure, panels = style.grid(rows, 2, size=(8.6, 0.6 + 2.6 * rows), titles=titles)
    for panel, channel in zip(panels, channels, strict=True):
        for name, flight in flights.items():
            panel.plot(flight.t, flight.channels[channel], **lines[name])
        style.over_time(panel, f"{style.LABELS[channel]} [{style.UNITS[channel]}]", end)
    if len(flights) > 1:
        style.legend_above(figure, panels[0], columns=columns)
    return figure, panels


def measures_of(table: pd.DataFrame) -> dict[str, dict[str, dict[str, float]]]:
    """Measures by name and channel as plain numbers, from an index (name, channel)."""
    names = table.index.get_level_values(0).unique()
    return {
        str(name): {
            channel: {key: float(table.loc[(name, channel), key]) for key in MEASURES}
            for channel in CHANNELS
        }
        for name in names
    }


def measures_table(table: pd.DataFrame) -> pd.DataFrame:
    """Measures as rows of name and channel, for a file."""
    return table[MEASURES].rename_axis(["name", "channel"]).reset_index()


def at_ends(from_high_to_low: pd.Series) -> dict[str, float]:
    """A measure of the gain sets with the highest and the lowest R_K."""
    first, *_, last = from_high_to_low
    return {"at_highest_R_K": first, "at_lowest_R_K": last}


def fig5(study: Study) -> Made:
    """Draw errors and rates with K*, and the peaks against what the text says of them."""
    flight = study.flights[STAR]
    figure, _ = profiles({STAR: flight}, {STAR: {"color": INK}})
    return Made(
        figures={"fig5": figure, "fig5_peak_time": _peaks(flight)},
        tables={"fig5": history_table({"": flight})},
        values={
            channel: {key: float(flight.measures.loc[channel, key]) for key in MEASURES}
            for channel in PROFILES
        },
    )


def _peaks(flight: PaperFlight) -> "Figure":
    figure, panels = style.grid(1, 2, size=(8.6, 3.3), titles=("$e_χ$", "$e_γ$"))
    for panel, (channel, overshoot) in zip(panels, printed.LARGEST_OVERSHOOT.items(), strict=True):
        panel.plot(flight.t, flight.channels[channel], color=INK)
        label = "stated: overshoot and peak time below"
        style.limits(panel, x=(printed.LARGEST_PEAK_TIME,), y=(overshoot,), label=label)
        height, when = flight.peak(channel)
        label = f"peak {height:.3f} rad at {when:.2f} s"
        panel.plot(when, height, "o", color=style.CHI, ms=6, label=label)
        style.over_time(panel, f"{style.LABELS[channel]} [rad]", DURATION)
        panel.legend(loc="lower right")
    return figure


def fig12(study: Study) -> Made:
    """Draw the commands with K*, and what the printed rate limits do to the manoeuvre."""
    flight = study.flights[STAR]
    flights = {name: study.readings[name] for name in READING_COLOURS}
    rates = np.max(np.abs(flight.command_rates), axis=0)
    largest = np.max(np.abs(flight.u), axis=0)
    rate_limited = flights["ranges and rate limits"]
    anti_windup = flights["with rate limits and anti-windup"]
    return Made(
        figures={"fig12": _commands(flight), "fig12_rate_limits": _readings(flights)},
        tables={
            "fig12": history_table({"": flight}),
            "fig12_rate_limits": history_table(
                {name.replace(" ", "_"): one for name, one in flights.items()}
            ),
        },
        values={
            "largest_phi_rad": float(largest[0]),
            "largest_n_z": float(largest[1]),
            "largest_phi_rate_radps": float(rates[0]),
            "largest_n_z_rate_1_per_s": float(rates[1]),
            "readings": {name: _peak_values(one) for name, one in study.readings.items()},
        },
        numbers={
            "rate_limits": printed_limits().rate_upper,
            "rate_limited": "converges" if rate_limited.converged else "does not converge",
            "anti_windup": "does" if anti_windup.converged else "does not",
        },
    )


def _peak_values(flight: PaperFlight) -> dict[str, object]:
    peaks = {channel: flight.peak(channel) for channel in ("chi", "gamma")}
    return {
        "status": flight.status,
        "converged": flight.converged,
        **{channel: {"MO_rad": height, "PT_s": t} for channel, (height, t) in peaks.items()},
    }


def _commands(flight: PaperFlight) -> "Figure":
    figure, panels = style.grid(1, 2, size=(8.6, 3.2), titles=("φ(t)", "$n_z$(t)"))
    limits = printed_limits()
    for i, (panel, label) in enumerate(zip(panels, COMMAND_LABELS, strict=True)):
        panel.plot(flight.t, flight.unlimited[:, i], color=NEUTRAL, lw=0.9, label="before limits")
        panel.plot(flight.t, flight.u[:, i], color=INK, label="after limits")
        style.limits(panel, y=(limits.lower[i], limits.upper[i]), label="printed range")
        style.over_time(panel, label, DURATION)
    style.legend_above(figure, panels[0], columns=3)
    return figure


def _readings(flights: dict[str, PaperFlight]) -> "Figure":
    titles = "$e_χ$", "$e_γ$", "φ", "$n_z$"
    figure, panels = style.grid(2, 2, size=(8.6, 5.6), titles=titles)
    errors, commands, limits = panels[:2], panels[2:], printed_limits()
    for i, channel in enumerate(("chi", "gamma")):
        for name, flight in flights.items():
            line: dict[str, Any] = {"color": READING_COLOURS[name], "label": name}
            errors[i].plot(flight.t, flight.channels[channel], **line)
            commands[i].plot(flight.t, flight.u[:, i], **line)
        style.over_time(errors[i], f"{style.LABELS[channel]} [rad]", DURATION)
        style.over_time(commands[i], COMMAND_LABELS[i], DURATION)
        style.limits(commands[i], y=(limits.lower[i], limits.upper[i]))
    style.legend_above(figure, panels[0], columns=3)
    return figure


def fig8(study: Study) -> Made:
    """Draw errors and rates with K1 to K6 and K*."""
    lines = {
        name: {
            "color": style.GAIN_COLOURS[name],
            "label": f"{name}: $R_K$ {found.R_K:.3f}, $I_K$ {found.I_K:.2f}",
        }
        for name, found in study.indicators.items()
    }
    figure, _ = profiles(study.flights, lines, columns=4)
    return Made(
        figures={"fig8": figure},
        tables={
            "fig8": history_table(study.flights, commands=False),
            "fig8_measures": measures_table(study.by_gains),
        },
        values=measures_of(study.by_gains),
        numbers=at_ends(study.of_gains("chi", "ITAE")),
    )


def fig11(study: Study) -> Made:
    """Draw errors and rates with K* under d1 to d9, and the errors after 20 s enlarged."""
    flights = study.disturbed
    lines = {name: style.disturbance_style(name) for name in flights}
    figure, panels = profiles(flights, lines, end=AFTERWARDS, columns=3)
    for panel in panels:
        panel.axvline(DURATION, color=NEUTRAL, lw=0.9)
    later, panels = profiles(flights, lines, end=AFTERWARDS, columns=3, channels=("chi", "gamma"))
    for panel in panels:
        panel.set(xlim=(DURATION, AFTERWARDS), ylim=(-0.08, 0.08))
    values = measures_of(study.by_disturbance)
    for name, flight in flights.items():
        for channel in ("chi", "gamma"):
            values[name][channel]["largest_after_20_s_rad"] = flight.after(channel, DURATION)
    return Made(
        figures={"fig11": figure, "fig11_after": later},
        tables={
            "fig11": history_table(flights, commands=False),
            "fig11_measures": measures_table(study.by_disturbance),
        },
        values=values,
    )
