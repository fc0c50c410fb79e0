"""Tasks of a small campaign in one thread here; one process flies them, and no cluster is started.

A cluster takes some seconds to start, more than the flights of a small campaign.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any

from flighttune.campaign.engine.cluster import Done, Task, translated
from flighttune.campaign.engine.flyer import Flyer
from flighttune.campaign.engine.worker import cancel_flights, end_flights, fly_by
from flighttune.campaign.planning.plan import Plan

SMALL_S = 3.0
"""Time of all flights on one core up to which a campaign is small."""

SPEEDS = {"kinematic": 5000.0, "point_mass": 3000.0}
"""Seconds of flight in a second of a core, roughly, by kind of plant."""

SPEED = 600.0
"""Of an aircraft in JSBSim, and of plants of the user's own."""


def is_small(plan: Plan) -> bool:
    """Whether all flights of a plan take less time than a cluster to start."""
    kinds = {table.label: table.kind for table in plan.scenario.plant}
    cycle_s = sum(
        plan.scenario.flight.duration_s / SPEEDS.get(kinds[group.plant], SPEED)
        for group in plan.groups
    )
    return cycle_s * plan.draws <= SMALL_S


@contextmanager
def alone(flyer: Flyer | None) -> Iterator["OneThread"]:
    """One thread for the block that does tasks; the process that flies for it ends with it."""
    with ThreadPoolExecutor(1, "flights", fly_by, (flyer or Flyer(),)) as executor:
        try:
            yield OneThread(executor)
        finally:
            cancel_flights()
            executor.shutdown(cancel_futures=True)
            end_flights()


class OneThread:
    """Does tasks one after another; stands in for the `Workers` of a cluster.

    Parameters
    ----------
    executor : ThreadPoolExecutor
        Of one thread.

    Attributes
    ----------
    ours : bool
        As of `Workers`.
    """

    ours = True

    def __init__(self, executor: ThreadPoolExecutor) -> None:
        self._executor = executor
        self._tasks: dict[Future[Any], Task] = {}

    @property
    def waiting(self) -> int:
        """Tasks that are not over."""
        return len(self._tasks)

    def threads(self) -> int:
        """How many tasks can run at a time."""
        return 1

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
        over = wait(self._tasks, seconds, FIRST_COMPLETED).done
        found = []
        for future in over:
            task, error = self._tasks.pop(future), future.exception()
            if error is not None:
                raise translated(error) from error
            found.append(Done(task, future.result()))
        return found

    def stop(self, cancel: Callable[[], object]) -> None:
        """Take back all tasks, and end the flight in progress."""
        for future in self._tasks:
            future.cancel()
        cancel()
        self._tasks.clear()
