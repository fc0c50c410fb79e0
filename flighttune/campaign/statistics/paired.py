"""Gain sets compared on the same draws."""

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import bdtr

from flighttune.arrays import FloatArray
from flighttune.campaign.statistics.intervals import CONFIDENCE, quantile_interval, rate_interval


def paired(
    rows: pd.DataFrame, measure: str, *, confidence: float = CONFIDENCE
) -> list[dict[str, Any]]:
    """Compare every two gain sets on every plant, draw by draw, by a measure to be minimised."""
    return list(_pairs(rows.assign(**{measure: scores(rows, measure)}), measure, confidence))


def scores(rows: pd.DataFrame, measure: str) -> FloatArray:
    """The measure of every flight, infinite where it was not completed or has no value."""
    values = rows[measure].to_numpy(dtype=float)
    measured = (rows["status"] == "completed").to_numpy() & ~np.isnan(values)
    return np.where(measured, values, np.inf)


def ordered_quantile(values: FloatArray, q: float) -> FloatArray:
    """The order statistic at a quantile along the last axis: infinite values need no mean."""
    n = values.shape[-1]
    place = min(n - 1, max(0, math.ceil(q * n) - 1))
    return np.partition(values, place, axis=-1)[..., place]


def difference(a: FloatArray, b: FloatArray) -> FloatArray:
    """``a - b``, 0 where both are infinite: two lost flights are tied."""
    tied = a == b
    return np.where(tied, 0.0, np.where(tied, 0.0, a) - np.where(tied, 0.0, b))


def _pairs(rows: pd.DataFrame, measure: str, confidence: float) -> Iterator[dict[str, Any]]:
    for plant, on_plant in rows.groupby("plant", sort=False):
        flown = on_plant.pivot(index="draw", columns="gains", values=[measure, "success"])
        for a, b in combinations(on_plant["gains"].unique(), 2):
            both = flown.loc[:, pd.IndexSlice[:, [a, b]]].dropna()
            if both.empty:
                continue
            x, y = (both[measure, name].to_numpy(dtype=float) for name in (a, b))
            ok_a, ok_b = (both["success", name].to_numpy(dtype=bool) for name in (a, b))
            wins_a, wins_b = int(np.sum(x < y)), int(np.sum(y < x))
            lo, hi = rate_interval(wins_a, wins_a + wins_b, confidence)
            apart = difference(x, y)
            median_lo, median_hi = quantile_interval(apart, 0.5, confidence)
            only_a, only_b = int(np.sum(ok_a & ~ok_b)), int(np.sum(ok_b & ~ok_a))
            yield {
                "plant": str(plant),
                "a": a,
                "b": b,
                "measure": measure,
                "n": len(x),
                "wins_a": wins_a,
                "wins_b": wins_b,
                "win_rate": wins_a / (wins_a + wins_b) if wins_a + wins_b else 0.5,
                "lo": float(lo),
                "hi": float(hi),
                "median": float(ordered_quantile(apart, 0.5)),
                "median_lo": median_lo,
                "median_hi": median_hi,
                "only_a": only_a,
                "only_b": only_b,
                # exact McNemar test: both sides of the binomial distribution
                "p_success": min(1.0, 2.0 * float(bdtr(min(only_a, only_b), only_a + only_b, 0.5))),
            }
