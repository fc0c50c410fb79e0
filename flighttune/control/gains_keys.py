"""``[[gains]]`` of a scenario, and the names of gain sets that are tuned."""

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, Field

from flighttune.base import quantities as q
from flighttune.base.words import listed
from flighttune.control.gains import PIGains
from flighttune.control.law import DEFAULT

# Gains tuned on the model that ``[tuning]`` names.
TUNED = "tuned"

# Gains tuned on the identified model, even if ``[tuning]`` names another model.
TUNED_IDENTIFIED = "tuned_identified"

# Gains of the exact law on the identified model, with feedback of roll and load factor and the
# smallest errors in turbulence.
TUNED_FED_BACK = "tuned_fed_back"

# The same with the estimation errors of a standard receiver and inertial unit, under bounds on the
# rates of roll and load factor.
TUNED_GENTLE = "tuned_gentle"

# Gains of the exact law alone
OF_EXACT_LAW = TUNED_FED_BACK, TUNED_GENTLE

# Gains that fly where none are stated: the first that tuning finds.
FIRST_FOUND = TUNED_FED_BACK, TUNED_IDENTIFIED

# Gains tuned for an aircraft, the best first.
TUNED_FOR_AIRCRAFT = *OF_EXACT_LAW, TUNED_IDENTIFIED


def default_gains(names: Sequence[str]) -> str:
    """The default gain set: gains tuned for the aircraft, else the first set."""
    sets = {name.rpartition(":")[2]: name for name in reversed(names)}
    return next((sets[name] for name in TUNED_FOR_AIRCRAFT if name in sets), names[0])


def _square(rows: list[list[float]]) -> list[list[float]]:
    if [len(row) for row in rows] not in ([2, 2], [3, 3, 3]):
        raise ValueError(
            "must have 2 rows (phi, n_z) of 2 numbers (chi, gamma), or 3 of 3 with n_x and V"
        )
    return rows


Feedback: TypeAlias = Annotated[
    list[Annotated[float, Field(ge=0.0, lt=1.0)]], Field(min_length=2, max_length=2)
]

GainMatrix: TypeAlias = Annotated[list[list[q.Gain]], AfterValidator(_square)]


def on_aircraft(names: Iterable[str]) -> str:
    """Aircraft in words."""
    return listed([f"the {name}" for name in names]) or "the law alone"


class TunedFor(q.Table):
    """``[gains.tuned_for]``: aircraft and airspeeds for which gains were tuned."""

    aircraft: list[q.PathName]  # if left out: the law alone
    V_a_mps: list[q.Airspeed]  # if left out: any airspeed
    # Assumptions of their model, as sentences; none if left out
    assumed: list[str] | None = None

    @property
    def words(self) -> str:
        """``the c172p at 50 m/s``."""
        ends = dict.fromkeys(f"{end(self.V_a_mps):.6g}" for end in (min, max) if self.V_a_mps)
        return on_aircraft(self.aircraft) + f" at {' to '.join(ends)} m/s" * bool(ends)

    def unlike(self, aircraft: Iterable[str], airspeeds: Sequence[float]) -> bool:
        """Whether a flight uses another aircraft, or an airspeed outside the range."""
        low, high = min(self.V_a_mps, default=0.0), max(self.V_a_mps, default=math.inf)
        other = self.aircraft and {*aircraft} - {*self.aircraft}
        return bool(other) or min(airspeeds) < low or max(airspeeds) > high


class GainsTable(q.Table):
    """``[[gains]]`` as numbers: rows phi, n_z (or their rates), columns chi, gamma."""

    name: q.Name
    K_P: GainMatrix
    K_I: GainMatrix
    # paper, or exact, whose rows are rates in 1/s and 1/s^2; exact if left out and no other law
    # flies. Other laws get mapped gains
    law: Literal["paper", "exact"] | None = None
    feedback: Feedback | None = None  # of the exact law, on measured roll and load factor
    tuned_for: TunedFor | None = None  # written by `tune` and `meet`

    def gains(self, law: str = DEFAULT) -> PIGains:
        """The gains as a value; `law` is their law if the table does not name it."""
        return PIGains.from_lists(self.K_P, self.K_I, self.law or law, self.feedback)
