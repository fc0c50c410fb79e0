"""The process of a `Flyer`: ``python -m flighttune.campaigns.engine.server DESCRIPTOR``."""

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

from flighttune.base.errors import FlightTuneError, PlantError
from flighttune.base.files.code import Grant, take
from flighttune.campaigns.flying.rows import Draw, Row, fly_again, fly_draw, warm_up
from flighttune.campaigns.planning.plan import Plan
from flighttune.flight.fly import library_versions
from flighttune.flight.own import with_own
from flighttune.flight.records.parquet import parquet_bytes
from flighttune.flight.records.refly import changed_versions
from flighttune.vehicles.aircraft.aircraft import files_hash

# Longest time to load a plan, s. The first samples of its flights have another limit: that of a
# flight, and COMPILE_S: their code may have to be compiled.
PREPARE_S, COMPILE_S = 120.0, 120.0


def serve(pipe: Connection) -> None:
    """Fly what the pipe asks for until its other end is closed."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # no image of a crash in the working folder
    with suppress(EOFError, OSError):  # the parent was killed
        while True:
            work, draw = pipe.recv()
            try:
                with _time_limit(PREPARE_S):
                    plan, fly, granted = _prepared(work)
                    take(granted)
                    with_own(plan.scenario, flown=plan.flown)  # refuses a file that has changed
            except Exception as error:
                own = isinstance(error, FlightTuneError)
                pipe.send(str(error) if own else f"{type(error).__name__}: {error}")
                continue
            together = len(draw.runs) if draw.drawn is None else 1  # flown before the first row
            limit = plan.campaign.time_limit_s * together
            pipe.send(limit)  # from here on a crash is that of the flight
            answers = fly(draw)
            try:
                for _ in draw.runs:
                    with _time_limit(limit):
                        answer = next(answers)
                    pipe.send(answer)
            except Exception as error:  # whatever a run does, it is the outcome of that run
                pipe.send(f"{type(error).__name__}: {error}")
    shutil.rmtree(os.environ["TMPDIR"], ignore_errors=True)


@lru_cache(maxsize=2)
def _prepared(work: bytes) -> tuple[Plan, Callable[[Draw], Iterator[Row | bytes]], Grant]:
    """The plan, a function that flies the runs of a draw, and what may run."""
    wanted, content = pickle.loads(work)
    if other := changed_versions(dict.fromkeys(library_versions(), "absent") | wanted):
        raise PlantError(
            "; ".join(f"{name} must be {a}, got {b}" for name, (a, b) in other.items())
        )
    plan, probes, signals, granted = pickle.loads(content)
    take(granted)
    for name, was in plan.aircraft.items():
        if files_hash(name) != was:
            raise PlantError(f"the files of aircraft {name} must be those it was planned with")
    with _time_limit(COMPILE_S + plan.campaign.time_limit_s):
        warm_up(plan)

    def fly(draw: Draw) -> Iterator[Row | bytes]:
        if not signals:
            return fly_draw(plan, draw, probes)
        return (parquet_bytes(fly_again(plan, n)[plan.group_of(n).label]) for n in draw.runs)

    return plan, fly, granted


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """End this process by SIGALRM if the block takes longer."""
    # The system does it, by a signal without a handler: a thread of Python could not, while JSBSim
    # computes and does not release the interpreter. So it ends in time without its parent too.
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
