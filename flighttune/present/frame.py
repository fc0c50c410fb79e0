"""Parts of every page: questions, sections with charts and tables, and the frame of HTML."""

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from flighttune.present.chart import Chart, dashes, key, marked_up, style
from flighttune.present.tables import Column, Table
from flighttune.whole_file import write_text

if TYPE_CHECKING:
    from jinja2 import Template

Verdict: TypeAlias = Literal["yes", "no", "partly", "none"]

FRAME_PACKAGE = "flighttune.present"


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """A question of the headline; the tables of the page have the numbers behind its verdict."""

    question: str
    verdict: Verdict  # "none" where the question is not one of yes and no
    short: str  # the answer in a few words
    criterion: str = ""  # what the verdict goes by
    sentences: tuple[str, ...] = ()  # what no table says


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of the page."""

    id: str  # its anchor
    title: str
    note: str = ""  # how to read it
    charts: Sequence[Chart] = ()
    tables: Sequence[Table] = ()
    legend: bool = True  # whether the runs are named above the charts
    columns: int = 2  # charts side by side on a wide screen, 2 or 3
    folded: bool = True  # only the title is seen at first; folded sections come last


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A page that was written.

    Attributes
    ----------
    path : Path
        The file.
    summary : tuple of str
        Sentences at its top.
    questions : tuple of Question
        Questions that it answers, each with its verdict.
    sections : tuple of str
        Titles.
    tables : tuple of Table
        Tables below the questions.
    """

    path: Path
    summary: tuple[str, ...]
    questions: tuple[Question, ...]
    sections: tuple[str, ...]
    tables: tuple[Table, ...]


QUESTION_COLUMNS = (Column("question", "question"), Column("short", "answer"))


def questions_table(questions: Sequence[Question]) -> Table:
    """Questions with their answers, as a command prints them."""
    return Table(
        title="", name="headline", columns=QUESTION_COLUMNS, records=[asdict(q) for q in questions]
    )


def share_verdict(good: int, count: int) -> Verdict:
    """Yes where all of `count` are good, no where none is, partly between; none of nothing."""
    if not count:
        return "none"
    return "yes" if good == count else "partly" if good else "no"


def write_page(
    path: Path,
    template: "Template",
    *,
    summary: tuple[str, ...] = (),
    questions: tuple[Question, ...] = (),
    sections: Sequence[Section] = (),
    **more: Any,
) -> Report:
    """Write a page: summary, sections, answers, and what its template asks for besides.

    Parent folders of `path` are made. Raises OutputError if the file cannot be written.
    """
    write_text(
        path, page_text(template, summary=summary, questions=questions, sections=sections, **more)
    )
    titles = tuple(section.title for section in sections if section.title)
    tables = tuple(table for section in sections for table in section.tables)
    return Report(path=path, summary=summary, questions=questions, sections=titles, tables=tables)


def page_text(template: "Template", **values: Any) -> str:
    """A page with the style and the script of all pages."""
    empty = {"claim": "", "summary": (), "questions": (), "sections": (), "legend": ()}
    return template.render(
        **{**empty, **values},
        style=f"{style()}\n{_file('page.css')}",
        script=_file("page.js"),
        script_hash=_sha256(_file("page.js")),
    )


@cache
def _file(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def _sha256(script: str) -> str:
    """The hash of a script as a content security policy allows it."""
    digest = hashlib.sha256(script.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


@cache
def page_template(package: str, name: str) -> "Template":
    """A template of a package; it may extend ``frame.html.jinja``, the frame of every page."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(folder, ".") for folder in (package, FRAME_PACKAGE)]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["key"] = lambda style: Markup(key(style.colour, dashes(style), style.width))
    environment.filters["words"] = lambda text: Markup(marked_up(text, "<sub>{}</sub>"))
    environment.filters["sign"] = lambda colour, dash: Markup(key(colour, dash))
    return environment.get_template(name)
