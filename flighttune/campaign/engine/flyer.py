"""The work of a worker, here or on a cluster: each draw is flown by a process of its own.

A crash inside JSBSim therefore costs a row and not the campaign. A draw whose process crashes or is
stopped at the time limit is flown again run by run, so that only the run to blame loses its row.
"""

import os
import pickle
import signal
import subprocess
import sys
import threading
from multiprocessing import Pipe
from typing import TYPE_CHECKING, Any, NamedTuple

from flighttune.errors import CampaignError, PlantError
from flighttune.processes import crash_of
from flighttune.scratch import scratch_folder
from flighttune.shipped import TRUST_AIRCRAFT
from flighttune.whole_file import reason_of

if TYPE_CHECKING:
    from flighttune.campaign.flying.rows import Draw, Drawn, Probes, Row
    from flighttune.campaign.planning.plan import Plan

SERVER = "flighttune.campaign.engine.server"

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Set to 1 in each process: one flight uses one core, and BLAS gives the same bits everywhere."""


class Lost(NamedTuple):
    """A run without a row: it ended its process (``crashed``) or was ``timed_out``."""

    run: int
    drawn: "Drawn"
    status: str
    reason: str


class Flyer:
    """Client of the process that flies for one thread; starts a new one after each crash."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False

    def ask(self, work: bytes, draw: "Draw", limit: float, *, signals: bool = False) -> Any:
        """Rows of a draw, or the signals of its run, or `Lost`; `work` is what `work_of` makes.

        `limit` (s) is the longest time of each flight. PlantError if the process cannot start, or
        cannot fly this plan.
        """
        code, preparing = 0, True
        for _ in range(2):  # somebody else may have killed a process that waited
            self.start()
            try:
                self._pipe.send((work, draw, limit, signals))
                if refusal := self._pipe.recv():
                    raise PlantError(refusal)
                preparing = False
                return self._pipe.recv()
            except (EOFError, OSError):
                code = self.end()
            if not preparing:
                break
        if preparing:
            raise PlantError(f"the undispersed flights cannot be flown: {_how(code)}")
        if code == -signal.SIGALRM:
            status, reason = "timed_out", f"the flight must end within {limit:g} s of wall time"
        else:
            status = "crashed"
            reason = f"the flight ended the process that flew it: {_how(code)}"
        return Lost(draw.runs[0], draw.drawn, status, reason)

    def close(self) -> None:
        """End the process for good, from any thread; the flight in progress is lost."""
        self._closed = True
        process = self._process
        if process is not None:
            process.kill()

    def start(self) -> None:
        """Start the process, unless it runs; PlantError if it cannot start, or after `close`."""
        if self._process is not None:
            return
        if self._closed:
            raise PlantError("the flights have been stopped.")
        self._scratch = scratch_folder()
        self._pipe, theirs = Pipe()
        command = [sys.executable, "-m", SERVER, str(theirs.fileno()), self._scratch.name]
        try:
            self._process = subprocess.Popen(
                command,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the command, which ends its processes
                env={**os.environ, **dict.fromkeys((*THREADS, TRUST_AIRCRAFT), "1")},
            )
        except OSError as error:
            self._scratch.cleanup()
            got = reason_of(error)
            raise PlantError(f"the process that flies must start, got: {got}.") from error
        finally:
            theirs.close()
        if self._closed:  # meanwhile, when there was no process yet to kill
            self._process.kill()

    def end(self) -> int:
        """End the process and remove what it left; return its exit code."""
        if self._process is None:
            return 0
        self._process.kill()
        code = self._process.wait()
        self._process = None
        self._pipe.close()
        self._scratch.cleanup()
        return code


def _how(code: int) -> str:
    return crash_of(code) or f"exit status {code}"


_OF_THREAD = threading.local()


def fly_by(flyer: Flyer) -> None:
    """Let this thread fly by a flyer."""
    _OF_THREAD.flyer = flyer


def _flyer() -> Flyer:
    if not hasattr(_OF_THREAD, "flyer"):  # on a worker of a cluster
        _OF_THREAD.flyer = Flyer()
    return _OF_THREAD.flyer


def fly_rows(work: bytes, draw: "Draw", limit: float) -> "list[Row | Lost]":
    """Rows of a draw; PlantError where its flights cannot be flown here."""
    answer = _flyer().ask(work, draw, limit)
    if isinstance(answer, Lost) and len(draw.runs) > 1:
        alone = [fly_rows(work, draw._replace(runs=(run,)), limit) for run in draw.runs]
        return [row for rows in alone for row in rows]
    if isinstance(answer, Lost) and answer.status == "crashed":
        # only a second crash counts: an operator, or the system out of memory, may have killed it
        answer = _flyer().ask(work, draw, limit)
    return [answer] if isinstance(answer, Lost) else answer


def fly_signals(work: bytes, draw: "Draw", limit: float) -> tuple[int, bytes]:
    """A run of a draw, and its recording; no bytes where the flight is lost."""
    answer = _flyer().ask(work, draw, limit, signals=True)
    return draw.runs[0], b"" if isinstance(answer, Lost) else answer


def work_of(plan: "Plan", probes: "Probes") -> bytes:
    """A plan and probes as processes get them, with the libraries that rows must come from."""
    from flighttune.flight.fly import library_versions

    return pickle.dumps((library_versions(), plan.as_dict(), probes))


def failure(error: BaseException) -> CampaignError:
    """Error of the campaign for an exception of a worker."""
    if isinstance(error, PlantError):
        return CampaignError(f"a worker cannot fly for this campaign: {error}")
    if isinstance(error, ModuleNotFoundError):
        return CampaignError(f"a worker has no `{error.name}`: install flighttune there")
    return CampaignError(f"a worker failed: {type(error).__name__}: {error}")
