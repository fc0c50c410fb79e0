"""``[turn_back]`` of a scenario: one place of a route from which a flight turns back."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from flighttune import quantities as q
from flighttune.arrays import FloatArray
from flighttune.references.follow import CHANGE_N_X
from flighttune.scenario.tables import FlightTable
from flighttune.units import DEG

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
    """``[turn_back]``: a turn of `turn_deg` to one `side`, begun `reaction_s` after detection.

    The flight is at `at_m` of a route whose `place` are known at the time `detected_s`. Its
    `[reference]` and the start in [flight] follow from these keys.
    """

    at_m: Annotated[q.Finite, Field(ge=0.0)] = 0.0
    side: Literal[-1, 1] = 1  # right positive
    bank_deg: Annotated[q.Finite, Field(ge=1.0, le=80.0)]
    turn_deg: Annotated[q.Finite, Field(ge=90.0, le=720.0)] = 180.0
    detected_s: q.Instant = DETECTED_S
    reaction_s: Annotated[q.Instant, Field(le=60.0)] = 1.0
    roll_rate_dps: q.PositiveRate  # of the aircraft: it gives the time of a roll-in
    place: Annotated[list[PlaceTable], Field(min_length=2)]

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
    def duration_s(self) -> float:
        """Time of the flight: the climb has ended too, and the aircraft is on its way back."""
        slowest = min(place.back_dps for place in self.place)
        return self.detected_s + self.reaction_s + self.turn_deg / slowest + BACK_S

    def formula(self, V_a: float, g: float) -> float:
        """Distance ahead in still air, m: that of the reaction, and the radius of the turn."""
        return V_a * self.reaction_s + V_a**2 / (g * math.tan(self.bank_deg * DEG))

    def followed(self, tables: Mapping[str, Any]) -> dict[str, Any]:
        """The tables of a scenario with the start and the reference of this flight."""
        *_, chi, gamma, h, V_a, rate, back = self.here
        turned_s = self.detected_s + self.reaction_s - TURNED_FROM_S
        # As a level turn: the tangent of the roll for the change from one rate to the other.
        flight = FlightTable.model_validate(tables["flight"])
        load = (abs(rate) + back) * DEG * V_a / flight.g_mps2
        roll_in_s = max(ROLL_IN_S, ROLL_IN_SHARE * load / (self.roll_rate_dps * DEG))
        back_s = self.detected_s + self.reaction_s + 0.5 * roll_in_s
        ramps = (TURNED_FROM_S, turned_s, rate), (back_s, self.turn_deg / back, self.side * back)
        level_s = max(1.0, abs(gamma) / 5.0) * LEVEL_S
        chi -= rate * (self.detected_s - TURNED_FROM_S)
        # At the height of the place when it detects, but for a place just above the ground.
        rise = self.detected_s * V_a * math.sin(gamma * DEG)
        h = max(h - rise, min(place.h_m for place in self.place))
        start = {"chi_deg": chi % 360.0, "gamma_deg": gamma, "h_m": h}
        reference: dict[str, Any] = {
            "chi_deg": [_ramp(*ramp, roll_in_s) for ramp in ramps],
            "gamma_deg": [_ramp(back_s, level_s, -gamma / level_s, LEVEL_ROLL_IN_S)],
        }
        if (tables.get("reference") or {}).get("V_mps") is not None:
            change, per_s = V_a - flight.V_a_mps, CHANGE_N_X * flight.g_mps2
            ramp = {"shape": "ramp", "duration_s": abs(change) / per_s}
            ramp["rate_mps2"] = math.copysign(per_s, change)
            reference["V_mps"] = [ramp] if abs(change) > SAME_AIRSPEED else V_a
        start = {**tables["flight"], **start, "duration_s": self.duration_s}
        return {**tables, "flight": start, "reference": reference}


def _ramp(start_s: float, duration_s: float, rate_dps: float, roll_in_s: float) -> dict[str, Any]:
    ramp = {"shape": "ramp", "start_s": start_s, "duration_s": duration_s}
    return {**ramp, "rate_dps": rate_dps, "roll_in_s": roll_in_s}


def rate_of(bank: float, speed: FloatArray, g: float) -> FloatArray:
    """Rates of course, deg/s, of level turns at a bank (rad) and some speeds (m/s)."""
    return g * math.tan(bank) / speed / DEG
