"""Workers of a dask cluster elsewhere: the only importer of dask."""

import logging
import math
import pickle
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from flighttune.campaign.engine.flyer import failure
from flighttune.errors import CampaignError, InputError
from flighttune.extras import need

if TYPE_CHECKING:
    from distributed import Client

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
"""Time that workers may take to stop."""

COUNT_S = 1.0
"""Largest age of a count of the workers."""


@contextmanager
def cluster(scheduler: str) -> Iterator[Callable[[], "ClusterWorkers"]]:
    """Connection to a scheduler for the block: a call makes it, and returns the workers.

    `scheduler` is its address, ``tcp://HOST:PORT`` or ``tls://HOST:PORT``. InputError if
    dask.distributed is not installed, or the address cannot be one; CampaignError from the call if
    no scheduler answers there.
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
        context = Security().get_connection_args("client").get("ssl_context")
    except OSError as error:  # of SSL too
        raise InputError(f"`scheduler` {scheduler}: dask's certificates: {error}.") from error
    if context is None:
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
        if at.hostname and at.port:
            return at.hostname, at.port
    except ValueError:  # of a port that is no number
        pass
    raise InputError(f"`scheduler` must be tcp://HOST:PORT, got {scheduler!r}.")


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
    """Workers of one cluster."""

    max_draws = 8  # of a task: to hand one out takes 1 ms

    def __init__(self, client: "Client") -> None:
        self._client = client
        self._threads, self._counted = 0, -math.inf
        self._executor = client.get_executor(pure=False)

    def threads(self) -> int:
        """Number of tasks that can run at a time; CampaignError if the cluster is gone."""
        if self._client.status != "running":
            raise self._gone()
        if time.monotonic() > self._counted + COUNT_S:
            try:
                workers = self._client.scheduler_info(n_workers=-1)["workers"]
            except (CancelledError, OSError, TimeoutError) as error:
                raise self._gone() from error
            self._threads = sum(worker["nthreads"] for worker in workers.values())
            self._counted = time.monotonic()
        return self._threads

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Hand out a call of a function of a module."""
        where = function.__module__, function.__name__
        # as bytes: a scheduler unpickles arguments, and needs no flighttune
        return self._executor.submit(_call, *where, pickle.dumps(arguments))

    def failure(self, error: BaseException) -> CampaignError:
        """Error of the campaign for a task that failed or was cancelled."""
        if isinstance(error, (CancelledError, OSError, TimeoutError)):
            return self._gone()
        if type(error).__name__ == "KilledWorker":
            return CampaignError(f"workers of the cluster end again and again: {error}")
        return failure(error)

    def stop(self) -> None:
        """Take back all tasks; flights in progress end where they are."""

        def take_back() -> None:
            with suppress(Exception):  # the workers may be gone
                self._client.cancel(list(self._client.futures), force=True)

        # in a thread, because it waits for as long as a scheduler does not answer
        thread = threading.Thread(target=take_back, daemon=True)
        thread.start()
        thread.join(STOP_S)

    def _gone(self) -> CampaignError:
        where = self._client.scheduler.address if self._client.scheduler else "the scheduler"
        return CampaignError(f"{where}: the connection to the scheduler is lost")


def _call(module: str, name: str, arguments: bytes) -> Any:
    from importlib import import_module
    from pickle import loads

    function = getattr(import_module(module), name)  # first, so that what is missing is named
    return function(*loads(arguments))


# Sent as code and not by name: a worker that cannot import what it is sent never answers.
_call.__module__ = "__main__"
