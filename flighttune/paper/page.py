"""One page with everything: claims first, then the items with their figures, then the errata."""

import base64
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flighttune.paper.claims.base import VERDICTS, Finding
from flighttune.paper.errata import Erratum
from flighttune.paper.items.base import Item, Made

if TYPE_CHECKING:
    from jinja2 import Template

TEMPLATE = "page.html.jinja"
PIXELS_PER_INCH = 108.0


def page_text(
    findings: Sequence[Finding],
    items: Sequence[tuple[Item, Made]],
    errata: Mapping[str, Sequence[Erratum]],
    *,
    folder: Path,
) -> str:
    """The page as HTML that needs nothing else.

    Parameters
    ----------
    findings : sequence of Finding
        Claims with their verdicts.
    items : sequence of (Item, Made)
        What was made; the figures are taken as SVG from `folder`.
    errata : mapping of str to sequence of Erratum
        By part.
    folder : Path
        Where the figures are.

    Returns
    -------
    str
    """
    counts = Counter(finding.verdict for finding in findings)
    return _template().render(
        findings=findings,
        counts=[(verdict, counts[verdict]) for verdict in VERDICTS],
        items=[
            {
                "item": item,
                "made": made,
                "figures": [
                    {
                        "name": name,
                        "caption": caption,
                        "uri": data_uri(folder / f"{name}.svg"),
                        "width": round(PIXELS_PER_INCH * figure.get_figwidth()),
                    }
                    for name, (caption, figure) in made.figures.items()
                ],
            }
            for item, made in items
        ],
        errata=errata,
    )


def data_uri(path: Path) -> str:
    """An SVG file as the address of an image that is part of the page."""
    return f"data:image/svg+xml;base64,{base64.b64encode(path.read_bytes()).decode()}"


def shown(value: Any) -> str:
    """A number with five digits, text as it is."""
    return f"{value:.5g}" if isinstance(value, (int, float)) else str(value)


def verdict_class(verdict: str) -> str:
    """Name of a verdict in the style sheet."""
    return verdict.replace(" ", "-")


@cache
def _template() -> "Template":
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader("flighttune.paper", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["shown"] = shown
    environment.filters["verdict_class"] = verdict_class
    return environment.get_template(TEMPLATE)
