"""Runs of plans flown into rows: kinematic flights in batches here, all others by workers."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from functools import cache
from itertools import chain, groupby
from typing import Any

import pyarrow as pa

from flighttune.arrays import check_at_least
from flighttune.campaign.dataset import Span
from flighttune.campaign.engine.cluster import ClusterWorkers, cluster
from flighttune.campaign.engine.flyer import (
    Draw,
    Flyer,
    Lost,
    failure,
    fly_by,
    fly_draws,
    fly_signals,
    plan_text,
)
from flighttune.campaign.engine.progress import CampaignObserver, CampaignProgress, Tally
from flighttune.campaign.flying.claim import claims
from flighttune.campaign.flying.rows import (
    Row,
    batched_groups,
    blocks,
    crashed_row,
    fly_together,
    split,
    table_of,
)
from flighttune.campaign.planning.plan import Plan
from flighttune.errors import InputError
from flighttune.simulate.batch import cores

TASKS_PER_WORKER = 2
"""Tasks of a worker: one that it flies, and one that is ready when it ends."""

POLL_S = 0.2

KEEP_S, KEEP_SHARE, KEEP_MAX_S = 0.25, 0.05, 10.0
"""Rows are kept every 0.25 s, later after a twentieth of the time so far, at the latest after 10 s:
a killed campaign loses little, and a long one has few files."""

Task = tuple[Callable[..., Any], tuple[Any, ...]]
"""A call for a worker."""


class Threads:
    """Threads of this process, each with a process that flies for it; as `ClusterWorkers`."""

    max_draws = 1  # of a task

    def __init__(self, count: int) -> None:
        self._count, self._flyers = count, [Flyer() for _ in range(count)]
        waiting = list(self._flyers)
        for flyer in self._flyers:
            flyer.start()  # all at once: each takes a second to import what it needs
        self._executor = ThreadPoolExecutor(count, "flights", lambda: fly_by(waiting.pop()))
        self.submit = self._executor.submit
        self.failure = failure

    def threads(self) -> int:
        """Number of tasks that can run at a time."""
        return self._count

    def stop(self) -> None:
        """Take back all tasks, and end the flights in progress."""
        for flyer in self._flyers:
            flyer.close()
        self._executor.shutdown(cancel_futures=True)
        for flyer in self._flyers:
            flyer.end()


Workers = Threads | ClusterWorkers


@contextmanager
def worker_pool(
    workers: int | None = None,
    scheduler: str | None = None,
    observer: CampaignObserver | None = None,
) -> Iterator["WorkerPool"]:
    """Workers for the block: so many processes here, or those of a dask scheduler elsewhere.

    They start, or are connected to, when there is something for them to fly. `workers` are one per
    core by default. InputError if the arguments cannot be used.
    """
    if workers is not None and scheduler is not None:
        raise InputError("`workers` must not be given with `scheduler`, which has its own.")
    check_at_least(1, workers=workers)
    with cluster(scheduler) if scheduler else _threads(workers or cores()) as start:
        yield WorkerPool(start, observer)


@contextmanager
def _threads(count: int) -> Iterator[Callable[[], Threads]]:
    """Threads of this process for the block: a call starts them."""
    with ExitStack() as stack:

        def start() -> Threads:
            threads = Threads(count)
            stack.callback(threads.stop)
            return threads

        yield cache(start)


class WorkerPool:
    """Flies runs by the workers of a campaign; `flown` counts the rows so far.

    `start` returns the workers, and is called when there is something for them to fly. The observer
    receives the progress and may stop the flights.
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
        """Fly runs of a plan; return whether all were, and the observer did not stop it.

        `keep` gets the rows of successive runs in order of `run`; the tables come in any order.
        `tally` holds the rows that exist already, and counts the new ones.
        """
        tally, gaps = tally or Tally(), list(gaps)
        if not gaps:
            return True
        runs = tally.runs + sum(gap.runs for gap in gaps)
        buffer = _Buffer(plan, gaps, keep)

        def done(flown: Iterable[Row | Lost]) -> None:
            rows = [
                crashed_row(plan, *outcome) if isinstance(outcome, Lost) else outcome
                for outcome in flown
            ]
            buffer.add(rows)
            tally.add([row["status"] for row in rows], [row["success"] for row in rows])
            self.flown += len(rows)

        try:
            tasks = self._tasks(plan, gaps, done)
            return self._hand_out(tasks, done, doing, tally, runs)
        finally:
            buffer.write()

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

        `keep` gets each run and the bytes of its recording; `tally` counts the rows that are there.
        """
        if not runs:
            return True
        text, limit = plan_text(plan), plan.campaign.time_limit_s

        def done(signals: tuple[int, bytes]) -> None:
            run, data = signals
            if data:
                keep(run, data)
            else:
                self._observer.hear(f"run {run}: did not end when it was flown for its signals.")

        tasks = ((fly_signals, (text, limit, _draw(plan, [run]))) for run in runs)
        return self._hand_out(tasks, done, doing, tally, tally.runs)

    def _tasks(
        self, plan: Plan, gaps: Sequence[Span], done: Callable[[Iterable[Row]], None]
    ) -> Iterator[Task | None]:
        """Tasks of whole draws in order; None after a batch that was flown here."""
        in_batch = batched_groups(plan)
        if len(in_batch) < len(plan.groups):
            self._start()  # the processes get ready while the first batch is flown
        claim_of = claims(plan, in_batch)  # of kinematic flights: no JSBSim here
        text, limit = plan_text(plan), plan.campaign.time_limit_s
        left = sum(gap.runs for gap in gaps) // len(plan.groups)
        for block in chain.from_iterable(blocks(plan, range(*gap)) for gap in gaps):
            batched, alone = split(plan, block)
            if batched:
                done(fly_together(plan, batched, claim_of))
                yield None
            draws = [_draw(plan, list(runs)) for _, runs in groupby(alone, key=plan.draw_of)]
            while draws:
                workers = self._start()
                share = left // (
                    2 * TASKS_PER_WORKER * max(workers.threads(), 1)
                )  # fewer towards the end
                size = min(max(share, 1), workers.max_draws)
                task, draws = draws[:size], draws[size:]
                left -= len(task)
                yield fly_draws, (text, limit, task)

    def _hand_out(
        self,
        tasks: Iterator[Task | None],
        done: Callable[[Any], None],
        doing: str,
        tally: Tally,
        runs: int,
    ) -> bool:
        """Have all tasks done; return False if the observer stopped it.

        `done` gets what each task returns, in any order.
        """
        observer = self._observer
        if self._flying_since is None:
            observer.see(CampaignProgress(doing="starting", done=tally.runs, runs=runs))
        self._flying_since = self._flying_since or time.perf_counter()
        workers: Workers | None = None
        pending: set[Future[Any]] = set()
        more = True
        while not observer.stopped:
            threads = workers.threads() if workers else 1  # until then this process flies
            # also with no worker one task is handed out: some schedulers start workers for it
            while more and len(pending) <= TASKS_PER_WORKER * threads:
                try:
                    task = next(tasks)
                except StopIteration:
                    more = False
                    break
                if task is None:
                    break
                workers = workers or self._start()
                function, arguments = task
                pending.add(workers.submit(function, *arguments))
                threads = workers.threads()
            observer.see(self._progress(doing, tally, runs, len(pending), threads))
            if not more and not pending:
                return True
            ready = 0.0 if more and len(pending) <= TASKS_PER_WORKER * threads else POLL_S
            over, pending = wait(pending, ready, FIRST_COMPLETED)
            for future in over:
                done(_result(workers, future))
        if workers:
            for future in wait(pending, 0.0).done:
                done(_result(workers, future))
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


class _Buffer:
    """Rows that have come back, until they are kept in order of `run`."""

    def __init__(self, plan: Plan, gaps: Sequence[Span], keep: Callable[[pa.Table], None]) -> None:
        self._plan, self._keep = plan, keep
        self._rows: dict[int, Row] = {}
        self._wanted = chain.from_iterable(range(*gap) for gap in gaps)
        self._next = next(self._wanted, None)
        self._began = self._kept = time.perf_counter()

    def add(self, rows: Iterable[Row]) -> None:
        """Take rows, and keep those before the first that is still flown, if it is time to."""
        self._rows |= {row["run"]: row for row in rows}
        now = time.perf_counter()
        if now < self._kept + min(max(KEEP_S, KEEP_SHARE * (now - self._began)), KEEP_MAX_S):
            return
        ready = []
        while self._next in self._rows:
            ready.append(self._next)
            self._next = next(self._wanted, None)
        self._write(ready)
        self._kept = now

    def write(self) -> None:
        """Keep all rows."""
        self._write(sorted(self._rows))

    def _write(self, runs: Sequence[int]) -> None:
        # successive runs have the same difference from their place in the list
        for _, span in groupby(enumerate(runs), key=lambda at: at[1] - at[0]):
            rows = [self._rows.pop(run) for _, run in span]
            self._keep(table_of(self._plan, rows))


def _draw(plan: Plan, runs: Sequence[int]) -> Draw:
    return Draw(tuple(runs), plan.values_of(plan.draw_of(runs[0])))


def _result(workers: Workers | None, future: Future[Any]) -> Any:
    try:
        return future.result()
    except Exception as error:
        assert workers is not None
        raise workers.failure(error) from error
