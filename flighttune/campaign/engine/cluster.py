"""Workers for this process, here or on a cluster: with their tasks, the only importer of dask."""

import logging
import os
import signal
import socket
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib.util import find_spec
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from flighttune.campaign.engine.cluster_tasks import Workers
from flighttune.errors import CampaignError, InputError

if TYPE_CHECKING:
    from distributed import Client

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
    if scheduler is not None:
        _host_and_port(scheduler)
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
        _environment_kept(),
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
def _environment_kept() -> Iterator[None]:
    """Undo what dask writes to the environment for its workers: threads of BLAS change bits."""
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


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
    socket.create_connection(_host_and_port(scheduler), CONNECT_S).close()


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
