"""Charts of a counted band: its signals with the flights that were counted."""

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.claims.band import Band
from flighttune.claims.fence import KEPT
from flighttune.claims.shape import predicted
from flighttune.present.chart import DOTTED, Chart
from flighttune.present.names import shown_unit
from flighttune.present.palette import HUES, LIMIT, NEUTRAL
from flighttune.references.fence import read_fence
from flighttune.references.maps import rings_around
from flighttune.reports.panels import ERRORS
from flighttune.reports.route_charts import APART, DISTANCE_AXIS, KM, ROUTE_ERRORS, route_map

# Fewest flights drawn inside the band, if so many are.
MIN_DRAWN = 100

(STRONG, _), (LIGHT, _) = HUES[0]

# Titles and labels of signals; others have their names.
TITLES = {name: (title, label) for name, title, label in (*ERRORS, *ROUTE_ERRORS)}


def band_charts(band: Band, room: Band | None = None) -> list[Chart]:
    """Each signal with the flights that were counted; on a route its map before them.

    `room`: of flights of the route that turn back.
    """
    charts = [_chart(band, i) for i in range(len(band.about.signals))]
    return [_map(band, room), _heights(band), *charts] if band.flights.over == "along" else charts


def _chart(band: Band, i: int) -> Chart:
    """One signal: the band, and flights in it, outside of it and nearest to leaving it."""
    about = band.about
    name, si = list(about.signals.items())[i]
    unit, factor = shown_unit(si)
    title, label = TITLES.get(name, (name, f"{name} [{unit}]"))
    edges, axis = band.flights.edges, "t [s]"
    if band.flights.over == "along":
        edges, axis = edges / KM, DISTANCE_AXIS
    chart = Chart(title=title, x=axis, y=label, linked=True)
    flights = band.extremes[..., i, :].astype(float)
    middle = predicted(band.wind, about.coefficients)[..., i]
    if about.predicted_from:
        flights, middle = flights - middle[..., None], np.zeros_like(middle)
    # both extremes of a window, one after the other
    flights = flights.reshape(len(flights), -1)
    x = np.linspace(edges[0], edges[-1], flights.shape[1])
    low, high = (
        factor * np.repeat(middle[0] + sign * band.half_widths[:, i], 2) for sign in (-1.0, 1.0)
    )
    chart.band(x, low, high, NEUTRAL, name="counted band")
    for edge in (low, high):
        chart.line(x, edge, NEUTRAL, dash=DOTTED, width=1.2, hover=False)
    completed, within = np.isfinite(band.scores), band.scores <= band.scale
    inside, outside = (np.flatnonzero(completed & side) for side in (within, ~within))
    chosen = inside[:: max(1, len(inside) // MIN_DRAWN)]
    _lines(chart, x, factor * flights[chosen], LIGHT, f"{len(chosen)} of {len(inside)} inside", 0.5)
    _lines(chart, x, factor * flights[outside], LIMIT, f"{len(outside)} outside", 0.9)
    if band.claims:
        nearest = factor * flights[band.draws.tolist().index(band.nearest)]
        chart.line(x, nearest, STRONG, name=f"draw {band.nearest}, nearest to leaving")
    return chart


def _map(band: Band, room: Band | None) -> Chart:
    """The route from above with the corridor that the band claims, if it does, and its fences."""
    about, (path, origin, _) = band.about, band.flights.route.where
    s, sides = path.points(APART), None
    if "cross_track" in about.signals and band.claims and not about.predicted_from:
        bounds, i = band.bounds(s), list(about.signals).index("cross_track")
        sides = np.stack([bounds.low[:, i], bounds.high[:, i]])
    chart = route_map(band.flights.central, path, s, sides)
    for tables in about.fences:
        fence = read_fence(KEPT, origin, tables)
        ends = np.stack([fence.start, fence.end, np.full_like(fence.end, np.nan)], axis=1)
        north, east = ends.reshape(-1, 2).T
        chart.line(east, north, LIMIT, name="fence", most=len(north), hover=False)
    if room is not None and room.claims and band.claims:
        for name, volume in room.volumes(band).items():
            breaks = [
                np.vstack([ring, [np.nan, np.nan]]) for ring in rings_around(path, volume.width)
            ]
            north, east = np.concatenate(breaks).T
            chart.line(east, north, NEUTRAL, name=name, most=len(north), hover=False)
    return chart


def _heights(band: Band) -> Chart:
    """Height over the start along the route, in the band, with floor and ceiling of its fences."""
    about, (path, origin, _) = band.about, band.flights.route.where
    ends = 0.0, path.length / KM
    chart = Chart(title="Height over the start", x=DISTANCE_AXIS, y="h [m]", x_range=ends)
    s = path.points(APART)
    if "height_err" in about.signals and band.claims and not about.predicted_from:
        bounds, i = band.bounds(s), list(about.signals).index("height_err")
        high, low = (path.beside(s, below=x[:, i])[:, 2] for x in (bounds.low, bounds.high))
        chart.band(s / KM, low, high, NEUTRAL, name="corridor")
    chart.line(s / KM, np.interp(s, path.s, path.up), STRONG, name="planned")
    for tables in about.fences:
        fence = read_fence(KEPT, origin, tables)
        for height, name in ((fence.high, "ceiling"), (fence.low, "floor")):
            if np.isfinite(height):
                chart.line(np.array(ends), np.full(2, height), LIMIT, name=name)
    return chart


def _lines(
    chart: Chart, x: FloatArray, flights: FloatArray, colour: str, name: str, width: float
) -> None:
    """A line for each flight, as one line that is broken between them."""
    if len(flights):
        gap = np.full((len(flights), 1), np.nan)
        ys = np.hstack([flights, gap]).ravel()
        xs = np.tile(np.append(x, np.nan), len(flights))
        chart.line(xs, ys, colour, name=name, width=width, most=len(xs), hover=False)
