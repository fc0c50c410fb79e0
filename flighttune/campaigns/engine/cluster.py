"""Workers of a remote dask cluster: the only module that imports dask."""

import math
import pickle
import socket
import threading
import time
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from typing import Any
from urllib.parse import urlsplit

from flighttune.base.errors import CampaignError, InputError, PlantError, need
from flighttune.campaigns.engine.flyer import Answer
from flighttune.campaigns.flying.rows import Draw

# Loggers that report lost workers and closed connections, which are outcomes here
QUIET = ("distributed", "distributed.client", "tornado.application", "asyncio")

CONNECT_S = 10.0

# Maximum time for workers to stop
STOP_S = 5.0

# Maximum age of a count of the workers
COUNT_S = 1.0


def check_scheduler(scheduler: str) -> tuple[str, int]:
    """Host and port of the address of a scheduler; InputError if it cannot be one."""
    need("`scheduler`", "dask", "distributed")
    with suppress(ValueError):  # the port is not a number
        address = urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
        if address.hostname and address.port:
            return address.hostname, address.port
    raise InputError(f"`scheduler` must be tcp://HOST:PORT, got {scheduler!r}.")


class ClusterWorkers:
    """Workers of a scheduler's cluster; CampaignError if the scheduler does not answer."""

    def __init__(self, scheduler: str) -> None:
        import dask.config

        # set before the import of distributed, which reads the levels of its loggers from it
        dask.config.set(logging=dict.fromkeys(QUIET, "critical"))
        from distributed import Client

        self._scheduler = scheduler
        try:
            # This fails at once if no process listens; dask would retry until its timeout.
            socket.create_connection(check_scheduler(scheduler), CONNECT_S).close()
            with dask.config.set({"distributed.comm.timeouts.connect": CONNECT_S}):
                self._client: Any = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TypeError, ValueError) as error:  # TypeError: TLS without certificates
            raise CampaignError(f"{scheduler}: no scheduler answers there: {error}") from error
        self._threads, self._counted = 0, -math.inf
        self._executor = self._client.get_executor(pure=False)

    def threads(self) -> int:
        """Number of tasks that can run at a time; CampaignError if the cluster is gone."""
        if self._client.status != "running":
            raise campaign_error(ConnectionError(), self._scheduler)
        if time.monotonic() > self._counted + COUNT_S:
            try:
                self._threads = sum(self._client.nthreads().values())
            except (CancelledError, OSError) as error:
                raise campaign_error(error, self._scheduler) from error
            self._counted = time.monotonic()
        return self._threads

    def submit(self, work: bytes, draw: Draw) -> Future[list[Answer]]:
        """Submit the arguments of `flighttune.campaigns.engine.flyer.fly`."""
        # as bytes, because a scheduler unpickles arguments but may lack flighttune
        return self._executor.submit(_fly, pickle.dumps((work, draw)))

    def stop(self) -> None:
        """Cancel all tasks and disconnect; flights in progress are aborted."""

        def leave() -> None:
            with suppress(Exception):  # the workers may be gone
                self._client.cancel(list(self._client.futures), force=True)
                self._client.close()

        # in a thread, because it waits until the scheduler answers
        thread = threading.Thread(target=leave, daemon=True)
        thread.start()
        thread.join(STOP_S)


def campaign_error(error: BaseException, scheduler: str | None) -> CampaignError:
    """Error of the campaign for a task that failed or was cancelled."""
    match error:
        case CancelledError() | OSError() if scheduler:
            text = f"{scheduler}: the connection to the scheduler is lost"
        case PlantError():
            text = f"a worker cannot fly for this campaign: {error}"
        case ModuleNotFoundError():
            text = f"a worker has no `{error.name}`: install flighttune there"
        case Exception() if type(error).__name__ == "KilledWorker":
            text = f"workers of the cluster end again and again: {error}"
        case _:
            text = f"a worker failed: {type(error).__name__}: {error}"
    return CampaignError(text)


def _fly(task: bytes) -> Any:
    from pickle import loads

    from flighttune.campaigns.engine.flyer import fly  # first, so that a missing module is named

    return fly(*loads(task))


# Sent as code and not by name: a worker that cannot import a task never answers.
_fly.__module__ = "__main__"
