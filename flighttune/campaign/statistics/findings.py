"""Everything in the report of a campaign, as numbers: results of each group and what matters."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.campaign.statistics.flights import Flights, is_number
from flighttune.campaign.statistics.intervals import (
    CONFIDENCE,
    Method,
    ordered_quantile,
    paired,
    scores,
)
from flighttune.campaign.statistics.sensitivity import classes_of, influences
from flighttune.errors import InputError
from flighttune.flight.expectations import bound_checks
from flighttune.planning.plan import Group
from flighttune.present.answer import pick
from flighttune.present.names import endings, reasons
from flighttune.scenario.tables import in_rad
from flighttune.units import DEG

PERCENTILES = {"p05": 0.05, "p50": 0.5, "p95": 0.95}

# Separator of the sentences of the column ``missed``.
BETWEEN_SENTENCES = "; "

# Smallest number of flights on a convergence curve, and the maximum number of its points.
FIRST_PREFIX, POINTS = 10, 25


def summary(flights: Flights, group: Group, rows: pd.DataFrame) -> dict[str, Any]:
    """Counts, rates and metrics of the flights of a group, as ``--json`` has them."""
    success = rows["success"].to_numpy(dtype=bool)
    completed = rows.loc[(rows["status"] == "completed").to_numpy()]
    # Points of a Latin hypercube or Sobol sequence are taken as if they were independent: their
    # intervals are wider than they need be.
    rate = flights.share(success, flights.clusters(rows))
    statuses = rows["status"].value_counts().to_dict()
    return {
        "group": group.label,
        **pick(group, "gains plant"),
        "n": len(rows),
        "success": rate.value,
        **pick(rate, "lo hi"),
        "successes": int(success.sum()),
        "statuses": statuses,
        "reasons": endings(rows.loc[rows["reason"] != ""].to_dict("records")),
        "missed": _missed(completed),
        "metrics": {
            name: _spread(flights, completed, name)
            for name in flights.measures
            if completed[name].notna().any()
        },
    }


def requirements(flights: Flights) -> list[dict[str, Any]]:
    """Bounds of success in the units of the columns, the one most missed or nearest first."""
    completed, stated = flights.rows.loc[(flights.rows["status"] == "completed").to_numpy()], []
    groups = list(zip(completed["plant"], completed["gains"], strict=True))
    for table in flights.plan.scenario.expect:
        rows = completed.loc[[table.meant(*group) for group in groups]]
        for check in bound_checks([table], {}):
            measure = f"{check.subject}.{in_rad(check.measure)}"
            bound = check.bound * (DEG if check.measure.endswith("_deg") else 1.0)
            values = rows[measure].to_numpy(dtype=float)
            beyond = values - bound if check.sense == "at_most" else bound - values
            beyond = np.where(np.isnan(values), np.inf, beyond) / (abs(bound) or 1.0)
            stated.append(
                {
                    **pick(table, "plant gains"),
                    "measure": measure,
                    "sense": check.sense,
                    "bound": bound,
                    "n": len(rows),
                    "missed": int((beyond > 0.0).sum()),
                    "near": ordered_quantile(beyond, 0.95).item() if len(rows) else -np.inf,
                }
            )
    ordered = sorted(stated, key=lambda bound: (-bound["missed"], -bound["near"]))
    return [
        {**bound, "near": bound["near"] if np.isfinite(bound["near"]) else None}
        for bound in ordered
    ]


def _missed(completed: pd.DataFrame) -> list[dict[str, Any]]:
    """Missed requirements, each counted by itself: a flight that misses two counts for both."""
    failed = completed.loc[~completed["success"].to_numpy(dtype=bool), ["run", "missed"]]
    failed = failed.assign(missed=failed["missed"].str.split(BETWEEN_SENTENCES)).explode("missed")
    return reasons(failed["missed"].tolist(), failed["run"].tolist())


def _spread(flights: Flights, completed: pd.DataFrame, measure: str) -> dict[str, Any]:
    """Mean and percentiles of a measure over the completed flights that have it."""
    measured = completed.loc[completed[measure].notna().to_numpy()]
    values, clusters = measured[measure].to_numpy(dtype=float), flights.clusters(measured)
    spread: dict[str, Any] = {"mean": float(np.mean(values)), "n": len(values)}
    for name, q in PERCENTILES.items():
        estimate = flights.percentile(values, q, clusters)
        spread |= {name: estimate.value, f"{name}_interval": [estimate.lo, estimate.hi]}
    return spread


def convergence(flights: Flights, measure: str) -> list[dict[str, Any]]:
    """Estimates from the first n flights of each group: `success`, and `p95` of the measure."""
    curves = []
    for group, rows in flights.groups():
        clusters, success = flights.clusters(rows), rows["success"].to_numpy(dtype=bool)
        values = rows[measure].to_numpy(dtype=float)
        measured = (rows["status"] == "completed").to_numpy() & ~np.isnan(values)
        counts, q = prefixes(len(rows)), PERCENTILES["p95"]
        first = [np.flatnonzero(measured[:n]) for n in counts]
        curves.append(
            {
                "group": group.label,
                "n": counts,
                "success": [flights.share(success[:n], clusters[:n]) for n in counts],
                "p95": [flights.percentile(values[kept], q, clusters[kept]) for kept in first],
            }
        )
    return curves


def prefixes(n: int) -> list[int]:
    """Up to 25 numbers from 10, or `n` / 4 if less, to `n`, evenly spaced in their logarithm."""
    spaced = np.geomspace(max(1, min(FIRST_PREFIX, n // 4)), n, POINTS)
    return np.unique(spaced.round().astype(int)).tolist()


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
    if method == "any-time":
        plan, rows = flights.plan, flights.rows
        if plan.campaign.design != "random" or plan.cycle > 1:
            raise InputError(
                "`interval` any-time must be with independent draws, which are those of `design` "
                f"random without a grid, got {plan.campaign.design}."
            )
        # A stop leaves rows behind runs that had not ended, and how a run ends decides when.
        flights = replace(flights, rows=rows[rows["run"].to_numpy() == np.arange(len(rows))])
        if flights.rows.empty:
            raise InputError(f"{flights.url}: `interval` any-time must be with run 0, got none.")
    measures, measure = flights.measures, flights.plan.campaign.keep.worst_by
    if measure not in measures:
        measure = next(iter(measures), None)
    groups, splits, keys = [], [], [*flights.plan.keys]
    for group, rows in flights.groups():
        sensitivity = {
            name: {"ranks": influences(rows[keys], values_of(rows, name), confidence=confidence)}
            for name in (SUCCESS, measure)
            if name
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
