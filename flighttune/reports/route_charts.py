"""Charts of a route: a map, and height and distances from it along the way."""

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.flight.conditions import reference_of
from flighttune.present.chart import Chart
from flighttune.present.palette import INK, NEUTRAL
from flighttune.references.follow import RouteReference
from flighttune.references.path import Path
from flighttune.reports.panels import Drawn, draw_claims, most_points
from flighttune.scenario.load import scenario_of
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import claimed_along

ROUTE_ERRORS = (
    ("cross_track", "To the right of the route", "e_y [m]"),
    ("height_err", "Below the route", "e_h [m]"),
)

# The three charts along the route stand beside the map, in three rows of the page.
ROW_HEIGHT, MAP_HEIGHT = 150.0, 510.0

DISTANCE_AXIS, KM = "along the route [km]", 1000.0

# Distance between points of the corridor's edges, m.
APART = 10.0

# Factors on the width of a corridor, and its largest width then as a share of the map.
CORRIDOR_FACTORS, MAX_CORRIDOR_SHARE = (2, 5, 10, 20, 50, 100), 0.02

# Length of the wind arrow as a share of the map.
ARROW = 0.12


def planned_path(flights: Drawn) -> Path | None:
    """The path of the route that runs fly, if they fly one."""
    followed = reference_of(scenario_of(flights[0][0]))
    return followed.path if isinstance(followed, RouteReference) else None


def route_charts(flights: Drawn) -> list[Chart]:
    """Map, height, and distances from the route of flights along it; none without a route."""
    path = planned_path(flights)
    if path is None:
        return []
    return [_map(flights, path), _height(flights, path), *_errors(flights, path)]


def _map(flights: Drawn, path: Path) -> Chart:
    """The map of the route with flights."""
    s, most = path.points(APART), most_points(len(flights))
    chart = route_map(scenario_of(flights[0][0]), path, s, _corridor(flights, "cross_track", s))
    for run, style in flights:
        chart.run_line(run.signals["east"], run.signals["north"], style, run.label, most=most)
    return chart


def route_map(scenario: Scenario, path: Path, s: FloatArray, corridor: FloatArray | None) -> Chart:
    """Seen from above, north up: planned path, waypoints, wind, and a corridor at distances `s`."""
    chart = Chart(title="Map", x="east [m]", y="north [m]", equal=True, height=MAP_HEIGHT)
    inside = path.s <= path.length
    east, north = path.east[inside], path.north[inside]
    if corridor is not None:
        sides = np.append(corridor[0], corridor[1, ::-1])
        largest_factor = MAX_CORRIDOR_SHARE * max(np.ptp(east), np.ptp(north)) / np.abs(sides).max()
        wider = max((times for times in CORRIDOR_FACTORS if times <= largest_factor), default=1)
        up, across, _ = path.beside(np.append(s, s[::-1]), wider * sides).T
        name = "corridor" if wider == 1 else f"corridor, drawn {wider} times as wide"
        chart.area(across, up, NEUTRAL, name=name)
    chart.line(east, north, NEUTRAL, name="planned path", width=2.2)
    assert scenario.route is not None
    points = scenario.route.waypoints()
    places = [point.east for point in points], [point.north for point in points]
    chart.points(*places, INK, size=2.0)
    chart.label_points([(p.east, p.north, f"{i}") for i, p in enumerate(points, start=1)])
    if rally := scenario.route.rally_points():
        north, east = zip(*rally, strict=True)
        chart.points(east, north, INK, size=4.0)
        chart.label_points([(e, n, "rally") for n, e in rally])
    if scenario.wind is not None:
        _wind_arrow(chart, np.array(scenario.wind.profile().at(scenario.flight.h_m)[:2]))
    return chart


def _wind_arrow(chart: Chart, wind: FloatArray) -> None:
    """An arrow with the wind in the upper left corner, and its speed."""
    speed = float(np.hypot(*wind))
    if speed == 0.0:
        return
    (left, right), (_, top) = chart.x_ends(), chart.y_ends()
    size = ARROW * (right - left)
    ahead = size * wind[::-1] / speed  # east and north
    aside = 0.2 * ahead[::-1] * [-1.0, 1.0]
    tail = np.array([left, top]) + 0.7 * size * np.array([1.0, -1.0]) - 0.5 * ahead
    head, neck = tail + ahead, tail + 0.7 * ahead
    for line in ([tail, head], [neck + aside, head, neck - aside]):
        across, up = np.transpose(line)
        chart.line(across, up, INK, width=1.8)
    place = (left + 1.4 * size, top - 0.7 * size)
    chart.text(*place, f"wind at the start {speed:.3g} m/s", shift=(0.0, 4.0))


def _height(flights: Drawn, path: Path) -> Chart:
    """Height over the start along the route, in its corridor; turns have the waypoint's number."""
    chart = _along(path, "Height over the start", "h [m]")
    s = path.points(APART)
    if (corridor := _corridor(flights, "height_err", s)) is not None:
        high, low = (path.beside(s, below=end)[:, 2] for end in corridor)
        chart.band(s / KM, low, high, NEUTRAL, name="corridor")
    chart.line(path.s / KM, path.up, NEUTRAL, name="planned", width=2.2)
    for run, style in flights:
        along, down = (run.signals[name].to_numpy() for name in ("along", "down"))
        chart.run_line(along / KM, -down, style, run.label, most=most_points(len(flights)))
    for turn in path.stretches:
        if turn.kind != "leg":
            middle = turn.start + 0.5 * turn.length
            height, number = float(np.interp(middle, path.s, path.up)), f"{turn.waypoint}"
            chart.text(middle / KM, height, number, anchor="middle", shift=(0.0, -5.0))
    low, high = chart.y_ends()
    chart.y_range = low, high + 0.15 * (high - low)  # room for the numbers
    return chart


def _errors(flights: Drawn, path: Path) -> list[Chart]:
    """Distances of flights from the route along it, in the band counted for them."""
    charts = []
    for signal, title, unit in ROUTE_ERRORS:
        chart = _along(path, title, unit)
        chart.level(0.0, NEUTRAL, dash="")
        for run, style in flights:
            along = run.signals["along"].to_numpy() / KM
            draw_claims(chart, run, along, signal, style.colour)
            values, most = run.signals[signal].to_numpy(), most_points(len(flights))
            chart.run_line(along, values, style, run.label, most=most)
        charts.append(chart)
    return charts


def _along(path: Path, title: str, unit: str) -> Chart:
    """An empty chart over the distance along the route."""
    ends = 0.0, path.length / KM
    return Chart(title=title, x=DISTANCE_AXIS, y=unit, x_range=ends, height=ROW_HEIGHT)


def _corridor(flights: Drawn, signal: str, s: FloatArray) -> FloatArray | None:
    """Both ends of the first band around a signal of a run, at distances along the route."""
    bounds = (ends for run, _ in flights for ends in claimed_along(run, signal, s))
    return next(bounds, None)
