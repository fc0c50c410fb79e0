"""Gains that were searched for to meet requirements, with all candidates."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.answering import Answering
from flighttune.base.answers.answer import Answer, Column, Table
from flighttune.base.answers.labels import columns, endings_table, in_words, measure_words
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.words import interval, listed, percent, pick
from flighttune.campaigns.planning.schema import Campaign
from flighttune.campaigns.statistics.intervals import CONFIDENCE
from flighttune.claims.counted_flights import distribution_of
from flighttune.control.gains import PIGains, gains_lists, gains_table
from flighttune.control.linear_model import closed_loop
from flighttune.control.margins import loop_margins, margins_table
from flighttune.control.theory.indicators import indicators
from flighttune.flight.flown import BoundCheck
from flighttune.flight.gains import certify_scenario
from flighttune.flight.models import linear_model
from flighttune.flight.scenario.schema import Scenario

Status: TypeAlias = Literal["met", "missed", "not sure"]

# How rows of the margins are named that are required unless the scenario states others.
BY_DEFAULT = "by default"

REQUIREMENT_COLUMNS = columns(
    "run words sense bound value start unit margin active", of="requirements"
)
SHARE_COLUMNS = [*REQUIREMENT_COLUMNS[:4], *columns("value unit share share_start", of="shares")]
TRADE_COLUMNS = [*REQUIREMENT_COLUMNS[:5], *columns("unit alone beside", of="trade_offs")]
TRADED = "the best of each among the gains flown here"
CERTIFICATE_COLUMNS = [Column("in_words", "status"), *columns("rate growth radius")]
# What is claimed, by what decides it or by the answer that is sure.
AT_ANY = f"confidence {CONFIDENCE:g} at any number of draws"
DECIDED = {
    "lo": "{} are wanted, by the lower end of the interval",
    "value": "{} are wanted, by the estimate",
    "yes": f"those of a new random draw do with a probability of at least {{}}, {AT_ANY}",
    "no": f"those of a new random draw do with a probability below {{}}, {AT_ANY}",
    "evidence": "it is not sure whether those of a new random draw do with a probability of {}",
}
BY_DEFAULT_NOTE = (
    "Margins of the linear loop of 6 dB and 35 deg are required by default: others under "
    "at_least.loop of [[expect]] replace them."
)


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
        Name of the best gains of the start, and those.
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

    def answer(self) -> Answer:
        """Requirements, gains, margins and certificate; a failure if a requirement is missed."""
        scenario, rows, law = self.scenario, self.requirements, self.scenario.laws[0]
        model = linear_model(scenario, law)
        loop = indicators(closed_loop(model, self.gains), errors=len(model.errors))
        figures = pick(loop, "R_K I_K E_K spectral_abscissa")
        certificate = certify_scenario(scenario, self.gains, law=law).values
        drawn = []
        if self.campaign is not None:
            labels = [plant.label for plant in scenario.plant]
            drawn = [distribution_of(self.campaign, label).table(label) for label in labels]
        missed = [f"{_subject(row)}: {row['why']}" for row in rows if row["why"]]
        shown = SHARE_COLUMNS if self.success else REQUIREMENT_COLUMNS
        return Answer(
            values={
                **pick(self, "status start start_met flights candidates metric"),
                **pick(self, "requirements worse trade_offs success tuned_for"),
                **gains_lists(self.gains),
                **figures,
                "certificate": certificate,
            },
            tables=[
                Table(shown, [*map(in_words, rows)], self.start_sentence or scenario.title),
                Table(TRADE_COLUMNS, [*map(in_words, self.trade_offs)], TRADED),
                gains_table("gains", self.gains),
                *drawn,
                Table(columns("R_K I_K E_K spectral_abscissa"), [figures]),
                margins_table(loop_margins(model, self.gains)),
                Table(CERTIFICATE_COLUMNS, [certificate], "certificate"),
                endings_table(self.endings),
            ],
            notes=[
                *filter(None, [self.worse_sentence, *self.notes, *missed]),
                *[BY_DEFAULT_NOTE] * any(row["run"].endswith(BY_DEFAULT) for row in rows),
            ],
            verdict=self.sentence,
            failure="" if self.status == "met" else self.sentence,
        )

    @property
    def start_sentence(self) -> str:
        """A note that the gains of the start need no search; empty if they do."""
        n = len(self.requirements)
        met = f"the gains of the start, {self.start}, already meet all {n} requirements"
        return met if self.start_met else ""

    @property
    def worse_sentence(self) -> str:
        """Measures that are worse than with the gains of the start; empty if there are none."""
        worse = [
            f"{row['words']} {row['value']:.3g} {row['unit']} (was {row['start']:.3g})"
            for row in map(in_words, self.worse)
        ]
        return f"Worse than with {self.start}: {listed(worse)}." if worse else ""

    @property
    def sentence(self) -> str:
        """Whether the requirements are met, after how many flights, and which are active."""
        rows, flights = self.requirements, f"{self.flights} flight{'s' * (self.flights != 1)}"
        if self.success:
            return self._counted(self.success, flights)
        n, missed = len(rows), sum(not row["margin"] >= 0.0 for row in rows)
        if missed:
            said = f"{missed} of {n} requirements missed, after {flights}"
            return f"{said}; these are the nearest gains."
        least = 100.0 * min(row["margin"] for row in rows)
        met = f"All {n} requirements are met by {least:.1f} %, after {flights}"
        if self.metric["name"] == "margin":
            return f"{met}."
        active = [_subject(row) for row in rows if row["active"]]
        stop = "stops" if len(active) == 1 else "stop"
        limits = f"; {listed(active)} {stop} it from falling" if active else ""
        return (
            f"{met}. {self.metric['name']} is {self.metric['value']:.4g}, "
            f"{self.metric['start']:.4g} at the start{limits}."
        )

    def _counted(self, success: Mapping[str, Any], flights: str) -> str:
        """The share of fresh draws on which the requirements are met."""
        gains, start = (
            interval(*(100.0 * x[end] for end in ("value", "lo", "hi")))
            if "lo" in x
            else percent(x["value"])
            for x in (success["share"], success["of_start"])
        )
        rule = DECIDED[success["sure"] or success["by"]].format(f"{100 * success['wanted']:g} %")
        return (
            f"On {success['share']['n']} fresh draws (seed {success['seed']}) {gains} % of the "
            f"flights meet all requirements, {start} % with {self.start}; {rule} ({flights})."
        )


def _subject(row: Mapping[str, Any]) -> str:
    return f"{measure_words(row['measure'])} on {row['run']}"
