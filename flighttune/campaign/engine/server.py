"""The process of a `Flyer`: ``python -m flighttune.campaign.engine.server DESCRIPTOR FOLDER``."""

import os
import pickle
import resource
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from multiprocessing.connection import Connection

from flighttune.aircraft.aircraft import files_hash
from flighttune.campaign.flying.alone import fly_again
from flighttune.campaign.flying.claim import Claims, claims
from flighttune.campaign.flying.rows import Probes, Row, fly_draw, warm_up
from flighttune.campaign.planning.plan import Plan
from flighttune.errors import FlightTuneError, PlantError
from flighttune.flight.fly import library_versions
from flighttune.flight.own import with_own
from flighttune.flight.refly import changed_versions
from flighttune.recording.parquet import parquet_bytes

PREPARE_S = 120.0
"""Time to load a plan and to fly its undispersed flights."""


def serve(pipe: Connection, scratch: str) -> None:
    """Fly what the pipe asks for until its other end is closed."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # no image of a crash in the working folder
    tempfile.tempdir = os.environ["TMPDIR"] = scratch
    with suppress(EOFError, OSError):  # the parent is gone, maybe without a word
        while True:
            work, draw, limit, signals = pipe.recv()
            try:
                _end_after(PREPARE_S)
                plan, claim_of, probes = _prepared(work)
            except Exception as error:
                pipe.send(str(error) if isinstance(error, FlightTuneError) else repr(error))
                continue
            finally:
                _end_after(0.0)
            pipe.send("")  # from here on a crash is that of the flight
            flights: Iterator[Row | bytes] = (
                (parquet_bytes(fly_again(plan, n)[plan.group_of(n).label]) for n in draw.runs)
                if signals
                else fly_draw(plan, draw, claim_of, probes)
            )
            try:
                _end_after(limit)
                for answer in flights:
                    pipe.send(answer)
                    _end_after(limit)  # of the next flight
            except Exception as error:  # whatever a run does, it is the outcome of that run
                pipe.send(("crashed", f"{type(error).__name__}: {error}"))
            finally:
                _end_after(0.0)
    shutil.rmtree(scratch, ignore_errors=True)


@lru_cache(maxsize=2)
def _prepared(work: bytes) -> tuple[Plan, Claims, Probes]:
    """A plan, its claims and the probes; FlightTuneError if rows would be others than elsewhere."""
    wanted, content = pickle.loads(work)
    other = changed_versions(dict.fromkeys(library_versions(), "absent") | wanted)
    if other:
        raise PlantError(
            "; ".join(f"{name} must be {a}, got {b}" for name, (a, b) in other.items())
        )
    plan, probes = pickle.loads(content)
    for name, was in plan.aircraft.items():
        if files_hash(name) != was:
            raise PlantError(f"the files of aircraft {name} must be those it was planned with")
    with_own(plan.scenario)
    warm_up(plan)
    return plan, claims(plan), probes


def _end_after(seconds: float) -> None:
    """End this process by SIGALRM after `seconds`; 0: do not.

    The system does it, by a signal without a handler: a thread of Python could not, while JSBSim
    computes and does not release the interpreter. So a flight ends in time without its parent too.
    """
    signal.setitimer(signal.ITIMER_REAL, seconds)


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])), sys.argv[2])
