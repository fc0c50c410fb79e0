"""A table as text, written to a terminal, a notebook, a page or a Markdown file."""

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from textwrap import wrap

from flighttune.present.numbers import MISSING

GAP = "  "
"""Between two columns."""

NARROWEST = 16
"""Width to which a column of words may be wrapped before the table is cut in two, characters."""

NO_DIGITS = ("-", MISSING, "never", "∞", "−∞")
"""Cells without a digit that may stand in a column of numbers."""

LEFT = "text-align:left"
BOLD, RED, PLAIN = "\x1b[1m", "\x1b[31m", "\x1b[0m"


class Bad(str):
    """A cell that tells of a failure: red on a terminal."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Headings and cells, ready to be laid out.

    Attributes
    ----------
    title : str
    head : sequence of str
        Headings of the columns; without them the first cell of a row is its heading.
    rows : sequence of sequence of str
        Plain text.
    labels : sequence of str
        Label of the run whose colour each row carries on a page; empty for none.
    last_is_text : bool
        Whether a page may wrap the last column.
    grouped : bool
        The first column is the same for several rows. A terminal has a table for each of its cells
        where there is no room for the column.
    lowest, highest : sequence of str
        Headings of columns whose lowest or highest number is the best: bold on a terminal.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    labels: Sequence[str] = ()
    last_is_text: bool = False
    grouped: bool = False
    lowest: Sequence[str] = ()
    highest: Sequence[str] = ()

    def text(self, width: int, *, styled: bool = False) -> str:
        """The table in lines of at most `width` characters.

        Words are wrapped. Numbers never are: where they have no room side by side, the rest of the
        columns follows in a second table, each with the first column.
        """
        if self.grouped and len(self.head) > 1 and sum(self._natural()) > width:
            groups = list(dict.fromkeys(row[0] for row in self.rows))
            tables = [
                replace(
                    self,
                    title=group,
                    head=self.head[1:],
                    rows=[row[1:] for row in self.rows if row[0] == group],
                    grouped=False,
                ).text(width, styled=styled)
                for group in groups
            ]
            return "\n\n".join([_printed(self.title), *tables])
        blocks = self._blocks(width)
        lines = [_printed(self.title), *(line for b in blocks for line in self._lines(b, styled))]
        return "\n".join(lines)

    def _column(self, i: int) -> list[str]:
        return [_printed(row[i]) for row in self.rows]

    def _is_numbers(self, i: int) -> bool:
        return bool(self.rows) and all(_is_number(row[i]) for row in self.rows)

    def _natural(self) -> list[int]:
        """Width of each column on one line, with the space before it."""
        return [
            max(map(len, (_printed(heading), *self._column(i)))) + (len(GAP) if i else 0)
            for i, heading in enumerate(self.head)
        ]

    def _least(self, i: int) -> int:
        """Width to which a column may be wrapped."""
        heading, cells = _printed(self.head[i]), self._column(i)
        if self._is_numbers(i):
            return max(map(len, (*heading.split(), *cells, "")))
        words = max((len(word) for cell in (heading, *cells) for word in cell.split()), default=0)
        return min(words, NARROWEST)

    def _blocks(self, width: int) -> Iterator[dict[int, int]]:
        """Width of each column by its number, of each table that the terminal has room for."""
        columns = range(len(self.head))
        natural = [n - (len(GAP) if i else 0) for i, n in enumerate(self._natural())]
        least = [min(self._least(i), natural[i]) for i in columns]
        left = list(columns[1:])
        while True:
            block, room = [0] if natural else [], width - (least[0] if natural else 0)
            while left and (len(block) == 1 or room >= least[left[0]] + len(GAP)):
                room -= least[left[0]] + len(GAP)
                block.append(left.pop(0))
            yield _shared_out({i: (least[i], natural[i]) for i in block}, max(room, 0))
            if not left:
                return

    def _lines(self, widths: dict[int, int], styled: bool) -> Iterator[str]:
        best = self._best() if styled else set()
        head = [_printed(heading) for heading in self.head]
        yield from self._row(head, widths)
        yield GAP.join(_printed("─") * width for width in widths.values())
        for place, row in enumerate(self.rows):
            styles = {}
            if styled:
                styles = {i: BOLD for i in widths if (place, i) in best}
                styles |= {i: RED for i in widths if isinstance(row[i], Bad)}
            yield from self._row([_printed(cell) for cell in row], widths, styles)

    def _row(
        self, cells: Sequence[str], widths: dict[int, int], styles: dict[int, str] | None = None
    ) -> Iterator[str]:
        wrapped = {i: wrap(cells[i], width, break_on_hyphens=False) for i, width in widths.items()}
        for k in range(max((len(lines) for lines in wrapped.values()), default=0)):
            shown = []
            for i, width in widths.items():
                part = wrapped[i][k] if k < len(wrapped[i]) else ""
                space = " " * (width - len(part))
                if part and styles and i in styles:
                    part = f"{styles[i]}{part}{PLAIN}"
                shown.append(space + part if self._is_numbers(i) else part + space)
            yield GAP.join(shown).rstrip()

    def _best(self) -> set[tuple[int, int]]:
        """Row and column of the best number of each column that has one."""
        found = set()
        for names, sign in ((self.lowest, 1.0), (self.highest, -1.0)):
            for i in (i for i, heading in enumerate(self.head) if heading in names):
                values = [sign * _value(row[i]) for row in self.rows]
                known = [value for value in values if math.isfinite(value)]
                if len(set(known)) > 1:
                    found |= {(k, i) for k, value in enumerate(values) if value == min(known)}
        return found

    def html(self) -> str:
        """HTML for a notebook."""
        lines = [f"<table><caption style='{LEFT}'><b>{escape(self.title)}</b></caption>"]
        if self.head:
            lines.append(f"<thead><tr>{_cells(self.head, 'th')}</tr></thead>")
        lines.append("<tbody>")
        for first, *rest in self.rows:
            heading = _cells([first], "td" if self.head else "th")
            lines.append(f"<tr>{heading}{_cells(rest, 'td')}</tr>")
        return "".join([*lines, "</tbody></table>"])

    def markdown(self) -> str:
        """Markdown without the title; all columns but the first stand to the right."""
        rule = ["---", *["---:"] * (len(self.head) - 1)]
        cells = [[" ".join(cell.split()).replace("|", "\\|") for cell in row] for row in self.rows]
        return "\n".join(f"| {' | '.join(line)} |" for line in [self.head, rule, *cells])


def _printed(text: str) -> str:
    """`text` as standard output has it: in an encoding without ``χ`` it may take more room."""
    encoding = sys.stdout.encoding or "utf-8"
    return text.encode(encoding, sys.stdout.errors or "strict").decode(encoding)


def _shared_out(columns: dict[int, tuple[int, int]], room: int) -> dict[int, int]:
    """Widths from the least to the natural one, with `room` to share; narrow columns first."""
    widths = {}
    lacking = sorted(columns, key=lambda i: columns[i][1] - columns[i][0])
    for k, i in enumerate(lacking):
        least, natural = columns[i]
        more = min(natural - least, room // (len(lacking) - k))
        widths[i], room = least + more, room - more
    return {i: widths[i] for i in columns}


def _value(cell: str) -> float:
    """The number at the start of a cell, NaN where there is none."""
    try:
        return float(cell.split()[0])
    except (IndexError, ValueError):
        return math.nan


def _is_number(cell: str) -> bool:
    return cell in NO_DIGITS or cell.lstrip("-+")[:1].isdigit()


def _cells(texts: Sequence[str], kind: str) -> str:
    return "".join(f"<{kind} style='{LEFT}'>{escape(text)}</{kind}>" for text in texts)
