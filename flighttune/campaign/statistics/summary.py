"""Results of each group: shares, percentiles, reasons of failure, and their convergence."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.flights import Flights
from flighttune.campaign.statistics.intervals import Estimate

PERCENTILES = {"p05": 0.05, "p50": 0.5, "p95": 0.95}
BETWEEN_SENTENCES = "; "
"""Separator of the sentences of the column ``missed``."""

GOT = ", got … (missed by …)"
"""Ending that is cut off a shared sentence: it has no number left."""

FIRST_PREFIX, POINTS = 10, 25
"""Smallest number of flights on a convergence curve, and the maximum number of its points."""

_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|(?<=[\s=])-?(?:inf|nan)\b")

HELD, BROKEN, NOT_ENTERED = "held", "broken", "not entered"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Reason for which several flights failed, in words that differ only in their numbers."""

    text: str  # with an ellipsis in place of each number that they do not share
    count: int
    run: int  # first of these flights


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Distribution of a measure over the completed flights that have it."""

    n: int
    mean: float
    percentiles: Mapping[str, Estimate]  # p05, p50 and p95


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Number of flights with one status."""

    status: str
    count: int
    reasons: tuple[Reason, ...]  # the most frequent first; empty for completed flights


@dataclass(frozen=True, slots=True, kw_only=True)
class CertifiedCount:
    """Numbers of flights that stayed in the certified ultimate set, and that left it."""

    held: int
    broken: int
    not_entered: int
    lost: int  # flights that were not completed
    of_all: Estimate  # share of all flights for which the set held
    of_entered: Estimate  # share of the flights that entered the set


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupSummary:
    """The flights of one plant with one gain set."""

    group: Group
    n: int  # flights
    successes: int
    success: Estimate  # success rate
    statuses: tuple[Status, ...]  # the most frequent first
    missed: tuple[Reason, ...]  # requirements missed by completed flights, the most frequent first
    measures: Mapping[str, Spread]  # of every measure that a completed flight has
    certified: CertifiedCount | None  # None without a claim


@dataclass(frozen=True, slots=True, kw_only=True)
class ConvergenceCurve:
    """Estimates from the first flights of a group."""

    group: Group
    n: tuple[int, ...]  # numbers of flights, evenly spaced in their logarithm, up to all of them
    success: tuple[Estimate, ...]  # success rate of the first n flights
    measure: str  # to be minimised
    p95: tuple[Estimate, ...]  # 95th percentile of the measure over the completed ones among them


def summaries(flights: Flights) -> tuple[GroupSummary, ...]:
    """Summarise every group of a campaign that has flights, in the order of the plan.

    Where draws of a design belong together (the blocks of Saltelli's, the cells of a grid), counts
    are replaced by effective ones, see `flighttune.campaign.statistics.intervals.effective_size`.
    Points of a Latin hypercube or Sobol sequence are taken as if they were independent: their
    intervals are wider than they need be.
    """
    return tuple(_summary(group, rows, flights) for group, rows in flights.groups())


def _summary(group: Group, rows: pd.DataFrame, flights: Flights) -> GroupSummary:
    success = rows["success"].to_numpy(dtype=bool)
    completed = (rows["status"] == "completed").to_numpy()
    failed = rows.loc[completed & ~success]
    return GroupSummary(
        group=group,
        n=len(rows),
        successes=int(success.sum()),
        success=flights.share(success, flights.clusters(rows)),
        statuses=_statuses(rows),
        missed=_missed(failed),
        measures={
            name: _spread(rows.loc[completed], name, flights)
            for name in flights.measures
            if rows.loc[completed, name].notna().any()
        },
        certified=_certified(rows, flights),
    )


def _statuses(rows: pd.DataFrame) -> tuple[Status, ...]:
    statuses = [
        Status(
            status=str(name),
            count=len(own),
            reasons=reasons(own["reason"].tolist(), own["run"].tolist()),
        )
        for name, own in rows.groupby("status", sort=False, observed=True)
    ]
    return tuple(sorted(statuses, key=lambda status: -status.count))


def _missed(failed: pd.DataFrame) -> tuple[Reason, ...]:
    """Missed requirements, each counted by itself: a flight that misses two counts for both."""
    sentences = [
        (sentence, run)
        for text, run in zip(failed["missed"].tolist(), failed["run"].tolist(), strict=True)
        for sentence in text.split(BETWEEN_SENTENCES)
    ]
    missed = reasons(*zip(*sentences, strict=True)) if sentences else ()
    return tuple(replace(reason, text=reason.text.removesuffix(GOT)) for reason in missed)


def _spread(completed: pd.DataFrame, measure: str, flights: Flights) -> Spread:
    values, clusters = completed[measure].to_numpy(dtype=float), flights.clusters(completed)
    measured = ~np.isnan(values)
    values, clusters = values[measured], clusters[measured]
    return Spread(
        n=len(values),
        mean=float(np.mean(values)),
        percentiles={
            name: flights.percentile(values, q, clusters) for name, q in PERCENTILES.items()
        },
    )


def _certified(rows: pd.DataFrame, flights: Flights) -> CertifiedCount | None:
    said = rows["certified"].to_numpy(dtype=object)
    inside, broken, outside = (said == word for word in (HELD, BROKEN, NOT_ENTERED))
    lost = (rows["status"] != "completed").to_numpy()
    entered = inside | broken
    if not (entered | outside).any():
        return None
    clusters, all_of = flights.clusters(rows), entered | outside | lost
    return CertifiedCount(
        held=int(inside.sum()),
        broken=int(broken.sum()),
        not_entered=int(outside.sum()),
        lost=int(lost.sum()),
        of_all=flights.share(inside[all_of], clusters[all_of]),
        of_entered=flights.share(inside[entered], clusters[entered]),
    )


def convergence(flights: Flights, measure: str) -> tuple[ConvergenceCurve, ...]:
    """Success rate and 95th percentile of each group over a growing number of its flights."""
    curves = []
    for group, rows in flights.groups():
        clusters, success = flights.clusters(rows), rows["success"].to_numpy(dtype=bool)
        values = rows[measure].to_numpy(dtype=float)
        measured = (rows["status"] == "completed").to_numpy() & ~np.isnan(values)
        counts = prefixes(len(rows))
        first = [np.flatnonzero(measured[:n]) for n in counts]
        q = PERCENTILES["p95"]
        p95 = tuple(flights.percentile(values[kept], q, clusters[kept]) for kept in first)
        rates = tuple(flights.share(success[:n], clusters[:n]) for n in counts)
        curves.append(
            ConvergenceCurve(group=group, n=tuple(counts), success=rates, measure=measure, p95=p95)
        )
    return tuple(curves)


def prefixes(n: int) -> list[int]:
    """Up to 25 numbers from 10, or `n` / 4 if less, to `n`, evenly spaced in their logarithm."""
    first = max(1, min(FIRST_PREFIX, n // 4))
    spaced: npt.NDArray[np.float64] = np.geomspace(first, n, POINTS)
    return sorted({round(value) for value in spaced.tolist()})


def reasons(texts: Sequence[str], runs: Sequence[int]) -> tuple[Reason, ...]:
    """Group sentences that differ only in their numbers, the most frequent first."""
    places_of: dict[str, list[int]] = {}
    for place, text in enumerate(texts):
        if text:
            places_of.setdefault(_NUMBER.sub("…", text), []).append(place)
    grouped = [
        Reason(
            text=_shared([texts[place] for place in at]),
            count=len(at),
            run=int(runs[at[0]]),
        )
        for at in places_of.values()
    ]
    return tuple(sorted(grouped, key=lambda reason: (-reason.count, reason.run)))


def _shared(texts: Sequence[str]) -> str:
    """The common text of sentences that differ only in numbers, with the numbers they share."""
    places = zip(*(_NUMBER.findall(text) for text in texts), strict=True)
    numbers = iter([shown[0] if len(set(shown)) == 1 else "…" for shown in places])
    return _NUMBER.sub(lambda _: next(numbers), texts[0])
