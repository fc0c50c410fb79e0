"""Forecast of a campaign: its flights, and the time and disk space that they take."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flighttune.campaign.dataset import parquet_bytes
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.flying.columns import table_of
from flighttune.planning.plan import Plan, draws_in_words
from flighttune.present.answer import Answer, Answering, pick
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table
from flighttune.simulate.batch import cores

# A timing that takes at least this long is accurate enough, s
ENOUGH_S = 0.25

# Factor by which the number of runs grows from one timing to the next
MORE = 4

COST_COLUMNS = [
    *columns("core_s workers wall_s"),
    Column("rows_bytes", "rows", "MB", factor=1e-6),
    Column("signals_bytes", "signals, at most", "MB", factor=1e-6),
]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Forecast(Answering):
    """A plan and what it costs; without a cost where an estimate would run code of its files."""

    plan: Plan
    cost: Mapping[str, Any]  # as `campaign_cost` returns it, or empty

    def answer(self) -> Answer:
        """Flights, dispersions and signals kept; times and sizes where they are estimated."""
        plan, cost = self.plan, self.cost
        campaign, keep = plan.campaign, plan.campaign.keep
        disperse = [table.model_dump(mode="json", exclude_none=True) for table in campaign.disperse]
        counted = draws_in_words(plan.runs, len(plan.groups))
        keys = " ".join(dict.fromkeys(key for table in disperse for key in table))
        values = {
            "title": campaign.title,
            **pick(plan, "runs draws"),
            **pick(campaign, "design seed time_limit_s"),
            "disperse": disperse,
            "keep": keep.model_dump(mode="json"),
            **cost,
        }
        tables = [
            Table(columns("runs draws design seed time_limit_s"), [values], campaign.title),
            Table(columns(keys), disperse, "dispersed"),
        ]
        if cost:
            title = f"cost, from {cost['timed_runs']} runs flown now"
            tables.insert(1, Table(columns("plant gains run_s"), cost["groups"], "groups"))
            tables.append(Table(COST_COLUMNS, [values], title))
        unknown = "time and space are not estimated: that runs the code of"
        return Answer(
            values=values,
            tables=tables,
            notes=[
                f"{plan.runs} flights = {counted}",
                f"signals kept: the first {keep.failures} failures, the worst {keep.worst} by "
                f"{keep.worst_by}, a sample of {keep.sample}",
                *(f"{unknown} {file}" for file in plan.code),
            ],
        )


def forecast(plan: Plan, workers: int | None = None) -> Forecast:
    """The cost of a plan on `workers` processes, by default one per core: it flies a few runs."""
    # Whoever asks what a campaign costs shall not run code of somebody else.
    cost = {} if plan.code else campaign_cost(plan, workers or cores())
    return Forecast(plan=plan, cost=cost)


def campaign_cost(plan: Plan, workers: int) -> dict[str, Any]:
    """Fly a few runs of a plan in one process and estimate what all of them will take."""
    size = min(len(plan.groups), plan.runs)
    with WorkerPool(1) as pool:
        list(pool.rows(plan, range(size)))  # untimed: starts the process
        while True:
            began = time.perf_counter()
            rows = list(pool.rows(plan, range(size)))
            spent = time.perf_counter() - began
            if size == plan.runs or spent > ENOUGH_S:
                break
            size = min(size * MORE, plan.runs)
        sizes = [len(signals) for _, signals in pool.signals(plan, [0])]
    # The last timing has the most runs: kinematic flights take less time each in a larger batch.
    table, keep = table_of(plan, rows), plan.campaign.keep
    run_s = table.to_pandas().groupby(["plant", "gains"], sort=False)["wall_s"].mean()
    core_s = spent / size * plan.runs
    return {
        "groups": run_s.rename("run_s").reset_index().to_dict("records"),
        "timed_runs": size,
        "core_s": core_s,  # of all runs on one core
        "workers": workers,
        "wall_s": core_s / workers,
        "rows_bytes": round(len(parquet_bytes(table)) / size * plan.runs),
        "signals_bytes": sum(sizes) * min(plan.runs, keep.failures + keep.worst + keep.sample),
    }
