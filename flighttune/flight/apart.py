"""A copy of this process, whose crash or hang ends what it does there alone."""

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

# Called with the label of a run and the part of it flown, 0 to 1.
Progress: TypeAlias = Callable[[str, float], None]

# Time after which a copy that its own alarm has not ended is given up, s.
GRACE_S = 5.0


def apart(
    call: Callable[[Progress], Any], silence: float, progress: Progress | None = None
) -> tuple[Any, str, float]:
    """Result of `call` in a copy of this process or None, how that ended, and the part flown."""
    import multiprocessing  # here: --help must be quick

    need_fork("code of your own and the reader of a log")
    # a copy has the classes of the user's, which another process would have to import again
    fork = multiprocessing.get_context("fork")
    receiver, sender = fork.Pipe(duplex=False)
    # The copy ends by itself where `call` reports no progress for `silence` seconds, as Python
    # could not while a library computes. What it prints goes to stderr.
    process = fork.Process(target=_answer, args=(call, silence, sender))
    part = 0.0
    with warnings.catch_warnings():  # the threads of the libraries take no part in a flight
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    sender.close()  # else the pipe would stay open here when the copy ends
    late = f"made no progress for {silence:.0f} s"
    try:
        while receiver.poll(silence + GRACE_S):
            try:
                result, *seen = receiver.recv()
            except (EOFError, OSError):  # at the end of a message or inside it
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
    import resource  # Windows has none

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # no image of a crash in the working folder
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the command, which ends its copies
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
    except Exception as error:  # of the plant or the scenario, for the command to say
        result = error
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    try:
        sender.send((result,))
    except Exception as error:  # a class that only this copy knows
        sender.send((PlantError(f"a law or plant must return what can be copied, got {error!r}"),))
