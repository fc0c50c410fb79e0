"""Word to the user before Python code that a file names is run, here or in a worker."""

from collections.abc import Callable, Iterable
from contextvars import ContextVar
from typing import TypeAlias

# Called with the name of a Python file.
Notice: TypeAlias = Callable[[str], object]

# Does nothing for callers from Python, who chose the code. It is set in a command, and not in the
# processes that it starts.
NOTICE: ContextVar[Notice | None] = ContextVar("notice", default=None)


def before_running(files: Iterable[str]) -> None:
    """Give notice of the Python files that are going to be run."""
    notice = NOTICE.get()
    if notice is not None:
        for file in files:
            notice(file)
