"""``fly --live``: the viewer, the pace, and Ctrl-C."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from flighttune.cli.progress import raise_on_interrupt, stop_on_interrupt
from flighttune.cli.show import as_json, say, tell
from flighttune.errors import InputError

if TYPE_CHECKING:
    from flighttune.flight.fly import Observer
    from flighttune.scenario.schema import Scenario

FASTEST = "max"


def pace_of(text: str) -> float | None:
    """Simulated seconds per second from ``--pace``; None for as fast as possible."""
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
def live_viewer(scenario: "Scenario", *, pace: float | None) -> Iterator["Observer"]:
    """Show the flights of the block in a viewer; Ctrl-C ends the flights, and not the block.

    `pace` is in simulated seconds per second. On a terminal the viewer stays open after the
    flights, until it is closed.
    """
    from flighttune.recording.live import LiveSession
    from flighttune.recording.viewer import stream_url, waiting_viewer

    with raise_on_interrupt(), waiting_viewer() as viewer:
        if viewer.url:
            show = tell if as_json() else say
            show(f"no screen here; open {viewer.url} in a browser on this machine")
        url = stream_url(viewer.port)
        with LiveSession(scenario, url, pace=pace) as session, stop_on_interrupt(session.stop):
            yield session
        if sys.stdout.isatty() and not session.stopped:
            say("all runs are flown and recorded; close the viewer or press Ctrl-C to end")
            with stop_on_interrupt(viewer.close):
                viewer.wait()
