"""Workers here or on a cluster, and the tasks they do: the only importer of dask."""

import logging
import math
import os
import queue
import signal
import socket
import threading
import time
import uuid
from collections.abc import Callable, Hashable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib.util import find_spec
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import urlsplit

from flighttune.errors import CampaignError, InputError
from flighttune.file_lock import scratch_folder
from flighttune.simulate.batch import cores

if TYPE_CHECKING:
    from distributed import Client, Future

LOCAL = {
    # Samples every thread's stack 100 times a second, for a profile that is never read.
    "distributed.worker.profile.enabled": False,
    # A worker holds a few kB of rows. Memory is taken by the processes that fly, which dask neither
    # sees nor can free.
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.monitor-interval": "1s",
    # A task that loses its worker comes back at once: it is handed out again here, and counted.
    "distributed.scheduler.allowed-failures": 0,
    # Few tasks wait at a time, each for a worker that is nearly ready for it; moving them costs
    # more messages than it saves.
    "distributed.scheduler.work-stealing": False,
    # Looks for copies of results to drop; a result is fetched once and is gone.
    "distributed.scheduler.active-memory-manager.start": False,
    # Charts of a dashboard that is not opened.
    "distributed.admin.system-monitor.interval": "10s",
    # Watches for a blocked event loop, and warns; on a loaded machine it is blocked now and then.
    "distributed.admin.tick.interval": "5s",
    "distributed.admin.tick.limit": "60s",
}
"""Settings of dask for a cluster of our own; those of a cluster elsewhere are its owner's."""

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

NEEDED = ("dask", "distributed")
INSTALL = "install it with: pip install 'flighttune[cluster]'"
CONNECT_S = 10.0

STOP_S = 5.0
"""How long workers may take to stop."""

COUNT_S = 1.0
"""How old a count of the workers may be."""


@contextmanager
def cluster(
    workers: int | None = None, scheduler: str | None = None
) -> Iterator[Callable[[], "Workers"]]:
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
        Starts the workers at its first call, and returns them.

    Raises
    ------
    InputError
        If dask.distributed is not installed, or the arguments cannot be used.
    CampaignError
        From the call, if no scheduler answers at the address.
    """
    if workers is not None and scheduler is not None:
        raise InputError("`workers` must not be given with `scheduler`, which has its own.")
    if workers is not None and workers < 1:
        raise InputError(f"`workers` must be at least 1, got {workers}.")
    check_installed()
    if scheduler is not None:
        _host_and_port(scheduler)
        _check_certificates(scheduler)
    with ExitStack() as stack:

        def start() -> Workers:
            stack.enter_context(_silence())
            if scheduler is None:
                client = stack.enter_context(_local(workers or cores()))
            else:
                client = stack.enter_context(_remote(scheduler))
            return Workers(client, ours=scheduler is None)

        yield cache(start)


def check_installed() -> None:
    """Check that what campaigns are flown with is there.

    Raises
    ------
    InputError
        If it is not; the message says how to install it.
    """
    if not all(map(find_spec, NEEDED)):
        raise InputError(f"campaigns need {', '.join(NEEDED)}; {INSTALL}")


@contextmanager
def _local(workers: int) -> "Iterator[Client]":
    import dask.config
    from distributed import Client, LocalCluster

    with (
        _environment_kept(),
        scratch_folder() as folder,
        dask.config.set({**LOCAL, "temporary-directory": str(folder)}),
    ):
        with _ctrl_c_blocked():
            made = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,  # one flight a core
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
                local_directory=str(folder),
            )
        with made, Client(made, set_as_default=False) as client:
            yield client


@contextmanager
def _environment_kept() -> Iterator[None]:
    """Undo what dask writes to the environment for its workers: threads of BLAS change bits."""
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


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
def _remote(scheduler: str) -> "Iterator[Client]":
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
def _ctrl_c_blocked() -> Iterator[None]:
    """Let Ctrl-C not reach the threads and processes started in the block, and theirs.

    A terminal sends it to all of them; it is for the main process alone to end them. They inherit
    which signals are blocked.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Python unblocks SIGINT where it starts this process: started before, it does not.
    resource_tracker.ensure_running()
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


class Task(NamedTuple):
    """A call for a worker.

    Attributes
    ----------
    about : hashable
        The run or runs it is about.
    function : callable
        Of a module.
    arguments : tuple
    """

    about: Hashable
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


class Done(NamedTuple):
    """A task that is over.

    Attributes
    ----------
    task : Task
    value : object
        What it returned.
    lost : bool
        Whether its worker went away before it returned.
    """

    task: Task
    value: Any = None
    lost: bool = False


class Workers:
    """Workers of one cluster, and the tasks they have.

    Attributes
    ----------
    ours : bool
        Whether they are processes of this machine, started for this campaign.
    """

    def __init__(self, client: "Client", *, ours: bool) -> None:
        self._client = client
        self.ours = ours
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
            with self._connected():
                workers = self._client.scheduler_info(n_workers=-1)["workers"]
            self._threads = sum(worker["nthreads"] for worker in workers.values())
            self._counted = time.monotonic()
        return self._threads

    def submit(self, task: Task) -> None:
        """Hand out a task."""
        where = task.function.__module__, task.function.__name__
        key = f"flighttune-{self._campaign}-{uuid.uuid4().hex}"
        with self._connected():
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

    def stop(self, cancel: Callable[[], object]) -> None:
        """Take back all tasks; workers of this machine call `cancel`, so that their tasks end."""

        def take_back() -> None:
            with suppress(Exception):  # the workers may be gone
                self._client.cancel([future for future, _ in self._tasks.values()], force=True)
                if self.ours:
                    self._client.run(cancel)

        # in a thread, because either call waits for as long as a scheduler does not answer
        thread = threading.Thread(target=take_back, daemon=True)
        thread.start()
        thread.join(STOP_S)
        self._tasks.clear()

    def _done(self, future: "Future") -> Done:
        _, task = self._tasks.pop(str(future.key))
        with self._connected():
            if future.status == "finished":
                return Done(task, future.result())
            if future.status == "error":
                error: Any = future.exception()
                if type(error).__name__ != "KilledWorker":
                    raise translated(error) from error
        return Done(task, lost=True)

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


def translated(error: BaseException | None) -> CampaignError:
    """What a task raised, as an error of the campaign."""
    if isinstance(error, ModuleNotFoundError):
        return CampaignError(f"a worker has no `{error.name}`: install flighttune there")
    return CampaignError(f"a worker failed: {type(error).__name__}: {error}")
