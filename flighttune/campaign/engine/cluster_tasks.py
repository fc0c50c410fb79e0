"""Tasks handed out to the workers of a cluster, and what becomes of them."""

import math
import queue
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flighttune.errors import CampaignError

if TYPE_CHECKING:
    from distributed import Client, Future

STOP_S = 5.0
"""How long workers may take to stop."""

COUNT_S = 1.0
"""How old a count of the workers may be."""


@dataclass(frozen=True, slots=True)
class Done:
    """A task that is over.

    Attributes
    ----------
    about : object
        What was given with the task.
    value : object
        What it returned.
    lost : bool
        Whether its worker went away before it did.
    """

    about: Any
    value: Any
    lost: bool


class Workers:
    """Workers of one cluster, and the tasks they have.

    Attributes
    ----------
    ours : bool
        Whether they are processes of this machine that nobody else uses.
    """

    def __init__(self, client: "Client", *, ours: bool) -> None:
        self._client = client
        self.ours = ours
        self._threads, self._counted = 0, -math.inf
        self._about: dict[str, tuple[Future, Any]] = {}
        self._over: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._campaign = uuid.uuid4().hex

    @property
    def waiting(self) -> int:
        """Tasks that are not over."""
        return len(self._about)

    def threads(self) -> int:
        """How many tasks can run at a time now, to a second."""
        if time.monotonic() > self._counted + COUNT_S:
            with self._connected():
                workers = self._client.scheduler_info(n_workers=-1)["workers"]
            self._threads = sum(worker["nthreads"] for worker in workers.values())
            self._counted = time.monotonic()
        return self._threads

    def submit(self, about: Any, function: Callable[..., Any], *arguments: Any) -> None:
        """Hand out a task; `about` comes back with its outcome.

        `function` is one of a module; it takes and returns plain values.
        """
        where = function.__module__, function.__name__
        key = f"flighttune-{self._campaign}-{uuid.uuid4().hex}"
        with self._connected():
            future = self._client.submit(_call, *where, *arguments, key=key, pure=False)
            self._about[key] = future, about
            future.add_done_callback(self._over.put)

    def wait(self, seconds: float) -> list[Done]:
        """Tasks that are over, after at most `seconds`.

        Raises
        ------
        CampaignError
            If the scheduler is gone, or a worker cannot run tasks of ours.
        """
        over: list[Future] = []
        with suppress(queue.Empty):
            over.append(self._over.get(timeout=seconds))
            while True:
                over.append(self._over.get_nowait())
        if self._client.status != "running":
            raise self._gone()
        return [self._done(future) for future in over if future.key in self._about]

    def stop(self, here: Callable[[], object]) -> None:
        """Take back all tasks; workers of this machine are to call `here`, so that theirs end."""

        def take_back() -> None:
            with suppress(Exception):  # they may be gone
                self._client.cancel([future for future, _ in self._about.values()], force=True)
                if self.ours:
                    self._client.run(here)

        thread = threading.Thread(target=take_back, daemon=True)
        thread.start()
        thread.join(STOP_S)
        self._about.clear()

    def _done(self, future: "Future") -> Done:
        _, about = self._about.pop(str(future.key))
        with self._connected():
            if future.status == "finished":
                return Done(about, future.result(), lost=False)
            if future.status == "error":
                error: Any = future.exception()
                if type(error).__name__ == "KilledWorker":
                    return Done(about, None, lost=True)
                raise _translated(error) from error
        return Done(about, None, lost=True)

    @contextmanager
    def _connected(self) -> Iterator[None]:
        from distributed import CancelledError

        if self._client.status != "running":
            raise self._gone()
        try:
            yield
        except (CancelledError, OSError, TimeoutError) as error:
            raise self._gone() from error

    def _gone(self) -> CampaignError:
        where = self._client.scheduler.address if self._client.scheduler else "the scheduler"
        return CampaignError(f"{where}: the connection to the scheduler is lost")


def _call(module: str, name: str, *arguments: Any) -> Any:
    from importlib import import_module

    return getattr(import_module(module), name)(*arguments)


# Sent as code and not by name: a worker that cannot import what it is sent never answers.
_call.__module__ = "__main__"


def _translated(error: BaseException | None) -> CampaignError:
    if isinstance(error, ModuleNotFoundError):
        return CampaignError(f"a worker has no `{error.name}`: install flighttune there")
    return CampaignError(f"a worker failed: {type(error).__name__}: {error}")
