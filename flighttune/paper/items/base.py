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
    """An item as computed."""

    figures: Mapping[str, Sheet]  # by file name; the first bears the item's name
    # Content of the figures, by file name; the first bears the item's name. Columns carry units
    tables: Mapping[str, pd.DataFrame]
    values: Mapping[str, Any]  # the numbers of the item, plain: ``--json`` prints them
    # Further numbers, which only its sentences name
    numbers: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Assumption:
    """A choice that had to be made because the paper does not print it."""

    what: str  # what is missing
    taken: str  # what was taken instead
    why: str  # the reason for that choice


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A table or figure of the paper that can be made again."""

    name: str  # as on the command line: the label in the paper's source
    title: str
    printed: str  # where it stands in the paper
    make: Callable[[Study], Made]  # from a study to the item as computed
    parameters: list[str]  # the printed parameters used, a line each
    assumed: list[Assumption]  # what the paper does not print
    outcome: list[str]  # the results, a sentence each, with braces where `Made` has the numbers
    captions: Mapping[str, str]  # captions of the figures by file name, with braces as well

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
