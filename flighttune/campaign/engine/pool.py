"""Runs of plans flown by workers here or elsewhere: tasks handed out a few at a time."""

import json
import time
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pyarrow as pa

from flighttune.arrays import check_at_least
from flighttune.campaign.dataset import Span
from flighttune.campaign.engine.chunks import Chunks
from flighttune.campaign.engine.cluster import cluster
from flighttune.campaign.engine.flyer import Flyer
from flighttune.campaign.engine.here import workers_here
from flighttune.campaign.engine.progress import CampaignObserver, CampaignProgress, Tally
from flighttune.campaign.engine.tasks import Task, Workers
from flighttune.campaign.engine.worker import FlownChunk, fly_chunk, fly_signals
from flighttune.campaign.flying.rows import crashed_row
from flighttune.campaign.planning.plan import Plan
from flighttune.errors import CampaignError, InputError
from flighttune.flight.fly import library_versions
from flighttune.simulate.batch import cores

WAITING_PER_THREAD = 2
"""Tasks handed out per thread: one that runs, and one that is ready when it ends."""

LOOK_S = 0.2
MOST_LOSSES = 5
"""How often a task may lose its worker."""


@contextmanager
def worker_pool(
    workers: int | None = None,
    scheduler: str | None = None,
    observer: CampaignObserver | None = None,
    *,
    flyers: Sequence[Flyer] = (),
) -> Iterator["WorkerPool"]:
    """Workers for the block: threads of this process, or those of a scheduler elsewhere.

    Parameters
    ----------
    workers : int, optional
        Flights at a time on this machine; by default one per core.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, instead.
    observer : CampaignObserver, optional
        Receives the progress; may stop the flights.
    flyers : sequence of Flyer
        Processes that have started already, for the first threads of this machine.

    Yields
    ------
    WorkerPool
        It connects to a scheduler when there is something to fly.

    Raises
    ------
    InputError
        If the arguments cannot be used.
    CampaignError
        From the first flights, if no scheduler answers at the address.
    """
    if workers is not None and scheduler is not None:
        raise InputError("`workers` must not be given with `scheduler`, which has its own.")
    check_at_least(1, workers=workers)
    if scheduler is None:
        with workers_here(workers or cores(), flyers) as threads:
            yield WorkerPool(lambda: threads, observer)
        return
    with cluster(scheduler) as connect:
        yield WorkerPool(connect, observer)


class WorkerPool:
    """Flies runs by the workers of a campaign.

    Parameters
    ----------
    start : callable
        Returns the workers. Called when there is something to fly.
    observer : CampaignObserver, optional
        Receives the progress; may stop the flights.

    Attributes
    ----------
    flown : int
        Rows so far.
    """

    def __init__(
        self, start: Callable[[], Workers], observer: CampaignObserver | None = None
    ) -> None:
        self._start = start
        self._observer = observer or CampaignObserver()
        self._flying_since: float | None = None
        self.flown = 0

    def fly_rows(
        self,
        plan: Plan,
        gaps: Iterable[Span],
        keep: Callable[[pa.Table], None],
        *,
        tally: Tally | None = None,
        doing: str = "flying",
    ) -> bool:
        """Fly runs of a plan.

        Parameters
        ----------
        plan : Plan
        gaps : iterable of Span
            Which runs.
        keep : callable
            Gets the rows of each chunk; chunks come in any order.
        tally : Tally, optional
            Of the rows that exist already; the new ones are added.
        doing : str
            Name of the activity, for the observer.

        Returns
        -------
        bool
            Whether all were flown; False where the observer stopped it.

        Raises
        ------
        CampaignError
            If the cluster is gone, cannot fly for this process, or a chunk loses its worker again
            and again.
        """
        tally = tally or Tally()
        chunks = Chunks(gaps, draw=len(plan.groups))
        runs = tally.runs + chunks.left
        text, versions = json.dumps(plan.as_dict()), library_versions()
        limit = plan.campaign.time_limit_s

        def next_task(threads: int) -> Task | None:
            span = chunks.take(threads)
            return span and Task(span, fly_chunk, (text, versions, *span, limit))

        def done(span: Span, chunk: FlownChunk) -> None:
            rows = _rows(plan, span, chunk)
            keep(rows)
            tally.add(rows)
            self.flown += span.runs
            if not chunk.crashed:  # the time of one with a crash is not that of its flights
                chunks.learn(span, chunk.seconds)

        return not chunks.left or self._hand_out(next_task, done, doing, tally, runs)

    def fly_signals(
        self,
        plan: Plan,
        runs: Sequence[int],
        keep: Callable[[int, bytes], None],
        *,
        tally: Tally,
        doing: str = "keeping signals",
    ) -> bool:
        """Fly runs of a plan once more for their signals; return whether all were.

        Parameters
        ----------
        plan : Plan
        runs : sequence of int
        keep : callable
            Gets each run and the bytes of its recording.
        tally : Tally
            Of the rows that are there.
        doing : str
            Name of the activity, for the observer.
        """
        left = sorted(runs, reverse=True)
        text, limit = json.dumps(plan.as_dict()), plan.campaign.time_limit_s

        def next_task(_threads: int) -> Task | None:
            if not left:
                return None
            run = left.pop()
            return Task(run, fly_signals, (text, run, limit))

        def done(run: int, signals: bytes) -> None:
            if signals:
                keep(run, signals)
            else:
                self._observer.hear(f"run {run}: did not end when it was flown for its signals.")

        return not left or self._hand_out(next_task, done, doing, tally, tally.runs)

    def _hand_out(
        self,
        next_task: Callable[[int], Task | None],
        done: Callable[[Any, Any], None],
        doing: str,
        tally: Tally,
        runs: int,
    ) -> bool:
        """Hand out all tasks; return False if the observer stopped it.

        `next_task` is given how many tasks can run at a time; `done` gets what a task was about and
        what it returned, in any order.
        """
        observer = self._observer
        if self._flying_since is None:
            observer.see(CampaignProgress(doing="starting", done=tally.runs, runs=runs))
        workers = self._start()
        self._flying_since = self._flying_since or time.perf_counter()
        losses: Counter[Hashable] = Counter()
        again: list[Task] = []
        while not observer.stopped:
            threads = workers.threads()
            # also with no worker one task is handed out: some schedulers start workers for it
            while workers.waiting <= WAITING_PER_THREAD * threads:
                task = again.pop() if again else next_task(max(threads, 1))
                if task is None:
                    break
                workers.submit(task)
            observer.see(self._progress(doing, tally, runs, workers.waiting, threads))
            if not workers.waiting:
                return True
            for over in workers.wait(LOOK_S):
                about = over.task.about
                if not over.lost:
                    done(about, over.value)
                    continue
                again.append(over.task)
                losses[about] += 1
                if losses[about] >= MOST_LOSSES:
                    raise CampaignError(f"{about}: lost its worker {MOST_LOSSES} times")
        for over in workers.wait(0.0):
            if not over.lost:
                done(over.task.about, over.value)
        workers.stop()
        return False

    def _progress(
        self, doing: str, tally: Tally, runs: int, waiting: int, threads: int
    ) -> CampaignProgress:
        since = self._flying_since
        rate = self.flown / (time.perf_counter() - since) if since is not None else 0.0
        return CampaignProgress(
            doing=doing,
            done=tally.runs,
            runs=runs,
            failed=tally.failed,
            crashed=tally.crashed,
            waiting=waiting,
            workers=threads,
            rate_per_s=rate,
            left_s=(runs - tally.runs) / rate if rate else None,
        )


def _rows(plan: Plan, span: Span, chunk: FlownChunk) -> pa.Table:
    """The rows of a chunk, those of crashed runs among them, each run once and in order."""
    if chunk.refused:
        raise CampaignError(f"a worker cannot fly for this campaign: {chunk.refused}")
    tables = [pa.ipc.open_stream(data).read_all() for data in chunk.tables]
    tables += [crashed_row(plan, *crash) for crash in chunk.crashed]
    rows = pa.concat_tables(tables).sort_by("run")
    if rows.column("run").to_pylist() != list(range(*span)):
        raise CampaignError(f"runs {span.first} to {span.end - 1}: each must come back once")
    return rows
