"""The process of a `Flyer`: ``python -m flighttune.campaigns.engine.server DESCRIPTOR``."""

import gc
import os
import pickle
import resource
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from multiprocessing.connection import Connection

from flighttune.base.errors import DifferenceError, FlightTuneError, PlantError
from flighttune.base.files.code import Grant, take
from flighttune.campaigns.engine.flyer import COMPILE_S, PREPARE_S
from flighttune.campaigns.flying.rows import Draw, Row, fly_again, fly_draw, warm_up
from flighttune.campaigns.planning.plan import Plan
from flighttune.flight.own import with_own
from flighttune.flight.records.parquet import parquet_bytes
from flighttune.flight.records.refly import other_versions
from flighttune.vehicles.aircraft.aircraft import files_hash


def serve(pipe: Connection) -> None:
    """Fly the requests of the pipe until its other end is closed."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # no core dump in the working folder
    here = None
    with suppress(EOFError, OSError):  # the parent was killed
        while True:
            folder, work, draw = pipe.recv()
            try:
                if folder not in (None, here):  # relative paths are those of the asking process
                    os.chdir(here := folder)
                    prepared.cache_clear()
                    warm.cache_clear()
                with _time_limit(PREPARE_S):
                    plan, fly, granted = prepared(work)
                    take(granted)
                    with_own(plan.scenario, flown=plan.flown)  # this refuses a changed file
                first = COMPILE_S + plan.campaign.time_limit_s
                pipe.send(first)
                with _time_limit(first):
                    warm(work)
            except Exception as error:
                own = isinstance(error, FlightTuneError)
                pipe.send(str(error) if own else f"{type(error).__name__}: {error}")
                continue
            together = len(draw.runs) if draw.drawn is None else 1  # flown before a row
            limit = plan.campaign.time_limit_s * together
            pipe.send(limit)  # from here on the flight causes a crash
            answers = fly(draw)
            try:
                for _ in draw.runs:
                    with _time_limit(limit):
                        answer = next(answers)
                    pipe.send(answer)
            except DifferenceError as error:  # no outcome of a run: it ends the command
                pipe.send(error)
            except Exception as error:  # any other error is the outcome of the run
                pipe.send(f"{type(error).__name__}: {error}")
    shutil.rmtree(os.environ["TMPDIR"], ignore_errors=True)


@lru_cache(maxsize=2)
def prepared(work: bytes) -> tuple[Plan, Callable[[Draw], Iterator[Row | bytes]], Grant]:
    """The plan, a function that flies the runs of a draw, and the permission to run code."""
    wanted, content = pickle.loads(work)
    if other := other_versions(wanted):
        raise PlantError(
            "; ".join(f"{name} must be {a}, got {b}" for name, (a, b) in other.items())
        )
    plan, probes, signals, again, granted = pickle.loads(content)
    take(granted)
    for name, was in plan.aircraft.items():
        if files_hash(name) != was:
            raise PlantError(f"the files of aircraft {name} must be those it was planned with")

    def fly(draw: Draw) -> Iterator[Row | bytes]:
        if not signals:
            return fly_draw(plan, draw, probes, again=again)
        return (parquet_bytes(fly_again(plan, n)[plan.group_of(n).label]) for n in draw.runs)

    return plan, fly, granted


@lru_cache(maxsize=2)
def warm(work: bytes) -> None:
    """Load the code for the flights of a plan."""
    warm_up(prepared(work)[0])
    # Collections would look at all that is loaded, for a tenth of a short row. What plans before
    # this one left is collected first, because frozen garbage stays for good.
    gc.unfreeze()
    gc.collect()
    gc.freeze()


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """End this process by SIGALRM if the block takes longer."""
    # The system ends it by a signal without a handler, since a Python thread cannot run while
    # JSBSim computes without releasing the interpreter. This also works if the parent is gone.
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
