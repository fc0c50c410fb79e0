"""What every page is made of: answers, sections with charts and tables, and the frame of HTML."""

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from flighttune.present.chart import Chart, dashes, key, marked_up, style
from flighttune.present.tables import Table
from flighttune.whole_file import write_text

if TYPE_CHECKING:
    from jinja2 import Template

Verdict: TypeAlias = Literal["yes", "no", "partly", "none"]

FRAME_PACKAGE = "flighttune.present"


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One question of the headline.

    Attributes
    ----------
    question : str
    verdict : "yes", "no", "partly" or "none"
        "none" where the question is not one of yes and no.
    short : str
        The answer in a few words.
    sentences : tuple of str
        With numbers.
    criterion : str
        What the verdict goes by; empty where the sentences say it.
    """

    question: str
    verdict: Verdict
    short: str
    sentences: tuple[str, ...]
    criterion: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of the page.

    Attributes
    ----------
    id : str
        Its anchor.
    title : str
    note : str
        How to read it.
    charts : sequence of Chart
    tables : sequence of Table
    legend : bool
        Whether the runs are named above the charts.
    columns : int
        Charts side by side on a wide screen, 2 or 3.
    folded : bool
        Whether only its title is seen at first; parts that are not folded come first.
    """

    id: str
    title: str
    note: str = ""
    charts: Sequence[Chart] = ()
    tables: Sequence[Table] = ()
    legend: bool = True
    columns: int = 2
    folded: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A page that was written.

    Attributes
    ----------
    path : Path
        The HTML file.
    summary : tuple of str
        The sentences at its top.
    answers : tuple of Answer
        Questions answered in words.
    sections : tuple of str
        Titles of its parts.
    """

    path: Path
    summary: tuple[str, ...]
    answers: tuple[Answer, ...]
    sections: tuple[str, ...]


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
    answers: tuple[Answer, ...] = (),
    sections: Sequence[Section] = (),
    **more: Any,
) -> Report:
    """Write a page: summary, sections, answers in words, and what its template asks for besides.

    Parameters
    ----------
    path : Path
        HTML file to write or replace; parent folders are made.
    template : Template
        As `page_template` returns it.
    summary : tuple of str
    answers : tuple of Answer
    sections : sequence of Section
    more
        Further values of the template.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    write_text(
        path, page_text(template, summary=summary, answers=answers, sections=sections, **more)
    )
    titles = tuple(one.title for one in sections if one.title)
    return Report(path=path, summary=summary, answers=answers, sections=titles)


def page_text(template: "Template", **values: Any) -> str:
    """A page with the style and the script of all pages.

    Parameters
    ----------
    template : Template
        As `page_template` returns it.
    values
        Of the template.
    """
    empty = {"claim": "", "summary": (), "answers": (), "sections": (), "legend": ()}
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
    """A template of a package; it may extend ``frame.html.jinja``, the frame of every page.

    Parameters
    ----------
    package : str
        Package whose folder holds the template.
    name : str
        Its file.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(one, ".") for one in (package, FRAME_PACKAGE)]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["key"] = lambda style: Markup(key(style.colour, dashes(style), style.width))
    environment.filters["words"] = lambda text: Markup(marked_up(text, "<sub>{}</sub>"))
    environment.filters["sign"] = lambda colour, dash: Markup(key(colour, dash))
    return environment.get_template(name)
