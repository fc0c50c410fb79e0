"""Subprocess that flies runs, so that a crash inside JSBSim costs one process and not a worker.

`Flyer` is the side of the worker: it starts ``python -m flighttune.campaign.engine.flyer``, watches
it, and replaces it when it ends. Requests go to its standard input, messages come back from its
standard output: pickled dicts there, pickled tuples of a kind, a run and a payload here. The first
processes of a command may be forks of it instead, which need not import again what flights need.
"""

import ctypes
import json
import multiprocessing
import os
import pickle
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple, TypeAlias

from flighttune.errors import FlightTuneError, PlantError
from flighttune.processes import OWN_GROUP, can_be_copied, crash_of, ctrl_c_blocked
from flighttune.shipped import TRUST_AIRCRAFT
from flighttune.whole_file import reason_of

if TYPE_CHECKING:
    import pyarrow as pa

    from flighttune.campaign.planning.plan import Plan

START_S = 120.0
"""Longest time a process may take to start, and to load and compile what a plan needs."""

EXIT_S = 10.0
"""Longest time a process may take to exit after its output has closed."""

MOST_COPIES = 4
"""Most copies of the command: a fifth takes longer to make than it saves."""

ORPHAN_LIMITS = 2.0
"""After this many time limits of a run the process ends itself. Its parent ends it after one; a
process that is still there has no parent any more."""

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

SET_THREADS = [
    f"{before}openblas_set_num_threads{after}" for before in ("scipy_", "") for after in ("", "64_")
]
"""In the libraries of the wheels of NumPy and SciPy, and in those of distributions."""

Message: TypeAlias = tuple[str, int, Any]
"""Kind, run (-1 where it is about none) and payload."""


@dataclass(frozen=True, slots=True)
class FlyerAnswer:
    """Rows of a range of runs (an Arrow stream) or the recording of one, and how long it took."""

    data: bytes
    seconds: float


class CrashedRun(NamedTuple):
    """A run that ended the process that flew it, or took too long.

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


class Flyer:
    """Client of the subprocess that flies; starts a new one after each crash."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | _Copy | None = None
        self._messages: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._cancelled = self._ready = False
        self.versions: dict[str, str] = {}

    def launch(
        self, one_thread: Sequence[Callable[[int], Any]] = (), beside: Sequence["Flyer"] = ()
    ) -> None:
        """Start the process, and neither wait for it nor listen to it.

        Parameters
        ----------
        one_thread : sequence of callable
            Of `_thread_setters`; with them the process is a copy of this one.
        beside : sequence of Flyer
            Those launched before, whose pipes a copy must not hold.

        Raises
        ------
        OSError
            If the system has no room for a process.
        """
        self._messages, self._ready = queue.SimpleQueue(), False
        with ctrl_c_blocked():
            self._process = (
                _Copy(one_thread, [flyer.pipe_ends() for flyer in beside])
                if one_thread
                else subprocess.Popen(
                    [sys.executable, "-m", "flighttune.campaign.engine.flyer"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    creationflags=OWN_GROUP,
                    env={**os.environ, **dict.fromkeys((*THREADS, TRUST_AIRCRAFT), "1")},
                )
            )

    def pipe_ends(self) -> tuple[int, int]:
        """This side's ends of the pipes to the process: its input and its output."""
        assert self._process is not None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        return self._process.stdin.fileno(), self._process.stdout.fileno()

    def listen(self) -> None:
        """Take what the process says, in a thread of its own."""
        assert self._process is not None
        assert self._process.stdout is not None
        reader = threading.Thread(
            target=_read_messages, args=(self._process.stdout, self._messages), daemon=True
        )
        reader.start()

    def start(self) -> None:
        """Start the process, unless it runs, and wait until it can fly.

        Raises
        ------
        PlantError
            If it does not come up, or the flights have been cancelled.
        """
        if self._process is None:
            if self._cancelled:
                raise PlantError("the flights of this worker have been cancelled.")
            try:
                self.launch()
            except OSError as error:
                got = reason_of(error)
                raise PlantError(f"the process that flies must start, got: {got}.") from error
            self.listen()
        if self._ready:
            return
        kind, _, payload = self._next(START_S)
        if kind != "ready":
            how = self._exit() if kind == "ended" else "nothing in time"
            self.close()
            raise PlantError(f"the process that flies must start, got: {how}.")
        self.versions, self._ready = payload, True

    def rows(self, plan: str, first: int, end: int, limit: float) -> FlyerAnswer | CrashedRun:
        """Fly the runs `first` to `end` of a plan (its JSON), none longer than `limit` (s).

        Raises
        ------
        PlantError
            If the process does not come up, or has not the files that the plan was made with.
        """
        return self._ask({"plan": plan, "first": first, "end": end, "limit": limit}, limit)

    def signals(self, plan: str, run: int, limit: float) -> FlyerAnswer | CrashedRun:
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

    def cancel(self) -> None:
        """End the process for good, from any thread; the flight in progress counts as crashed."""
        self._cancelled = True
        process = self._process
        if process is not None:
            with suppress(OSError):
                process.kill()

    def _ask(self, request: dict[str, Any], limit: float) -> FlyerAnswer | CrashedRun:
        self.start()
        assert self._process is not None
        assert self._process.stdin is not None
        with suppress(OSError):  # the process has ended already: the answer says so
            pickle.dump(request, self._process.stdin)
            self._process.stdin.flush()
        run, seconds = -1, START_S
        while True:
            kind, about, payload = self._next(seconds)
            match kind:
                case "begins":
                    run, seconds = about, limit
                case "done":
                    return FlyerAnswer(*payload)
                case "raised":
                    return CrashedRun(run, "crashed", payload)
                case "unfit":
                    raise PlantError(payload)
                case "silent":
                    self.close()
                    reason = f"the flight must end within {seconds:g} s of wall time"
                    return CrashedRun(run, "timed_out", reason)
                case _:
                    reason = f"the flight ended the process that flew it: {self._exit()}"
                    return CrashedRun(run, "crashed", reason)

    def _next(self, seconds: float) -> Message:
        try:
            return self._messages.get(timeout=seconds)
        except queue.Empty:
            return "silent", -1, None

    def _exit(self) -> str:
        """Wait for the process to end, and say how it did."""
        assert self._process is not None
        try:
            code = self._process.wait(EXIT_S)
        except subprocess.TimeoutExpired:
            return "its output closed"
        finally:
            self.close()
        return crash_of(code) or f"exit status {code}"


@contextmanager
def flyer_copies(count: int) -> Iterator[list[Flyer]]:
    """Up to `count` processes that fly, for the block: copies of this one, with all its imports.

    Not more than `MOST_COPIES`, nor than the system has room for. Where this process cannot be
    copied, one starts anew.
    """
    one_thread = _thread_setters() if count else []
    flyers: list[Flyer] = []
    with ExitStack() as stack:
        with suppress(OSError):
            for _ in range(min(count, MOST_COPIES if one_thread else 1)):
                flyer = Flyer()
                stack.callback(flyer.close)
                flyer.launch(one_thread, flyers)
                flyers.append(flyer)
        for flyer in flyers:  # not before: a process with threads cannot be copied
            flyer.listen()
        yield flyers


class _Copy:
    """A copy of this process that flies, with the members of `subprocess.Popen` that are used."""

    def __init__(
        self, one_thread: Sequence[Callable[[int], Any]], others: Sequence[tuple[int, int]]
    ) -> None:
        with ExitStack() as theirs, ExitStack() as ours:
            requests, self.stdin = _pipe(theirs, ours)
            self.stdout, messages = _pipe(ours, theirs)
            own = self.stdin.fileno(), self.stdout.fileno()
            of_parent = [end for pair in (*others, own) for end in pair]
            self._process = multiprocessing.get_context("fork").Process(
                target=_serve_as_copy,
                args=(requests.fileno(), messages.fileno(), of_parent, one_thread),
                daemon=True,
            )
            self._process.start()
            ours.pop_all()  # they stay open

    def kill(self) -> None:
        self._process.kill()

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        code = self._process.exitcode
        if code is None:
            raise subprocess.TimeoutExpired("flights", timeout or 0.0)
        return code


def _pipe(reading: ExitStack, writing: ExitStack) -> tuple[IO[bytes], IO[bytes]]:
    """Both ends of a new pipe, each open as long as its stack."""
    read, write = os.pipe()
    ends = os.fdopen(read, "rb"), os.fdopen(write, "wb")
    return reading.enter_context(ends[0]), writing.enter_context(ends[1])


def _serve_as_copy(
    requests: int,
    messages: int,
    of_parent: Sequence[int],
    one_thread: Sequence[Callable[[int], Any]],
) -> None:
    """Serve in a copy, without the parent's ends of any pipe, so that it ends with its parent."""
    for descriptor in of_parent:
        os.close(descriptor)
    nothing = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        os.dup2(nothing, standard)
    for set_threads in one_thread:
        set_threads(1)
    os.environ[TRUST_AIRCRAFT] = "1"
    _serve(os.fdopen(requests, "rb"), os.fdopen(messages, "wb"))


def _thread_setters() -> list[Callable[[int], Any]]:
    """Functions that set the threads of each OpenBLAS in this process.

    An empty list where a copy of this process would not do: it cannot be copied, or the numbers
    come from a library that computes other bits in several threads and cannot be told.
    """
    if not can_be_copied():
        return []
    maps = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
    libraries = {line.split()[-1] for line in maps if re.search(r"/lib[^/]*(blas|mkl)", line)}
    setters = []
    for library in libraries:
        functions = ctypes.CDLL(library)
        names = [name for name in SET_THREADS if hasattr(functions, name)]
        if not names:
            return []
        setters.append(getattr(functions, names[0]))
    return setters


def _read_messages(stream: IO[bytes], messages: "queue.SimpleQueue[Message]") -> None:
    """Take messages off a stream until it ends, in the middle of one where the process crashed."""
    with stream, suppress(EOFError, pickle.UnpicklingError):
        while True:
            messages.put(pickle.load(stream))
    messages.put(("ended", -1, None))


class _Server:
    """The side of the subprocess: answers requests, one after another."""

    def __init__(self, out: IO[bytes]) -> None:
        self._out = out
        self._text = ""
        self._plan: Plan | None = None

    def send(self, kind: str, run: int = -1, payload: Any = None) -> None:
        """Send one message."""
        pickle.dump((kind, run, payload), self._out)
        self._out.flush()

    def answer(self, request: dict[str, Any]) -> None:
        """Answer one request: rows of a range of runs, or the signals of one run."""

        def begins(run: int) -> None:
            _exit_after(ORPHAN_LIMITS * request["limit"])
            self.send("begins", run)

        try:
            plan = self._planned(request["plan"])
        except FlightTuneError as error:
            self.send("unfit", payload=str(error))
            return
        try:
            self.send("done", payload=_flown(plan, request, begins))
        except Exception as error:  # whatever a run does, it is the outcome of that run
            self.send("raised", payload=f"{type(error).__name__}: {error}")
        finally:
            _exit_after(0.0)

    def _planned(self, text: str) -> "Plan":
        """The plan, ready to fly.

        Raises
        ------
        FlightTuneError
            If rows flown here would not be those of the campaign.
        """
        if text != self._text:
            from flighttune.aircraft.aircraft import files_hash
            from flighttune.campaign.flying.rows import warm_up
            from flighttune.campaign.planning.plan import plan_from
            from flighttune.flight.own import with_own

            plan = plan_from(json.loads(text))
            if self._plan is not None and plan.sha256 == self._plan.sha256:
                self._text, self._plan = text, plan  # the same but for draws that are given
                return plan
            for name, was in plan.aircraft.items():
                if files_hash(name) != was:
                    raise PlantError(
                        f"the files of aircraft {name} must be those it was planned with"
                    )
            with_own(plan.scenario)
            warm_up(plan)
            self._text, self._plan = text, plan
        assert self._plan is not None
        return self._plan


def _flown(
    plan: "Plan", request: dict[str, Any], begins: Callable[[int], None]
) -> tuple[bytes, float]:
    """What a request asks for and how long it took, s."""
    from flighttune.campaign.flying.refly import fly_run
    from flighttune.campaign.flying.rows import fly_runs
    from flighttune.recording.parquet import parquet_bytes

    started = time.perf_counter()
    if "signals" in request:
        begins(request["signals"])
        data = parquet_bytes(fly_run(plan, request["signals"]))
    else:
        runs = range(request["first"], request["end"])
        data = _arrow_stream(fly_runs(plan, runs, begins=begins))
    return data, time.perf_counter() - started


def _arrow_stream(rows: "pa.Table") -> bytes:
    import pyarrow as pa

    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, rows.schema) as stream:
        stream.write_table(rows)
    return sink.getvalue().to_pybytes()


def _exit_after(seconds: float) -> None:
    """End this process after `seconds`; 0: do not.

    The system does it, by a signal without a handler: a thread of Python could not, while JSBSim
    computes and does not release the interpreter.
    """
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _preload() -> None:
    """Load what flights need before the first request: the plan may still be in the making."""
    from flighttune.campaign.flying import refly, rows
    from flighttune.flight.fly import fly
    from flighttune.recording import parquet
    from flighttune.scenario import load_scenario

    scenario = load_scenario("paper")
    short = scenario.flight.model_copy(update={"duration_s": 0.1})
    with suppress(FlightTuneError):
        fly(scenario.model_copy(update={"flight": short, "gains": ["paper"]}))
    _ = refly, rows, parquet


def _leave_no_core_file() -> None:
    """Let a crash not write an image of this process to the working folder."""
    with suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _requests(source: IO[bytes]) -> "queue.SimpleQueue[dict[str, Any]]":
    """Requests as they come; when the parent is gone they end, and so does the process."""
    waiting: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()

    def read() -> None:
        with suppress(EOFError, pickle.UnpicklingError):
            while True:
                waiting.put(pickle.load(source))
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    return waiting


def main() -> None:
    """Serve until standard input ends."""
    # Messages have a descriptor of their own. What JSBSim prints to 1 goes to standard error: in
    # the middle of a message it would destroy it.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _serve(sys.stdin.buffer, out)


def _serve(source: IO[bytes], out: IO[bytes]) -> None:
    _leave_no_core_file()
    waiting = _requests(source)
    from flighttune.flight.fly import library_versions

    server = _Server(out)
    server.send("ready", payload=library_versions())
    _preload()
    while True:
        server.answer(waiting.get())


if __name__ == "__main__":
    main()
