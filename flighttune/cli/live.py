"""Flying while someone watches: the viewer, the pace, and Ctrl-C."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

from flighttune.cli.show import say, tell
from flighttune.errors import InputError

if TYPE_CHECKING:
    from flighttune.flight import Watcher
    from flighttune.scenario.schema import Scenario

FASTEST = "max"


def pace_of(text: str) -> float | None:
    """Seconds of flight a second from ``--pace``; None for as fast as it goes.

    Raises
    ------
    InputError
        If it is neither a positive number nor ``max``.
    """
    if text == FASTEST:
        return None
    try:
        pace = float(text)
    except ValueError:
        pace = 0.0
    if not 0.0 < pace < float("inf"):
        raise InputError(f"`--pace` must be a positive number or {FASTEST}, got {text!r}.")
    return pace


@contextmanager
def watched(scenario: "Scenario", *, pace: float | None, quiet: bool) -> Iterator["Watcher"]:
    """A viewer that shows the flights of the block; Ctrl-C ends them, and not the block.

    The viewer stays behind them where someone watches, until it is closed.

    Parameters
    ----------
    scenario : Scenario
        What is flown in the block.
    pace : float or None
        Seconds of flight a second.
    quiet : bool
        Say nothing on stdout.
    """
    from flighttune.recording.live import LiveSession
    from flighttune.recording.live_viewer import stream_url, waiting_viewer

    with terminated_like_ctrl_c(), waiting_viewer() as viewer:
        if viewer.url and quiet:
            tell(f"no screen here; open {viewer.url} in a browser on this machine")
        elif viewer.url:
            say(f"no screen here; open {viewer.url} in a browser on this machine")
        url = stream_url(viewer.port)
        with LiveSession(scenario, url, pace=pace) as session, ctrl_c(session.stop):
            yield session
        if sys.stdout.isatty() and not session.stopped:
            say("all runs are flown and recorded; close the viewer or press Ctrl-C to end")
            with ctrl_c(viewer.close):
                viewer.wait()


@contextmanager
def ctrl_c(first: Callable[[], object]) -> Iterator[None]:
    """Call `first` on the first Ctrl-C of the block; a second one ends the command."""

    def handle(_number: int, _frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, before)
        first()

    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def terminated_like_ctrl_c() -> Iterator[None]:
    """Treat SIGTERM in the block as Ctrl-C, so that what the block opened is closed.

    Ctrl-C itself is heard too, also where the command was started with it turned off, as shells do
    in the background.
    """
    numbers = (signal.SIGTERM, signal.SIGINT)
    before = [signal.signal(number, signal.default_int_handler) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
