"""Result of a search for gains that meet requirements, with all candidates."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.campaigns.flying.compiled import CompiledFlights
from flighttune.campaigns.planning.schema import Campaign
from flighttune.control.gains import PIGains
from flighttune.flight.flown import BoundCheck
from flighttune.flight.scenario.schema import Scenario

Status: TypeAlias = Literal["met", "missed", "not sure"]

# Run of the margins that are required unless the scenario states others.
BY_DEFAULT = "by default"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """Gains with every requirement on every draw."""

    gains: PIGains
    excess: FloatArray  # (draws, requirements); relative to the bounds, `LOST` without a value
    checks: tuple[tuple[BoundCheck, ...], ...]  # of each draw and requirement
    metric: float = math.inf  # sum over the flights of the metric
    ends: Mapping[str, float] = field(default_factory=dict)  # largest ``end_error`` by channel
    held: tuple[str, ...] = ()  # which limits hold a command to the end, in words

    @property
    def worst(self) -> FloatArray:
        """Largest excess of each draw."""
        return self.excess.max(axis=1)

    @property
    def worst_draw(self) -> int:
        """The draw with the smallest margin, by the requirements on which draws differ, if any."""
        differ = np.ptp(self.excess, axis=0) > 0.0
        return int(self.excess[:, differ | ~differ.any()].max(axis=1).argmax())

    @property
    def met(self) -> bool:
        """Whether all requirements are met on all draws."""
        return bool(self.worst.max() <= 0.0)

    @property
    def default(self) -> npt.NDArray[np.bool_]:
        """Which requirements are default margins, which no flight decides."""
        return np.array([check.run.endswith(BY_DEFAULT) for check in self.checks[0]])


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Meeting(Answering):
    """The flown gains that are nearest to meeting the requirements of scenarios.

    Attributes
    ----------
    status : "met", "missed" or "not sure"
    scenario : Scenario
        The first scenario; the gains are for its first law.
    campaign : Campaign or None
        The campaign that disperses the scenario.
    gains : PIGains
        The best gains, even if they miss a requirement.
    start, start_gains : str, PIGains
        Name and gains of the start used for comparison: the best of the gain sets that the
        scenario flies.
    start_of_scenario : bool
        Whether the scenario flies the start; else it is the best of the tuned gains.
    other_starts : tuple of str
        Names of the other gains that were tried as a start.
    start_met : bool
        Whether the start already meets all requirements.
    flights, candidates : int
        Number of flights, and of gain sets that were flown.
    metric : mapping
        The quantity that was minimised: its ``name``, and its ``value`` with the gains and at the
        ``start``.
    requirements : sequence of mapping
        ``run``, ``measure``, ``sense``, ``bound``, ``value``, ``margin`` relative to the bound, why
        there is no value (``why``), the value at the ``start``, and the shares of draws on which
        the requirement is met. ``active`` requirements keep the metric from falling further. On a
        campaign, values are from the worst fresh draw.
    worse : sequence of mapping
        Measures that are worse than at the start, required or not: R_K, margins of the loop and the
        largest mean error at the end of each channel, with ``measure``, ``value`` and ``start``, in
        SI.
    trade_offs : sequence of mapping
        Best value of each conflicting requirement in this search: in any candidate (``alone``), and
        in candidates that meet the others (``beside``, None if none does). Empty on a campaign.
    success : mapping or None
        On a campaign the ``share`` of fresh draws on which all requirements are met, the share of
        the start (``of_start``) and the share ``wanted``. ``by`` says what decides: the lower end
        of the interval (``lo``), the estimate (``value``) or ``evidence``. ``sure`` is "yes", "no"
        or empty. Also the ``worst_draw`` and the ``seed`` of these draws.
    worst : Scenario or None
        The scenario in the worst draw.
    trials : sequence of Trial
        All candidates.
    tuned_for : mapping
        Names of ``aircraft``, and ends of the airspeed ranges (``V_a_mps``) of all scenarios.
    notes : tuple of str
        Sentences about a start that was tuned for another aircraft or airspeed and, without a
        campaign, about a command that a limit holds to the end.
    endings : sequence of mapping
        ``run``, ``status`` and ``reason`` of the flights that were not completed.
    compiled : CompiledFlights
        Numbers of flights that were compiled, that JSBSim flew again, and that JSBSim flew alone.

    Examples
    --------
    >>> meeting = ft.meet("paper_identified", start="paper", budget=2)
    >>> meeting.status, [row["measure"] for row in meeting.requirements if row["margin"] >= 0.0]
    ('missed', ['loop.gain_margin_dB'])
    """

    status: Status
    scenario: Scenario
    campaign: Campaign | None
    gains: PIGains
    start: str
    start_gains: PIGains
    start_of_scenario: bool
    other_starts: tuple[str, ...]
    start_met: bool
    flights: int
    candidates: int
    metric: Mapping[str, Any]
    requirements: Sequence[Mapping[str, Any]]
    worse: Sequence[Mapping[str, Any]]
    trade_offs: Sequence[Mapping[str, Any]]
    success: Mapping[str, Any] | None
    worst: Scenario | None
    trials: Sequence[Trial]
    tuned_for: Mapping[str, Any]
    notes: tuple[str, ...]
    endings: Sequence[Mapping[str, Any]]
    compiled: CompiledFlights = field(default_factory=CompiledFlights)
