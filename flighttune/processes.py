"""How processes are named, kept from Ctrl-C, and end; work in a copy of this one."""

import multiprocessing
import os
import shlex
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

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
def ctrl_c_blocked() -> Iterator[None]:
    """Let Ctrl-C not reach processes started in the block: it is for the command to end them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    try:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def meanwhile(work: Callable[[], T]) -> Iterator[Callable[[], T]]:
    """Work in a copy of this process while the block runs; its result is a call away.

    Where there can be no copy, or it ends without a result, the call does the work here: errors are
    those of the work itself.

    Parameters
    ----------
    work : callable
        What it returns is pickled. It must change nothing.
    """
    if not can_be_copied():
        yield work
        return
    context = multiprocessing.get_context("fork")
    receiving = None
    with ExitStack() as stack:
        # Ctrl-C does not reach the copy. An OSError says that there is no room for one.
        with ctrl_c_blocked(), suppress(OSError), warnings.catch_warnings():
            # Python 3.12 warns of any thread; those of BLAS know of copies.
            warnings.simplefilter("ignore", DeprecationWarning)
            ends = context.Pipe(duplex=False)
            receiving = stack.enter_context(ends[0])
            with ends[1]:
                copy = context.Process(target=_send_result, args=(work, *ends), daemon=True)
                stack.callback(_end, copy)
                copy.start()

        def answer() -> T:
            if receiving is not None:
                with suppress(EOFError, OSError):  # none, or its end is missing
                    return receiving.recv()
            return work()

        yield answer


def can_be_copied() -> bool:
    """Whether a fork of this process may be tried.

    Not on another system than Linux (frameworks of macOS break in it), nor with other threads of
    Python, whose locks it would hold for ever. Threads of libraries are not counted.
    """
    return sys.platform == "linux" and threading.active_count() == 1


def _send_result(
    work: Callable[[], object], receiving: "Connection", sending: "Connection"
) -> None:
    receiving.close()  # or it would wait for ever for a parent that is gone
    with suppress(BaseException):  # without a result the work is done again, and says what is wrong
        sending.send(work())


def _end(copy: "BaseProcess") -> None:
    if copy.pid is not None:  # it has started
        copy.kill()
        copy.join()
