"""The answer of a command: one value, printed as text or as one JSON object."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from shlex import quote
from textwrap import fill
from typing import Any

from flighttune.present.tables import Table

# Command that reads a file, by the key of the file in an answer.
READ_BY = {
    "recording": "view",
    "dataset": "report",
    "proof": "verify",
    "scenario": "fly",
}


WIDTH = 100  # characters of a result that is printed from Python


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The result of a command: values, tables, sentences, a command to copy, files, failure."""

    values: Mapping[str, Any] = field(default_factory=dict)
    tables: Sequence[Table] = ()
    notes: Sequence[str] = ()
    verdict: str = ""
    command: str = ""  # to copy
    files: Mapping[str, Path | str | None] = field(default_factory=dict)
    failure: str = ""  # reason for an exit status other than 0
    status: int = 1  # exit status of a failure: 1 where the answer is no

    def json(self) -> str:
        """One JSON object; numbers that JSON has no word for become null."""
        from pydantic_core import to_jsonable_python  # here: --help must be quick

        records = {table.name: table.records for table in self.tables if table.name}
        sentences = {"notes": self.notes, "verdict": self.verdict}
        if self.command:
            sentences["command"] = self.command
        values = {**records, **sentences, **self.values, **self.files}
        plain = to_jsonable_python(values, inf_nan_mode="null", fallback=_plain)
        return json.dumps(plain, indent=2)

    def text(self, width: int) -> Iterator[str]:
        """Paragraphs and tables of at most `width` characters; commands and paths may be longer."""
        for place, table in enumerate(table for table in self.tables if table.records):
            text = table.text(width)
            yield f"\n{text}" if place else text
        sentences = [sentence for sentence in (*self.notes, self.verdict) if sentence]
        if self.tables and sentences:
            yield ""
        for sentence in sentences:
            yield fill(sentence, width, break_long_words=False, break_on_hyphens=False)
        if self.command:
            yield self.command
        for key, path in self.files.items():
            if path is not None:
                how = f"   (flighttune {READ_BY[key]} {quote(str(path))})" if key in READ_BY else ""
                yield f"{key.replace('_', ' ')}: {path}{how}"
        recording = self.files.get("recording")
        if recording is not None and not (self.files.get("page") or self.failure):
            yield f"A page to send: flighttune report {quote(str(Path(recording).parent))}"

    def html(self) -> str:
        """Tables and sentences for a notebook."""
        tables = [table.html() for table in self.tables if table.records]
        sentences = (*self.notes, self.verdict, self.failure)
        return "".join([*tables, *(f"<p>{escape(text)}</p>" for text in sentences if text)])


class Answering:
    """A result that terminal, ``--json`` and notebooks show by its `answer`."""

    __slots__ = ()

    def answer(self) -> Answer:
        """Values, tables, notes and verdict, as they are shown."""
        raise NotImplementedError

    # A dataclass makes a representation of all its arrays, unless its class has one already.
    def __init_subclass__(cls) -> None:
        cls.__repr__ = Answering.__str__

    def __str__(self) -> str:
        return "\n".join(self.answer().text(WIDTH))

    def _repr_html_(self) -> str:
        return self.answer().html()


def pick(value: object, names: str) -> dict[str, Any]:
    """Attributes of `value` by name; `names` are separated by spaces."""
    return {name: getattr(value, name) for name in names.split()}


def _plain(value: Any) -> Any:
    """A mapping that is no dictionary, an array or a scalar of NumPy's as what pydantic knows."""
    return dict(value) if isinstance(value, Mapping) else value.tolist()
