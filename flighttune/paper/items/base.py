"""An item of the paper, and the result of making it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper.study import Study
from flighttune.present.chart import Sheet


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Made:
    """An item as computed.

    Attributes
    ----------
    figures : mapping of str to Sheet
        By file name; the first bears the item's name.
    tables : mapping of str to DataFrame
        What the figures show, by file name; the first bears the item's name. Columns carry units.
    values : mapping
        The numbers of the item, plain: ``--json`` prints them.
    numbers : mapping
        Further numbers, which only its sentences name.
    """

    figures: Mapping[str, Sheet]
    tables: Mapping[str, pd.DataFrame]
    values: Mapping[str, Any]
    numbers: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Assumption:
    """A choice that had to be made because the paper does not print it.

    Attributes
    ----------
    what : str
        What is missing.
    taken : str
        What was taken instead.
    why : str
        The reason for that choice.
    """

    what: str
    taken: str
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A table or figure of the paper that can be made again.

    Attributes
    ----------
    name : str
        As on the command line: the label in the paper's source.
    title : str
        What it shows.
    printed : str
        Where it stands in the paper.
    make : callable
        From a study to the item as computed.
    parameters : list of str
        The printed parameters used, a line each.
    assumed : list of Assumption
        What the paper does not print.
    outcome : list of str
        The results, a sentence each, with braces where `Made` has the numbers.
    captions : mapping of str to str
        Captions of the figures by file name, with braces as well.
    """

    name: str
    title: str
    printed: str
    make: Callable[[Study], Made]
    parameters: list[str]
    assumed: list[Assumption]
    outcome: list[str]
    captions: Mapping[str, str]

    def filled_in(self, text: str, made: Made) -> str:
        """A caption or a sentence of the outcome with the numbers as computed."""
        return text.format(printed=printed, values=made.values, **made.numbers)

    def text(self, made: Made) -> str:
        """The short text of the item, Markdown."""
        assumed = [f"{a.what}: {a.taken}. Why: {a.why}." for a in self.assumed] or ["nothing"]
        parts = [f"# {self.name}: {self.title}\n\n{self.printed} of arXiv 2411.13140.\n"]
        for title, lines in (
            ("What comes out", [self.filled_in(line, made) for line in self.outcome]),
            ("Parameters", self.parameters),
            ("Assumed, because the paper does not print it", assumed),
        ):
            parts.append(f"## {title}\n\n" + "".join(f"- {line}\n" for line in lines))
        return "\n".join(parts)
