"""The text of an aircraft's main file with placeholders: made once, filled for each flight."""

import re
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar
from xml.etree import ElementTree

from flighttune.errors import PlantError

Value = TypeVar("Value")
Stamp = tuple[Path, int, int]

_PLACEHOLDER = re.compile(r"\{\{(.+?)\*(.+?)\}\}")
_HEAD = '<?xml version="1.0" encoding="utf-8"?>\n'


def placeholder(name: str, base: float = 1.0) -> str:
    """Text that stands for the value of `name` times `base`.

    Parameters
    ----------
    name : str
        What `ModelText.filled` is given a value for.
    base : float
        What stands there in the aircraft's own file, where the value is a factor on it.
    """
    return f"{{{{{name}*{base!r}}}}}"


class Sources:
    """Reads XML files and keeps note of them."""

    def __init__(self) -> None:
        self.stamps: list[Stamp] = []

    def root(self, file: Path, what: str) -> ElementTree.Element:
        """Return the root element of `file`.

        Parameters
        ----------
        file : path
            An XML file.
        what : str
            What an error message begins with.

        Raises
        ------
        PlantError
            If it cannot be read.
        """
        try:
            self.stamps.append(stamp(file))
            return ElementTree.parse(file).getroot()
        except (OSError, ElementTree.ParseError) as error:
            raise PlantError(f"{what}: {error}.") from error


def stamp(file: Path) -> Stamp:
    """Return what tells one state of `file` from another.

    Raises
    ------
    OSError
        If there is no such file.
    """
    state = file.stat()
    return file, state.st_mtime_ns, state.st_size


def unchanged(stamps: tuple[Stamp, ...]) -> bool:
    """Whether files are as they were when `stamps` were taken."""
    try:
        return all(stamp(file) == (file, *rest) for file, *rest in stamps)
    except OSError:
        return False


class FileCache(Generic[Value]):
    """Values made from files, one a key, good as long as the files are as they were."""

    def __init__(self) -> None:
        self._made: dict[Hashable, tuple[tuple[Stamp, ...], Value]] = {}

    def find(self, key: Hashable) -> Value | None:
        """Return the value of `key` if it is there and still good."""
        found = self._made.get(key)
        return found[1] if found is not None and unchanged(found[0]) else None

    def keep(self, key: Hashable, stamps: tuple[Stamp, ...], value: Value) -> Value:
        """Keep `value`, made from files as their `stamps` say, and return it."""
        self._made[key] = stamps, value
        return value


@dataclass(frozen=True, slots=True)
class ModelText:
    """A main file with placeholders.

    Attributes
    ----------
    pieces : tuple of str
        The text before, between and behind the placeholders.
    placeholders : tuple of (str, float)
        Name and base of each: what a value of that name multiplies.
    """

    pieces: tuple[str, ...]
    placeholders: tuple[tuple[str, float], ...]

    @classmethod
    def of(cls, root: ElementTree.Element) -> "ModelText":
        """Text of an element tree whose placeholders were made by `placeholder`."""
        text = _HEAD + ElementTree.tostring(root, encoding="unicode")
        found = _PLACEHOLDER.split(text)
        placeholders = zip(found[1::3], map(float, found[2::3]), strict=True)
        return cls(tuple(found[0::3]), tuple(placeholders))

    def filled(self, values: Mapping[str, float]) -> str:
        """Text with `values` in its placeholders, to the last bit."""
        numbers = [repr(values[name] * base) for name, base in self.placeholders]
        return "".join(
            piece + number for piece, number in zip(self.pieces, [*numbers, ""], strict=True)
        )
