"""Tables of numbers: columns say how they are written in a terminal, on a page and in Markdown."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from textwrap import wrap
from typing import Any

from flighttune.present.numbers import MISSING, interval, number

GAP = "  "
"""Between two columns."""

NARROWEST = 16
"""Width to which a column of words may be wrapped before the table is cut in two, characters."""

LONG_WORDS = 40
"""Characters of a cell from which on a page may wrap the last column."""


@dataclass(frozen=True, slots=True)
class Column:
    """Key of a column in a record, and the format of its values."""

    key: str  # dots lead into a value: "metrics.chi.ITAE"
    name: str = ""
    unit: str = ""
    digits: str | Callable[[float], str] = "z.4g"  # how its numbers are written
    factor: float = 1.0  # from the value to the unit shown
    ends: tuple[str, str] | None = None  # keys of the interval around its numbers
    missing: str = MISSING

    @property
    def heading(self) -> str:
        """Name with unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def text(self, record: Mapping[str, Any]) -> str:
        """The value as it is written."""
        value = _value(record, self.key)
        if value is None:
            return self.missing
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, list | tuple):
            return ", ".join(map(str, value)) or self.missing
        if isinstance(value, str):
            return value
        if self.ends is None:
            return self.missing if math.isnan(value) else self.written(value)
        low, high = (_value(record, end) for end in self.ends)
        ends = (math.nan if end is None else end for end in (low, high))
        return interval(value, *ends, written=self.written)

    def written(self, value: float) -> str:
        """A number as it is written, in the unit shown."""
        value = value * self.factor
        return self.digits(value) if callable(self.digits) else number(value, self.digits)


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Records and the columns that are shown of them."""

    columns: Sequence[Column]
    records: Sequence[Mapping[str, Any]]
    title: str = ""
    name: str = ""  # key of the records in a JSON object; empty where its values have them
    label: str = ""  # key of the run whose colour a row has on a page
    grouped: bool = False  # the first column repeats: it heads a table each where room is short

    @property
    def head(self) -> list[str]:
        """Headings; none where no column has a name."""
        return (
            [column.heading for column in self.columns] if any(c.name for c in self.columns) else []
        )

    @property
    def of_words(self) -> list[bool]:
        """Whether a column has no number: its cells stand to the left."""
        return [
            not any(_is_number(_value(record, column.key)) for record in self.records)
            for column in self.columns
        ]

    @property
    def rows(self) -> list[list[str]]:
        """Cells as text."""
        return [[column.text(record) for column in self.columns] for record in self.records]

    @property
    def labels(self) -> list[str]:
        """Label of the run of each row; empty without."""
        return [str(_value(record, self.label)) for record in self.records] if self.label else []

    @property
    def ends_in_words(self) -> bool:
        """Whether a page may wrap the last column."""
        return any(len(row[-1]) > LONG_WORDS for row in self.rows)

    def text(self, width: int) -> str:
        """The table in lines of at most `width` characters.

        Words are wrapped. Numbers never are: where they have no room side by side, the rest of the
        columns follows in a second table, each with the first column. Columns without any value
        are left out.
        """
        columns = [
            column
            for place, column in enumerate(self.columns)
            if not place
            or any(_value(record, column.key) not in (None, "") for record in self.records)
        ]
        if len(columns) < len(self.columns):
            return replace(self, columns=columns).text(width)
        least = sum(map(self._least, range(len(columns)))) + len(GAP) * (len(columns) - 1)
        if self.grouped and least > width:
            first, *others = self.columns
            groups = dict.fromkeys(first.text(record) for record in self.records)
            tables = [
                replace(
                    self,
                    title=group,
                    columns=others,
                    records=[record for record in self.records if first.text(record) == group],
                    grouped=False,
                ).text(width)
                for group in groups
            ]
            return "\n\n".join([self.title, *tables] if self.title else tables)
        blocks = self._blocks(width)
        lines = [line for block in blocks for line in self._lines(block)]
        return "\n".join([self.title, *lines] if self.title else lines)

    def _natural(self) -> list[int]:
        """Width of each column on one line."""
        cells = zip(*self.rows, strict=True) if self.records else [()] * len(self.columns)
        headings = [column.heading for column in self.columns]
        return [max(map(len, (head, *own))) for head, own in zip(headings, cells, strict=True)]

    def _least(self, i: int) -> int:
        """Width to which a column may be wrapped."""
        heading, cells = self.columns[i].heading, [row[i] for row in self.rows]
        if not self.of_words[i]:
            return max(map(len, (*heading.split(), *cells, "")))
        if not i:  # it names the rows
            return min(max(map(len, (heading, *cells))), 2 * NARROWEST)
        words = max((len(word) for cell in (heading, *cells) for word in cell.split()), default=0)
        return min(words, NARROWEST)

    def _blocks(self, width: int) -> Iterator[dict[int, int]]:
        """Width of each column by its number, of each table that the terminal has room for."""
        natural = self._natural()
        least = [min(self._least(i), natural[i]) for i in range(len(natural))]
        left = list(range(1, len(natural)))
        while True:
            block, room = [0], width - least[0]
            while left and (len(block) == 1 or room >= least[left[0]] + len(GAP)):
                room -= least[left[0]] + len(GAP)
                block.append(left.pop(0))
            yield _shared_out({i: (least[i], natural[i]) for i in block}, max(room, 0))
            if not left:
                return

    def _lines(self, widths: dict[int, int]) -> Iterator[str]:
        if self.head:
            yield from self._row(self.head, widths)
            yield GAP.join("─" * width for width in widths.values())
        for row in self.rows:
            yield from self._row(row, widths)

    def _row(self, cells: Sequence[str], widths: dict[int, int]) -> Iterator[str]:
        words = self.of_words
        wrapped = {i: wrap(cells[i], width, break_on_hyphens=False) for i, width in widths.items()}
        for k in range(max(map(len, wrapped.values()))):
            parts = {i: lines[k] if k < len(lines) else "" for i, lines in wrapped.items()}
            shown = [
                part.ljust(widths[i]) if words[i] else part.rjust(widths[i])
                for i, part in parts.items()
            ]
            yield GAP.join(shown).rstrip()

    def markdown(self) -> str:
        """Markdown without the title; numbers stand to the right."""
        rule = ["---" if words else "---:" for words in self.of_words]
        return _markdown(self.head, rule, self.rows)


def facts_table(title: str, facts: Mapping[str, str]) -> Table:
    """A table of words: a name and what is said of it in each row."""
    records = [{"what": what, "value": value} for what, value in facts.items()]
    return Table(title=title, columns=(Column("what"), Column("value")), records=records)


def html(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table for a notebook; without `head` the first cell of a row is its heading."""
    left = " style='text-align:left'"  # a notebook moves cells to the right

    def cells(texts: Sequence[str], kind: str) -> str:
        return "".join(f"<{kind}{left}>{escape(text)}</{kind}>" for text in texts)

    top = f"<thead><tr>{cells(head, 'th')}</tr></thead>" if head else ""
    kind = "td" if head else "th"
    body = "".join(f"<tr>{cells(row[:1], kind)}{cells(row[1:], 'td')}</tr>" for row in rows)
    caption = f"<caption{left}><b>{escape(title)}</b></caption>"
    return f"<table>{caption}{top}<tbody>{body}</tbody></table>"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; all columns but the first stand to the right."""
    return _markdown(head, ["---", *["---:"] * (len(head) - 1)], rows)


def _markdown(head: Sequence[str], rule: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    cells = [[" ".join(cell.split()).replace("|", "\\|") for cell in row] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, rule, *cells])


def _value(record: Any, key: str) -> Any:
    """A value of a record, None where it has none; both keys and ways into values have dots."""
    if isinstance(record, list | tuple):
        record = {str(place): value for place, value in enumerate(record)}
    if not isinstance(record, Mapping):
        return None
    if key in record:
        return record[key]
    for place, letter in enumerate(key):
        if letter == "." and key[:place] in record:
            return _value(record[key[:place]], key[place + 1 :])
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _shared_out(columns: dict[int, tuple[int, int]], room: int) -> dict[int, int]:
    """Widths from the least to the natural one, with `room` to share; narrow columns first.

    The first column, which names the rows, takes what it needs.
    """
    widths = {}
    lacking = sorted(columns, key=lambda i: (i > 0, columns[i][1] - columns[i][0]))
    for k, i in enumerate(lacking):
        least, natural = columns[i]
        more = min(natural - least, room // (len(lacking) - k) if i else room)
        widths[i], room = least + more, room - more
    return {i: widths[i] for i in columns}
