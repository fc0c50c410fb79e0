"""How gains are to be chosen by flying them, and what was chosen."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from flighttune.campaign.choice.candidates import Candidate
from flighttune.campaign.planning.schema import MEASURES
from flighttune.errors import InputError
from flighttune.scenario.expect_table import in_rad

Status: TypeAlias = Literal[
    "chosen", "infeasible", "too_many_lost", "too_few_succeed", "interrupted"
]

CANDIDATES = 12
PERCENTILE = 95.0
METRICS = ("chi.ITAE",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What a gain set flew to.

    Attributes
    ----------
    candidate : Candidate
    draws : int
        Draws it was flown on.
    percentile, lo, hi : float
        Of the score over those draws, with the 95 % interval; infinite where flights were lost.
    success, success_lo, success_hi : float, 1
        Part of the draws on which it succeeds on every plant, with the 95 % interval.
    p_best : float, 1
        Part of the resamples in which it is the best candidate; of one that was dropped the part in
        which it did as well as the leader then, of one that is not to be chosen NaN.
    dropped : bool
        Whether it was dropped before the last draws.
    behind, behind_lo, behind_hi : float
        Median and 95 % interval over the resamples of how far its percentile lies above that of the
        chosen one; NaN where it was dropped.
    """

    candidate: Candidate
    draws: int
    percentile: float
    lo: float
    hi: float
    success: float
    success_lo: float
    success_hi: float
    p_best: float
    dropped: bool
    behind: float
    behind_lo: float
    behind_hi: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustChoice:
    """Gains that were chosen by flying them.

    Attributes
    ----------
    status : str
        ``chosen``; ``infeasible`` where there is no frontier; ``too_many_lost`` where so many
        flights of every candidate were lost that no percentile is finite; ``too_few_succeed`` where
        no candidate succeeds as often as it must; ``interrupted``.
    reason : str
        A sentence where `status` is not ``chosen``.
    best : Judged or None
        The best candidate, also where it is not good enough.
    p_best : float, 1
        Probability that it is the best candidate on draws like these; NaN where there is none.
    loss : float
        What its percentile lies above that of the best, mean over the resamples.
    candidates : tuple of Judged
        All of the frontier, I_K rising.
    own : tuple of Judged
        The campaign's own gain sets, for comparison.
    metrics : tuple of str
        What is added up to the score.
    percentile : float, %
    draws, flights : int
        Draws of those at the end, and flights of all.
    """

    status: Status
    reason: str
    best: Judged | None = None
    p_best: float = float("nan")
    loss: float = float("nan")
    candidates: tuple[Judged, ...] = ()
    own: tuple[Judged, ...] = ()
    metrics: tuple[str, ...] = METRICS
    percentile: float = PERCENTILE
    draws: int = 0
    flights: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustSettings:
    """How gains are chosen.

    Attributes
    ----------
    metrics : tuple of str
        Columns of the rows, or with ``_deg`` in place of ``_rad``; their sum is the score, less of
        which is better. A flight that was not completed, or has no value, is worse than any other.
    percentile : float, %
        Of the score that is to be as low as can be.
    least_success : float, 1
        Part of the draws on which the chosen gains must succeed.
    candidates : int
        Points of the frontier.
    draws : int or None
        Draws of those at the end; None for those of the campaign.
    plants : tuple of str
        Labels of the plants to fly; empty for all. A draw's score is that of its worst plant.
    """

    metrics: tuple[str, ...] = METRICS
    percentile: float = PERCENTILE
    least_success: float = 0.0
    candidates: int = CANDIDATES
    draws: int | None = None
    plants: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.metrics:
            if in_rad(name) not in MEASURES:
                raise InputError(
                    f"`metric` must be one of {', '.join(MEASURES)} (or _deg in place of _rad), "
                    f"got {name!r}."
                )
        if not self.metrics:
            raise InputError("`metric` must be given, got nothing.")
        if not 0.0 < self.percentile < 100.0:
            raise InputError(f"`percentile` must be between 0 and 100, got {self.percentile:g}.")
        if not 0.0 <= self.least_success <= 1.0:
            raise InputError(f"`min_success` must be 0 to 1, got {self.least_success:g}.")
        if self.draws is not None and self.draws < 1:
            raise InputError(f"`draws` must be at least 1, got {self.draws}.")
