"""Everything in the report of a campaign, as numbers."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.campaign.statistics.flights import Flights, is_number
from flighttune.campaign.statistics.intervals import CONFIDENCE, Method
from flighttune.campaign.statistics.paired import paired, scores
from flighttune.campaign.statistics.sensitivity import classes_of, influences
from flighttune.campaign.statistics.summary import convergence, requirements, summary
from flighttune.planning.plan import Group

SUCCESS = "success"

# Classes of the most important parameter for which a success rate is given.
SPLIT_INTO = 5

# Worst flights that are listed of a group.
WORST = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Findings:
    """Statistics of a campaign."""

    flights: Flights
    measure: str | None  # measure that orders and compares flights; None where no flight has it
    # as ``--json`` has them: shares between 0 and 1, units as in the columns
    values: dict[str, Any]
    # Success over the classes of the parameter that matters most, of groups in which both successes
    # and failures occur: group, parameter, label and centre of each class, and estimates
    splits: list[dict[str, Any]]
    convergence: list[dict[str, Any]]  # of each group, see `convergence`


def findings(
    flights: Flights, *, method: Method = "wilson", confidence: float = CONFIDENCE
) -> Findings:
    """Evaluate the flights of a campaign, finished or not, with all intervals by one method."""
    flights = replace(flights, method=method, confidence=confidence)
    measures, measure = flights.measures, flights.plan.campaign.keep.worst_by
    if measure not in measures:
        measure = next(iter(measures), None)
    groups, splits = [], []
    for group, rows in flights.groups():
        sensitivity = {
            name: {"ranks": _ranks(flights, rows, name)} for name in (SUCCESS, measure) if name
        }
        worst = _worst(flights, rows, measure) if measure else []
        groups.append({**summary(flights, group, rows), "worst": worst, "sensitivity": sensitivity})
        apart = [rank["parameter"] for rank in sensitivity[SUCCESS]["ranks"] if rank["apart"]]
        splits += [_split(flights, group, rows, key) for key in apart[:1]]
    return Findings(
        flights=flights,
        measure=measure,
        values={
            "dataset": flights.url,
            "title": flights.plan.campaign.title,
            "runs": len(flights.rows),
            "planned": flights.plan.runs,
            "design": flights.plan.campaign.design,
            "interval": method,
            "confidence": confidence,
            "worst_by": measure,
            "requirements": requirements(flights),
            "groups": groups,
            "paired": paired(flights.rows, measure, confidence=confidence) if measure else [],
        },
        splits=splits,
        convergence=convergence(flights, measure) if measure else [],
    )


def values_of(rows: pd.DataFrame, name: str) -> FloatArray:
    """Success as 0 and 1, or a measure: NaN where the flight was not completed."""
    if name == SUCCESS:
        return rows[SUCCESS].to_numpy(dtype=float)
    values = scores(rows, name)
    return np.where(np.isinf(values), np.nan, values)


def _worst(flights: Flights, rows: pd.DataFrame, measure: str) -> list[dict[str, Any]]:
    """The worst completed flights, with all that was drawn."""
    measured = (rows["status"] == "completed").to_numpy() & rows[measure].notna().to_numpy()
    worst = rows.loc[measured].sort_values([measure, "run"], ascending=[False, True]).head(WORST)
    return [
        {key: flight[key] for key in ("run", "draw", measure, SUCCESS)}
        | {"parameters": {key: flight[key] for key in flights.plan.keys}}
        for flight in worst.to_dict("records")
    ]


def _ranks(flights: Flights, rows: pd.DataFrame, name: str) -> list[dict[str, Any]]:
    """Influence of each parameter by ranks."""
    parameters = rows.loc[:, list(flights.plan.keys)]
    return influences(parameters, values_of(rows, name), confidence=flights.confidence)


def _split(flights: Flights, group: Group, rows: pd.DataFrame, parameter: str) -> dict[str, Any]:
    """Success rate over the classes of a parameter."""
    rows = rows.loc[rows[parameter].notna().to_numpy()]
    numeric = is_number(rows[parameter])
    classes = [members for _, members in rows.groupby(classes_of(rows[parameter], SPLIT_INTO))]
    values = [members[parameter].to_numpy() for members in classes]
    return {
        "group": group.label,
        "parameter": parameter,
        "labels": _ranges(values) if numeric else [str(of_class[0]) for of_class in values],
        # median of the parameter in each class; the position of a class that is no number
        "centres": [
            float(np.median(of_class.astype(float))) if numeric else float(place)
            for place, of_class in enumerate(values)
        ],
        "success": [
            flights.share(members[SUCCESS].to_numpy(dtype=bool), flights.clusters(members))
            for members in classes
        ],
    }


def _ranges(values: list[np.ndarray]) -> list[str]:
    """Ranges of neighbouring classes, each ending where the next begins."""
    if all(of_class.min() == of_class.max() for of_class in values):
        return [f"{of_class[0]:.4g}" for of_class in values]
    edges = [values[0].min(), *(0.5 * (a.max() + b.min()) for a, b in pairwise(values))]
    edges.append(values[-1].max())
    return [f"{low:.4g} to {high:.4g}" for low, high in pairwise(edges)]
