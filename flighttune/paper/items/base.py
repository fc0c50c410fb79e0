"""Common parts of the paper's figures: colours, labels, kinds of panel, and results of items."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy.typing as npt
import pandas as pd

from flighttune.paper.flight import PaperFlight
from flighttune.paper.parameters import DURATION, STAR, TABLE_2
from flighttune.present.chart import DASHED, DOTTED, Chart, LegendEntry, Sheet
from flighttune.present.palette import HUES, INK

STRONG = [strong for (strong, _), _ in HUES]
CHI, GAMMA, GREEN, MAGENTA = STRONG[:4]  # the first two: course and path angle of one flight

# A gain set has the same colour in the recording.
GAIN_COLOURS = {STAR: INK, **dict(zip(TABLE_2, STRONG, strict=True))}

AMPLITUDE_COLOURS = {0.1: CHI, 0.2: GREEN, 0.3: MAGENTA}
OMEGA_DASHES = {0.1: "", 0.15: DASHED, 0.2: DOTTED}

# Name, symbol and unit of each channel.
CHANNEL_LABELS = {
    "chi": ("course error", "e_χ", "rad"),
    "gamma": ("path-angle error", "e_γ", "rad"),
    "chi_dot": ("rate of the course error", "ė_χ", "rad/s"),
    "gamma_dot": ("rate of the path-angle error", "ė_γ", "rad/s"),
    "s_chi": ("course error and its rate", "s_χ", "rad"),
    "s_gamma": ("path-angle error and its rate", "s_γ", "rad"),
}
INDICATOR_LABELS = {"R_K": "R_K [1/s]", "I_K": "I_K [s²]"}
COMMAND_LABELS = {"roll": "φ [rad]", "load factor": "n_z [1]"}


Look: TypeAlias = tuple[str, str]  # colour and dashes of a line


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Made:
    """An item as computed."""

    figures: Mapping[str, Sheet]  # by file name; the first bears the item's name
    # Content of the figures, by file name; the first bears the item's name. Columns carry units
    tables: Mapping[str, pd.DataFrame]
    values: Mapping[str, Any]  # the numbers of the item, plain: ``--json`` prints them
    # Further numbers, which only its sentences name
    numbers: Mapping[str, Any] = field(default_factory=dict)


def named(looks: Mapping[str, Look]) -> list[LegendEntry]:
    """A legend of lines by their names."""
    return [(name, *look) for name, look in looks.items()]


def sheet(charts: Sequence[Chart], *, legend: Sequence[LegendEntry] = ()) -> Sheet:
    """Charts as one figure, lettered like the panels of the paper where there are several."""
    if len(charts) > 1:
        for letter, chart in zip("abcdefgh", charts, strict=False):
            chart.title = f"({letter}) {chart.title}"
    return Sheet(charts=charts, columns=min(len(charts), 2), legend=legend)


def over_time(
    flights: Mapping[str, PaperFlight],
    looks: Mapping[str, Look],
    channel: str,
    *,
    x_range: tuple[float, float] = (0.0, DURATION),
    y_range: tuple[float, float] | None = None,
) -> Chart:
    """A channel of each flight over time, in the look of its name."""
    name, symbol, unit = CHANNEL_LABELS[channel]
    chart = Chart(title=name, y=f"{symbol} [{unit}]", x_range=x_range, y_range=y_range)
    for label, flight in flights.items():
        colour, dash = looks[label]
        chart.line(flight.t, flight.channels[channel], colour, dash=dash, run=label)
    return chart


def marked_line(
    chart: Chart,
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    colour: str,
    *,
    dash: str = "",
    name: str = "",
    run: str = "",
) -> None:
    """Draw a line with a dot at each of its points, hollow on a dashed line."""
    chart.line(x, y, colour, dash=dash, name=name, run=run)
    chart.points(x, y, colour, filled=not dash)
