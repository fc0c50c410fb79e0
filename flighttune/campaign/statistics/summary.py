"""Results of each group: shares, percentiles, reasons of failure, and their convergence."""

from typing import Any

import numpy as np
import pandas as pd

from flighttune.campaign.statistics.flights import Flights
from flighttune.campaign.statistics.paired import ordered_quantile
from flighttune.flight.expectations import bound_checks
from flighttune.planning.plan import Group
from flighttune.present.answer import pick
from flighttune.present.reasons import endings, reasons
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
