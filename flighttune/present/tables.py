"""A table as text, written to a terminal, a notebook, a page or a Markdown file."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from flighttune.present.numbers import MISSING

PLAIN_WIDTH = 132
"""Width of a table that goes to a file or a pipe, characters."""

UNLIMITED = 10_000
"""Width that no table reaches, characters."""

NO_DIGITS = ("-", MISSING, "never", "∞", "−∞")
"""Cells without a digit that may stand in a column of numbers."""

LEFT = "text-align:left"


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
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    labels: Sequence[str] = ()
    last_is_text: bool = False

    def print(self) -> None:
        """Print to the terminal; the first column and those of numbers are never cut."""
        from rich.console import Console
        from rich.table import Table as RichTable
        from rich.text import Text

        console = Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH, highlight=False)
        table = RichTable()
        head, *rows = ([_printed(cell) for cell in row] for row in (self.head, *self.rows))
        for i, heading in enumerate(head):
            cells = [row[i] for row in rows]
            numbers = bool(cells) and all(_is_number(row[i]) for row in self.rows)
            whole = numbers or i == 0
            table.add_column(
                Text(heading),
                justify="right" if numbers else "left",
                no_wrap=whole,
                min_width=max(map(len, (heading, *cells))) if whole else None,
            )
        for row in rows:
            table.add_row(*map(Text, row))
        # Rich would cut the columns that must stay whole rather than exceed the console.
        unlimited = console.options.update(max_width=UNLIMITED)
        console.width = max(console.width, console.measure(table, options=unlimited).minimum)
        console.print(Text(self.title))
        console.print(table)

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


def _is_number(cell: str) -> bool:
    return cell in NO_DIGITS or cell.lstrip("-+")[:1].isdigit()


def _cells(texts: Sequence[str], kind: str) -> str:
    return "".join(f"<{kind} style='{LEFT}'>{escape(text)}</{kind}>" for text in texts)
