"""Processes that work for this one, here or on a cluster: the only importer of dask.distributed."""

import logging
import math
import os
import queue
import signal
import socket
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from flighttune.errors import CampaignError, InputError

if TYPE_CHECKING:
    from distributed import Client, Future

LOCAL = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.scheduler.allowed-failures": 0,
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.admin.tick.interval": "5s",
    "distributed.admin.tick.limit": "60s",
}
"""Settings of dask for a cluster of our own; those of a cluster elsewhere are its owner's."""

QUIET = ("distributed", "distributed.worker", "distributed.scheduler", "distributed.nanny",
         "distributed.client", "distributed.core", "tornado.application", "asyncio")  # fmt: skip
NEEDED = ("dask", "distributed", "fsspec")
INSTALL = "install it with: pip install 'flighttune[cluster]'"
CONNECT_S = 10.0
STOP_S = 5.0
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


@contextmanager
def cluster(
    workers: int | None = None, scheduler: str | None = None
) -> Iterator[Callable[[], Workers]]:
    """Workers for the block: processes of this machine, or those of a scheduler elsewhere.

    Parameters
    ----------
    workers : int, optional
        Processes on this machine; by default one a core.
    scheduler : str, optional
        Address of a scheduler, ``tcp://HOST:PORT``, instead.

    Yields
    ------
    callable
        Returns the workers, which are there from its first call on.

    Raises
    ------
    InputError
        If dask.distributed is not installed, or the arguments cannot be used.
    CampaignError
        If nobody answers at the address: from the call.
    """
    if workers is not None and scheduler is not None:
        raise InputError("`workers` must not be given with `scheduler`, which has its own.")
    if workers is not None and workers < 1:
        raise InputError(f"`workers` must be at least 1, got {workers}.")
    check_installed()
    with ExitStack() as stack:

        def hire() -> Workers:
            stack.enter_context(_silence())
            if scheduler is None:
                client = stack.enter_context(_local(workers or cores()))
            else:
                client = stack.enter_context(_remote(scheduler))
            return Workers(client, ours=scheduler is None)

        yield cache(hire)


def check_installed() -> None:
    """Check that what campaigns are flown with is there.

    Raises
    ------
    InputError
        If it is not; the message says how to install it.
    """
    if not all(map(find_spec, NEEDED)):
        raise InputError(f"campaigns need {', '.join(NEEDED)}; {INSTALL}")


def cores() -> int:
    """Processor cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _local(workers: int) -> "Iterator[Client]":
    import dask.config
    from distributed import Client, LocalCluster

    with (
        tempfile.TemporaryDirectory(prefix="flighttune-", ignore_cleanup_errors=True) as folder,
        dask.config.set({**LOCAL, "temporary-directory": folder}),
    ):
        with _deaf_to_ctrl_c():
            made = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
                local_directory=folder,
            )
        with made, Client(made, set_as_default=False) as client:
            yield client


@contextmanager
def _remote(scheduler: str) -> "Iterator[Client]":
    import dask.config
    from distributed import Client

    with dask.config.set({"distributed.comm.timeouts.connect": CONNECT_S}):
        try:
            _knock(scheduler)
            client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise CampaignError(f"{scheduler}: no scheduler answers there: {error}") from error
        with client:
            yield client


def _knock(scheduler: str) -> None:
    """Raise OSError at once where nobody listens; dask tries for as long as it may take."""
    at = urlsplit(scheduler)
    if at.hostname and at.port:
        socket.create_connection((at.hostname, at.port), CONNECT_S).close()


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Let threads and processes started in the block, and theirs, not be reached by Ctrl-C.

    It is for the main process to end them. They inherit which signals are held back.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # it would let signals through when it is started
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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


def _call(module: str, name: str, *arguments: Any) -> Any:
    from importlib import import_module

    return getattr(import_module(module), name)(*arguments)


# Sent as code and not by name: a worker that cannot import what it is sent never answers.
_call.__module__ = "__main__"


def _translated(error: BaseException | None) -> CampaignError:
    if isinstance(error, ModuleNotFoundError):
        return CampaignError(f"a worker has no `{error.name}`: install flighttune there")
    return CampaignError(f"a worker failed: {type(error).__name__}: {error}")
