"""``[route]`` of a scenario and the path planned through it; ``[turn_back]``, a place of it."""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from flighttune.base import quantities as q
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.units import DEG
from flighttune.flight.scenario.tables import FlightTable
from flighttune.routes.follow import CHANGE_N_X, RouteReference, airspeeds_along
from flighttune.routes.maps import LatLon, north_east
from flighttune.routes.path import Ability, Waypoint, plan

# When a flight finds that it must turn back, s, where the route has one airspeed: until then it
# flies as the route does there, in which it settles.
DETECTED_S = 10.0

# Time of the flight after the turn, with its roll-in and roll-out, s.
BACK_S = 8.0

# Shortest time of a roll-in, s, and its share of the time that the roll rate takes.
ROLL_IN_S, ROLL_IN_SHARE = 1.0, 1.2

# Time over which the climb ends, for each 5 deg of it, and over which a rate of it rises, s.
LEVEL_S, LEVEL_ROLL_IN_S = 2.0, 1.0

# Start of the turn that the route makes at the place, s.
TURNED_FROM_S = 2.0

# Longest time on a slope that a flight from level flight flies before the place, s: several times
# that in which its airspeed settles at a closed or full throttle.
SETTLED_S = 60.0

# Least speed over ground on a slope, a share of the airspeed.
SLOWEST = 0.2

# Difference of airspeeds that is none, m/s.
SAME_AIRSPEED = 1e-6


class PlaceTable(q.Table):
    """One place of the route: where it is, how the route is flown there, and how to turn back."""

    along_m: Annotated[q.Finite, Field(ge=0.0)]
    north_m: q.Finite  # from the start of the route
    east_m: q.Finite
    chi_deg: q.Finite  # without jumps of a whole turn
    gamma_deg: q.Inclination
    h_m: q.Height
    V_a_mps: q.Airspeed
    rate_dps: q.AngularRate  # of course, in still air
    back_dps: q.PositiveRate  # of course, while a flight turns back


class TurnBackTable(q.Table):
    """``[turn_back]``: a flight that turns back at one place of a route."""

    # Where on the route it is when it detects that it must turn
    at_m: Annotated[q.Finite, Field(ge=0.0)] = 0.0
    side: Literal[-1, 1] = 1  # right positive
    bank_deg: Annotated[q.Finite, Field(ge=1.0, le=80.0)]
    turn_deg: Annotated[q.Finite, Field(ge=90.0, le=720.0)] = 180.0
    detected_s: q.Instant = DETECTED_S
    reaction_s: Annotated[q.Instant, Field(le=60.0)] = 1.0  # from there to the turn
    roll_rate_dps: q.PositiveRate  # of the aircraft: it gives the time of a roll-in
    # true: it begins level where it has no steady flight on the slope of the place
    or_level: bool | None = None
    sloped_s: q.Instant | None = None  # on the slope, of a flight that begins level
    place: Annotated[list[PlaceTable], Field(min_length=2)]  # the route, from place to place

    @property
    def columns(self) -> FloatArray:
        """The keys of each place, shape (keys, places)."""
        return np.array([list(vars(place).values()) for place in self.place]).T

    @property
    def here(self) -> list[float]:
        """The keys of the place at `at_m`."""
        along, *columns = self.columns
        return [self.at_m, *(np.interp(self.at_m, along, x).item() for x in columns)]

    @property
    def slope_m(self) -> float:
        """Distance from where the slope of the place begins, m, or in which an airspeed settles."""
        at_m, *_, gamma, _, V_a, _, _ = self.here
        along, *_, gammas, _, _, _, _ = self.columns
        begun = along[(along < at_m) & (gammas * gamma <= 0.0)].max(initial=0.0).item()
        return min(at_m - begun, SETTLED_S * V_a)

    def time_on_slope(self, north: float, east: float) -> float:
        """Time on the slope before the place in a wind, m/s, in s: slopes are over ground."""
        along, _, _, chi, _, _, V_a, *_ = self.columns
        s = np.linspace(self.at_m - self.slope_m, self.at_m, round(self.slope_m / 10.0) + 2)
        chi, V_a = (np.interp(s, along, x) for x in (chi * DEG, V_a))
        ground = np.maximum(V_a + north * np.cos(chi) + east * np.sin(chi), SLOWEST * V_a)
        return float(np.trapezoid(1.0 / ground, s))

    @property
    def found_s(self) -> float:
        """When this flight detects that it must turn, s."""
        return self.detected_s + (self.sloped_s or 0.0)

    @property
    def duration_s(self) -> float:
        """Time of the flight: the climb has ended too, and the aircraft is on its way back."""
        slowest = min(place.back_dps for place in self.place)
        return self.found_s + self.reaction_s + self.turn_deg / slowest + BACK_S

    def formula(self, V_a: float, g: float) -> float:
        """Distance ahead in still air, m: that of the reaction, and the radius of the turn."""
        return V_a * self.reaction_s + V_a**2 / (g * math.tan(self.bank_deg * DEG))

    def wind(self, g: float) -> float:
        """Least wind from behind, m/s, in which turns at the bank have the rates of the places."""
        *_, V_a, _, back = self.columns
        return float(np.min(g * math.tan(self.bank_deg * DEG) / (back * DEG) - V_a))

    def followed(self, tables: Mapping[str, Any]) -> dict[str, Any]:
        """The tables of a scenario with the start and the reference of this flight."""
        *_, chi, _, h, V_a, rate, back = self.here
        turned_s = self.found_s + self.reaction_s - TURNED_FROM_S
        # As a level turn: the tangent of the roll for the change from one rate to the other.
        flight = FlightTable.model_validate(tables["flight"])
        load = (abs(rate) + back) * DEG * V_a / flight.g_mps2
        roll_in_s = max(ROLL_IN_S, ROLL_IN_SHARE * load / (self.roll_rate_dps * DEG))
        back_s = self.found_s + self.reaction_s + 0.5 * roll_in_s
        ramps = (TURNED_FROM_S, turned_s, rate), (back_s, self.turn_deg / back, self.side * back)
        first, rise, slopes = self._slopes(back_s)
        chi -= rate * (self.found_s - TURNED_FROM_S)
        # At the height of the place when it detects, but for a place just above the ground.
        h = max(h - rise, min(place.h_m for place in self.place))
        start = {"chi_deg": chi % 360.0, "gamma_deg": first, "h_m": h}
        reference: dict[str, Any] = {
            "chi_deg": [_ramp(*ramp, roll_in_s) for ramp in ramps],
            "gamma_deg": slopes,
        }
        if (tables.get("reference") or {}).get("V_mps") is not None:
            change, per_s = V_a - flight.V_a_mps, CHANGE_N_X * flight.g_mps2
            ramp = {"shape": "ramp", "duration_s": abs(change) / per_s}
            ramp["rate_mps2"] = math.copysign(per_s, change)
            reference["V_mps"] = [ramp] if abs(change) > SAME_AIRSPEED else V_a
        start = {**tables["flight"], **start, "duration_s": self.duration_s}
        return {**tables, "flight": start, "reference": reference}

    def _slopes(self, back_s: float) -> tuple[float, float, list[dict[str, Any]]]:
        """Path angle of the start, deg, the rise until it detects, m, and the changes of slope."""
        *_, gamma, _, V_a, _, _ = self.here
        level_s, far = max(1.0, abs(gamma) / 5.0) * LEVEL_S, self.found_s * V_a
        levelled = _ramp(back_s, level_s, -gamma / level_s, LEVEL_ROLL_IN_S)
        if self.sloped_s is None:
            return gamma, far * math.sin(gamma * DEG), [levelled]
        slope_s = self.found_s - max(self.sloped_s, level_s)
        far = max(self.slope_m, V_a * level_s) - 0.5 * V_a * level_s
        sloped = _ramp(slope_s, level_s, gamma / level_s, LEVEL_ROLL_IN_S)
        return 0.0, far * math.sin(gamma * DEG), [sloped, levelled]


def _ramp(start_s: float, duration_s: float, rate_dps: float, roll_in_s: float) -> dict[str, Any]:
    ramp = {"shape": "ramp", "start_s": start_s, "duration_s": duration_s}
    return {**ramp, "rate_dps": rate_dps, "roll_in_s": roll_in_s}


def rate_of(bank: float, speed: FloatArray, g: float) -> FloatArray:
    """Rates of course, deg/s, of level turns at a bank (rad) and some speeds (m/s)."""
    return g * math.tan(bank) / speed / DEG


Distance: TypeAlias = Annotated[q.Finite, Field(ge=-1e6, le=1e6)]  # m from the start
Latitude: TypeAlias = Annotated[q.Finite, Field(ge=-85.0, le=85.0)]  # deg
Longitude: TypeAlias = Annotated[q.Finite, Field(ge=-180.0, le=180.0)]  # deg

# Share of the airspeed that turns allow for as wind by default.
WIND_SHARE = 1.0 / 3.0

# Most waypoints of a route.
MAX_WAYPOINTS = 1000


class WaypointTable(q.Table):
    """``[[route.waypoint]]``: a point to pass, or to circle around."""

    north_m: Distance | None = None  # from the start, with east_m, or lat_deg and lon_deg
    east_m: Distance | None = None
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    up_m: Distance = 0.0  # above the first one
    # Circles around it, clockwise positive
    turns: Annotated[q.Finite, Field(ge=-100.0, le=100.0)] = 0.0
    radius_m: q.Length | None = None  # the smallest possible if left out
    # Path angle at the beginning of the leg; steady along it if left out
    climb_deg: Annotated[q.Finite, Field(gt=0.0, le=60.0)] | None = None
    hold_s: q.Instant = 0.0  # least time of its circles
    spiral: bool = False  # true: the circles take the change of height
    # Airspeed from the end of its turn on, with holds_airspeed; unchanged if left out
    V_mps: q.Airspeed | None = None
    name: Annotated[str, Field(max_length=40)] = ""  # its number if left out

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
    """``[[route.rally]]``: a point to fly to if the mission is broken off; it is drawn on maps."""

    lat_deg: Latitude
    lon_deg: Longitude
    up_m: Distance = 0.0  # above the first waypoint


class RouteTable(q.Table):
    """``[route]``: what is flown in place of a reference over time, from its first waypoint on."""

    waypoint: Annotated[list[WaypointTable], Field(min_length=2, max_length=MAX_WAYPOINTS)]
    # Largest wind that turns allow for; a third of the airspeed if left out
    wind_mps: q.WindSpeed | None = None
    # Share of roll and its rate that is left to the feedback
    margin: Annotated[float, Field(ge=0.0, le=0.9)] = 0.2
    gamma_deg: q.Inclinations = (-10.0, 10.0)  # steepest path angles
    look_ahead_s: q.TimeConstant = 3.0
    # true: the law holds the airspeed by n_x; the aircraft does if left out
    holds_airspeed: bool | None = None
    # true: the file of the mission states no airspeed at its start
    airspeed_assumed: bool | None = None
    lat_deg: Latitude = 0.0  # of the start, for maps, if the waypoints have none
    lon_deg: Longitude = 0.0
    widen: bool = False  # true: circles that are too small get the smallest radius
    # How far a turn-around may go from its leg; 0: none; no bound if left out
    turnaround_m: Annotated[q.Finite, Field(ge=0.0, le=1e5)] | None = None
    # Points to fly to if the mission is broken off, for maps
    rally: Annotated[list[RallyTable], Field(default_factory=list, max_length=MAX_WAYPOINTS)]
    # What of the file that the waypoints were read from is not flown
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
        """Airspeeds from waypoints on, m/s, by their numbers, where the law holds the airspeed."""
        speeds = {i: point.V_mps for i, point in enumerate(self.waypoint, start=1) if point.V_mps}
        return speeds if self.holds_airspeed else {}

    def reference(self, flight: FlightTable, *, phi: float, phi_rate: float) -> RouteReference:
        """The reference along the path, with the margin left of the limits of roll (rad, rad/s)."""
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
        return RouteReference(
            path=path,
            V_a=largest,
            g=flight.g_mps2,
            look_ahead=self.look_ahead_s,
            holds_airspeed=bool(self.holds_airspeed),
            airspeeds=airspeeds_along(path, flight.V_a_mps, self.airspeeds, flight.g_mps2),
        )


# The flights of a campaign fly the same path.
planned = lru_cache(maxsize=8)(plan)
