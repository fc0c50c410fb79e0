"""Workers fly runs of plans into rows; this process flies a few kinematic flights in batches."""

import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from itertools import chain
from typing import Any

from flighttune.base.errors import DifferenceError, StoppedError
from flighttune.base.processors import cores
from flighttune.campaigns.engine.cluster import ClusterWorkers, campaign_error
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.flyer import (
    OF_THREAD,
    Answer,
    Flyer,
    fly,
    give_back,
    take_ready,
    work_of,
)
from flighttune.campaigns.engine.progress import CampaignObserver, CampaignProgress
from flighttune.campaigns.flying import rows as flying
from flighttune.campaigns.flying.compiled import CompiledFlights
from flighttune.campaigns.planning.plan import Plan
from flighttune.flight.own import ask_to_fly

# Tasks for each worker: one in flight and one waiting
TASKS_PER_WORKER = 2

# Number of kinematic flights that this process flies before workers have started
FEW = 2000

# Maximum wait for a result before progress is shown and a stop is noticed, s
POLL_S = 0.2


class Threads:
    """Threads of this process, each with a process that flies; used like `ClusterWorkers`."""

    def __init__(self, count: int) -> None:
        # all at once, because each takes a second for its imports
        self._flyers = [take_ready() or Flyer() for _ in range(count)]
        flyers = iter(self._flyers)
        self._executor = ThreadPoolExecutor(
            count, initializer=lambda: setattr(OF_THREAD, "flyer", next(flyers))
        )

    def submit(self, work: bytes, draw: flying.Draw) -> Future[list[Answer]]:
        """Submit the arguments of `fly`."""
        return self._executor.submit(fly, work, draw)

    def threads(self) -> int:
        """Number of tasks that can run at a time."""
        return len(self._flyers)

    def stop(self) -> None:
        """Cancel the waiting tasks and end the flights in progress."""
        for flyer in self._flyers:
            flyer.stopped = True
        self._executor.shutdown(cancel_futures=True)
        for flyer in self._flyers:
            give_back(flyer)


class WorkerPool:
    """Flies runs with the workers of a campaign, for an observer that may stop it."""

    # A scheduler is connected to `at_once`, so that nothing is written where none answers, and
    # processes start with the first flight. Both stop at the end of the ``with`` block.
    def __init__(self, fliers: Fliers, *, at_once: bool = True) -> None:
        self._at_once = at_once
        self._count, self._scheduler = fliers.workers or cores(), fliers.scheduler
        self._workers: Threads | ClusterWorkers | None = None
        self.observer = fliers.observer or CampaignObserver()
        self.progress = CampaignProgress(stage=fliers.stage)

    def __enter__(self) -> "WorkerPool":
        if self._at_once and self._scheduler is not None:
            self._started()
        return self

    def __exit__(self, *_: object) -> None:
        if self._workers is not None:
            self._workers.stop()

    def _started(self) -> Threads | ClusterWorkers:
        if self._workers is None:
            remote = self._scheduler
            self._workers = ClusterWorkers(remote) if remote else Threads(self._count)
        return self._workers

    def rows(
        self,
        plan: Plan,
        runs: Iterable[int],
        *,
        doing: str | None = None,
        probes: flying.Probes | None = None,
        draws: Sequence[flying.Drawn] | None = None,
        again: bool = False,
    ) -> Iterator[flying.Row]:
        """Fly runs of a plan, in rising order; their rows, and StoppedError if stopped.

        `again`: JSBSim repeats each compiled flight.
        """
        runs, work, progress = list(runs), flying.Work(plan, probes or {}, draws), self.progress
        if not runs:
            return
        if doing:
            progress.statuses.clear()
            progress.succeeded = 0
        ask_to_fly(plan.scenario, plan.flown)
        progress.runs = progress.done + len(runs)
        if progress.budget:  # flying again comes on top
            progress.budget = max(progress.budget, progress.flown + len(runs))
        flown_here: list[flying.Row] = []

        def alone_draws() -> Iterator[flying.Draw]:
            """Draws for the workers; a draw without runs follows a batch that this process flew."""
            many = draws is None and len(runs) > FEW
            if many or len(work.batched) < len(plan.groups):
                self._started()  # the processes get ready while the first batch is flown
            for together, alone in work.blocks(runs):
                if many and together:
                    yield flying.Draw(tuple(run for draw in together for run in draw.runs), None)
                else:
                    flown_here.extend(flying.fly_together(plan, together))
                    yield flying.Draw((), {})
                yield from alone

        content = work_of(plan, work.probes, again=again)
        for draw, answers in self._answers(doing or "flying", content, alone_draws()):
            rows = [
                x if isinstance(x, dict) else flying.lost_row(plan, run, draw.drawn, x)
                for run, x in zip(draw.runs, answers, strict=True)
            ]
            for row in chain(flown_here, rows):
                yield row
                progress.add([row])
                progress.flown += 1
            flown_here.clear()
        if self.observer.stopped:
            raise StoppedError("the observer stopped the flights.")

    def in_order(self, plan: Plan, runs: Iterable[int], **options: Any) -> list[flying.Row]:
        """All rows of `rows`, in order of `run`."""
        return sorted(self.rows(plan, runs, **options), key=lambda row: row["run"])

    def check_compiled(
        self, plan: Plan, runs: Iterable[int], *, draws: Sequence[flying.Drawn] | None = None
    ) -> None:
        """Let JSBSim repeat runs that decide an answer, if this pool has flown compiled ones.

        DifferenceError names the first signal that differs.
        """
        if not self.progress.compiled.flights:
            return
        with self.checking():
            for _ in self.rows(plan, sorted(runs), doing="repeating", draws=draws, again=True):
                pass

    @contextmanager
    def checking(self) -> Iterator[None]:
        """Count the compiled flights and endings of the block only as flown again."""
        progress = self.progress
        before, endings = progress.compiled, [*progress.endings]
        yield
        again = progress.compiled.flown_again - before.flown_again
        progress.compiled, progress.endings = before + CompiledFlights(flown_again=again), endings

    def signals(self, plan: Plan, runs: Iterable[int]) -> Iterator[tuple[int, bytes]]:
        """Fly runs of a plan again for their signals: each with the bytes of its recording."""
        self.progress.runs = self.progress.done  # the progress then shows the rows again
        draws, work = (flying.Draw((run,), {}) for run in runs), work_of(plan, {}, signals=True)
        for ((run,), _), (signals,) in self._answers("keeping signals", work, draws):
            if isinstance(signals, bytes):
                yield run, signals
            else:
                self.observer.hear(f"run {run}: did not end when it was flown for its signals.")
        if self.observer.stopped:
            raise StoppedError("the observer stopped the flights.")

    def _answers(
        self, doing: str, work: bytes, draws: Iterator[flying.Draw]
    ) -> Iterator[tuple[flying.Draw, list[Any]]]:
        """Draws with the answers of the workers, in any order; a draw without runs at once."""
        observer, progress, more = self.observer, self.progress, True
        if progress.began is None:
            observer.see(progress)
            progress.began = time.perf_counter()
        progress.doing = doing
        pending: dict[Future[list[Answer]], flying.Draw] = {}
        while more or pending:
            observer.see(progress)
            # `<=` submits a task even without a worker, because some schedulers then start workers
            room = len(pending) <= TASKS_PER_WORKER * progress.workers
            if more and room and not observer.stopped:
                draw = next(draws, None)
                more = draw is not None
                if draw and draw.runs:
                    pending[self._started().submit(work, draw)] = draw
                elif draw:
                    yield draw, []
                continue
            # results that are ready at a stop are not lost
            for future in wait(pending, 0.0 if observer.stopped else POLL_S, FIRST_COMPLETED).done:
                try:
                    answers = future.result()
                except DifferenceError:
                    raise
                except Exception as error:
                    raise campaign_error(error, self._scheduler) from error
                yield pending.pop(future), answers
            if observer.stopped:
                return
            self._count_workers()

    def _count_workers(self) -> None:
        """See how many tasks can run at a time, and tell where that becomes none."""
        before, now = self.progress.workers, self._started().threads()
        self.progress.workers = now
        if before and not now:
            self.observer.hear(
                f"{self._scheduler}: no worker is there; the flights go on when one comes."
            )
        elif now and not before:
            self.observer.hear(f"{self._scheduler}: a worker is there; the flights go on.")
