"""``[turn_back]`` of a scenario: one place of a route from which a flight turns back."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from flighttune import quantities as q
from flighttune.scenario.tables import FlightTable
from flighttune.units import DEG

# When the flight finds that it must turn back, s: until then it flies as the route does there, in
# which it settles.
DETECTED_S = 10.0

# Time of the flight after the turn, with its roll-in and roll-out, s.
BACK_S = 8.0

# Shortest time of a roll-in, s, and its share of the time that the roll rate takes.
ROLL_IN_S, ROLL_IN_SHARE = 1.0, 1.2

# Time over which the climb ends, for each 5 deg of it, and over which a rate of it rises, s.
LEVEL_S, LEVEL_ROLL_IN_S = 2.0, 1.0

# Start of the turn that the route makes at the place, s.
TURNED_FROM_S = 2.0


class PlaceTable(q.Table):
    """One place of the route: where it is, and how the route turns and climbs there."""

    along_m: Annotated[q.Finite, Field(ge=0.0)]
    chi_deg: q.Finite  # without jumps of a whole turn
    gamma_deg: q.Inclination
    h_m: q.Height
    rate_dps: q.AngularRate  # of course, in still air


class TurnBackTable(q.Table):
    """``[turn_back]``: a turn of `turn_deg` to one `side`, begun `reaction_s` after detection.

    The flight is at `at_m` of a route whose `place` are known. Its `[reference]` and the start in
    [flight] follow from these keys.
    """

    at_m: Annotated[q.Finite, Field(ge=0.0)] = 0.0
    side: Literal[-1, 1] = 1  # right positive
    bank_deg: Annotated[q.Finite, Field(ge=1.0, le=80.0)]
    turn_deg: Annotated[q.Finite, Field(ge=90.0, le=720.0)] = 180.0
    reaction_s: Annotated[q.Instant, Field(le=60.0)] = 1.0
    rate_dps: q.PositiveRate  # of course, while it turns back
    roll_rate_dps: q.PositiveRate  # of the aircraft: it gives the time of a roll-in
    place: Annotated[list[PlaceTable], Field(min_length=2)]

    @property
    def turning_s(self) -> float:
        """Time of the turn between the middles of its roll-in and its roll-out."""
        return self.turn_deg / self.rate_dps

    @property
    def duration_s(self) -> float:
        """Time of the flight: the climb has ended too, and the aircraft is on its way back."""
        return DETECTED_S + self.reaction_s + self.turning_s + BACK_S

    def formula(self, V_a: float, g: float) -> float:
        """Distance ahead in still air, m: that of the reaction, and the radius of the turn."""
        return V_a * self.reaction_s + V_a**2 / (g * math.tan(self.bank_deg * DEG))

    def followed(self, tables: Mapping[str, Any]) -> dict[str, Any]:
        """The tables of a scenario with the start and the reference of this flight."""
        columns = np.array([list(vars(place).values()) for place in self.place]).T
        chi, gamma, h, rate = (np.interp(self.at_m, columns[0], x).item() for x in columns[1:])
        turned_s = DETECTED_S + self.reaction_s - TURNED_FROM_S
        back = self.side * self.rate_dps
        # As a level turn: the tangent of the roll for the change from one rate to the other.
        flight = FlightTable.model_validate(tables["flight"])
        load = (abs(rate) + self.rate_dps) * DEG * flight.V_a_mps / flight.g_mps2
        roll_in_s = max(ROLL_IN_S, ROLL_IN_SHARE * load / (self.roll_rate_dps * DEG))
        back_s = DETECTED_S + self.reaction_s + 0.5 * roll_in_s
        ramps = (TURNED_FROM_S, turned_s, rate), (back_s, self.turning_s, back)
        level_s = max(1.0, abs(gamma) / 5.0) * LEVEL_S
        chi -= rate * (DETECTED_S - TURNED_FROM_S)
        start = {"chi_deg": chi % 360.0, "gamma_deg": gamma, "h_m": h}
        reference = {
            "chi_deg": [_ramp(*ramp, roll_in_s) for ramp in ramps],
            "gamma_deg": [_ramp(back_s, level_s, -gamma / level_s, LEVEL_ROLL_IN_S)],
        }
        airspeed = (tables.get("reference") or {}).get("V_mps")
        if airspeed is not None:
            reference["V_mps"] = airspeed
        start = {**tables["flight"], **start, "duration_s": self.duration_s}
        return {**tables, "flight": start, "reference": reference}


def _ramp(start_s: float, duration_s: float, rate_dps: float, roll_in_s: float) -> dict[str, Any]:
    ramp = {"shape": "ramp", "start_s": start_s, "duration_s": duration_s}
    return {**ramp, "rate_dps": rate_dps, "roll_in_s": roll_in_s}


def rate_of(bank: float, speed: float, g: float) -> float:
    """Rate of course, deg/s, of a level turn at a bank (rad) and a speed (m/s)."""
    return g * math.tan(bank) / speed / DEG
