"""What a campaign will cost, from a few flights of it."""

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from flighttune.campaign.dataset.dataset import parquet_bytes
from flighttune.campaign.engine.flyer_process import Fallen, Flown, FlyerProcess
from flighttune.campaign.planning.plan import Group, Plan

ENOUGH_S = 1.0
"""Flights are timed until a chunk of them takes this long."""

MORE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """Time and room that a campaign will take.

    Attributes
    ----------
    timed : int
        Runs flown to find out.
    group_s : mapping of Group to float, s
        Time of one run of a group on one core.
    core_s : float, s
        Time of all runs on one core.
    rows_bytes : int
        Room of all rows.
    signals_bytes : int
        Room of the signals kept, at the most.
    fallen : str
        Why the first runs could not be timed; empty where they could.
    """

    timed: int
    group_s: Mapping[Group, float]
    core_s: float
    rows_bytes: int
    signals_bytes: int
    fallen: str = ""

    def wall_s(self, workers: int) -> float:
        """Wall time of all runs with so many workers, s."""
        return self.core_s / workers


def estimate(plan: Plan) -> Estimate:
    """Fly a few runs of a plan, and say what all of them will take.

    Parameters
    ----------
    plan : Plan
        Nothing of it is kept.

    Returns
    -------
    Estimate
        By the largest chunk that was flown: many flights of the law together take less time each.
    """
    flyer, text = FlyerProcess(), json.dumps(plan.as_dict())
    limit = plan.campaign.time_limit_s
    try:
        size, began = len(plan.groups), time.perf_counter()
        while True:
            size = min(size, plan.runs)
            found = flyer.rows(text, 0, size, limit)
            if isinstance(found, Fallen):
                return _unknown(found)
            spent = time.perf_counter() - began
            if size == plan.runs or found.seconds * MORE > ENOUGH_S or spent > 2.0 * ENOUGH_S:
                break
            size *= MORE
        signals = flyer.signals(text, 0, limit)
    finally:
        flyer.close()
    rows = pa.ipc.open_stream(found.data).read_all()
    a_run = len(parquet_bytes(rows)) / size
    kept = plan.campaign.keep
    wanted = min(plan.runs, kept.failures + kept.worst + kept.sample)
    return Estimate(
        timed=size,
        group_s=_by_group(plan, rows),
        core_s=found.seconds / size * plan.runs,
        rows_bytes=round(a_run * plan.runs),
        signals_bytes=len(signals.data) * wanted if isinstance(signals, Flown) else 0,
    )


def _by_group(plan: Plan, rows: pa.Table) -> dict[Group, float]:
    taken: dict[Group, list[float]] = {group: [] for group in plan.groups}
    columns: list[list[Any]] = [rows.column(n).to_pylist() for n in ("plant", "gains", "wall_s")]
    for plant, gains, wall in zip(*columns, strict=True):
        taken[Group(plant, gains)].append(wall)
    return {group: sum(walls) / len(walls) for group, walls in taken.items() if walls}


def _unknown(found: Fallen) -> Estimate:
    return Estimate(
        timed=0, group_s={}, core_s=float("nan"), rows_bytes=0, signals_bytes=0,
        fallen=f"run {found.run}: {found.reason}",
    )  # fmt: skip
