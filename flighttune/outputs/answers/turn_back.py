"""The table of flights that turn back and do not complete."""

from dataclasses import replace

from flighttune.claims.turn_back import TurnBack
from flighttune.outputs.answers.answer import Table
from flighttune.outputs.answers.labels import endings_table


def ended(room: TurnBack) -> Table:
    """Incomplete flights that turn back, beside incomplete flights of the mission."""
    title = "flights that turn back and did not complete"
    return replace(endings_table(room.endings), title=title, name="turn_back_endings")
