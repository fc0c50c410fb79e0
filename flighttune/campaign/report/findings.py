"""Everything the report of a campaign says, as numbers."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.campaign.flying.claim import Claim, claims
from flighttune.campaign.intervals import CONFIDENCE
from flighttune.campaign.planning.draws import SEED
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.report.convergence import Settling, settling
from flighttune.campaign.report.estimates import Estimate, Method, share
from flighttune.campaign.report.flown import Flown
from flighttune.campaign.report.paired import Paired, paired, scores
from flighttune.campaign.report.sensitivity import Influence, classes_of, influences, is_number
from flighttune.campaign.report.sobol import SobolIndices, sobol_indices
from flighttune.campaign.report.summary import GroupSummary, summaries
from flighttune.errors import FlightTuneError

SUCCESS = "success"
SPLIT_INTO = 5
"""Classes of the most important parameter over which the success rate is looked at."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Split:
    """Success rate over the values of one parameter.

    Attributes
    ----------
    group : Group
    parameter : str
    labels : tuple of str
        Value or range of each class.
    centres : tuple of float
        Median of the parameter in each; counted where it is no number.
    success : tuple of Estimate
    """

    group: Group
    parameter: str
    labels: tuple[str, ...]
    centres: tuple[float, ...]
    success: tuple[Estimate, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Findings:
    """What a campaign tells.

    Attributes
    ----------
    flown : Flown
    method : str
        Interval of shares.
    confidence : float, 1
        Of all intervals.
    measure : str or None
        What flights are ordered and compared by; None where no flight has it.
    groups : tuple of GroupSummary
    paired : tuple of Paired
    influences : mapping of (Group, str) to tuple of Influence
        By group, and ``success`` or `measure`; empty ones where nothing can be said.
    sobol : mapping of (Group, str) to SobolIndices
        By the same, where the design of the campaign allows.
    splits : tuple of Split
        Of every group that both succeeded and failed, by the parameter that matters most to it.
    settling : tuple of Settling
    claims : mapping of Group to Claim
        What the certified set of each group is; empty where no flight was held against one, or the
        undispersed flights that it is measured on cannot be flown here.
    """

    flown: Flown
    method: Method
    confidence: float
    measure: str | None
    groups: tuple[GroupSummary, ...]
    paired: tuple[Paired, ...]
    influences: Mapping[tuple[Group, str], tuple[Influence, ...]]
    sobol: Mapping[tuple[Group, str], SobolIndices]
    splits: tuple[Split, ...]
    settling: tuple[Settling, ...]
    claims: Mapping[Group, Claim]


def findings(
    flown: Flown, *, method: Method = "wilson", confidence: float = CONFIDENCE
) -> Findings:
    """Look at everything that has flown of a campaign.

    Parameters
    ----------
    flown : Flown
    method : "wilson" or "clopper-pearson"
        Interval of shares.
    confidence : float, 1
        Of all intervals.
    """
    measure = _measure(flown)
    looked_at = [SUCCESS] + ([measure] if measure else [])
    found, sobol, splits = {}, {}, []
    for group, rows in flown.groups():
        independent = flown.independent(rows)
        for name in looked_at:
            found[group, name] = influences(
                independent.loc[:, flown.keys], values_of(independent, name), confidence=confidence
            )
            indices = _sobol(flown, rows, name, confidence)
            if indices is not None:
                sobol[group, name] = indices
        split = _split(flown, group, rows, found[group, SUCCESS], method, confidence)
        splits += [split] if split is not None else []
    groups = summaries(flown, method=method, confidence=confidence)
    return Findings(
        flown=flown, method=method, confidence=confidence, measure=measure, groups=groups,
        paired=paired(flown.rows, measure, confidence=confidence) if measure else (),
        influences=found, sobol=sobol, splits=tuple(splits),
        settling=settling(flown, measure, method=method, confidence=confidence) if measure else (),
        claims=_claims(flown) if any(one.certified for one in groups) else {},
    )  # fmt: skip


def _claims(flown: Flown) -> dict[Group, Claim]:
    try:
        found = claims(flown.plan)
    except FlightTuneError:
        return {}
    return {group: claim for group, claim in found.items() if claim is not None}


def values_of(rows: pd.DataFrame, name: str) -> FloatArray:
    """Success as 0 and 1, or a measure: NaN where the flight was not completed."""
    if name == SUCCESS:
        return rows[SUCCESS].to_numpy(dtype=float)
    values = scores(rows, name)
    return np.where(np.isinf(values), np.nan, values)


def _measure(flown: Flown) -> str | None:
    """What the campaign keeps the worst flights by, or the first measure there is."""
    known = flown.measures
    return flown.worst_by if flown.worst_by in known else next(iter(known), None)


def _sobol(flown: Flown, rows: pd.DataFrame, name: str, confidence: float) -> SobolIndices | None:
    """Indices over the whole cycles of a Saltelli design that have flown."""
    factors, cycle = flown.plan.factors, flown.plan.cycle
    if not factors:
        return None
    draws = rows["draw"].to_numpy()
    values = np.full((int(draws.max()) // cycle + 1, cycle), np.nan)
    values[draws // cycle, draws % cycle] = values_of(rows, name)
    return sobol_indices(
        values[:, 0], values[:, 1], values[:, 2:].T,
        confidence=confidence, seed=flown.plan.campaign.seed,
    )  # fmt: skip


def _split(
    flown: Flown,
    group: Group,
    rows: pd.DataFrame,
    found: tuple[Influence, ...],
    method: Method,
    confidence: float,
) -> Split | None:
    """Success over the parameter that matters most, if any does."""
    apart = [one.parameter for one in found if one.apart and one.parameter != SEED]
    if not apart:
        return None
    rows = rows.loc[rows[apart[0]].notna().to_numpy()]
    column = pd.Series(rows[apart[0]])
    codes, clusters = classes_of(column, SPLIT_INTO), flown.clusters(rows)
    success = rows[SUCCESS].to_numpy(dtype=bool)
    classes = range(int(codes.max()) + 1)
    values = [column.to_numpy()[codes == one] for one in classes]
    numeric = is_number(column)
    return Split(
        group=group,
        parameter=apart[0],
        labels=_ranges(values) if numeric else tuple(str(one[0]) for one in values),
        centres=tuple(
            float(np.median(one.astype(float))) if numeric else float(place)
            for place, one in enumerate(values)
        ),
        success=tuple(
            share(success[codes == one], clusters[codes == one], method=method,
                  confidence=confidence)
            for one in classes
        ),
    )  # fmt: skip


def _ranges(values: list[np.ndarray]) -> tuple[str, ...]:
    """Ranges of neighbouring classes, each ending where the next begins."""
    if all(one.min() == one.max() for one in values):
        return tuple(f"{one[0]:.4g}" for one in values)
    edges = [values[0].min(), *(0.5 * (a.max() + b.min()) for a, b in pairwise(values))]
    edges.append(values[-1].max())
    return tuple(f"{low:.4g} to {high:.4g}" for low, high in pairwise(edges))
