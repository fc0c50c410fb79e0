"""Counts of flights that turn back, and their room beyond the route."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray, Floats
from flighttune.base.endings import endings
from flighttune.base.errors import InputError, printable
from flighttune.base.words import listed
from flighttune.campaigns.planning.plan import Plan
from flighttune.claims.about import About, Of
from flighttune.claims.band import Band
from flighttune.claims.counted import Counted
from flighttune.claims.counted_flights import room_of
from flighttune.claims.known import navigation_errors
from flighttune.claims.measured import Measured
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.load import scenario_of
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.follow import SAME_PLACE
from flighttune.routes.turn_back_keys import BACK_S, TurnBackTable
from flighttune.routes.volumes import BUFFER, CONTINGENCY, GEOGRAPHY, Volume

# Signals of flights that turn back, m, each the maximum since detection: the horizontal distance
# from the route in any direction, and the difference of height from the place of detection.
ROOM = {"from_route": "m", "height": "m"}

# What the room to turn back leaves out.
NOT_COUNTED = (
    "No failure of engine, link or receiver is in the room to turn back, and the room is no risk "
    "class."
)

# Factors on the half-widths of `ROOM`: some more metres of height cost nothing, and the distance is
# then bounded by nearly its quantile.
HEIGHT_ROOM = np.array([1.0, 2.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomSignals(Measured):
    """Largest distances of flights that turn back, since detection."""

    @classmethod
    def chosen(cls, plan: Plan, signals: Iterable[str] | None) -> Self:
        """Both signals of `ROOM`."""
        del plan, signals
        return cls(units=ROOM)

    @classmethod
    def of(cls, about: About, scenario: Scenario, plant: str) -> Self:
        """Signals from a file, which must belong to flights that turn back."""
        del plant
        if about.signals != ROOM:
            raise InputError(
                f"`signals` must be {listed(list(ROOM))} of flights that turn back, got "
                f"{listed(list(about.signals))}: flighttune 0.3.0 counted the distance ahead, and "
                "flights went further to the side; count it with flighttune mission --turn-back."
            )
        _turns(scenario)
        return cls(units=about.signals)

    @property
    def room(self) -> Floats:
        """Factors on the learned half-widths."""
        return HEIGHT_ROOM

    def values(self, run: Run, scenario: Scenario) -> FloatArray:
        """The room that a flight has used so far, shape (samples, 2)."""
        del scenario  # the flight may have begun level
        return room_of(run, _turns(scenario_of(run)))

    def windows(
        self, central: Scenario, samples: int, flights: int, per_unit: float
    ) -> npt.NDArray[np.integer]:
        """One window, from the detection on."""
        del flights
        return np.array([math.ceil(_turns(central).detected_s * per_unit), samples - 1])


def _with_sum(
    term: str, what: str, rows: Sequence[tuple[str, str, float, float | None]]
) -> list[dict[str, Any]]:
    """Records of terms, and after them one with their sum."""
    sums = (sum(x or 0.0 for x in column) for column in list(zip(*rows, strict=True))[2:])
    keys = "term", "is", "guideline", "counted"
    return [dict(zip(keys, row, strict=True)) for row in (*rows, (term, what, *sums))]


def _turns(scenario: Scenario) -> TurnBackTable:
    """The turn back of flights in a scenario; InputError if its flights do not turn back."""
    if scenario.turn_back is None:
        raise InputError("`plan` must be of flights that turn back.")
    return scenario.turn_back


class TurnRoom(NamedTuple):
    """Room of a flight that turns back, m, added to the width and height of a volume."""

    from_route: float  # in any horizontal direction
    height: float  # above and below

    def around(self, geography: Volume, claim: str) -> Volume:
        """The volume with this room around a flight geography, not below the ground."""
        width, high = geography.width + self.from_route, geography.high + self.height
        return Volume(width, max(geography.low - self.height, 0.0), high, claim)


# Errors of receiver, of holding the position and of the map, m, and the least width and height of
# a flight geography in largest dimensions. They are of the LBA's Guidance for Dimensioning of
# Flight Geography, Contingency Volume and Ground Risk Buffer, 1.7 (2024), as calculators quote it;
# that of flight-geography-calculator.dronedesk.io has the sums and the three dimensions.
S_GPS, S_POS, S_K, LEAST_SIZES = 3.0, 3.0, 1.0, 3.0

# Error of a barometric height, m (of one by GPS 4 m); the share of the speed that climbs, at 45 deg
# of pitch, during the reaction; and the height in V^2/g of the arc that ends this climb,
# 1 - cos(45 deg). They are quoted by natrammor/uav_flight_geometry (the share) and by Digisky's
# GroundRiskBuffer3.py (all but the 1 m), which has them from FOCA's UAS-GM-Part1.
H_BARO, CLIMBING, ARC = 1.0, 0.7, 0.3

# Words for the ends of flights.
ENDED = {"no_trim": "without a steady flight at their start"}

# Words for the start of flights that turn back on a slope.
BEGUN = "begun in steady flight or, where there is none on a slope, in level flight before it"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnBack(Counted):
    """A count of the largest distances of flights that turn back at any place of their route."""

    of: ClassVar[Of] = "turn_back"
    measures: ClassVar[type[Measured]] = RoomSignals
    title: ClassVar[tuple[str, str]] = "room to turn back", "room_bounds"

    @property
    def room(self) -> TurnRoom:
        """Room of its flights, rounded up to whole metres."""
        return TurnRoom(*np.ceil(self._ends(np.zeros((1, 0)))[1][0]).tolist())

    @property
    def summary(self) -> str:
        """The room in a line of a mission's answer, or why there is no claim."""
        if self.claims:
            begun = f" Its flights are {self.begun}." if self.begun else ""
            return f"Turning back takes {self.room.from_route:.0f} m beyond the corridor.{begun}"
        ended = "".join(
            f", {row['count']} of them {ENDED.get(row['status'], row['status'].replace('_', ' '))}"
            for row in endings(self.endings)
        )
        return (
            f"No room to turn back is claimed: of {len(self.scores)} flights that turn back "
            f"{self.lost}{ended}; at most {self.allowed} of {self.first} may."
        )

    @property
    def table(self) -> TurnBackTable:
        """Parameters of the turn back."""
        return _turns(self.flights.central)

    @property
    def _leaves(self) -> str:
        begun = f", {self.begun}," if self.begun else ""
        return (
            f"that turns back{begun} goes further than {self.room.from_route:.0f} m beyond the "
            f"flight geography in any direction, or {self.room.height:.0f} m above or below it,"
        )

    @property
    def begun(self) -> str:
        """The start of flights on slopes, in words; empty without slopes, or in files of 0.4.0."""
        return BEGUN if self.table.or_level else ""

    def volumes(self, corridor: Band) -> dict[str, Volume]:
        """The volumes around the route of these flights."""
        if not (self.claims and isinstance(corridor, Band)):
            got = f"a {type(corridor).__name__}" if self.claims else "no claim of the room"
            raise InputError(f"volumes must be of a room and the band of its route, got {got}.")
        # The flight geography has the largest width and height of the corridor, a band along the
        # route. The contingency volume adds the room to turn back, and the ground risk buffer adds
        # the contingency volume's height over ground and half of the largest dimension.
        planned = corridor.flights.route
        path, h_0 = planned.reference.path, planned.where[2]
        along, north, east, _, _, h, V_a, *_ = self.table.columns
        route = *path.beside(along).T, np.interp(along, path.s, planned.reference.V)
        flown, others = (
            f"{of.plant} / {of.gains_name} along {length:.10g} m"
            for of, length in ((self.flights, along[-1]), (corridor.flights, path.length))
        )
        if flown != others or not np.allclose(route, (north, east, h - h_0, V_a), atol=SAME_PLACE):
            raise InputError(
                "both bands must be of one aircraft with the same gains and airspeeds on one "
                f"route, got {flown} and {others}."
            )
        claimed = corridor.corridor(planned.where)
        beside, above = np.abs([claimed.low, claimed.high]).max(axis=(0, 1)).tolist()
        # Guidelines ask for a flight geography of three times the largest dimension.
        least = LEAST_SIZES * self.largest_dimension
        beside = max(beside, 0.5 * least)
        heights = path.up[path.s <= path.length] + h_0 - corridor.flights.central.flight.ground_m
        low, high = max(float(heights.min()) - above, 0.0), float(heights.max()) + above
        geography = Volume(beside, low, max(high, low + least), claimed.claim)
        around = self.room.around(geography, printable(self.sentence))
        top = around.high
        width = around.width + top + 0.5 * self.largest_dimension
        return {
            GEOGRAPHY: geography,
            CONTINGENCY: around,
            BUFFER: Volume(width, 0.0, top, "as wide as it is high, and half the span"),
        }

    @property
    def largest_dimension(self) -> float:
        """The wing span of the aircraft, m; 0 where there is none or its model states none."""
        return self.flights.span or 0.0

    def terms(self, corridor: Band) -> list[dict[str, Any]]:
        """Terms of a contingency volume beyond the path: of the guideline, and as counted, m.

        The guideline's speed is over ground, so the planned wind is added to the airspeed. The room
        that was counted is reaction and manoeuvre together. S_CV is the sum of the width, H_CV that
        of the height, whose first term is counted with the errors of flying.
        """
        g = self.flights.central.flight.g_mps2
        V_0 = max(self.flights.central.airspeeds) + max(self.table.wind(g), 0.0)
        reaction = V_0 * self.table.reaction_s
        turn = self.table.formula(V_0, g) - reaction
        geography, planned = self.volumes(corridor)[GEOGRAPHY], corridor.flights.route
        beside, path = geography.width, planned.reference.path
        highest = float(path.up[path.s <= path.length].max()) + planned.where[2]
        above = geography.high - (highest - corridor.flights.central.flight.ground_m)
        errors = navigation_errors(corridor)
        navigation = 0.0 if errors is None else min(errors.beside, beside)
        aside = [
            ("S_GPS", "navigation", S_GPS, navigation),
            ("S_Pos", "holding", S_POS, beside - navigation),
            ("S_K", "map", S_K, None),
            ("S_RZ", "reaction, in S_CM", reaction, None),
            ("S_CM", "manoeuvre", turn, self.room.from_route),
        ]
        upwards = [
            ("H_baro", "navigation, holding", H_BARO, above),
            ("H_RZ", "reaction, in H_CM", CLIMBING * reaction, None),
            ("H_CM", "manoeuvre", ARC * V_0**2 / g, self.room.height),
        ]
        return [*_with_sum("S_CV", "width", aside), *_with_sum("H_CV", "height", upwards)]

    def sizes(self) -> list[dict[str, float]]:
        return [{"high": size} for size in self.room]

    @property
    def _formula(self) -> float:
        central = self.flights.central
        return self.table.formula(max(central.airspeeds), central.flight.g_mps2)

    @property
    def own_values(self) -> dict[str, Any]:
        sizes = {f"{key}_m": size for key, size in self.room._asdict().items() if self.claims}
        return {"room": {**sizes, "by_formula_m": self._formula}}

    @property
    def own_notes(self) -> list[str]:
        table = self.table
        return [
            f"A turn of {table.turn_deg:g} deg to either side from any place of the route, "
            f"{table.reaction_s:g} s after detection, {table.bank_deg:g} deg of bank with a wind "
            f"of {table.wind(self.flights.central.flight.g_mps2):.3g} m/s from behind, until "
            f"{BACK_S:g} s after it; by formula {self._formula:.0f} m ahead in still air.",
            NOT_COUNTED,
        ]
