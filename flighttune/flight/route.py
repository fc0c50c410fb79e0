"""The plan of a route for an aircraft, before any flight: stretches, turns and times."""

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.errors import InputError, printable
from flighttune.base.files.load import kind_of
from flighttune.base.files.whole import write_text
from flighttune.base.words import pick
from flighttune.flight.conditions import reference_of, slopes_not_held
from flighttune.flight.load import SPEED, as_scenario, is_model, route_scenario
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.follow import RouteReference
from flighttune.routes.items import listed_places
from flighttune.routes.maps import Corridor, Mark, RouteMap, Where, areas_of, on_earth
from flighttune.routes.mission import KINDS, ROUTE_FILES, read_route, route_plan
from flighttune.routes.path import STEP
from flighttune.vehicles.aircraft.aircraft import load_aircraft

# Default aircraft for a file.
AIRCRAFT = "aerosonde"

# Radii that differ by less than this count as equal, m.
WIDER_M = 0.5

# A larger distance of a path from a waypoint is reported, m: `WP_RADIUS` of ArduPilot's planes.
CORNER_M = 90.0


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedRoute(Answering):
    """The path along a route with arcs and clothoids, and its duration.

    Attributes
    ----------
    scenario : Scenario
        The scenario with the route and its aircraft.
    reference : RouteReference
        The path as a reference of the outer loop.
    wind : float, m/s
        Wind from any direction for which turns are wide enough.
    conditions : str
        Airspeed, wind and height of the start, marked if assumed.

    Examples
    --------
    >>> planned = ft.route("circuit")
    >>> round(planned.reference.path.length), round(planned.time)
    (11204, 448)
    """

    scenario: Scenario
    reference: RouteReference
    wind: float
    conditions: str

    @property
    def stretches(self) -> list[dict[str, Any]]:
        """Legs, turns and climbs in order, angles in rad."""
        g, s, V = self.reference.g, self.reference.path.s, self.reference.V
        level = np.concatenate([[0.0], np.cumsum(STEP / V)])[:-1]  # s: time to each point, level
        rows = []
        for stretch in self.reference.path.stretches:
            ends = stretch.start, stretch.start + stretch.length
            begins, arrives = np.interp(ends, s, level).tolist()
            V_a = float(np.interp([*ends, *s[(s > ends[0]) & (s < ends[1])]], s, V).max())
            row = {
                **pick(stretch, "kind waypoint name turn gamma"),
                "course": round(stretch.course, 9) % math.tau,  # -1e-17 is 0, not 360 deg
                "start_m": stretch.start,
                "length_m": stretch.length,
                "radius_m": None if math.isinf(stretch.radius) else stretch.radius,
                "roll": math.atan(V_a**2 / (g * stretch.radius)),
                "roll_downwind": math.atan((V_a + self.wind) ** 2 / (g * stretch.radius)),
                "time_s": (arrives - begins) / math.cos(stretch.gamma),
            }
            rows.append(row)
        return rows

    @property
    def time(self) -> float:
        """Time in still air, s."""
        return sum(stretch["time_s"] for stretch in self.stretches)

    @property
    def length(self) -> float:
        """Length of the path seen from above, m."""
        return self.reference.path.length

    @property
    def where(self) -> Where:
        """The path, with latitude and longitude of its start in deg and height in m."""
        scenario = self.scenario
        assert scenario.route is not None
        return self.reference.path, scenario.route.origin, scenario.flight.h_m

    @property
    def changed(self) -> list[str]:
        """Sentences on legs and circles that are flown differently from the waypoints."""
        assert self.scenario.route is not None
        stretches, notes = self.reference.path.stretches, []
        if around := [x for x in stretches if x.kind == "turn-around"]:
            places = listed_places(stretch.name for stretch in around)
            farthest = max(stretch.aside for stretch in around)
            notes = [f"Turn-arounds at {places} go up to {farthest:.0f} m from the legs."]
        path, points = self.reference.path, self.scenario.route.waypoints()
        inside = {}
        for stretch in stretches:
            on = np.abs(path.s - stretch.start - 0.5 * stretch.length) <= 0.5 * stretch.length
            if stretch.kind == "turn" and on.any():
                point = points[stretch.waypoint - 1]
                away = np.hypot(path.north[on] - point.north, path.east[on] - point.east)
                inside[stretch.name] = float(away.min())
        if far := [name for name, away in inside.items() if away > CORNER_M]:
            rounded = f"The path rounds the corners at {listed_places(far)}"
            notes.append(
                f"{rounded} and passes their waypoints at up to {max(inside.values()):.0f} m."
            )
        stated = [point.radius_m for point in self.scenario.route.waypoint]
        for stretch in stretches:
            radius = stated[stretch.waypoint - 1] if stretch.kind == "loiter" else None
            if radius and radius < stretch.radius - WIDER_M:
                notes.append(
                    f"The circle at {stretch.name} has {stretch.radius:.0f} m in "
                    f"place of {radius:g} m, the smallest radius that can be flown."
                )
        return [*dict.fromkeys(notes), *slopes_not_held(self.scenario)]

    @property
    def except_slopes(self) -> str:
        """Words after "it can be flown" if an aircraft cannot hold a slope; else empty."""
        return ", but not everywhere at its airspeed" * bool(slopes_not_held(self.scenario))

    def save(
        self,
        path: str | Path,
        corridor: Corridor | None = None,
        fences: Iterable[Mapping[str, Any]] = (),
    ) -> list[str]:
        """Write the path to a file .plan, .kml or .geojson, with waypoints and rally points.

        `fences` in GeoJSON, and a corridor about the path, are also written. Reading the file gives
        the same route. A fence or corridor with more vertices than vehicles accept is simplified.
        Returns a sentence with the lost metres.
        """
        scenario, ending = self.scenario, Path(path).suffix.lower()
        assert scenario.route is not None
        start, said = scenario.flight.h_m, ""
        points = scenario.route.waypoints()
        places = on_earth(np.array([(x.north, x.east) for x in points]), self.where[1]).round(8)
        drawn = RouteMap(
            where=self.where,
            title=printable(scenario.title),
            points=[
                Mark(x.number, lat, lon, round(start + x.up, 2))
                for x, (lat, lon) in zip(points, places.tolist(), strict=True)
            ],
            rally=[
                Mark(f"rally {i}", x.lat_deg, x.lon_deg, round(start + x.up_m, 2))
                for i, x in enumerate(scenario.route.rally, start=1)
            ],
            areas=areas_of(fences),
            corridor=corridor,
            stated=self._stated,
        )
        if ending == ".plan":
            text, said = route_plan(drawn, self.reference.V_a, scenario.flight.ground_m)
        else:
            text = drawn.kml() if ending == ".kml" else drawn.geojson()
        write_text(Path(path), text)
        return [f"The fence in {path} {said}."] if said else []

    @property
    def _stated(self) -> dict[str, Any]:
        """Tables in a written file from which the same path is read."""
        scenario = self.scenario
        assert scenario.route is not None
        return {
            "route": scenario.route.model_dump(
                exclude_none=True, exclude={"notes": True, "waypoint": {"__all__": {"name"}}}
            ),
            "flight": pick(scenario.flight, "V_a_mps h_m ground_m g_mps2"),
            "limits": scenario.limits.model_dump(exclude_none=True),
        }


def planned_route(scenario: Scenario) -> PlannedRoute:
    """The planned route of a scenario; InputError if it has a reference over time."""
    reference, table = reference_of(scenario), scenario.route
    if table is None or not isinstance(reference, RouteReference):
        raise InputError(f"{scenario.title}: `route` must be given, got a reference over time.")
    wind = table.wind_at(reference.V_a)
    slowest = f"{reference.V.min():.4g} to " if reference.airspeeds is not None else ""
    conditions = (
        f"airspeed {slowest}{reference.V_a:.4g} m/s{scenario.assumed_words}, "
        f"turns for wind up to {wind:.3g} m/s{' (assumed)' * (table.wind_mps is None)}, "
        f"start {round(scenario.flight.h_m, 1):g} m above sea level"
    )
    return PlannedRoute(scenario=scenario, reference=reference, wind=wind, conditions=conditions)


def mission_scenario(
    source: str | Path,
    aircraft: str | None,
    changes: Mapping[str, Any] | None,
    terrain: str | Path | None,
) -> Scenario | None:
    """The scenario of a mission; None for another source."""
    file = Path(source)
    if (ending := file.suffix.lower()) not in ROUTE_FILES:
        if ending not in ("", ".toml") and os.path.isfile(file) and not kind_of(file):
            raise InputError(
                f"{file}: must be {KINDS}, or a scenario or campaign (.toml), got {file.suffix}."
            )
        return None
    changes = {**(changes or {})}
    skip = changes.pop("route.skip", False)
    if not isinstance(skip, bool):
        raise InputError(f"{file}: `route.skip` must be true or false, got {skip}.")
    aircraft = aircraft or AIRCRAFT
    known = SPEED not in changes and not is_model(aircraft)
    speeds = load_aircraft(aircraft).envelope.V_a if known else None
    mission = read_route(file, skip=skip, terrain=terrain, airspeeds=speeds)
    return route_scenario(file, mission, aircraft, changes)


def route(
    source: Scenario | str | Path,
    *,
    aircraft: str | None = None,
    terrain: str | Path | None = None,
    changes: Mapping[str, Any] | None = None,
) -> PlannedRoute:
    """Plan the route of a scenario or a file, in less than a second.

    Parameters
    ----------
    source : Scenario, str or Path
        A scenario with a route, its file or name; or a mission: ``.plan`` of QGroundControl,
        ``.waypoints`` of Mission Planner, KML or GeoJSON.
    aircraft : str, optional
        Aircraft for a file, at an airspeed at which it is identified; by default ``aerosonde``.
    terrain : str or Path, optional
        Raster of heights (GeoTIFF, .hgt) for a plan's heights above terrain.
    changes : mapping of str to value, optional
        Values to set in the scenario, by dotted key.

    Returns
    -------
    PlannedRoute

    Raises
    ------
    InputError
        If the route cannot be flown; the message names the waypoint and a remedy. Also if there is
        no route, or `aircraft` is given for a scenario.

    Examples
    --------
    >>> [stretch["kind"] for stretch in ft.route("circuit").stretches][:3]
    ['leg', 'turn', 'leg']
    """
    mission = None
    if not isinstance(source, Scenario):
        mission = mission_scenario(source, aircraft, changes, terrain)
    if mission is None and aircraft is not None:
        raise InputError(f"{source}: `aircraft` must be absent for a scenario.")
    return planned_route(mission or as_scenario(source, changes))
