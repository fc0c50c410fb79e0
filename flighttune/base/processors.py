"""Processor cores of this machine."""

import os


def cores() -> int:
    """Processor cores this process may use; PYTHON_CPU_COUNT replaces it, as in Python 3.13."""
    if (stated := os.environ.get("PYTHON_CPU_COUNT", "")).isdecimal() and int(stated):
        return int(stated)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
