"""Workers that fly plans into memory, for who looks at rows and keeps none."""

import json
import time
from collections.abc import Callable
from typing import Any

import pyarrow as pa

from flighttune.campaign.dataset.spans import Chunks, Span
from flighttune.campaign.engine.chunk_rows import chunk_rows
from flighttune.campaign.engine.cluster import Workers
from flighttune.campaign.engine.dispatch import Task, dispatch
from flighttune.campaign.engine.engine import Onlooker
from flighttune.campaign.engine.progress import CampaignProgress
from flighttune.campaign.engine.worker import FlownChunk, fly_chunk, stand_down
from flighttune.campaign.planning.plan import Plan
from flighttune.one_flight import library_versions


class Crew:
    """Workers of a cluster for one plan after another.

    Parameters
    ----------
    hire : callable
        Returns the workers, as `flighttune.campaign.cluster.cluster` gives it.
    onlooker : Onlooker, optional
        Told how far it is; may stop it.

    Attributes
    ----------
    flights : int
        Flown so far.
    """

    def __init__(self, hire: Callable[[], Workers], onlooker: Onlooker | None = None) -> None:
        self._hire, self._onlooker = hire, onlooker
        self.flights = 0

    def fly(self, plan: Plan, first: int, end: int, *, doing: str = "flying") -> pa.Table | None:
        """Rows of the runs `first` to `end` of a plan, in order; None where it was stopped.

        Parameters
        ----------
        plan : Plan
        first, end : int
            Runs wanted, `end` not among them.
        doing : str
            What the onlooker is told.

        Raises
        ------
        CampaignError
            If the cluster is gone, or cannot fly for this process.
        """
        chunks = Chunks([Span(first, end)], draw=len(plan.groups))
        fixed = (json.dumps(plan.as_dict()), library_versions())
        limit, began = plan.campaign.time_limit_s, time.perf_counter()
        tables: dict[int, pa.Table] = {}

        def take(threads: int) -> Task | None:
            span = chunks.take(threads)
            return span and Task(span, fly_chunk, (*fixed, *span, limit))

        def over(span: Span, found: dict[str, Any]) -> None:
            chunk = FlownChunk(**found)
            tables[span.first] = chunk_rows(plan, span, chunk)
            if not chunk.fallen:
                chunks.learn(span, chunk.seconds)

        def look(waiting: int, threads: int) -> None:
            done = sum(table.num_rows for table in tables.values())
            rate = done / (time.perf_counter() - began)
            if self._onlooker is not None:
                self._onlooker.see(
                    CampaignProgress(
                        doing=doing, done=done, runs=end - first, waiting=waiting,
                        workers=threads, rate_per_s=rate,
                        left_s=(end - first - done) / rate if rate else None,
                    )
                )  # fmt: skip

        workers = self._hire()
        if not dispatch(workers, take, over, look=look, stopped=self._stopped):
            workers.stop(stand_down)
            return None
        self.flights += end - first
        return pa.concat_tables([tables[at] for at in sorted(tables)])

    def _stopped(self) -> bool:
        return self._onlooker is not None and self._onlooker.stopped
