"""What every page is made of: answers, sections with pictures and tables, and the frame of HTML."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from flighttune.present.figures import on_white, svg_uri
from flighttune.present.tables import Table
from flighttune.whole_file import whole_file

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.axes import Axes

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
class Picture:
    """A figure of the page.

    Attributes
    ----------
    uri : str
        The image itself.
    alt : str
        What it shows, for who cannot see it.
    """

    uri: str
    alt: str


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
    pictures : sequence of Picture
    tables : sequence of Table
    legend : bool
        Whether the runs are named above the pictures.
    """

    id: str
    title: str
    note: str
    pictures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()
    legend: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A page that was written.

    Attributes
    ----------
    path : Path
        The HTML file.
    answers : tuple of Answer
        Its headline.
    sections : tuple of str
        Titles of its parts.
    """

    path: Path
    answers: tuple[Answer, ...]
    sections: tuple[str, ...]


def share_verdict(good: int, count: int) -> Verdict:
    """Yes where all of `count` are good, no where none is, partly between; none of nothing."""
    if not count:
        return "none"
    return "yes" if good == count else "partly" if good else "no"


def pictured(axes: "Axes", alt: str) -> Picture:
    """The finished figure around some axes."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    return Picture(uri=svg_uri(figure), alt=alt)


def write_page(
    path: Path,
    template: "Template",
    *,
    answers: tuple[Answer, ...],
    sections: Sequence[Section],
    **more: Any,
) -> Report:
    """Write a report: headline, sections and what its template asks for besides.

    Parameters
    ----------
    path : Path
        HTML file to write or replace; parent folders are made.
    template : Template
        As `page_template` returns it.
    answers : tuple of Answer
    sections : sequence of Section
    more
        Further values of the template.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with whole_file(path) as part:
        text = template.render(answers=answers, sections=sections, **more)
        part.write_text(text, encoding="utf-8")
    return Report(path=path, answers=answers, sections=tuple(one.title for one in sections))


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

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(one, ".") for one in (package, FRAME_PACKAGE)]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["on_white"] = on_white
    return environment.get_template(name)
