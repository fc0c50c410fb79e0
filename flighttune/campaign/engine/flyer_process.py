"""A process that flies for this one: started when needed, watched, and replaced when it falls."""

import json
import os
import queue
import signal
import struct
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import IO, Any, TypeAlias

from flighttune.campaign.engine.flyer import BEGINS, HEADER, RAISED, READY, ROWS, SIGNALS, UNFIT
from flighttune.errors import PlantError

START_S = 120.0
"""Longest time a process may take to start, and to load and compile what a plan needs."""

ENDING_S = 10.0
"""Longest time a process may take to end after its output has."""

SILENT, ENDED = b"?", b"."

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

Message: TypeAlias = tuple[bytes, int, bytes]


@dataclass(frozen=True, slots=True)
class Flown:
    """Rows of a range of runs, or the recording of one, and how long it took."""

    data: bytes
    seconds: float


@dataclass(frozen=True, slots=True)
class Fallen:
    """What became of the process while a run was flown.

    Attributes
    ----------
    run : int
        The run that had begun last; -1 where none had.
    status : str
        ``crashed`` or ``timed_out``.
    reason : str
        A sentence.
    """

    run: int
    status: str
    reason: str


class FlyerProcess:
    """One process that flies; a new one is started after each that fell."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._messages: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._retired = False
        self.versions: dict[str, str] = {}

    def start(self) -> None:
        """Start the process, if there is none.

        Raises
        ------
        PlantError
            If it does not come up.
        """
        if self._process is not None:
            return
        if self._retired:
            raise PlantError("the process that flies has been retired.")
        self._messages = queue.SimpleQueue()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "flighttune.campaign.engine.flyer"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **dict.fromkeys(THREADS, "1")},
        )
        assert self._process.stdout is not None
        threading.Thread(
            target=_read, args=(self._process.stdout, self._messages), daemon=True
        ).start()
        kind, _, payload = self._next(START_S)
        if kind != READY:
            how = self._how_it_ended() if kind == ENDED else "nothing in time"
            self.close()
            raise PlantError(f"the process that flies must start, got: {how}.")
        self.versions = json.loads(payload)

    def rows(self, plan: str, first: int, end: int, limit: float) -> Flown | Fallen:
        """Fly the runs `first` to `end` of a plan (its JSON), none longer than `limit` (s).

        Raises
        ------
        PlantError
            If the process does not come up, or has not the files that the plan was made with.
        """
        return self._ask({"plan": plan, "first": first, "end": end, "limit": limit}, limit)

    def signals(self, plan: str, run: int, limit: float) -> Flown | Fallen:
        """Fly a run of a plan (its JSON) for its signals, not longer than `limit` (s)."""
        return self._ask({"plan": plan, "signals": run, "limit": limit}, limit)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            with suppress(OSError):
                self._process.kill()
            self._process.wait()
            if self._process.stdin is not None:
                with suppress(OSError):
                    self._process.stdin.close()
            self._process = None

    def retire(self) -> None:
        """End the process for good, from any thread; the flight it is at has fallen."""
        self._retired = True
        process = self._process
        if process is not None:
            with suppress(OSError):
                process.kill()

    def _ask(self, request: dict[str, Any], limit: float) -> Flown | Fallen:
        self.start()
        assert self._process is not None
        assert self._process.stdin is not None
        with suppress(OSError):  # it is gone already: the answer says so
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
            self._process.stdin.flush()
        run, seconds = -1, START_S
        while True:
            kind, about, payload = self._next(seconds)
            if kind == BEGINS:
                run, seconds = about, limit
            elif kind == ROWS:
                return Flown(payload[8:], struct.unpack("<d", payload[:8])[0])
            elif kind == SIGNALS:
                return Flown(payload, 0.0)
            elif kind == RAISED:
                return Fallen(run, "crashed", payload.decode())
            elif kind == UNFIT:
                raise PlantError(payload.decode())
            elif kind == SILENT:
                self.close()
                return Fallen(
                    run, "timed_out", f"the flight must end within {seconds:g} s of wall time"
                )
            else:
                how = self._how_it_ended()
                return Fallen(run, "crashed", f"the flight ended the process that flew it: {how}")

    def _next(self, seconds: float) -> Message:
        try:
            return self._messages.get(timeout=seconds)
        except queue.Empty:
            return SILENT, -1, b""

    def _how_it_ended(self) -> str:
        """Say how the process ended; there is none afterwards."""
        assert self._process is not None
        try:
            code = self._process.wait(ENDING_S)
        except subprocess.TimeoutExpired:
            return "its output closed"
        finally:
            self.close()
        if code >= 0:
            return f"exit status {code}"
        with suppress(ValueError):
            return signal.Signals(-code).name
        return f"signal {-code}"


def _read(stream: IO[bytes], messages: "queue.SimpleQueue[Message]") -> None:
    """Take messages off a stream until it ends."""
    with stream:
        while len(header := stream.read(HEADER.size)) == HEADER.size:
            kind, run, length = HEADER.unpack(header)
            payload = stream.read(length)
            if len(payload) < length:
                break
            messages.put((kind, run, payload))
    messages.put((ENDED, -1, b""))
