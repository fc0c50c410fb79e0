"""Draw docs/corridor.svg, a route in its counted corridor: python docs/figures/corridor.py FILE.

FILE is the band of `flighttune band circuit_in_wind --epsilon 0.05 --confidence 0.95 --learn 60
--flights 93 --out FILE`.
"""

import sys
from pathlib import Path

import numpy as np

from flighttune.claims.band import Band
from flighttune.claims.counted_file import load_counted
from flighttune.outputs.drawing.chart import Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, INK

FILE = Path(__file__).parents[1] / "corridor.svg"
HEIGHT, KM = 270.0, 1000.0
(BLUE, _), (LIGHT, _) = HUES[0]

WIDER = 10
"""Factor by which the corridor is drawn wider: a true one is as narrow as the line of the route."""

MAX_FLIGHTS = 50


def route(band: Band) -> Chart:
    """The route from above, and the edges of its corridor."""
    path, *_ = band.flights.route.where
    corridor = band.corridor()
    chart = Chart(
        title=f"A route of {path.length / KM:.1f} km from above",
        x="east [m]",
        y="north [m]",
        equal=True,
        height=HEIGHT,
    )
    s = np.arange(0.0, path.length, 5.0)
    window = np.searchsorted(corridor.windows[:, 0], s, side="right") - 1
    north, east, course = (np.interp(s, path.s, x) for x in (path.north, path.east, path.course))
    for ends, name in (
        (corridor.low, f"corridor, drawn {WIDER} times as wide"),
        (corridor.high, ""),
    ):
        right = WIDER * ends[window, 0]
        across, up = east + right * np.cos(course), north - right * np.sin(course)
        chart.line(across, up, BLUE, width=1.0, name=name)
    chart.line(east, north, INK, name="planned path")
    return chart


def flights(band: Band) -> Chart:
    """Distances of some counted flights from the route, and the corridor that all of them set."""
    flights, corridor = band.flights, band.corridor()
    chart = Chart(
        title=f"How far {len(band.scores)} flights in wind and turbulence come from it",
        x="along the route [km]",
        y="to the right of the route [m]",
        height=HEIGHT,
    )
    middles = corridor.windows.mean(axis=1) / KM
    chart.band(middles, corridor.low[:, 0], corridor.high[:, 0], BLUE, name="corridor")
    # evenly spaced by how near they are to leaving, the nearest first
    inside = np.argsort(band.scores)[: np.sum(band.scores <= band.scale)][::-1]
    some = inside[:: -(-len(inside) // MAX_FLIGHTS)]
    distances = band.extremes[some, :, list(band.about.signals).index("cross_track")]
    x = np.linspace(flights.edges[0], flights.edges[-1], 2 * len(middles)) / KM
    # one line that is broken between two flights
    lines = np.pad(distances.reshape(len(some), -1), ((0, 0), (0, 1)), constant_values=np.nan)
    xs = np.tile(np.append(x, np.nan), len(some))
    name = f"lowest and highest distances of {len(some)}"
    chart.line(xs, lines.ravel(), LIGHT, width=0.5, name=name, most=len(xs))
    return chart


if __name__ == "__main__":
    counted = load_counted(sys.argv[1])
    assert isinstance(counted, Band)
    Sheet(charts=[route(counted), flights(counted)]).save(FILE)
