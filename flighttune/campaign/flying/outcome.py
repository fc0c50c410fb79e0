"""What came of one run: status, measures, whether it was a success, whether its claim held."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from flighttune.arrays import FloatArray
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.planning.schema import MEASURES
from flighttune.expectations import missed
from flighttune.scenario.expect_table import ExpectTable
from flighttune.scenario.schema import Scenario

PLACES = tuple((subject, name) for subject, name in (measure.split(".") for measure in MEASURES))
UNMEASURED = (math.nan,) * len(MEASURES)

Measured = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of one run.

    Attributes
    ----------
    status : str
        That of a run, or ``invalid``, ``crashed`` or ``timed_out``.
    reason : str
        A sentence where `status` is not ``completed``.
    measured : sequence of float, length of `MEASURES`
        NaN where a measure has no value.
    missed : tuple of str
        A sentence for each expectation that was not met; empty for a success.
    certified : str or None
        As `flighttune.gap.ultimate_set.Kept`; None without a claim or a completed flight.
    wall_s : float, s
        Time it took.
    """

    status: str
    reason: str
    measured: Sequence[float] | FloatArray = UNMEASURED
    missed: tuple[str, ...]
    certified: str | None = None
    wall_s: float


class FlownRow(NamedTuple):
    """A run, the scenario of its draw (None where it is refused) and what came of it."""

    run: int
    scenario: Scenario | None
    outcome: Outcome | None


def flat(measured: Measured) -> Sequence[float]:
    """Measures as `flighttune.metrics.measures` has them, in order of `MEASURES`."""
    if not measured:
        return UNMEASURED
    return [measured[subject].get(name, math.nan) for subject, name in PLACES]


def expected_of(scenario: Scenario, group: Group) -> list[ExpectTable]:
    """The expectations that mean the runs of a group.

    Parameters
    ----------
    scenario : Scenario
        Of a draw, or the undispersed one: they are never dispersed.
    group : Group
    """
    return [table for table in scenario.expect if table.meant(group.plant, group.gains)]


def misses(
    tables: Sequence[ExpectTable], status: str, reason: str, measured: Measured | FloatArray
) -> tuple[str, ...]:
    """What one run does not meet of what is expected of it.

    Parameters
    ----------
    tables : sequence of ExpectTable
        Those that mean the run.
    status, reason : str
    measured : mapping, or ndarray in order of `MEASURES`
    """
    if isinstance(measured, Mapping):
        return missed(tables, status, reason, measured)
    nested: dict[str, dict[str, float]] = {}
    if any(table.at_most or table.at_least for table in tables):
        for (subject, name), value in zip(PLACES, measured.tolist(), strict=True):
            nested.setdefault(subject, {})[name] = value
    return missed(tables, status, reason, nested)
