"""Computations that end soon after their caller asks for it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_ASKED: ContextVar[Callable[[], None]] = ContextVar("asked", default=lambda: None)


@contextmanager
def stopped_by(asked: Callable[[], None]) -> Iterator[None]:
    """Let `asked` end the searches of the block: it is called often, and raises a StoppedError."""
    token = _ASKED.set(asked)
    try:
        yield
    finally:
        _ASKED.reset(token)


def go_on() -> None:
    """Raise the StoppedError of a search that was stopped."""
    _ASKED.get()()
