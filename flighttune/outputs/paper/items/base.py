"""Items of the paper: their texts, results, and parts of their figures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy.typing as npt
import pandas as pd

from flighttune.outputs.drawing.chart import Chart, LegendEntry, Sheet
from flighttune.outputs.drawing.palette import HUES, INK
from flighttune.studies.paper import parameters as printed
from flighttune.studies.paper.study import Study

STRONG = [strong for (strong, _), _ in HUES]
CHI, GAMMA, GREEN, MAGENTA = STRONG[:4]  # the first two: course and path angle of one flight

# A gain set has the same colour in the recording.
GAIN_COLOURS = {printed.STAR: INK, **dict(zip(printed.TABLE_2, STRONG, strict=True))}

INDICATOR_LABELS = {"R_K": "R_K [1/s]", "I_K": "I_K [s²]"}

Look: TypeAlias = tuple[str, str]  # colour and dashes of a line


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Made:
    """An item as computed."""

    figures: Mapping[str, Sheet]  # by file name; the first bears the item's name
    # Tables of the figures, by file name; the first has the item's name. Columns have units
    tables: Mapping[str, pd.DataFrame]
    values: Mapping[str, Any]  # the numbers of the item, plain: ``--json`` prints them
    # Additional numbers for its sentences
    numbers: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A reproducible table or figure of the paper."""

    name: str  # name on the command line: its number in the PDF
    title: str
    printed: str  # its place in the paper
    make: Callable[[Study], Made]  # computes the item from a study
    parameters: list[str]  # the used printed parameters, one line each
    # Values that the paper does not print: assumption and reason
    assumed: list[dict[str, str]]
    outcome: list[str]  # the results, one sentence each, with braces for the numbers of `Made`
    captions: Mapping[str, str]  # captions of the figures by file name, with braces as well

    @property
    def heading(self) -> str:
        """Its number in the PDF, and its title."""
        return f"{self.printed.partition(',')[0]}: {self.title}"

    def filled_in(self, text: str, output: Made) -> str:
        """A caption or sentence with the computed numbers."""
        return text.format(printed=printed, values=output.values, **output.numbers)

    def text(self, output: Made) -> str:
        """The short text of the item, Markdown."""
        assumed = ["{what}: {taken}. Why: {why}.".format(**choice) for choice in self.assumed]
        parts = [f"# {self.heading}\n\n{self.printed} of arXiv 2411.13140.\n"]
        for title, lines in (
            ("What comes out", [self.filled_in(line, output) for line in self.outcome]),
            ("Parameters", self.parameters),
            ("Assumed, because the paper does not print it", assumed or ["nothing"]),
        ):
            parts.append(f"## {title}\n\n" + "".join(f"- {line}\n" for line in lines))
        return "\n".join(parts)


def sheet(charts: Sequence[Chart], *, legend: Sequence[LegendEntry] = ()) -> Sheet:
    """Charts as one figure; several panels have letters as in the paper."""
    if len(charts) > 1:
        for letter, chart in zip("abcdefgh", charts, strict=False):
            chart.title = f"({letter}) {chart.title}"
    return Sheet(charts=charts, columns=min(len(charts), 2), legend=legend)


def marked_line(
    chart: Chart, x: npt.ArrayLike, y: npt.ArrayLike, look: Look, *, name: str = "", run: str = ""
) -> None:
    """Draw a line with a dot at each of its points, hollow on a dashed line."""
    colour, dash = look
    chart.line(x, y, colour, dash=dash, name=name, run=run)
    chart.points(x, y, colour, filled=not dash)
