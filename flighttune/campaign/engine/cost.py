"""Time and space that a campaign will take, estimated from a few of its flights."""

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass

import pyarrow as pa

from flighttune.campaign.dataset import parquet_bytes
from flighttune.campaign.engine.flyer import CrashedRun, Flyer, FlyerAnswer
from flighttune.campaign.planning.plan import Group, Plan
from flighttune.errors import CampaignError

ENOUGH_S = 1.0
"""Flights are timed until a chunk of them takes this long."""

MORE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignCost:
    """Time and space that a campaign will take.

    Attributes
    ----------
    timed : int
        Runs flown to find out.
    group_s : mapping of Group to float, s
        Time of one run of a group on one core.
    core_s : float, s
        Time of all runs on one core.
    rows_bytes : int
        Space of all rows.
    signals_bytes : int
        Space of the signals kept, at the most.
    """

    timed: int
    group_s: Mapping[Group, float]
    core_s: float
    rows_bytes: int
    signals_bytes: int

    def wall_s(self, workers: int) -> float:
        """Wall time of all runs with so many workers, s."""
        return self.core_s / workers


def campaign_cost(plan: Plan) -> CampaignCost:
    """Fly a few runs of a plan and estimate what all of them will take.

    Parameters
    ----------
    plan : Plan
        Nothing of it is kept.

    Returns
    -------
    CampaignCost
        By the largest chunk that was flown: many kinematic flights together take less time each.

    Raises
    ------
    CampaignError
        If one of these runs crashes: they cannot be timed.
    """
    flyer, text = Flyer(), json.dumps(plan.as_dict())
    limit = plan.campaign.time_limit_s
    try:
        size, began = len(plan.groups), time.perf_counter()
        while True:
            size = min(size, plan.runs)
            found = flyer.rows(text, 0, size, limit)
            if isinstance(found, CrashedRun):
                raise CampaignError(
                    f"the first flights cannot be timed: run {found.run}: {found.reason}"
                )
            spent = time.perf_counter() - began
            if size == plan.runs or found.seconds * MORE > ENOUGH_S or spent > 2.0 * ENOUGH_S:
                break
            size *= MORE
        signals = flyer.signals(text, 0, limit)
    finally:
        flyer.close()
    rows = pa.ipc.open_stream(found.data).read_all()
    keep = plan.campaign.keep
    kept = min(plan.runs, keep.failures + keep.worst + keep.sample)
    by_group = rows.group_by(["plant", "gains"]).aggregate([("wall_s", "mean")]).to_pylist()
    return CampaignCost(
        timed=size,
        group_s={Group(one["plant"], one["gains"]): one["wall_s_mean"] for one in by_group},
        core_s=found.seconds / size * plan.runs,
        rows_bytes=round(len(parquet_bytes(rows)) / size * plan.runs),
        signals_bytes=len(signals.data) * kept if isinstance(signals, FlyerAnswer) else 0,
    )
