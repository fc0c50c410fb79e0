"""What the flights of each group came to: shares and percentiles with their intervals."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.campaign.intervals import CONFIDENCE
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.report.estimates import Estimate, Method, percentile, share
from flighttune.campaign.report.flown import Flown
from flighttune.campaign.report.reasons import Reason, reasons

PERCENTILES = {"p05": 0.05, "p50": 0.5, "p95": 0.95}
BETWEEN_SENTENCES = "; "
"""What stands between the sentences of the column ``missed``."""

GOT = ", got … (missed by …)"
"""End of a sentence of several flights that says nothing."""

HELD, BROKEN, NOT_ENTERED = "held", "broken", "not entered"


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """How a measure is spread over the flights that were completed and have it.

    Attributes
    ----------
    n : int
        How many those are.
    mean : float
    percentiles : mapping of str to Estimate
        ``p05``, ``p50`` and ``p95``.
    """

    n: int
    mean: float
    percentiles: Mapping[str, Estimate]


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """How many flights ended in one way.

    Attributes
    ----------
    status : str
    count : int
    reasons : tuple of Reason
        The most frequent first; empty where there are none.
    """

    status: str
    count: int
    reasons: tuple[Reason, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CertifiedCount:
    """Whether the certified ultimate set held.

    Attributes
    ----------
    held, broken, not_entered, lost : int
        Flights; lost ones were not completed.
    of_all : Estimate
        Share that held of all flights.
    of_entered : Estimate
        Share that held of those that entered the set.
    """

    held: int
    broken: int
    not_entered: int
    lost: int
    of_all: Estimate
    of_entered: Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupSummary:
    """The flights of one plant with one gain set.

    Attributes
    ----------
    group : Group
    n : int
        Flights.
    successes : int
    success : Estimate
        Their share.
    statuses : tuple of Status
        The most frequent first.
    missed : tuple of Reason
        What completed flights failed, the most frequent first; a flight may miss several.
    measures : mapping of str to Distribution
        Of every measure that a completed flight has.
    certified : CertifiedCount or None
        None where nothing was claimed.
    """

    group: Group
    n: int
    successes: int
    success: Estimate
    statuses: tuple[Status, ...]
    missed: tuple[Reason, ...]
    measures: Mapping[str, Distribution]
    certified: CertifiedCount | None


def summaries(
    flown: Flown, *, method: Method = "wilson", confidence: float = CONFIDENCE
) -> tuple[GroupSummary, ...]:
    """Sum up every group of a campaign.

    Parameters
    ----------
    flown : Flown
    method : "wilson" or "clopper-pearson"
        Interval of shares.
    confidence : float, 1
        Of all intervals.

    Returns
    -------
    tuple of GroupSummary
        In the order of the plan, without groups of which nothing has flown.

    Notes
    -----
    Where draws of a design belong together (the blocks of Saltelli's, the cells of a grid), counts
    are replaced by effective ones, see `flighttune.campaign.intervals.effective_size`. Points of a
    Latin hypercube or Sobol sequence are taken as if they were independent: their intervals are
    wider than they need be.
    """
    return tuple(_summary(group, rows, flown, method, confidence) for group, rows in flown.groups())


def _summary(
    group: Group, rows: pd.DataFrame, flown: Flown, method: Method, confidence: float
) -> GroupSummary:
    clusters = flown.clusters(rows)
    success = rows["success"].to_numpy(dtype=bool)
    completed = (rows["status"] == "completed").to_numpy()
    failed = rows.loc[completed & ~success]
    return GroupSummary(
        group=group,
        n=len(rows),
        successes=int(success.sum()),
        success=share(success, clusters, method=method, confidence=confidence),
        statuses=_statuses(rows),
        missed=_missed(failed),
        measures={
            name: _distribution(rows[name].to_numpy(dtype=float), completed, clusters, confidence)
            for name in flown.measures
            if rows.loc[completed, name].notna().any()
        },
        certified=_certified(rows, clusters, method, confidence),
    )


def _statuses(rows: pd.DataFrame) -> tuple[Status, ...]:
    found = [
        Status(
            status=str(name),
            count=len(own),
            reasons=reasons(own["reason"].tolist(), own["run"].tolist()),
        )
        for name, own in rows.groupby("status", sort=False, observed=True)
    ]
    return tuple(sorted(found, key=lambda one: -one.count))


def _missed(failed: pd.DataFrame) -> tuple[Reason, ...]:
    """Every sentence by itself: a flight that misses two bounds counts for both."""
    told = [
        (sentence, run)
        for text, run in zip(failed["missed"].tolist(), failed["run"].tolist(), strict=True)
        for sentence in text.split(BETWEEN_SENTENCES)
    ]
    found = reasons([sentence for sentence, _ in told], [run for _, run in told])
    return tuple(replace(one, text=one.text.removesuffix(GOT)) for one in found)


def _distribution(
    values: FloatArray, completed: np.ndarray, clusters: np.ndarray, confidence: float
) -> Distribution:
    kept = completed & ~np.isnan(values)
    values, clusters = values[kept], clusters[kept]
    return Distribution(
        n=len(values),
        mean=float(np.mean(values)),
        percentiles={
            name: percentile(values, q, clusters, confidence=confidence)
            for name, q in PERCENTILES.items()
        },
    )


def _certified(
    rows: pd.DataFrame, clusters: np.ndarray, method: Method, confidence: float
) -> CertifiedCount | None:
    said = rows["certified"].to_numpy(dtype=object)
    held, broken, outside = (said == word for word in (HELD, BROKEN, NOT_ENTERED))
    lost = (rows["status"] != "completed").to_numpy()
    entered = held | broken
    if not (entered | outside).any():
        return None
    all_of = entered | outside | lost
    of_all, of_entered = (
        share(held[kept], clusters[kept], method=method, confidence=confidence)
        for kept in (all_of, entered)
    )
    return CertifiedCount(
        held=int(held.sum()),
        broken=int(broken.sum()),
        not_entered=int(outside.sum()),
        lost=int(lost.sum()),
        of_all=of_all,
        of_entered=of_entered,
    )
