"""Everything in the report of a campaign, as numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.campaign.flying.claim import claims
from flighttune.campaign.planning.draws import SEED
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.flights import Flights, is_number
from flighttune.campaign.statistics.intervals import CONFIDENCE, Estimate, Method
from flighttune.campaign.statistics.paired import Paired, paired, scores
from flighttune.campaign.statistics.sensitivity import (
    Influence,
    SobolIndices,
    classes_of,
    influences,
    sobol_indices,
)
from flighttune.campaign.statistics.summary import (
    ConvergenceCurve,
    GroupSummary,
    convergence,
    summaries,
)
from flighttune.errors import FlightTuneError
from flighttune.guarantee.ultimate_set import UltimateSet

SUCCESS = "success"
SPLIT_INTO = 5
"""Classes of the most important parameter for which a success rate is given."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Split:
    """Success rate over the classes of one parameter."""

    group: Group
    parameter: str
    labels: tuple[str, ...]  # value or range of each class
    # median of the parameter in each class; the position of a class that is no number
    centres: tuple[float, ...]
    success: tuple[Estimate, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Findings:
    """Statistics of a campaign."""

    flights: Flights
    measure: str | None  # measure that orders and compares flights; None where no flight has it
    groups: tuple[GroupSummary, ...]
    paired: tuple[Paired, ...]
    # of success and the measure, by group; empty where nothing can be said
    influences: Mapping[tuple[Group, str], tuple[Influence, ...]]
    # by the same keys, where the design of the campaign allows
    sobol: Mapping[tuple[Group, str], SobolIndices]
    # of groups that both succeeded and failed, by the parameter that matters most
    splits: tuple[Split, ...]
    convergence: tuple[ConvergenceCurve, ...]
    # Certified set of each group; empty where no flight was compared with one, or the undispersed
    # flights that it is measured on cannot be flown here.
    claims: Mapping[Group, UltimateSet]


def findings(
    flights: Flights, *, method: Method = "wilson", confidence: float = CONFIDENCE
) -> Findings:
    """Evaluate the flights of a campaign, finished or not, with all intervals by one method."""
    flights = replace(flights, method=method, confidence=confidence)
    measure = _measure(flights)
    looked_at = [SUCCESS] + ([measure] if measure else [])
    by_parameter, sobol, splits = {}, {}, []
    for group, rows in flights.groups():
        independent = flights.independent(rows)
        for name in looked_at:
            by_parameter[group, name] = influences(
                independent.loc[:, flights.keys],
                values_of(independent, name),
                confidence=confidence,
            )
            indices = _sobol(flights, rows, name)
            if indices is not None:
                sobol[group, name] = indices
        split = _split(flights, group, rows, by_parameter[group, SUCCESS])
        splits += [split] if split is not None else []
    groups = summaries(flights)
    pairs, curves = (), ()
    if measure is not None:
        pairs = paired(flights.rows, measure, confidence=confidence)
        curves = convergence(flights, measure)
    return Findings(
        flights=flights,
        measure=measure,
        groups=groups,
        paired=pairs,
        influences=by_parameter,
        sobol=sobol,
        splits=tuple(splits),
        convergence=curves,
        claims=_claims(flights) if any(summary.certified for summary in groups) else {},
    )


def _claims(flights: Flights) -> dict[Group, UltimateSet]:
    try:
        stated = claims(flights.plan)
    except FlightTuneError:
        return {}
    return {group: claim for group, claim in stated.items() if claim is not None}


def values_of(rows: pd.DataFrame, name: str) -> FloatArray:
    """Success as 0 and 1, or a measure: NaN where the flight was not completed."""
    if name == SUCCESS:
        return rows[SUCCESS].to_numpy(dtype=float)
    values = scores(rows, name)
    return np.where(np.isinf(values), np.nan, values)


def _measure(flights: Flights) -> str | None:
    """Measure by which the campaign keeps its worst flights, or else the first measure."""
    measures = flights.measures
    return flights.worst_by if flights.worst_by in measures else next(iter(measures), None)


def _sobol(flights: Flights, rows: pd.DataFrame, name: str) -> SobolIndices | None:
    """Indices over the whole cycles of a Saltelli design that have flown."""
    factors, cycle = flights.plan.factors, flights.plan.cycle
    if not factors:
        return None
    draws = rows["draw"].to_numpy()
    values = np.full((int(draws.max()) // cycle + 1, cycle), np.nan)
    values[draws // cycle, draws % cycle] = values_of(rows, name)
    return sobol_indices(
        values[:, 0],
        values[:, 1],
        values[:, 2:].T,
        confidence=flights.confidence,
        seed=flights.plan.campaign.seed,
    )


def _split(
    flights: Flights, group: Group, rows: pd.DataFrame, influences_on_success: tuple[Influence, ...]
) -> Split | None:
    """Success over the parameter that matters most, if any does."""
    apart = [
        influence.parameter
        for influence in influences_on_success
        if influence.apart and influence.parameter != SEED
    ]
    if not apart:
        return None
    rows = rows.loc[rows[apart[0]].notna().to_numpy()]
    column = pd.Series(rows[apart[0]])
    codes, clusters = classes_of(column, SPLIT_INTO), flights.clusters(rows)
    success = rows[SUCCESS].to_numpy(dtype=bool)
    classes = range(int(codes.max()) + 1)
    values = [column.to_numpy()[codes == label] for label in classes]
    numeric = is_number(column)
    return Split(
        group=group,
        parameter=apart[0],
        labels=_ranges(values) if numeric else tuple(str(of_class[0]) for of_class in values),
        centres=tuple(
            float(np.median(of_class.astype(float))) if numeric else float(place)
            for place, of_class in enumerate(values)
        ),
        success=tuple(flights.share(success[codes == i], clusters[codes == i]) for i in classes),
    )


def _ranges(values: list[np.ndarray]) -> tuple[str, ...]:
    """Ranges of neighbouring classes, each ending where the next begins."""
    if all(of_class.min() == of_class.max() for of_class in values):
        return tuple(f"{of_class[0]:.4g}" for of_class in values)
    edges = [values[0].min(), *(0.5 * (a.max() + b.min()) for a, b in pairwise(values))]
    edges.append(values[-1].max())
    return tuple(f"{low:.4g} to {high:.4g}" for low, high in pairwise(edges))
