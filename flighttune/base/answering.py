"""Results that answer: what each says stands in the rooms above, and is found by a table.

The functions that speak are imported on first use: this module knows every result, and nothing of
what it says.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

# Characters of a line that is printed from Python.
WIDTH = 100

# The function that says what a result of each class is, as module:function.
SPEAKERS = {"Tube": "flighttune.outputs.answers.tube:answer"}


class Answering:
    """A result that terminal, ``--json`` and notebooks show by its `answer`."""

    __slots__ = ()

    def answer(self, *args: Any, **options: Any) -> Any:
        """Values, tables, notes and verdict, as they are shown; see `SPEAKERS`."""
        return _speaker(type(self))(self, *args, **options)

    def save(self, path: str | Path, /) -> Any:
        """Write the JSON object of the answer; gains in it are read by `load_gains`."""
        self.answer().save(path)

    # A dataclass makes a representation of all its arrays, unless its class has one already.
    def __init_subclass__(cls) -> None:
        cls.__repr__ = Answering.__str__

    def __str__(self) -> str:
        return "\n".join(self.answer().text(WIDTH))

    def _repr_html_(self) -> str:
        return self.answer().html()


def _speaker(kind: type) -> Any:
    """The function that speaks for a class, or for the nearest class that it is made of."""
    place = next((SPEAKERS[x.__name__] for x in kind.__mro__ if x.__name__ in SPEAKERS), None)
    if place is None:
        raise NotImplementedError(
            f"{kind.__module__}.{kind.__name__} must have a row in `SPEAKERS` of {__name__}."
        )
    module, _, function = place.partition(":")
    return getattr(import_module(module), function)
