"""JSBSim's chatter: kept off the terminal, at hand for error messages."""

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import jsbsim

_ANSI_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_KEPT_RECORDS = 200


class QuietLogger(jsbsim.FGLogger):
    """Logger that writes nowhere and keeps the errors of each thread."""

    def __init__(self) -> None:
        self._thread = threading.local()

    def set_level(self, level: Any) -> None:
        """Begin a record."""
        self._thread.level, self._thread.text = int(level), ""

    def file_location(self, filename: str, line: int) -> None:
        """Take the place in the XML that the record is about."""
        self._thread.text += f"{filename}:{line}: "

    def message(self, message: str) -> None:
        """Take a piece of text."""
        self._thread.text += message

    def format(self, format: Any) -> None:
        """Ignore colours."""

    def flush(self) -> None:
        """End the record."""
        thread = self._thread
        if thread.level >= jsbsim.LogLevel.ERROR and len(thread.records) < _KEPT_RECORDS:
            thread.records.append(thread.text)

    def clear(self) -> None:
        """Forget this thread's records."""
        self._thread.level, self._thread.text, self._thread.records = 0, "", []

    @property
    def text(self) -> str:
        """This thread's errors in one line."""
        return one_line(" ".join(self._thread.records))


def one_line(text: str) -> str:
    """Return `text` without colours and line breaks."""
    return " ".join(_ANSI_COLOUR.sub("", text).split())


# JSBSim holds one logger a thread and lets go of it at the thread's end without Python's lock: a
# logger that dies there takes the process along. This one outlives every thread, with references to
# spare for those that two threads drop at the same moment.
_LOGGER = QuietLogger()
_IMMORTAL = [_LOGGER] * 10_000


def silence() -> None:
    """Silence JSBSim in this thread from now on."""
    _LOGGER.clear()
    jsbsim.set_logger(_LOGGER)


@contextmanager
def quiet() -> Iterator[QuietLogger]:
    """Silence JSBSim in this thread from now on; the value holds what it says inside the block."""
    silence()
    yield _LOGGER
