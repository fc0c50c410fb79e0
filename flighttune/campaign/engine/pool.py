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
from flighttune.campaign.engine.cluster import ClusterWorkers, check_scheduler
from flighttune.campaign.engine.flyer import (
    Flyer,
    Lost,
    failure,
    fly_by,
    fly_rows,
    fly_signals,
    work_of,
)
from flighttune.campaign.engine.progress import CampaignObserver, CampaignProgress, Tally
from flighttune.campaign.flying.claim import claims
from flighttune.campaign.flying.rows import (
    Draw,
    Drawn,
    Probes,
    Row,
    batched_groups,
    blocks,
    crashed_row,
    fly_together,
    table_of,
)
from flighttune.campaign.planning.plan import Plan
from flighttune.errors import InputError
from flighttune.simulate.batch import cores

TASKS_PER_WORKER = 2
"""Tasks handed to each worker: one in flight, and one ready for when that ends."""

POLL_S = 0.2
"""Longest wait for a result before progress is shown and a stop is noticed, s."""

KEEP_S, KEEP_SHARE, KEEP_MAX_S = 0.25, 0.05, 10.0
"""Rows are written after a further twentieth of the time so far, but at least 0.25 s and at most
10 s apart: a killed campaign loses little, and a long one has few files."""

Task = tuple[Any, ...] | None
"""A function for a worker with its arguments; None after a batch that this process flew."""


class Threads:
    """Threads of this process, each with a process that flies; used like `ClusterWorkers`."""

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
        """Cancel the tasks that are waiting and end the flights in progress."""
        for flyer in self._flyers:
            flyer.close()  # before the shutdown, which waits for the threads in flight
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
    """A worker pool for the block: processes of this machine, or the workers of a dask scheduler.

    They are started, or connected to, only when there is something to fly. `workers` is the number
    of processes, by default one per core. Raises InputError if the arguments cannot be used.
    """
    if workers is not None and scheduler is not None:
        raise InputError("`workers` must not be given with `scheduler`, which has its own.")
    check_at_least(1, workers=workers)
    if scheduler:
        check_scheduler(scheduler)
    with ExitStack() as stack:

        @cache
        def start() -> Workers:
            made = ClusterWorkers(scheduler) if scheduler else Threads(workers or cores())
            stack.callback(made.stop)
            return made

        yield WorkerPool(start, observer)


class WorkerPool:
    """Flies runs with the workers of a campaign; `flown` counts the rows so far.

    `start` returns the workers and is called only when there is something to fly. The observer
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
        probes: Probes | None = None,
        draws: Sequence[Drawn] | None = None,
    ) -> bool:
        """Fly runs of a plan; return False if the observer stopped them.

        `keep` gets tables of consecutive runs, each in order of `run`; the order of the tables is
        arbitrary. `tally` starts with the rows that exist already and counts the new ones. `probes`
        and `draws` are those of `flighttune.campaign.flying.rows.fly_runs`.
        """
        tally, gaps, probes = tally or Tally(), list(gaps), probes or {}
        if not gaps:
            return True
        buffer = _Buffer(gaps, lambda rows: keep(table_of(plan, rows, probes)))

        def done(flown: Iterable[Row | Lost]) -> None:
            rows = [crashed_row(plan, *row) if isinstance(row, Lost) else row for row in flown]
            buffer.add(rows)
            tally.add([row["status"] for row in rows], [row["success"] for row in rows])
            self.flown += len(rows)

        def tasks() -> Iterator[Task]:
            in_batch = batched_groups(plan, probes, draws)
            if len(in_batch) < len(plan.groups):
                self._start()  # the processes get ready while the first batch is flown
            claim_of = claims(plan, in_batch)  # kinematic groups only: no JSBSim in this process
            work, limit = work_of(plan, probes), plan.campaign.time_limit_s
            runs = chain.from_iterable(range(*gap) for gap in gaps)
            for together, alone in blocks(plan, runs, in_batch, draws):
                if together:
                    done(fly_together(plan, together, claim_of))
                    yield None
                for draw in alone:
                    yield fly_rows, work, draw, limit

        try:
            total = tally.runs + sum(gap.runs for gap in gaps)
            return self._hand_out(tasks(), done, doing, tally, total)
        finally:
            # After a stop or an error, rows may be left behind a run that never came back.
            buffer.write(sorted(buffer.rows))

    def fly_signals(
        self,
        plan: Plan,
        runs: Sequence[int],
        keep: Callable[[int, bytes], None],
        *,
        tally: Tally,
    ) -> bool:
        """Fly runs of a plan once more for their signals; return False if the observer stopped it.

        `keep` gets each run and the bytes of its recording. `tally` holds the counts of the rows,
        which the progress shows.
        """
        if not runs:
            return True
        work, limit = work_of(plan, {}), plan.campaign.time_limit_s

        def done(signals: tuple[int, bytes]) -> None:
            run, data = signals
            if data:
                keep(run, data)
            else:
                self._observer.hear(f"run {run}: did not end when it was flown for its signals.")

        tasks = ((fly_signals, work, Draw((run,), {}), limit) for run in runs)
        return self._hand_out(tasks, done, "keeping signals", tally, tally.runs)

    def _hand_out(
        self,
        tasks: Iterator[Task],
        done: Callable[[Any], None],
        doing: str,
        tally: Tally,
        runs: int,
    ) -> bool:
        """Hand all tasks to the workers; return False if the observer stopped it.

        `done` gets what each task returns, in any order.
        """
        observer = self._observer
        if self._flying_since is None:
            observer.see(CampaignProgress(doing="starting", done=tally.runs, runs=runs))
        since = self._flying_since = self._flying_since or time.perf_counter()
        pending: set[Future[Any]] = set()
        threads, more = 1, True  # this process flies until there are workers
        while not observer.stopped:
            rate = self.flown / (time.perf_counter() - since) if self.flown else 0.0
            observer.see(
                CampaignProgress(
                    doing=doing,
                    done=tally.runs,
                    runs=runs,
                    failed=tally.failed,
                    crashed=tally.crashed,
                    waiting=len(pending),
                    workers=threads,
                    rate_per_s=rate,
                    left_s=(runs - tally.runs) / rate if rate else None,
                )
            )
            # `<=` hands out a task even with no worker: some schedulers start workers for it
            if more and len(pending) <= TASKS_PER_WORKER * threads:
                try:
                    task = next(tasks)
                except StopIteration:
                    more = False
                    continue
                if task is not None:
                    pending.add(self._start().submit(*task))
            elif not pending:
                return True
            else:
                over, pending = wait(pending, POLL_S, FIRST_COMPLETED)
                for future in over:
                    done(self._result(future))
            if pending:
                threads = self._start().threads()
        # results that were ready when the observer stopped the flights are not lost
        for future in wait(pending, 0.0).done:
            done(self._result(future))
        return False

    def _result(self, future: Future[Any]) -> Any:
        try:
            return future.result()
        except Exception as error:
            raise self._start().failure(error) from error


class _Buffer:
    """Rows that have come back and wait to be kept in order of `run`."""

    def __init__(self, gaps: Sequence[Span], keep: Callable[[list[Row]], None]) -> None:
        self.rows: dict[int, Row] = {}
        self._keep = keep
        self._wanted = chain.from_iterable(range(*gap) for gap in gaps)
        self._next = next(self._wanted, None)
        self._began = self._kept = time.perf_counter()

    def add(self, rows: Iterable[Row]) -> None:
        """Take rows; if it is time, keep those before the first run still in flight."""
        self.rows |= {row["run"]: row for row in rows}
        now = time.perf_counter()
        if now < self._kept + min(max(KEEP_S, KEEP_SHARE * (now - self._began)), KEEP_MAX_S):
            return
        ready = []
        while self._next in self.rows:
            ready.append(self._next)
            self._next = next(self._wanted, None)
        self.write(ready)
        self._kept = now

    def write(self, runs: Sequence[int]) -> None:
        """Keep the rows of these runs."""
        # consecutive runs have the same difference from their place in the list
        for _, span in groupby(enumerate(runs), key=lambda at: at[1] - at[0]):
            self._keep([self.rows.pop(run) for _, run in span])
