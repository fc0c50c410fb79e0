"""The work of a worker, here or on a cluster: each draw is flown by a process of its own.

A crash inside JSBSim therefore costs a row and not the campaign. The process answers run by run:
where it ends, the run that it was flying is to blame, and the runs after it go to a new process.
"""

import os
import pickle
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from multiprocessing import Pipe
from typing import TYPE_CHECKING, TypeAlias

from flighttune.errors import CampaignError, PlantError, crash_of
from flighttune.shipped import TRUST_AIRCRAFT
from flighttune.whole_file import reason_of, scratch_folder

if TYPE_CHECKING:
    from flighttune.campaign.flying.rows import Draw, Probes, Row
    from flighttune.campaign.planning.plan import Plan

SERVER = "flighttune.campaign.engine.server"

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Set to 1 in each process: one flight uses one core, and BLAS gives the same bits everywhere."""

Answer: TypeAlias = "Row | bytes | tuple[str, str]"
"""Row of a run or its recorded signals, or else the status and reason of a run without a row."""

OF_THREAD = threading.local()


class Flyer:
    """Client of the process that flies for one thread; starts a new one after each crash."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False

    def fly(self, work: bytes, draw: "Draw", limit: float, signals: bool) -> list[Answer]:
        """An answer for each run of a draw; `work` is what `work_of` makes.

        `limit` (s) is the longest time of each flight. PlantError if the process cannot start, or
        cannot fly this plan.
        """
        answers: list[Answer] = []
        ends = 0  # of processes that worked on the run that is next
        while len(answers) < len(draw.runs):
            left = draw._replace(runs=draw.runs[len(answers) :])
            ready = False
            self.start()
            try:
                self._pipe.send((work, left, limit, signals))
                if refusal := self._pipe.recv():
                    raise PlantError(refusal)
                ready = True
                for _ in left.runs:
                    answers.append(self._pipe.recv())
                    ends = 0
                    if isinstance(answers[-1], tuple):
                        break  # the process did not go on with the runs after it
            except (EOFError, OSError):
                code, ends = self.end(), ends + 1
                if ready and code == -signal.SIGALRM:
                    reason = f"the flight must end within {limit:g} s of wall time"
                    answers.append(("timed_out", reason))
                    ends = 0
                elif ends == 2:  # an operator, or the system out of memory, may have ended one
                    how = crash_of(code) or f"exit status {code}"
                    if not ready:
                        raise PlantError(
                            f"the undispersed flights cannot be flown: {how}"
                        ) from None
                    reason = f"the flight ended the process that flew it: {how}"
                    answers.append(("crashed", reason))
                    ends = 0
        return answers

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


def fly(work: bytes, draw: "Draw", limit: float, signals: bool) -> list[Answer]:
    """`Flyer.fly` by the process of this thread."""
    if not hasattr(OF_THREAD, "flyer"):  # on a worker of a cluster
        OF_THREAD.flyer = Flyer()
    return OF_THREAD.flyer.fly(work, draw, limit, signals)


def work_of(plan: "Plan", probes: "Probes") -> bytes:
    """A plan and probes as processes get them, with the libraries that rows must come from."""
    from flighttune.flight.fly import library_versions

    # The versions are compared before the rest is read, which other versions may not be able to.
    # A replaced plan is one without the draws that it has made so far.
    return pickle.dumps((library_versions(), pickle.dumps((replace(plan), probes))))


def failure(error: BaseException) -> CampaignError:
    """Error of the campaign for an exception of a worker."""
    if isinstance(error, PlantError):
        return CampaignError(f"a worker cannot fly for this campaign: {error}")
    if isinstance(error, ModuleNotFoundError):
        return CampaignError(f"a worker has no `{error.name}`: install flighttune there")
    return CampaignError(f"a worker failed: {type(error).__name__}: {error}")
