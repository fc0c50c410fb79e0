"""Tasks handed out to workers, a few at a time, until there are none left."""

import time
from collections import Counter
from collections.abc import Callable, Hashable
from typing import Any, NamedTuple

from flighttune.campaign.engine.cluster_tasks import Workers
from flighttune.errors import CampaignError

WAITING_PER_THREAD = 2
"""Tasks handed out for each that can run: one that runs, and one that is ready when it ends."""

LOOK_S = 0.2
MOST_LOSSES = 5
"""How often a task may lose its worker."""

NOBODY_S = 120.0
"""How long the cluster of this machine may be without any worker."""


class Task(NamedTuple):
    """What a worker is to do: `function` with `arguments`, about something."""

    about: Hashable
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


def dispatch(
    workers: Workers,
    take: Callable[[int], Task | None],
    over: Callable[[Any, Any], None],
    *,
    look: Callable[[int, int], None],
    stopped: Callable[[], bool],
) -> bool:
    """Hand out tasks until there are none left.

    Parameters
    ----------
    workers : Workers
        Who does them. Never more than `WAITING_PER_THREAD` for each that can run, and one, are
        with them.
    take : callable
        Returns the next task, given how many can run at a time; None where there is none left.
    over : callable
        Gets what a task was about and what it returned, in any order.
    look : callable
        Told now and then how many tasks are handed out, and how many can run at a time.
    stopped : callable
        Whether to stop.

    Returns
    -------
    bool
        Whether all are done; False where it was stopped.

    Raises
    ------
    CampaignError
        If the cluster is gone, or a task loses its worker again and again.
    """
    losses: Counter[Hashable] = Counter()
    again: list[Task] = []
    out: dict[Hashable, Task] = {}
    seen = time.monotonic()
    while not stopped():
        threads = workers.threads()
        while workers.waiting <= WAITING_PER_THREAD * threads:
            task = again.pop() if again else take(max(threads, 1))
            if task is None:
                break
            out[task.about] = task
            workers.submit(task.about, task.function, *task.arguments)
        look(workers.waiting, threads)
        if not workers.waiting:
            return True
        for done in workers.wait(LOOK_S):
            task = out.pop(done.about)
            if done.lost:
                losses[done.about] += 1
                again.append(task)
            else:
                over(done.about, done.value)
        _check(losses, workers, seen := time.monotonic() if threads else seen)
    for done in workers.wait(0.0):
        if not done.lost:
            over(done.about, done.value)
    return False


def _check(losses: Counter[Hashable], workers: Workers, seen: float) -> None:
    for about, count in losses.items():
        if count >= MOST_LOSSES:
            raise CampaignError(f"{about}: lost its worker {count} times")
    if workers.ours and time.monotonic() > seen + NOBODY_S:
        raise CampaignError(f"no worker came up on this machine within {NOBODY_S:g} s")
