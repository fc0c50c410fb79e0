"""How processes end."""

import signal

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
