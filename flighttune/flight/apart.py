"""A copy of this process, whose crash or hang ends only its own work."""

import os
import signal
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeAlias

from flighttune.base.errors import PlantError, ending_of, need_fork

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

# Called with the label of a run and its flown share, 0 to 1.
Progress: TypeAlias = Callable[[str, float], None]

# Time after which a copy that its own alarm did not end is abandoned, s.
GRACE_S = 5.0


def apart(
    call: Callable[[Progress], Any], silence: float, progress: Progress | None = None
) -> tuple[Any, str, float]:
    """Result of `call` in a copy of this process or None, the copy's end, and the flown share."""
    import multiprocessing  # here: --help must be quick

    need_fork("code of your own and the reader of a log")
    # a copy already has the user's classes, which another process would have to import
    fork = multiprocessing.get_context("fork")
    receiver, sender = fork.Pipe(duplex=False)
    # An alarm ends the copy if `call` reports no progress for `silence` seconds, since Python
    # cannot act while a library computes. Its output goes to stderr.
    process = fork.Process(target=_answer, args=(call, silence, sender))
    part = 0.0
    with warnings.catch_warnings():  # the threads of libraries do not take part in a flight
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    sender.close()  # else the pipe would stay open here after the end of the copy
    late = f"made no progress for {silence:.0f} s"
    try:
        while receiver.poll(silence + GRACE_S):
            try:
                result, *seen = receiver.recv()
            except (EOFError, OSError):  # a message may be cut at its end or inside
                process.join()
                code = process.exitcode or 0
                ended = f"ended by {ending_of(code)}"
                return None, late if code == -signal.SIGALRM else ended, part
            if not seen:
                if isinstance(result, Exception):
                    raise result
                return result, "", 1.0
            part = seen[0]
            if progress is not None:
                progress(result, part)
        return None, late, part
    finally:
        process.kill()
        process.join()


def _answer(call: Callable[[Progress], Any], silence: float, sender: "Connection") -> None:
    import resource  # Windows lacks the module

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # no core dump in the working folder
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the command
    for ends in (signal.SIGTERM, signal.SIGALRM):
        signal.signal(ends, signal.SIG_DFL)
    sys.stdout = sys.stderr
    with suppress(OSError):  # stderr may be closed
        os.dup2(2, 1)

    def seen(label: str, part: float) -> None:
        signal.setitimer(signal.ITIMER_REAL, silence)
        sender.send((label, part))

    signal.setitimer(signal.ITIMER_REAL, silence)
    try:
        result = call(seen)
    except Exception as error:  # an error of the plant or scenario, which the command reports
        result = error
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    try:
        sender.send((result,))
    except Exception as error:  # an object of a class that only this copy knows
        sender.send((PlantError(f"a law or plant must return what can be copied, got {error!r}"),))
