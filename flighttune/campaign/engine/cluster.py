"""Workers of a dask cluster elsewhere: the only importer of dask."""

import logging
import math
import queue
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from flighttune.campaign.engine.tasks import Done, Task, translated
from flighttune.errors import CampaignError, InputError
from flighttune.extras import need

if TYPE_CHECKING:
    from distributed import Client, Future

QUIET = (
    "distributed",
    "distributed.worker",
    "distributed.scheduler",
    "distributed.nanny",
    "distributed.client",
    "distributed.core",
    "tornado.application",
    "asyncio",
)
"""Loggers that report what is an outcome here: lost workers and closed connections."""

CONNECT_S = 10.0

STOP_S = 5.0
"""How long workers may take to stop."""

COUNT_S = 1.0
"""How old a count of the workers may be."""


@contextmanager
def cluster(scheduler: str) -> Iterator[Callable[[], "ClusterWorkers"]]:
    """Workers of a scheduler, for the block.

    Parameters
    ----------
    scheduler : str
        Its address, ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.

    Yields
    ------
    callable
        Connects at its first call, and returns the workers.

    Raises
    ------
    InputError
        If dask.distributed is not installed, or the address cannot be one.
    CampaignError
        From the call, if no scheduler answers there.
    """
    need("`scheduler`", "dask", "distributed")
    _host_and_port(scheduler)
    _check_certificates(scheduler)
    with ExitStack() as stack:

        def connect() -> ClusterWorkers:
            stack.enter_context(_silence())
            return ClusterWorkers(stack.enter_context(_connected(scheduler)))

        yield cache(connect)


def _check_certificates(scheduler: str) -> None:
    """Refuse an encrypted connection that dask's settings have no certificates for."""
    from distributed.security import Security

    if not scheduler.startswith("tls:"):
        return
    try:
        found = Security().get_connection_args("client").get("ssl_context")
    except OSError as error:  # of SSL too
        raise InputError(f"`scheduler` {scheduler}: dask's certificates: {error}.") from error
    if found is None:
        raise InputError(
            f"`scheduler` {scheduler} must have certificates: set ca-file, client.cert and "
            "client.key of distributed.comm.tls in dask's settings."
        )


@contextmanager
def _connected(scheduler: str) -> "Iterator[Client]":
    import dask.config
    from distributed import Client

    with dask.config.set({"distributed.comm.timeouts.connect": CONNECT_S}):
        try:
            # Where no process listens this fails at once; dask tries for as long as it may.
            socket.create_connection(_host_and_port(scheduler), CONNECT_S).close()
            client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise CampaignError(f"{scheduler}: no scheduler answers there: {error}") from error
        with client:
            yield client


def _host_and_port(scheduler: str) -> tuple[str, int]:
    try:
        at = urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
        found = at.hostname, at.port
    except ValueError:
        found = None, None
    if not found[0] or not found[1]:
        raise InputError(f"`scheduler` must be tcp://HOST:PORT, got {scheduler!r}.")
    return found[0], found[1]


@contextmanager
def _silence() -> Iterator[None]:
    import distributed  # noqa: F401  (sets its loggers up when it is imported)

    loggers = [logging.getLogger(name) for name in QUIET]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


class ClusterWorkers:
    """Workers of one cluster, see `flighttune.campaign.engine.tasks.Workers`.

    Parameters
    ----------
    client : distributed.Client
    """

    def __init__(self, client: "Client") -> None:
        self._client = client
        self._threads, self._counted = 0, -math.inf
        self._tasks: dict[str, tuple[Future, Task]] = {}
        self._over: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._campaign = uuid.uuid4().hex

    @property
    def waiting(self) -> int:
        """Tasks that are not over."""
        return len(self._tasks)

    def threads(self) -> int:
        """How many tasks can run at a time now, to a second."""
        if time.monotonic() > self._counted + COUNT_S:
            with self._reached():
                workers = self._client.scheduler_info(n_workers=-1)["workers"]
            self._threads = sum(worker["nthreads"] for worker in workers.values())
            self._counted = time.monotonic()
        return self._threads

    def submit(self, task: Task) -> None:
        """Hand out a task."""
        where = task.function.__module__, task.function.__name__
        key = f"flighttune-{self._campaign}-{uuid.uuid4().hex}"
        with self._reached():
            future = self._client.submit(_call, *where, *task.arguments, key=key, pure=False)
            self._tasks[key] = future, task
            future.add_done_callback(self._over.put)

    def wait(self, seconds: float) -> list[Done]:
        """Tasks that are over, after at most `seconds`.

        Raises
        ------
        CampaignError
            If the scheduler is gone, or a worker cannot run our tasks.
        """
        over: list[Future] = []
        with suppress(queue.Empty):
            over.append(self._over.get(timeout=seconds))
            while True:
                over.append(self._over.get_nowait())
        if self._client.status != "running":
            raise self._gone()
        return [self._done(future) for future in over if future.key in self._tasks]

    def stop(self) -> None:
        """Take back all tasks; flights in progress end where they are."""

        def take_back() -> None:
            with suppress(Exception):  # the workers may be gone
                self._client.cancel([future for future, _ in self._tasks.values()], force=True)

        # in a thread, because it waits for as long as a scheduler does not answer
        thread = threading.Thread(target=take_back, daemon=True)
        thread.start()
        thread.join(STOP_S)
        self._tasks.clear()

    def _done(self, future: "Future") -> Done:
        _, task = self._tasks.pop(str(future.key))
        with self._reached():
            if future.status == "finished":
                return Done(task, future.result())
            if future.status == "error":
                error: Any = future.exception()
                if type(error).__name__ != "KilledWorker":
                    raise translated(error) from error
        return Done(task, lost=True)

    @contextmanager
    def _reached(self) -> Iterator[None]:
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
