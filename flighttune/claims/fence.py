"""The count of a band's flights that are certainly inside a fence."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from flighttune.errors import InputError
from flighttune.metrics import OFF_ROUTE
from flighttune.present.answer import Column

# Stands for the file of a fence that is kept with its band.
KEPT = Path("fence")

# Distance in samples, at the airspeed, by which positions may lie beyond the edges of a window.
OVERLAP_SAMPLES = 2.0

NEAREST_COLUMNS = [
    Column("what", "nearest to the fence"),
    Column("margin_m", "margin", "m", "z.2f"),
    Column("side", "side"),
    Column("edge", "edge"),
    Column("along_m", "along", "m", ".0f"),
    Column("stretch", "stretch"),
]


class Fenced(NamedTuple):
    """The flights of a band that are not certainly inside a fence."""

    heights: str  # floor and ceiling of the fence in words
    outside: int
    epsilon: float  # probability of leaving the fence that the count supports
    supported: bool  # whether it is at most that of the band
    nearest: list[dict[str, Any]]  # of the completed flights, and of the band if it has a corridor
    sentence: str


def check_off_route(signals: Iterable[str], over: str = "along") -> None:
    """Refuse a band without the distances from a route."""
    if over != "along" or not {*OFF_ROUTE} <= {*signals}:
        raise InputError(
            f"the band must be of {' and '.join(OFF_ROUTE)} along a route, got one of "
            f"{', '.join(signals)} over {'time' if over == 'time' else 'the distance along it'}."
        )
