"""How processes are named, kept from Ctrl-C, and end; work in a copy of this one."""

import os
import pickle
import shlex
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TypeVar

T = TypeVar("T")

OWN_GROUP = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
"""Flag of a process that Ctrl-C does not reach on Windows; 0 elsewhere, where sessions do it."""

_EXCEPTION = 0x8000_0000
"""Windows gives a process that crashed the code of an exception, from here on."""


def crash_of(code: int) -> str:
    """What ended a process that did not end itself; empty for one that did.

    Parameters
    ----------
    code : int
        As ``subprocess.Popen.returncode``.
    """
    if code >= _EXCEPTION:
        return f"exception 0x{code:08X}"
    if code >= 0:
        return ""
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"


def joined(command: Sequence[str]) -> str:
    """A command line as the shell of this system reads it."""
    return subprocess.list2cmdline(command) if os.name == "nt" else shlex.join(command)


@contextmanager
def meanwhile(work: Callable[[], T]) -> Iterator[Callable[[], T]]:
    """Work in a copy of this process while the block runs; its result is a call away.

    Where a copy will not do, or ends without a result, the call does the work here: errors are
    those of the work itself.

    Parameters
    ----------
    work : callable
        What it returns is pickled. It must change nothing.
    """
    if not can_be_copied():
        yield work
        return
    result, to_parent = os.pipe()
    with warnings.catch_warnings():
        # Python 3.12 warns of any thread; those of BLAS know of copies.
        warnings.simplefilter("ignore", DeprecationWarning)
        copy = os.fork()
    if copy == 0:
        with suppress(BaseException):
            found = pickle.dumps(work())
            with os.fdopen(to_parent, "wb") as stream:
                stream.write(found)
        os._exit(0)  # without what the parent still has in its buffers
    os.close(to_parent)
    with os.fdopen(result, "rb") as stream:

        def answer() -> T:
            try:
                return pickle.load(stream)
            except (EOFError, pickle.UnpicklingError):  # it ended before, or in the middle
                return work()

        try:
            yield answer
        finally:
            os.kill(copy, signal.SIGKILL)
            os.waitpid(copy, 0)


def can_be_copied() -> bool:
    """Whether a fork of this process can work.

    Not on another system than Linux (frameworks of macOS break in it), nor with other threads of
    Python, whose locks it would hold for ever.
    """
    return sys.platform == "linux" and threading.active_count() == 1
