"""The process that flies: runs in, rows out. What a run does to it, it does to nobody else.

It is started by `FlyerProcess`, reads requests from its standard input and writes messages to its
standard output: a byte that says what it is, a run (8 bytes), a length (8 bytes) and the payload.
"""

import json
import os
import queue
import signal
import struct
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    from flighttune.campaign.planning.plan import Plan

HEADER = struct.Struct("<cqq")
READY, BEGINS, ROWS, SIGNALS, RAISED, UNFIT = b"v", b"b", b"r", b"s", b"e", b"u"
ORPHAN_LIMITS = 2.0
"""After this many time limits the process ends by itself: its parent, which ends it at the first,
is gone."""


class Flyer:
    """Flies what it is asked for.

    Parameters
    ----------
    out : binary file
        Where messages go.
    """

    def __init__(self, out: BinaryIO) -> None:
        self._out = out
        self._text, self._plan = "", None

    def tell(self, kind: bytes, run: int = -1, payload: bytes = b"") -> None:
        """Send one message."""
        self._out.write(HEADER.pack(kind, run, len(payload)) + payload)
        self._out.flush()

    def serve(self, request: dict[str, Any]) -> None:
        """Answer one request: rows of a range of runs, or the signals of one run."""
        limit = request["limit"]
        plan = self._planned(request["plan"])
        if isinstance(plan, str):
            self.tell(UNFIT, payload=plan.encode())
            return

        def begins(run: int) -> None:
            _end_after(ORPHAN_LIMITS * limit)
            self.tell(BEGINS, run)

        try:
            if "signals" in request:
                begins(request["signals"])
                self.tell(SIGNALS, request["signals"], _signals(plan, request["signals"]))
            else:
                self._rows(plan, request["first"], request["end"], begins)
        except Exception as error:  # whatever a run does, it is the outcome of that run
            self.tell(RAISED, payload=f"{type(error).__name__}: {error}".encode())
        finally:
            _end_after(0.0)

    def _rows(self, plan: "Plan", first: int, end: int, begins: Any) -> None:
        import pyarrow as pa

        from flighttune.campaign.flying.rows import fly_runs

        started = time.perf_counter()
        rows = fly_runs(plan, range(first, end), begins=begins)
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, rows.schema) as stream:
            stream.write_table(rows)
        took = struct.pack("<d", time.perf_counter() - started)
        self.tell(ROWS, first, took + sink.getvalue().to_pybytes())

    def _planned(self, text: str) -> "Plan | str":
        """The plan, ready to fly; or why rows flown here would not be those of the campaign."""
        if self._plan is None or text != self._text:
            from flighttune.campaign.flying.warm_up import warm_up
            from flighttune.campaign.planning.make import files_hash
            from flighttune.campaign.planning.plan import plan_from
            from flighttune.errors import FlightTuneError

            try:
                plan = plan_from(json.loads(text))
                for name, was in plan.aircraft.items():
                    if files_hash(name) != was:
                        return f"the files of aircraft {name} must be those it was planned with"
            except FlightTuneError as error:
                return str(error)
            warm_up(plan)
            self._text, self._plan = text, plan
        return self._plan


def _signals(plan: "Plan", run: int) -> bytes:
    """The recording of a run, as `write_run` writes it."""
    from flighttune.campaign.flying.rows import fly_run
    from flighttune.recording.parquet import write_run

    with tempfile.TemporaryDirectory(prefix="flighttune-") as folder:
        path = Path(folder) / "run.parquet"
        write_run(fly_run(plan, run), path)
        return path.read_bytes()


def _end_after(seconds: float) -> None:
    """End this process after `seconds` whatever it does then, also inside JSBSim; 0: do not."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _leave_no_core() -> None:
    """Let no image of this process be written to the working folder when a flight ends it."""
    with suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _requests(source: BinaryIO) -> "queue.SimpleQueue[dict[str, Any]]":
    """Requests as they come; at their end, or when the parent is gone, the process ends."""
    waiting: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()

    def read() -> None:
        for line in source:
            waiting.put(json.loads(line))
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    return waiting


def main() -> None:
    """Serve until standard input ends. Nothing but messages gets to standard output."""
    _leave_no_core()
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    waiting = _requests(sys.stdin.buffer)
    from flighttune.one_flight import library_versions

    flyer = Flyer(out)
    flyer.tell(READY, payload=json.dumps(library_versions()).encode())
    while True:
        flyer.serve(waiting.get())


if __name__ == "__main__":
    main()
