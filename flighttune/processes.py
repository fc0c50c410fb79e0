"""How processes are named, kept from Ctrl-C, and end."""

import os
import shlex
import signal
import subprocess
from collections.abc import Sequence

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
