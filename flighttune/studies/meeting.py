"""Gains that were searched for to meet requirements, with all candidates."""

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

# How rows of the margins are named that are required unless the scenario states others.
BY_DEFAULT = "by default"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """Gains with every requirement on every draw."""

    gains: PIGains
    excess: FloatArray  # (draws, requirements); relative to the bounds, `LOST` without a value
    checks: tuple[tuple[BoundCheck, ...], ...]  # likewise
    metric: float = math.inf  # sum over the flights of what is minimised
    ends: Mapping[str, float] = field(default_factory=dict)  # largest ``end_error`` by channel
    held: tuple[str, ...] = ()  # which limits hold a command to the end, in words

    @property
    def worst(self) -> FloatArray:
        """Largest excess of each draw."""
        return self.excess.max(axis=1)

    @property
    def worst_draw(self) -> int:
        """The draw nearest to a bound, by the requirements on which draws differ, if any."""
        differ = np.ptp(self.excess, axis=0) > 0.0
        return int(self.excess[:, differ | ~differ.any()].max(axis=1).argmax())

    @property
    def met(self) -> bool:
        """Whether all requirements are met on all draws."""
        return bool(self.worst.max() <= 0.0)

    @property
    def default(self) -> npt.NDArray[np.bool_]:
        """Which requirements are required by default, which no flight decides."""
        return np.array([check.run.endswith(BY_DEFAULT) for check in self.checks[0]])


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Meeting(Answering):
    """The gains nearest to meeting the requirements of scenarios, of all that were flown.

    Attributes
    ----------
    status : "met", "missed" or "not sure"
    scenario : Scenario
        The first one, whose first law the gains are for.
    campaign : Campaign or None
        The campaign that dispersed it.
    gains : PIGains
        The best ones, even if they miss a requirement.
    start, start_gains : str, PIGains
        Name of the gains with which those found are compared, the nearest of those that the
        scenario flies, and those.
    start_met : bool
        Whether those meet all requirements already.
    flights, candidates : int
        Number of flights, and of gain sets that were flown.
    metric : mapping
        The quantity that was minimised: its ``name``, and its ``value`` with the gains and at the
        ``start``.
    requirements : sequence of mapping
        ``run``, ``measure``, ``sense``, ``bound``, ``value``, ``margin`` relative to the bound, why
        there is no value (``why``), the value at the ``start``, and the shares of draws on which it
        is met; those that are ``active`` stop the metric. On a campaign, values are those of the
        worst fresh draw.
    worse : sequence of mapping
        What is worse than at the start, required or not: R_K, margins of the loop and the largest
        mean error at the end of each channel, with ``measure``, ``value`` and ``start``, in SI.
    trade_offs : sequence of mapping
        How far each requirement in conflict came in this search: in any candidate (``alone``), and
        in those that met the others (``beside``, None if none did). Empty on a campaign.
    success : mapping or None
        On a campaign the ``share`` of fresh draws on which all are met, that of the start
        (``of_start``), the share ``wanted``, and whether the lower end of the interval (``lo``),
        the estimate (``value``) or evidence at any number of draws decides (``by``); whether it is
        ``sure``, "yes", "no" or empty; the ``worst_draw`` and the ``seed`` of these draws.
    worst : Scenario or None
        The scenario in that draw.
    trials : sequence of Trial
        All candidates.
    tuned_for : mapping
        Names of ``aircraft`` and the ends of the airspeeds, ``V_a_mps``, of all scenarios.
    notes : tuple of str
        A sentence for gains of the start that were tuned for others, and, without a campaign, for a
        command that a limit holds to the end.
    endings : sequence of mapping
        ``run``, ``status`` and ``reason`` of the flights that were not completed.
    compiled : CompiledFlights
        How many flights were compiled, and how many JSBSim flew, again or alone.

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
