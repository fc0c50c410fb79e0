"""Parts of every page: sections with charts and tables, and the frame of HTML."""

import base64
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flighttune.base.answering import Answering
from flighttune.base.errors import printable
from flighttune.base.files.whole import write_text
from flighttune.base.words import COMMAND
from flighttune.base.words import sentence as in_words
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.drawing import chart
from flighttune.outputs.drawing.chart import Chart
from flighttune.outputs.drawing.templates import page_template

if TYPE_CHECKING:
    from jinja2 import Template


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of the page."""

    id: str = "runs"  # its anchor
    title: str = ""  # the only visible part of a closed section
    note: str | Sequence[str] = ""  # how to read the section: prose, or sentences for a list
    charts: Sequence[Chart] = ()
    tables: Sequence[Table] = ()
    legend: bool = True  # whether a legend of runs stands above the charts
    columns: int = 2  # charts side by side on a wide screen, 2 or 3
    open: bool = False  # whether it is open at first

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentences of its list, each with a capital and a full stop; or its prose."""
        if isinstance(self.note, str):
            return (self.note,) if self.note else ()
        return tuple(sentence(part) for note in self.note for part in SENTENCES.split(note))


# Parts of an answer's page, in this order: anchor, title unless the part has its own, whether it is
# open at first.
PARTS = (
    ("accuracy", "Accuracy", True),
    ("requirements", "Requirements", True),
    ("responses", "Flights", True),
    ("conditions", "What it holds for, and how to check it", True),
    ("margins", "Margins of the loop", False),
    ("costs", "What each requirement costs", False),
    ("flown", "What was flown", False),
    ("claim", "What is claimed", False),
)


# The end of one sentence of a note and the beginning of the next.
SENTENCES = re.compile(r"(?<=[\w)])\. (?=[A-Z])")


def sentence(note: str) -> str:
    """A terminal's note as a sentence of a page."""
    return in_words(COMMAND.sub(lambda command: f"`{command[0]}`", note.rstrip(". ")))


@dataclass(frozen=True, slots=True, kw_only=True)
class Report(Answering):
    """A written page."""

    path: Path
    summary: tuple[str, ...]  # sentences at its top
    sections: tuple[str, ...]  # titles
    tables: tuple[Table, ...]
    shown: Answer = field(default_factory=Answer, repr=False)  # the answer for a terminal


def answer(report: Report) -> Answer:
    """The answer that the page shows, and its file."""
    return replace(report.shown, files={"report": report.path})


def look_and_script(script: Path, *looks: Path) -> dict[str, str]:
    """Style and script of a page: those of charts and of every page, then its own.

    The page's content security policy allows only the script with this hash.
    """
    sheets = Path(__file__).with_name("page.css"), *looks
    scripts = Path(chart.__file__).with_suffix(".js"), script
    rules, whole = (
        "\n".join(file.read_text(encoding="utf-8") for file in files) for files in (sheets, scripts)
    )
    digest = base64.b64encode(hashlib.sha256(whole.encode()).digest()).decode()
    return {
        "style": f"{chart.style()}\n{rules}",
        "script": whole,
        "script_hash": f"sha256-{digest}",
    }


def write_page(
    path: Path,
    template: "Template",
    *,
    summary: tuple[str, ...] = (),
    sections: Sequence[Section] = (),
    **more: Any,
) -> Report:
    """Write a page without empty tables and sections."""
    filled = (
        replace(section, tables=[table for table in section.tables if table.records])
        for section in sections
    )
    sections = [section for section in filled if section.charts or section.tables]
    page = template.render(
        **{"claim": "", "about": (), "legend": (), "styles": {}, "found": None, **more},
        summary=summary,
        sections=sections,
        **look_and_script(Path(__file__).with_name("page.js")),
    )
    write_text(path, printable(page))  # a title may have control characters
    titles = tuple(section.title for section in sections if section.title)
    tables = tuple(table for section in sections for table in section.tables)
    return Report(path=path, summary=summary, sections=titles, tables=tables)


def write_answer(
    path: str | Path,
    *,
    title: str,
    summary: Sequence[str],
    commands: str,
    parts: Mapping[str, Section],
    texts: Mapping[str, str] | None = None,
    **more: Any,
) -> Report:
    """Write the page of an answer: a sentence, the existing `parts`, and how to repeat it."""
    # Parts that are not in `PARTS` come last.
    names = {
        key: {"id": key, "title": parts[key].title or name, "open": seen}
        for key, name, seen in PARTS
        if key in parts
    }
    ordered = [*names, *(x for x in parts if x not in names)]
    return write_page(
        Path(path),
        page_template("flighttune.outputs.pages", "answer.html.jinja"),
        title=title,
        summary=tuple(map(sentence, summary)),
        sections=[replace(parts[key], **names.get(key, {"id": key})) for key in ordered],
        commands=commands,
        texts={name: text for name, text in (texts or {}).items() if text},
        **more,
    )
