"""Tables and panels over time that several items share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pandas as pd

from flighttune.paper import style
from flighttune.paper.flight import PaperFlight
from flighttune.paper.measures import CHANNELS

PROFILES = ("chi", "gamma", "chi_dot", "gamma_dot")
MEASURES = ("ITAE", "MO_rad", "PT_s", "MS_rad", "ST_rad", "mean", "std")


def columns_of(name: str, flight: PaperFlight) -> dict[str, Any]:
    """Errors, rates, commands and disturbance of one flight, columns with units."""
    prefix = f"{name}_" if name else ""
    return {
        f"{prefix}e_chi_rad": flight.error[:, 0],
        f"{prefix}e_gamma_rad": flight.error[:, 1],
        f"{prefix}e_chi_dot_radps": flight.error_rate[:, 0],
        f"{prefix}e_gamma_dot_radps": flight.error_rate[:, 1],
        f"{prefix}phi_rad": flight.u[:, 0],
        f"{prefix}n_z": flight.u[:, 1],
        f"{prefix}phi_wanted_rad": flight.unlimited[:, 0],
        f"{prefix}n_z_wanted": flight.unlimited[:, 1],
    }


def profiles_table(flights: Mapping[str, PaperFlight]) -> pd.DataFrame:
    """Errors and rates of several flights side by side."""
    table = {"t_s": next(iter(flights.values())).t}
    for name, flight in flights.items():
        columns = columns_of(name, flight)
        table |= {key: columns[key] for key in list(columns)[:4]}
    return pd.DataFrame(table)


def profiles(
    flights: Mapping[str, PaperFlight],
    line: Callable[[str], dict[str, Any]],
    *,
    end: float,
    columns: int,
    channels: Sequence[str] = PROFILES,
) -> Any:
    """Panels of errors and their rates, two a row, a line a flight, with one legend."""
    rows = len(channels) // 2
    figure, panels = style.grid(
        rows, 2, size=(8.6, 0.6 + 2.6 * rows), titles=[style.LABELS[name] for name in channels]
    )
    for panel, channel in zip(panels, channels, strict=True):
        for name, flight in flights.items():
            panel.plot(flight.t, flight.channels[channel], **line(name))
        style.over_time(panel, f"{style.LABELS[channel]} [{style.UNITS[channel]}]", end)
    if len(flights) > 1:
        style.legend_above(figure, panels[0], columns=columns)
    return figure


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
    return table[list(MEASURES)].rename_axis(["name", "channel"]).reset_index()
