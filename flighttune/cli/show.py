"""Output of commands: one JSON object, or tables and lines, on stdout; reasons on stderr."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from shutil import get_terminal_size
from typing import Any, NoReturn

from flighttune.present.answer import Answer
from flighttune.whole_file import reason_of

FINE, NO, COULD_NOT_RUN, INTERRUPTED = 0, 1, 2, 130

# Width of a table that goes to a file or a pipe, characters.
PLAIN_WIDTH = 120

# Characters of a line about a failure.
MAX_REASON = 1500

_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)
_JSON: ContextVar[bool] = ContextVar("as_json", default=False)

# Status on the last line of a terminal's stderr until something else is printed.
_DOING: ContextVar[str] = ContextVar("doing", default="")


@contextmanager
def working(doing: str, *, quiet: bool, as_json: bool = False) -> Iterator[None]:
    """Show on a terminal, from the start, what a command is `doing`, such as ``tuning``."""
    asked, form = _QUIET.set(quiet), _JSON.set(as_json)
    shown = _DOING.set(f"{doing} ..." if watched() else "")
    if _DOING.get():
        print(_DOING.get(), end="", file=sys.stderr, flush=True)
    try:
        yield
    finally:
        clear()
        _DOING.reset(shown)
        _QUIET.reset(asked)
        _JSON.reset(form)


def watched() -> bool:
    """Whether to show progress: stderr is a terminal, and -q is absent."""
    return sys.stderr.isatty() and not quiet()


def quiet() -> bool:
    """Whether the command has -q."""
    return _QUIET.get()


def clear() -> None:
    """Clear the status from the terminal before something else is printed."""
    if doing := _DOING.get():
        print(f"\r{' ' * len(doing)}\r", end="", file=sys.stderr, flush=True)
        _DOING.set("")


def emit(answer: Answer) -> None:
    """Print an answer, and exit if it has a failure."""
    show(answer)
    if answer.failure:
        fail(answer.failure, answer.status)


def show(answer: Answer) -> None:
    """Print an answer: one JSON object with ``--json``, else its text."""
    with output():
        if _JSON.get():
            clear()
            print(answer.json())
        elif not quiet():
            for part in answer.text(get_terminal_size((PLAIN_WIDTH, 0)).columns):
                clear()  # the text may take its time
                print(part)


@contextmanager
def output() -> Iterator[None]:
    """Write what the block prints on stdout; a full disk ends the command."""
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        # what is left cannot be written: Python would complain about it once more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        fail(f"standard output must be writable, got {reason_of(error)}.", COULD_NOT_RUN)


def pick(value: object, names: str) -> dict[str, Any]:
    """Attributes of `value` by name; `names` are separated by spaces."""
    return {name: getattr(value, name) for name in names.split()}


def say(line: str) -> None:
    """Print one line while a command still runs, with ``--json`` on stderr."""
    clear()
    print(line, file=sys.stderr if _JSON.get() else sys.stdout, flush=True)  # pipes get it at once


def tell(line: str) -> None:
    """Print one line on stderr, for someone who watches."""
    clear()
    print(line, file=sys.stderr)


def fail(reason: str, status: int) -> NoReturn:
    """Print the reason in one line on stderr and exit with `status`; a long one is cut."""
    printable = (char if char.isprintable() else " " for char in reason)  # no terminal codes
    line = " ".join("".join(printable).split())
    if len(line) > MAX_REASON:
        half = MAX_REASON // 2
        line = f"{line[:half]} ... {line[-half:]}"
    tell(f"flighttune: {line}")
    sys.exit(status)
