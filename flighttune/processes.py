"""Ends of processes, in words."""

import signal


def crash_of(code: int) -> str:
    """Signal that ended a process with this return code; empty if it ended by itself."""
    if code >= 0:
        return ""
    try:
        return signal.Signals(-code).name
    except ValueError:  # a real-time signal, which has no name
        return f"signal {-code}"
