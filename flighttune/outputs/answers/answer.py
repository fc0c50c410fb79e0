"""The answer of a command: one value, shown as text, as tables or as one JSON object.

Tables become text here, for a terminal, a page, a notebook and Markdown.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from html import escape
from itertools import zip_longest
from pathlib import Path
from shlex import quote
from textwrap import fill, wrap
from typing import Any

from flighttune.base.errors import printable
from flighttune.base.files.whole import write_text
from flighttune.base.words import MISSING, interval, matrix, number, pick, sentence
from flighttune.outputs.answers.finding import Found, PartFinding, headlines, worst_of

# Space between two columns.
GAP = "  "

# Width to which a column of words may be wrapped before the table is cut in two, characters. A
# longer name is broken only above twice this width.
NARROWEST = 16

# Maximum number of lines of all tables of an answer in a terminal.
TABLE_LINES = 20

# Length of a cell from which a page may wrap the last column, characters.
LONG_WORDS = 40


@dataclass(frozen=True, slots=True)
class Column:
    """Key of a column in a record, and the format of its values."""

    key: str  # dots lead into a value: "metrics.chi.ITAE"
    name: str = ""
    unit: str = ""
    digits: str | Callable[[float], str] = "z.4g"  # how its numbers are written
    factor: float = 1.0  # factor from the value to the shown unit
    ends: tuple[str, str] | None = None  # keys of the interval around its numbers
    missing: str = MISSING
    short: str = ""  # name where the full one would not fit into one line
    spare: bool = False  # whether it is left out where even short names do not fit

    @property
    def heading(self) -> str:
        """Name with unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def text(self, record: Mapping[str, Any]) -> str:
        """The formatted value."""
        if (value := _value(record, self.key)) is None:
            return self.missing
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, list) and value and isinstance(value[0], list):
            return matrix(value)
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
        """A formatted number in the shown unit."""
        value = value * self.factor
        return self.digits(value) if callable(self.digits) else number(value, self.digits)


@dataclass(frozen=True, slots=True)
class Table:
    """Records and the columns to show."""

    columns: Sequence[Column]
    records: Sequence[Mapping[str, Any]]
    title: str = ""
    _: KW_ONLY
    name: str = ""  # key of the records in a JSON object; empty if its values already have them
    label: str = ""  # key of the run whose colour marks a row on a page
    grouped: bool = False  # whether the first column heads separate tables if room is short
    aside: bool = False  # whether a terminal leaves it to pages and --json

    @property
    def filled(self) -> "Table":
        """The table without empty columns, except the first."""
        columns = [
            column
            for place, column in enumerate(self.columns)
            if not place
            or any(_value(record, column.key) not in (None, "") for record in self.records)
        ]
        return replace(self, columns=columns)

    @property
    def head(self) -> list[str]:
        """Headings; empty if no column has a name."""
        return (
            [column.heading for column in self.columns] if any(c.name for c in self.columns) else []
        )

    @property
    def left_aligned(self) -> list[bool]:
        """Whether each column is text, and so left-aligned."""
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
        """The table in lines of at most `width` characters; words are wrapped, numbers are not."""
        # in one line, because a title from a file must not imitate other lines
        title = [" ".join(self.title.split())] if self.title else []
        first, *others = shown = self._shortened(self.filled.columns, width)
        least = dict(zip(shown, replace(self, columns=shown)._least(), strict=True))
        if self.grouped and sum(least[c] + len(GAP) for c in shown) > width + len(GAP):
            groups: dict[str, list[Mapping[str, Any]]] = {}
            for record in self.records:
                groups.setdefault(first.text(record), []).append(record)
            tables = [
                replace(self, title=name, columns=others, records=rows, grouped=False).text(width)
                for name, rows in groups.items()
            ]
            return "\n\n".join([*title, *tables])
        blocks, room = [[first]], width - least[first]
        for column in others:
            room -= least[column] + len(GAP)
            if room < 0 and len(blocks[-1]) > 1:
                blocks.append([first])
                room = width - least[first] - least[column] - len(GAP)
            blocks[-1].append(column)
        lines = [line for block in blocks for line in replace(self, columns=block)._lines(width)]
        return "\n".join([*title, *lines])

    def _shortened(self, columns: Sequence[Column], width: int) -> list[Column]:
        """The columns, with short names and without spare ones if they do not fit into a line."""
        cells = zip(*replace(self, columns=columns).rows, strict=True)
        widths = [max(map(len, (c.heading, *x))) for c, x in zip(columns, cells, strict=True)]
        if sum(widths) + len(GAP) * (len(widths) - 1) <= width:
            return [*columns]
        short = [replace(column, name=column.short or column.name) for column in columns]
        if sum(replace(self, columns=short)._least()) + len(GAP) * (len(short) - 1) <= width:
            return short
        return [column for column in short if not column.spare]

    def _least(self) -> list[int]:
        """Minimum width of each column: only words may be wrapped; names and units are whole."""
        widths = []
        columns = zip([column.heading for column in self.columns], *self.rows, strict=True)
        for place, ((heading, *cells), words) in enumerate(
            zip(columns, self.left_aligned, strict=True)
        ):
            if not words:
                widths.append(max(map(len, (*heading.split(" "), *cells)), default=0))
            elif not place:  # the first column names the rows
                widths.append(min(max(map(len, (heading, *cells))), 2 * NARROWEST))
            else:
                # short names stay whole, and so do units, which have other spaces
                long = [cell for cell in (heading, *cells) if len(cell) > NARROWEST]
                parts = [*heading.split(" "), *" ".join(long).split(" ")]
                parts += [cell for cell in cells if len(cell) <= NARROWEST]
                widths.append(min(max(map(len, parts), default=0), 2 * NARROWEST))
        return widths

    def _lines(self, width: int) -> Iterator[str]:
        """Lines of one block: the widest columns are wrapped until all have room."""
        least, rows, words = self._least(), self.rows, self.left_aligned
        cells = zip([column.heading for column in self.columns], *rows, strict=True)
        widths = [max(map(len, texts)) for texts in cells]
        while sum(widths) + len(GAP) * (len(widths) - 1) > width and widths != least:
            wide = [i for i in range(len(widths)) if widths[i] > least[i]]
            widths[max(wide, key=lambda i: widths[i])] -= 1
        for place, row in enumerate([self.head, *rows] if self.head else rows):
            wrapped = [
                wrap(cell, size, break_on_hyphens=False)
                for cell, size in zip(row, widths, strict=True)
            ]
            for parts in zip_longest(*wrapped, fillvalue=""):
                cells_of_line = [
                    part.ljust(size) if left else part.rjust(size)
                    for part, size, left in zip(parts, widths, words, strict=True)
                ]
                yield GAP.join(cells_of_line).rstrip()
            if self.head and not place:
                yield GAP.join("─" * size for size in widths)

    def html(self) -> str:
        """The table for a notebook; without headings the first cell of a row is its heading."""
        left = " style='text-align:left'"  # a notebook moves cells to the right

        def cells(texts: Sequence[str], kind: str) -> str:
            return "".join(f"<{kind}{left}>{escape(text)}</{kind}>" for text in texts)

        top = f"<thead><tr>{cells(self.head, 'th')}</tr></thead>" if self.head else ""
        kind = "td" if self.head else "th"
        body = "".join(
            f"<tr>{cells(row[:1], kind)}{cells(row[1:], 'td')}</tr>" for row in self.rows
        )
        caption = f"<caption{left}><b>{escape(self.title)}</b></caption>"
        return f"<table>{caption}{top}<tbody>{body}</tbody></table>"

    def markdown(self) -> str:
        """Markdown without the title; numbers stand to the right."""
        rule = ["---" if words else "---:" for words in self.left_aligned]
        top, *cells = (
            [" ".join(cell.split()).replace("|", "\\|") for cell in row]
            for row in (self.head, *self.rows)
        )
        return "\n".join(f"| {' | '.join(line)} |" for line in [top, rule, *cells])


def facts_table(title: str, facts: Mapping[str, str]) -> Table:
    """A table of words, with a name and its text in each row."""
    records = [{"what": name, "value": value} for name, value in facts.items()]
    return Table(title=title, columns=(Column("what"), Column("value")), records=records)


def _value(record: Any, key: str) -> Any:
    """Value at a dotted key of a record; None if missing. Keys may contain dots themselves."""
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


# Command that reads a file, by the key of the file in an answer.
READ_BY = {"recording": "view", "dataset": "report", "proof": "verify", "scenario": "fly"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The result of a command: values, tables, sentences, a command to copy, files, failure."""

    findings: Sequence[PartFinding] = ()  # of its parts; the worst is its verdict
    lines: Sequence[str] = ()  # the answer in a few lines, at the top, after those of findings
    changed: Sequence[str] = ()  # changes and omissions of the question, after these lines
    values: Mapping[str, Any] = field(default_factory=dict)
    tables: Sequence[Table] = ()
    notes: Sequence[str] = ()
    aside: Sequence[str] = ()  # sentences of these that a terminal leaves to pages and --json
    verdict: str = ""
    command: str = ""  # to copy
    files: Mapping[str, Path | str | None] = field(default_factory=dict)
    whole: bool = False  # whether its tables are the answer, and a terminal shows all lines

    @property
    def summary(self) -> list[str]:
        """The sentences of its findings, the worst first, and its lines."""
        return [*headlines(self.findings), *filter(None, self.lines)]

    @property
    def found(self) -> Found | None:
        """What its worst part found; None without a finding."""
        worst = worst_of(self.findings)
        return None if worst is None else worst.found

    @property
    def failure(self) -> str:
        """Reason for an exit status other than 0: that of the worst finding."""
        worst = worst_of(self.findings)
        return worst.reason or worst.sentence if worst and worst.status else ""

    @property
    def status(self) -> int:
        """Exit status: that of the worst finding."""
        worst = worst_of(self.findings)
        return 0 if worst is None else worst.status

    def json(self) -> str:
        """One JSON object; infinite numbers and NaN become null."""
        from pydantic_core import to_jsonable_python  # here: --help must be quick

        records = {table.name: table.records for table in self.tables if table.name}
        said = self.verdict or self.failure  # a negative answer is marked here too
        sentences = {"notes": [*self.changed, *self.notes], "verdict": said}
        if self.summary:
            sentences["summary"] = self.summary
        if any(finding.sentence for finding in self.findings):
            parts = [pick(finding, "found sentence reason") for finding in self.findings]
            sentences["findings"] = parts
        if self.command:
            sentences["command"] = self.command
        values = {**records, **sentences, **self.values, **self.files}
        plain = to_jsonable_python(values, inf_nan_mode="null", fallback=_plain)
        return json.dumps(plain, indent=2)

    def save(self, path: str | Path) -> None:
        """Write the JSON object."""
        write_text(Path(path), self.json() + "\n")

    def text(self, width: int) -> Iterator[str]:
        """Paragraphs and tables of at most `width` characters; commands and paths may be longer.

        The answer comes first, then what it leaves out, then at most `TABLE_LINES` of tables.
        """
        first = self._at_hand(self.summary) or [self.verdict] * bool(self.verdict)
        head = [line for part in (first, self.changed) for line in (*part, "") if part]
        for line in head:
            yield _filled(line, width)
        shown, left_out = self._shown(width)
        for place, text in enumerate(shown):
            yield f"\n{text}" if place else text
        last = "" if any(self.verdict in line for line in first) else self.verdict
        sentences = self._at_hand([*self.notes, last])
        left_out += ["notes"] * any(line in self.aside for line in (*self.notes, last))
        if left_out:
            sentences.append(f"More with --json: {', '.join(left_out)}.")
        if shown and sentences:
            yield ""
        for line in sentences:
            yield _filled(line, width)
        if self.command:
            yield self.command
        for key, path in self.files.items():
            if path is not None:
                how = f"   (flighttune {READ_BY[key]} {quote(str(path))})" if key in READ_BY else ""
                yield f"{key.replace('_', ' ')}: {path}{how}"
        recording = self.files.get("recording")
        if recording is not None and not (self.files.get("page") or self.failure):
            yield f"A page to send: flighttune report {quote(str(Path(recording).parent))}"

    def _at_hand(self, sentences: Sequence[str]) -> list[str]:
        """Sentences that a terminal shows."""
        return [line for line in sentences if line and line not in self.aside]

    def _shown(self, width: int) -> tuple[list[str], list[str]]:
        """Tables of a terminal in at most `TABLE_LINES`, and the names of what is left out."""
        shown, left_out, room = [], [], TABLE_LINES
        for table in (table for table in self.tables if table.records):
            text, n = table.text(width), len(table.records)
            kept = n
            while not (self.whole or table.aside or shown) and kept > 1 and _lines(text) > room:
                kept -= 1
                text = replace(table, records=table.records[:kept]).text(width)
            name = " ".join(table.title.partition(",")[0].split())
            if table.aside or (shown and not self.whole and _lines(text) + 1 > room):
                left_out += [name] if name else []
                continue
            left_out += [f"{n - kept} of {n} rows"] * (kept < n)
            shown.append(text)
            room -= _lines(text) + 1
        return shown, left_out

    def html(self) -> str:
        """Tables and sentences for a notebook."""
        tables = [table.html() for table in self.tables if table.records]
        before, after = (
            [f"<p>{escape(text)}</p>" for text in texts if text]
            for texts in ((*self.summary, *self.changed), (*self.notes, self.verdict, self.failure))
        )
        return printable("".join([*before, *tables, *after]))


def _filled(line: str, width: int) -> str:
    """A sentence in lines of at most `width` characters; names and commands are whole."""
    return fill(sentence(line), width, break_long_words=False, break_on_hyphens=False)


def _lines(text: str) -> int:
    return text.count("\n") + 1


def _plain(value: Any) -> Any:
    """A mapping, array or NumPy scalar converted to a type that pydantic knows."""
    return dict(value) if isinstance(value, Mapping) else value.tolist()
