"""Time and space that a campaign will take, estimated from a few of its flights."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

import pyarrow as pa

from flighttune.campaign.dataset import Span, parquet_bytes
from flighttune.campaign.engine.pool import worker_pool
from flighttune.campaign.engine.progress import Tally
from flighttune.campaign.planning.plan import Group, Plan

ENOUGH_S = 0.25
"""Flights are timed until this many seconds of them are flown at a time."""

MORE = 4
"""Growth of the number of runs from one timing to the next."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignCost:
    """Time and space that a campaign will take."""

    timed: int  # runs flown to find out
    group_s: Mapping[Group, float]  # s, time of one run of a group on one core
    core_s: float  # s, time of all runs on one core
    rows_bytes: int  # space of all rows
    signals_bytes: int  # space of the signals kept, at the most

    def wall_s(self, workers: int) -> float:
        """Wall time of all runs with so many workers, s."""
        return self.core_s / workers


def campaign_cost(plan: Plan) -> CampaignCost:
    """Fly a few runs of a plan in one process and estimate what all of them will take.

    The runs of the last timing count: many kinematic flights together take less time each. Nothing
    is kept.
    """
    tables: list[pa.Table] = []
    sizes: list[int] = []
    with worker_pool(1) as pool:
        size = min(len(plan.groups), plan.runs)
        pool.fly_rows(plan, [Span(0, size)], tables.append)  # starts the process
        while True:
            began = time.perf_counter()
            tables.clear()
            pool.fly_rows(plan, [Span(0, size)], tables.append)
            spent = time.perf_counter() - began
            if size == plan.runs or spent > ENOUGH_S:
                break
            size = min(size * MORE, plan.runs)
        pool.fly_signals(plan, [0], lambda _, data: sizes.append(len(data)), tally=Tally())
    rows = pa.concat_tables(tables)
    keep = plan.campaign.keep
    kept = min(plan.runs, keep.failures + keep.worst + keep.sample)
    by_group = rows.group_by(["plant", "gains"]).aggregate([("wall_s", "mean")]).to_pylist()
    return CampaignCost(
        timed=size,
        group_s={Group(row["plant"], row["gains"]): row["wall_s_mean"] for row in by_group},
        core_s=spent / size * plan.runs,
        rows_bytes=round(len(parquet_bytes(rows)) / size * plan.runs),
        signals_bytes=sum(sizes) * kept,
    )
