"""The task of a worker, here or on a cluster: a separate process flies each draw.

A crash inside JSBSim therefore costs one row and not the campaign. The process answers run by run.
If it ends, the current run caused the crash, and a new process flies the runs after it.
"""

import atexit
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from flighttune.base.errors import FORKS, DifferenceError, PlantError, ending_of, need_fork
from flighttune.base.files import owned
from flighttune.base.files.shipped import OWN_AIRCRAFT, TRUST_AIRCRAFT
from flighttune.base.files.whole import lock, reason_of, scratch_folder, scratch_place
from flighttune.base.processors import cores

if TYPE_CHECKING:
    from flighttune.campaigns.flying.rows import Draw, Probes, Row
    from flighttune.campaigns.planning.plan import Plan

SERVER = "flighttune.campaigns.engine.server"

# Set to 1 in each process: a flight uses one core, and BLAS gives the same bits everywhere
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

# File in the temporary folder of a process, locked until the process ends in any way
LOCK = "lock"

# Maximum time until a thread notices that the flights have been stopped, s
STOP_S = 0.1

# Time beyond its own limit after which a process that does not answer is ended, s
GRACE_S = 10.0

# Time limit to load a plan, s. The first samples of its flights have the limit of a flight plus
# COMPILE_S, because their code may have to be compiled.
PREPARE_S, COMPILE_S = 120.0, 120.0

# Row of a run or its recorded signals; else an error or the exit code of its process, which is
# SIGALRM's code after the time limit.
Answer: TypeAlias = "Row | bytes | str | int"

OF_THREAD = threading.local()


class Flyer:
    """Client of the process that flies for one thread; it starts a new process after each crash."""

    def __init__(self) -> None:
        need_fork("the flights of a campaign")
        self.stopped = self._busy = False
        self._started_in = _surroundings()
        _remove_abandoned()
        self._start()

    def fly(self, work: bytes, draw: "Draw") -> list[Answer]:
        """An answer for each run of a draw; `work` comes from `work_of`."""
        answers: list[Answer] = []
        # Runs during or before which a process ended. The first time, a user or the out-of-memory
        # killer may have killed it.
        suspects: set[tuple[int, bool]] = set()
        self._busy = True
        while runs := draw.runs[len(answers) :]:
            ready, limit = False, PREPARE_S
            try:
                self._pipe.send((_folder(), work, draw._replace(runs=runs)))
                for _ in ("loaded", "compiled"):
                    limit = self._receive(limit + GRACE_S)
                    if isinstance(limit, str):  # a refusal
                        raise PlantError(limit)
                ready = True
                for _ in runs:
                    answer = self._receive(limit + GRACE_S)
                    if isinstance(answer, DifferenceError):
                        raise answer
                    answers.append(answer)
                    if isinstance(answers[-1], str):
                        break  # the process does not fly the remaining runs
            except (EOFError, OSError) as error:
                run, code = draw.runs[len(answers)], self.end()
                self._start()
                # A process that ended itself took too long; one that did not may have been stopped.
                alarm = -signal.SIGALRM
                if (run, ready) not in suspects and code != alarm:
                    suspects.add((run, ready))
                    continue
                code = alarm if isinstance(error, TimeoutError) else code
                if ready:
                    answers.append(code)
                else:
                    late = "they take longer than `time_limit_s` and the time to load them"
                    ending = late if code == alarm else ending_of(code)
                    raise PlantError(f"the undispersed flights cannot be flown: {ending}") from None
        self._busy = False
        return answers

    def is_ready(self) -> bool:
        """Whether it is alive and idle, and was started in the environment of today."""
        alive = self._process.poll() is None
        return alive and not self._busy and self._started_in == _surroundings()

    def end(self) -> int:
        """End the process and remove its temporary files; return its exit code."""
        self._process.kill()
        code = self._process.wait()
        self._pipe.close()
        self._scratch.cleanup()
        return code

    def _start(self) -> None:
        self._scratch = scratch_folder()
        self._pipe, theirs = Pipe()
        settings = {**dict.fromkeys((*THREADS, TRUST_AIRCRAFT), "1"), "TMPDIR": self._scratch.name}
        try:
            with Path(self._scratch.name, "new").open("wb") as lock_file:
                with suppress(OSError):  # not every file system has locks
                    lock(lock_file)
                    Path(lock_file.name).rename(Path(self._scratch.name, LOCK))
                self._process = subprocess.Popen(
                    [sys.executable, "-m", SERVER, str(theirs.fileno())],
                    pass_fds=[theirs.fileno(), lock_file.fileno()],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,  # Ctrl-C goes to the command, which ends its processes
                    env=os.environ | settings,
                )
        except OSError as error:
            self._scratch.cleanup()
            got = reason_of(error)
            place = error.filename or sys.executable
            raise PlantError(f"{place}: the process that flies must start, got: {got}.") from error
        finally:
            theirs.close()

    def _receive(self, limit: float) -> Any:
        end = time.monotonic() + limit
        while not self._pipe.poll(STOP_S):
            if self.stopped:
                raise PlantError("the flights have been stopped.")
            if time.monotonic() > end:  # it hangs or was stopped, and could not end itself
                raise TimeoutError
        return self._pipe.recv()


# Idle processes by the process that started them, so that a fork uses none of its parent's. They
# were started early or are kept, because the next verb would wait for their imports again.
_READY: dict[int, list[Flyer]] = {}


def _ready() -> list[Flyer]:
    return _READY.setdefault(os.getpid(), [])


def get_ready(workers: int | None) -> None:
    """Start processes, by default one a core, while their command reads what they shall fly."""
    if FORKS:
        missing = min(workers or cores(), cores()) - len(_ready())
        _ready().extend(Flyer() for _ in range(missing))


def take_ready() -> Flyer | None:
    """One of the processes without work, if there is one that is ready."""
    while ready := _ready():
        flyer = ready.pop()
        if flyer.is_ready():
            return flyer
        flyer.end()
    return None


def give_back(flyer: Flyer) -> None:
    """Keep a process for the next verb, at most one a core, or end it."""
    flyer.stopped = False
    if flyer.is_ready() and len(_ready()) < cores():
        _ready().append(flyer)
    else:
        flyer.end()


@atexit.register
def end_ready() -> None:
    """End the processes without work."""
    while (flyer := take_ready()) is not None:
        flyer.end()


def _surroundings() -> tuple[object, ...]:
    """What a process takes from the one that starts it, besides its folder."""
    names = ("HOME", "TMPDIR", "XDG_CACHE_HOME", "XDG_DATA_HOME", OWN_AIRCRAFT)
    return tuple(map(os.environ.get, names))


def _folder() -> str | None:
    """The working folder, in which a process reads relative paths; None if it is gone."""
    with suppress(OSError):
        return os.getcwd()
    return None


def _remove_abandoned() -> None:
    """Remove temporary folders of processes that were killed with their command."""
    for path in scratch_place().glob("flighttune-*"):
        with (
            suppress(OSError),  # locked, of another user, or just removed
            owned.opened(path, flags=owned.FOLDER) as folder,
            owned.opened(LOCK, folder) as file,
        ):
            if owned.is_mine(os.fstat(folder)) and owned.is_mine(os.fstat(file)):
                lock(file)
                shutil.rmtree(path)


def fly(work: bytes, draw: "Draw") -> list[Answer]:
    """`Flyer.fly` by the process of this thread."""
    if not hasattr(OF_THREAD, "flyer"):  # on a worker of a cluster
        OF_THREAD.flyer = Flyer()
    return OF_THREAD.flyer.fly(work, draw)


def work_of(plan: "Plan", probes: "Probes", *, signals: bool = False, again: bool = False) -> bytes:
    """A plan and probes, pickled for processes; with `signals` flights are recorded.

    `again`: JSBSim repeats each compiled flight.
    """
    from flighttune.base.files.code import grant
    from flighttune.flight.fly import library_versions

    # The versions are compared before the rest is read, because other versions may not be able to
    # read it. A replaced plan has no cached draws.
    content = replace(plan), probes, signals, again, grant()
    return pickle.dumps((library_versions(), pickle.dumps(content)))
