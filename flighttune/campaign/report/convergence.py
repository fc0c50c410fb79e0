"""How estimates settle as flights are added."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.campaign.intervals import CONFIDENCE
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.report.estimates import Estimate, Method, percentile, share
from flighttune.campaign.report.flown import Flown
from flighttune.campaign.report.summary import PERCENTILES

FIRST = 10
POINTS = 25


@dataclass(frozen=True, slots=True, kw_only=True)
class Settling:
    """Estimates from the first flights of a group.

    Attributes
    ----------
    group : Group
    n : tuple of int
        Numbers of flights, evenly spaced by their logarithm, all of them last.
    success : tuple of Estimate
        Success rate of each.
    measure : str
        A measure, less of which is better.
    p50, p95 : tuple of Estimate
        Its median and 95th percentile over the completed flights of each.
    """

    group: Group
    n: tuple[int, ...]
    success: tuple[Estimate, ...]
    measure: str
    p50: tuple[Estimate, ...]
    p95: tuple[Estimate, ...]


def settling(
    flown: Flown, measure: str, *, method: Method = "wilson", confidence: float = CONFIDENCE
) -> tuple[Settling, ...]:
    """Success rate and percentiles of every group from its first flights on.

    Parameters
    ----------
    flown : Flown
    measure : str
        A column of the rows.
    method : "wilson" or "clopper-pearson"
        Interval of the success rate.
    confidence : float, 1

    Returns
    -------
    tuple of Settling
        In the order of the plan; nothing of groups that have not flown.
    """
    found = []
    for group, rows in flown.groups():
        clusters, success = flown.clusters(rows), rows["success"].to_numpy(dtype=bool)
        values = rows[measure].to_numpy(dtype=float)
        known = (rows["status"] == "completed").to_numpy() & ~np.isnan(values)
        counts = prefixes(len(rows))
        p50, p95 = (
            tuple(
                percentile(
                    values[:n][known[:n]], PERCENTILES[q], clusters[:n][known[:n]],
                    confidence=confidence,
                )
                for n in counts
            )
            for q in ("p50", "p95")
        )  # fmt: skip
        rates = tuple(
            share(success[:n], clusters[:n], method=method, confidence=confidence) for n in counts
        )
        found.append(
            Settling(group=group, n=tuple(counts), success=rates, measure=measure, p50=p50, p95=p95)
        )
    return tuple(found)


def prefixes(n: int) -> list[int]:
    """Up to 25 numbers to `n`, evenly spaced by their logarithm, from 10 on or a quarter of `n`."""
    first = max(1, min(FIRST, n // 4))
    spaced: npt.NDArray[np.float64] = np.geomspace(first, n, POINTS)
    return sorted({round(value) for value in spaced.tolist()})
