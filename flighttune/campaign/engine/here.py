"""Tasks done on this machine: by threads, each with a process that flies for it."""

from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any

from flighttune.campaign.engine.flyer import Flyer
from flighttune.campaign.engine.tasks import Done, Task, translated
from flighttune.campaign.engine.worker import cancel_flights, end_flights, fly_by
from flighttune.campaign.planning.plan import Plan

SMALL_S = 3.0
"""Time of all flights on one core above which a new process, not a copy, is worth its start."""

SPEEDS = {"kinematic": 5000.0, "point_mass": 3000.0}
"""Seconds of flight in a second of a core, roughly, by kind of plant."""

SPEED = 600.0
"""Of an aircraft in JSBSim, and of plants of the user's own."""


def is_small(plan: Plan) -> bool:
    """Whether all flights of a plan take one process less time than it takes to start another."""
    kinds = {table.label: table.kind for table in plan.scenario.plant}
    cycle_s = sum(
        plan.scenario.flight.duration_s / SPEEDS.get(kinds[group.plant], SPEED)
        for group in plan.groups
    )
    return cycle_s * plan.draws <= SMALL_S


@contextmanager
def workers_here(count: int, flyers: Sequence[Flyer] = ()) -> Iterator["Threads"]:
    """Threads for the block; the processes that fly for them end with it.

    Parameters
    ----------
    count : int
    flyers : sequence of Flyer
        Processes for the first of them, which have started already.
    """
    ready = [*flyers[:count], *(Flyer() for _ in range(count - len(flyers)))]
    with ThreadPoolExecutor(count, "flights", lambda: fly_by(ready.pop(0))) as executor:
        try:
            yield Threads(executor, count)
        finally:
            cancel_flights()
            executor.shutdown(cancel_futures=True)
            end_flights()


class Threads:
    """Workers on this machine, see `flighttune.campaign.engine.tasks.Workers`.

    Parameters
    ----------
    executor : ThreadPoolExecutor
    count : int
        Its threads.
    """

    def __init__(self, executor: ThreadPoolExecutor, count: int) -> None:
        self._executor = executor
        self._count = count
        self._tasks: dict[Future[Any], Task] = {}

    @property
    def waiting(self) -> int:
        """Tasks that are not over."""
        return len(self._tasks)

    def threads(self) -> int:
        """How many tasks can run at a time."""
        return self._count

    def submit(self, task: Task) -> None:
        """Take on a task."""
        self._tasks[self._executor.submit(task.function, *task.arguments)] = task

    def wait(self, seconds: float) -> list[Done]:
        """Tasks that are over, after at most `seconds`.

        Raises
        ------
        CampaignError
            If a task fails otherwise than by its flight.
        """
        found = []
        for future in wait(self._tasks, seconds, FIRST_COMPLETED).done:
            task, error = self._tasks.pop(future), future.exception()
            if error is not None:
                raise translated(error) from error
            found.append(Done(task, future.result()))
        return found

    def stop(self) -> None:
        """Take back all tasks, and end the flights in progress."""
        for future in self._tasks:
            future.cancel()
        cancel_flights()
        self._tasks.clear()
