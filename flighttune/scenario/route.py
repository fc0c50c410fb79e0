"""``[route]`` of a scenario: waypoints, and the path planned through them."""

import math
from functools import lru_cache
from typing import Annotated, ClassVar, Self, TypeAlias

from pydantic import Field, model_validator

from flighttune import quantities as q
from flighttune.references.earth import LatLon, north_east
from flighttune.references.follow import RouteReference, airspeeds_along
from flighttune.references.path import Ability, Path, Waypoint, check_length, plan
from flighttune.units import DEG

Distance: TypeAlias = Annotated[q.Finite, Field(ge=-1e6, le=1e6)]  # m from the start
Latitude: TypeAlias = Annotated[q.Finite, Field(ge=-85.0, le=85.0)]  # deg
Longitude: TypeAlias = Annotated[q.Finite, Field(ge=-180.0, le=180.0)]  # deg

# Share of the airspeed that turns allow for as wind by default.
WIND_SHARE = 1.0 / 3.0

# Most waypoints of a route.
MAX_WAYPOINTS = 1000


class WaypointTable(q.Table):
    """``[[route.waypoint]]``: a point to pass, or to circle around."""

    north_m: Distance | None = None
    east_m: Distance | None = None
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    up_m: Distance = 0.0
    turns: Annotated[q.Finite, Field(ge=-100.0, le=100.0)] = 0.0
    radius_m: q.Length | None = None
    climb_deg: Annotated[q.Finite, Field(gt=0.0, le=60.0)] | None = None
    hold_s: q.Instant = 0.0
    spiral: bool = False
    V_mps: q.Airspeed | None = None

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        local = self.north_m is not None and self.east_m is not None
        geographic = self.lat_deg is not None and self.lon_deg is not None
        keys = {"north_m", "east_m", "lat_deg", "lon_deg"} & self.model_fields_set
        if local == geographic or len(keys) > 2:
            raise ValueError("`north_m` and `east_m`, or `lat_deg` and `lon_deg` must be given")
        circles = ("radius_m", "hold_s", "spiral")
        if not self.turns and (wrong := [key for key in circles if getattr(self, key)]):
            raise ValueError(f"`{wrong[0]}` must be absent without `turns`")
        return self


class RallyTable(q.Table):
    """``[[route.rally]]``: a point to fly to if the mission is broken off; it is drawn on maps."""

    lat_deg: Latitude
    lon_deg: Longitude
    up_m: Distance = 0.0


class RouteTable(q.Table):
    """``[route]``: what is flown in place of a reference over time.

    The route begins at its first waypoint, where the flight starts; `lat_deg` and `lon_deg` say
    where that is for maps, if the waypoints do not. `widen` flies circles that are too small at the
    smallest radius, and turn-arounds go `turnaround_m` from their leg at most. With
    `holds_airspeed` the law holds the airspeed by n_x, and the path angle gives way to it where
    thrust is short; `V_mps` of a waypoint is then the airspeed from the end of its turn on. `notes`
    say what is not flown of the file that the waypoints were read from.
    """

    waypoint: Annotated[list[WaypointTable], Field(min_length=2, max_length=MAX_WAYPOINTS)]
    wind_mps: q.WindSpeed | None = None
    margin: Annotated[float, Field(ge=0.0, le=0.9)] = 0.2
    gamma_deg: q.Inclinations = (-10.0, 10.0)
    look_ahead_s: q.TimeConstant = 3.0
    holds_airspeed: bool | None = None
    lat_deg: Latitude = 0.0
    lon_deg: Longitude = 0.0
    widen: bool = False
    turnaround_m: Annotated[q.Finite, Field(ge=0.0, le=1e5)] | None = None
    rally: Annotated[list[RallyTable], Field(default_factory=list, max_length=MAX_WAYPOINTS)]
    notes: Annotated[list[str], Field(default_factory=list)]
    batched: ClassVar[bool] = False  # by the compiled kernel: it depends on the position

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
        """Whether it is known where on earth it is."""
        return self.origin != (0.0, 0.0)

    def waypoints(self) -> tuple[Waypoint, ...]:
        """The waypoints in m and rad, from the first on."""
        first, placed = self.waypoint[0], []
        for point in self.waypoint:
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
        """Airspeeds from waypoints on, m/s, by their numbers, where the law holds the airspeed."""
        speeds = {i: point.V_mps for i, point in enumerate(self.waypoint, start=1) if point.V_mps}
        return speeds if self.holds_airspeed else {}

    def ability(
        self, *, V_a: float, g: float, phi: float, phi_rate: float, duration: float = math.inf
    ) -> Ability:
        """Largest airspeed, and limits on roll (rad) and its rate (rad/s) less the margin."""
        share = 1.0 - self.margin
        low, high = self.gamma_deg
        largest = max(V_a, *self.airspeeds.values(), 0.0)
        return Ability(
            V_a=largest,
            wind=self.wind_at(largest),
            phi=share * phi,
            phi_rate=share * phi_rate,
            gamma=(low * DEG, high * DEG),
            g=g,
            widen=self.widen,
            turnaround=math.inf if self.turnaround_m is None else self.turnaround_m,
            duration=duration,
        )

    def reference(self, ability: Ability, V_a: float) -> RouteReference:
        """The reference that follows the path through the waypoints, from the airspeed `V_a` on."""
        path = planned(self.waypoints(), ability)
        ends = ((stretch.waypoint, stretch.start + stretch.length) for stretch in path.stretches)
        check_length(ends, ability)  # a path that was planned for a longer time
        return RouteReference(
            path=path,
            V_a=ability.V_a,
            g=ability.g,
            look_ahead=self.look_ahead_s,
            holds_airspeed=bool(self.holds_airspeed),
            airspeeds=airspeeds_along(path, V_a, self.airspeeds, ability.g),
        )


@lru_cache(maxsize=8)  # the flights of a campaign fly the same path
def planned(waypoints: tuple[Waypoint, ...], ability: Ability) -> Path:
    """`plan`, made once for the same waypoints."""
    return plan(waypoints, ability)
