"""``[route]`` of a scenario, and the path planned through it."""

import math
from functools import lru_cache
from typing import Annotated, ClassVar, Self, TypeAlias

from pydantic import Field, model_validator

from flighttune.base import quantities as q
from flighttune.base.errors import InputError
from flighttune.base.units import DEG
from flighttune.routes.ending_keys import RouteEndingTable
from flighttune.routes.follow import RouteReference, airspeeds_along
from flighttune.routes.maps import LatLon, north_east
from flighttune.routes.path import Ability, Waypoint, plan
from flighttune.vehicles.flight_keys import FlightTable

Distance: TypeAlias = Annotated[q.Finite, Field(ge=-1e6, le=1e6)]  # m from the start
Latitude: TypeAlias = Annotated[q.Finite, Field(ge=-85.0, le=85.0)]  # deg
Longitude: TypeAlias = Annotated[q.Finite, Field(ge=-180.0, le=180.0)]  # deg

# Default wind in turns, as a share of the airspeed.
WIND_SHARE = 1.0 / 3.0

# Maximum number of waypoints.
MAX_WAYPOINTS = 1000


class WaypointTable(q.Table):
    """``[[route.waypoint]]``: a point to pass, or to circle around."""

    north_m: Distance | None = None  # from the start, with east_m, or lat_deg and lon_deg
    east_m: Distance | None = None
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    up_m: Distance = 0.0  # above the first waypoint
    # Circles around it, clockwise positive
    turns: Annotated[q.Finite, Field(ge=-100.0, le=100.0)] = 0.0
    radius_m: q.Length | None = None  # if left out, the smallest possible
    # Path angle at the beginning of the leg; steady along the leg if left out
    climb_deg: Annotated[q.Finite, Field(gt=0.0, le=60.0)] | None = None
    hold_s: q.Instant = 0.0  # minimum time of its circles
    spiral: bool = False  # true: the circles change the height
    # Airspeed from the end of its turn on, with holds_airspeed; unchanged if left out
    V_mps: q.Airspeed | None = None
    name: Annotated[str, Field(max_length=40)] = ""  # if left out, its number

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        local = self.north_m is not None and self.east_m is not None
        geographic = self.lat_deg is not None and self.lon_deg is not None
        keys = {"north_m", "east_m", "lat_deg", "lon_deg"} & self.model_fields_set
        if local == geographic or len(keys) > 2:
            raise ValueError("`north_m` and `east_m`, or `lat_deg` and `lon_deg` must be given")
        if not self.turns:
            self.must_lack("without `turns`", "radius_m", "hold_s", "spiral")
        return self


class RallyTable(q.Table):
    """``[[route.rally]]``: a point for a flight that aborts the mission; it is drawn on maps."""

    lat_deg: Latitude
    lon_deg: Longitude
    up_m: Distance = 0.0  # above the first waypoint


class RouteTable(q.Table):
    """``[route]``: a path to fly, from its first waypoint on, instead of a reference over time."""

    waypoint: Annotated[list[WaypointTable], Field(min_length=2, max_length=MAX_WAYPOINTS)]
    # Largest wind for which turns are planned; a third of the airspeed if left out
    wind_mps: q.WindSpeed | None = None
    # Share of roll and roll rate reserved for the feedback
    margin: Annotated[float, Field(ge=0.0, le=0.9)] = 0.2
    gamma_deg: q.Inclinations = (-10.0, 10.0)  # steepest path angles
    look_ahead_s: q.TimeConstant = 3.0
    # true: the law holds the airspeed by n_x; if left out, the aircraft holds it
    holds_airspeed: bool | None = None
    # true: the file of the mission states no airspeed at its start
    airspeed_assumed: bool | None = None
    lat_deg: Latitude = 0.0  # place of the start, for maps, if the waypoints have no place
    lon_deg: Longitude = 0.0
    widen: bool = False  # true: circles that are too small get the smallest radius
    # Maximum distance of a turn-around from its leg; 0: no turn-around; no bound if left out
    turnaround_m: Annotated[q.Finite, Field(ge=0.0, le=1e5)] | None = None
    ending: RouteEndingTable | None = None  # manoeuvre that ends the flight before the route does
    # Points for flights that abort the mission, for maps
    rally: Annotated[list[RallyTable], Field(default_factory=list, max_length=MAX_WAYPOINTS)]
    # Parts of the waypoints' file that are not flown
    notes: Annotated[list[str], Field(default_factory=list)]
    batched: ClassVar[bool] = False  # since the reference depends on the position

    @model_validator(mode="after")
    def _of_one_kind(self) -> Self:
        if len({point.lat_deg is None for point in self.waypoint}) > 1:
            raise ValueError("`waypoint` must be by north and east, or by latitude and longitude")
        return self

    @property
    def origin(self) -> LatLon:
        """Latitude and longitude of the start, deg."""
        first = self.waypoint[0]
        if first.lat_deg is None or first.lon_deg is None:
            return self.lat_deg, self.lon_deg
        return first.lat_deg, first.lon_deg

    @property
    def geographic(self) -> bool:
        """Whether its place on Earth is known."""
        return self.origin != (0.0, 0.0)

    def waypoints(self) -> tuple[Waypoint, ...]:
        """The waypoints in m and rad, from the first on."""
        first, placed = self.waypoint[0], []
        for number, point in enumerate(self.waypoint, start=1):
            if point.lat_deg is not None and point.lon_deg is not None:
                north, east = north_east((point.lat_deg, point.lon_deg), self.origin)
            else:
                north = (point.north_m or 0.0) - (first.north_m or 0.0)
                east = (point.east_m or 0.0) - (first.east_m or 0.0)
            there = Waypoint(
                north=north,
                east=east,
                up=point.up_m - first.up_m,
                turns=point.turns,
                radius=point.radius_m,
                climb=None if point.climb_deg is None else point.climb_deg * DEG,
                hold=point.hold_s,
                spiral=point.spiral,
                name=point.name or f"waypoint {number}",
            )
            placed.append(there)
        return tuple(placed)

    def rally_points(self) -> list[tuple[float, float]]:
        """North and east of the rally points from the start, m."""
        return [north_east((point.lat_deg, point.lon_deg), self.origin) for point in self.rally]

    def wind_at(self, V_a: float) -> float:
        """Largest wind that turns allow for at an airspeed, m/s."""
        return WIND_SHARE * V_a if self.wind_mps is None else self.wind_mps

    @property
    def airspeeds(self) -> dict[int, float]:
        """Airspeeds, m/s, by the waypoint from which each holds, if the law holds the airspeed."""
        speeds = {i: point.V_mps for i, point in enumerate(self.waypoint, start=1) if point.V_mps}
        return speeds if self.holds_airspeed else {}

    def reference(self, flight: FlightTable, *, phi: float, phi_rate: float) -> RouteReference:
        """The reference along the path, for limits of roll (rad, rad/s) less the margin."""
        share, (low, high) = 1.0 - self.margin, self.gamma_deg
        largest = max(flight.V_a_mps, *self.airspeeds.values(), 0.0)
        if share * phi >= 0.5 * math.pi:
            raise InputError(
                f"[limits] `phi_deg` must be below {90.0 / share:g} deg, so that a route with the "
                f"`margin` {self.margin:g} rolls to less than 90 deg, got {phi / DEG:g} deg."
            )
        ability = Ability(
            V_a=largest,
            wind=self.wind_at(largest),
            phi=share * phi,
            phi_rate=share * phi_rate,
            gamma=(low * DEG, high * DEG),
            g=flight.g_mps2,
            widen=self.widen,
            turnaround=math.inf if self.turnaround_m is None else self.turnaround_m,
            duration=flight.duration_s,
        )
        path = planned(self.waypoints(), ability)
        whole = RouteReference(
            path=path,
            V_a=largest,
            g=flight.g_mps2,
            look_ahead=self.look_ahead_s,
            holds_airspeed=bool(self.holds_airspeed),
            airspeeds=airspeeds_along(path, flight.V_a_mps, self.airspeeds, flight.g_mps2),
        )
        if self.ending is None:
            return whole
        return self.ending.followed(whole, ability, flight.h_m - flight.ground_m)


# The flights of a campaign fly the same path.
planned = lru_cache(maxsize=8)(plan)
