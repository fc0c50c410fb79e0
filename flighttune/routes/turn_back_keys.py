"""``[turn_back]`` of a scenario: a flight that turns back at one place of a route."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from flighttune.base import quantities as q
from flighttune.base.arrays import FloatArray
from flighttune.base.units import DEG
from flighttune.routes.follow import CHANGE_N_X
from flighttune.vehicles.flight_keys import FlightTable

# Time at which a flight detects that it must turn back, s, on a route with one airspeed. Until then
# it follows the route, so that it settles.
DETECTED_S = 10.0

# Time of the flight after the turn, with its roll-in and roll-out, s.
BACK_S = 8.0

# Shortest time of a roll-in, s, and its share of the time that the roll rate takes.
ROLL_IN_S, ROLL_IN_SHARE = 1.0, 1.2

# Time over which the climb ends, for each 5 deg of it, and over which a rate of it rises, s.
LEVEL_S, LEVEL_ROLL_IN_S = 2.0, 1.0

# Start of the turn that the route makes at the place, s.
TURNED_FROM_S = 2.0

# Longest time on a slope before the place for a flight that begins level, s: several settling times
# of the airspeed at closed or full throttle.
SETTLED_S = 60.0

# Minimum ground speed on a slope, as a share of the airspeed.
SLOWEST = 0.2

# Airspeeds that differ by less count as equal, m/s.
SAME_AIRSPEED = 1e-6


class PlaceTable(q.Table):
    """One place of the route: its position, the flight of the route there, and the turn back."""

    along_m: Annotated[q.Finite, Field(ge=0.0)]
    north_m: q.Finite  # from the start of the route
    east_m: q.Finite
    chi_deg: q.Finite  # without jumps of a whole turn
    gamma_deg: q.Inclination
    h_m: q.Height
    V_a_mps: q.Airspeed
    rate_dps: q.AngularRate  # rate of course, in still air
    back_dps: q.PositiveRate  # rate of course while a flight turns back


class TurnBackTable(q.Table):
    """``[turn_back]``: a flight that turns back at one place of a route."""

    # Place on the route where the flight detects that it must turn
    at_m: Annotated[q.Finite, Field(ge=0.0)] = 0.0
    side: Literal[-1, 1] = 1  # right positive
    bank_deg: Annotated[q.Finite, Field(ge=1.0, le=80.0)]
    turn_deg: Annotated[q.Finite, Field(ge=90.0, le=720.0)] = 180.0
    detected_s: q.Instant = DETECTED_S
    reaction_s: Annotated[q.Instant, Field(le=60.0)] = 1.0  # from detection to the turn
    roll_rate_dps: q.PositiveRate  # roll rate of the aircraft, which sets the time of a roll-in
    # true: the flight begins level if the slope of the place allows no steady flight
    or_level: bool | None = None
    sloped_s: q.Instant | None = None  # time on the slope of a flight that begins level
    place: Annotated[list[PlaceTable], Field(min_length=2)]  # the places of the route

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
        """Distance from the beginning of the place's slope, m, or to settle its airspeed."""
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
        """Time at which this flight detects that it must turn, s."""
        return self.detected_s + (self.sloped_s or 0.0)

    @property
    def duration_s(self) -> float:
        """Duration of the flight: the climb has ended and the aircraft flies back."""
        slowest = min(place.back_dps for place in self.place)
        return self.found_s + self.reaction_s + self.turn_deg / slowest + BACK_S

    def formula(self, V_a: float, g: float) -> float:
        """Distance ahead in still air, m: the reaction distance plus the radius of the turn."""
        return V_a * self.reaction_s + V_a**2 / (g * math.tan(self.bank_deg * DEG))

    def wind(self, g: float) -> float:
        """Smallest tail wind, m/s, in which turns at the bank have the rates of the places."""
        *_, V_a, _, back = self.columns
        return float(np.min(g * math.tan(self.bank_deg * DEG) / (back * DEG) - V_a))

    def followed(self, tables: Mapping[str, Any]) -> dict[str, Any]:
        """The tables of a scenario, with the start and reference of this flight."""
        *_, chi, _, h, V_a, rate, back = self.here
        turned_s = self.found_s + self.reaction_s - TURNED_FROM_S
        # As in a level turn: the tangent of the roll for the change of rate.
        flight = FlightTable.model_validate(tables["flight"])
        load = (abs(rate) + back) * DEG * V_a / flight.g_mps2
        roll_in_s = max(ROLL_IN_S, ROLL_IN_SHARE * load / (self.roll_rate_dps * DEG))
        back_s = self.found_s + self.reaction_s + 0.5 * roll_in_s
        ramps = (TURNED_FROM_S, turned_s, rate), (back_s, self.turn_deg / back, self.side * back)
        first, rise, slopes = self._slopes(back_s)
        chi -= rate * (self.found_s - TURNED_FROM_S)
        # The flight detects at the height of the place, unless the place is just above ground.
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
        """Path angle of the start, deg, the climb until detection, m, and the changes of slope."""
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
    """Rates of course, deg/s, of level turns at a bank (rad) and speeds (m/s)."""
    return g * math.tan(bank) / speed / DEG
