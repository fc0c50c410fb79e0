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
"""Tasks of a worker: one that it flies, and one that is ready when it ends."""

POLL_S = 0.2

KEEP_S, KEEP_SHARE, KEEP_MAX_S = 0.25, 0.05, 10.0
"""Rows are kept every 0.25 s, later after a twentieth of the time so far, at the latest after 10 s:
a killed campaign loses little, and a long one has few files."""

Task = tuple[Any, ...] | None
"""A function of a worker and its arguments; None after a batch that was flown here."""


class Threads:
    """Threads of this process, each with a process that flies for it; as `ClusterWorkers`."""

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
        probes: Probes | None = None,
        draws: Sequence[Drawn] | None = None,
    ) -> bool:
        """Fly runs of a plan; return whether all were, and the observer did not stop it.

        `keep` gets the rows of successive runs in order of `run`; the tables come in any order.
        `tally` holds the rows that exist already, and counts the new ones. `probes` and `draws` are
        those of `flighttune.campaign.flying.rows.fly_runs`.
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
            claim_of = claims(plan, in_batch)  # of kinematic flights: no JSBSim here
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
            buffer.write(sorted(buffer.rows))

    def fly_signals(
        self,
        plan: Plan,
        runs: Sequence[int],
        keep: Callable[[int, bytes], None],
        *,
        tally: Tally,
    ) -> bool:
        """Fly runs of a plan once more for their signals; return whether all were.

        `keep` gets each run and the bytes of its recording; `tally` counts the rows that are there.
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
        """Have all tasks done; return False if the observer stopped it.

        `done` gets what each task returns, in any order.
        """
        observer = self._observer
        if self._flying_since is None:
            observer.see(CampaignProgress(doing="starting", done=tally.runs, runs=runs))
        since = self._flying_since = self._flying_since or time.perf_counter()
        pending: set[Future[Any]] = set()
        threads, more = 1, True  # until there are workers this process flies
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
            # also with no worker one task is handed out: some schedulers start workers for it
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
        for future in wait(pending, 0.0).done:
            done(self._result(future))
        return False

    def _result(self, future: Future[Any]) -> Any:
        try:
            return future.result()
        except Exception as error:
            raise self._start().failure(error) from error


class _Buffer:
    """Rows that have come back, until they are kept in order of `run`."""

    def __init__(self, gaps: Sequence[Span], keep: Callable[[list[Row]], None]) -> None:
        self.rows: dict[int, Row] = {}
        self._keep = keep
        self._wanted = chain.from_iterable(range(*gap) for gap in gaps)
        self._next = next(self._wanted, None)
        self._began = self._kept = time.perf_counter()

    def add(self, rows: Iterable[Row]) -> None:
        """Take rows, and keep those before the first that is still flown, if it is time to."""
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
        # successive runs have the same difference from their place in the list
        for _, span in groupby(enumerate(runs), key=lambda at: at[1] - at[0]):
            self._keep([self.rows.pop(run) for _, run in span])
