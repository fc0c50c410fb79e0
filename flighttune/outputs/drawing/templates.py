"""Templates of pages and of files of other programs."""

import re
from functools import cache
from typing import TYPE_CHECKING

from flighttune.outputs.drawing.chart import dashes, key, marked_up

if TYPE_CHECKING:
    from jinja2 import Template


@cache
def page_template(package: str, name: str) -> "Template":
    """A template of a package; it may extend ``frame.html.jinja``, the frame of every page."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    environment = Environment(
        loader=ChoiceLoader(
            [PackageLoader(folder, ".") for folder in (package, "flighttune.outputs.pages")]
        ),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["key"] = lambda style: Markup(key(style.colour, dashes(style), style.width))
    environment.filters["words"] = lambda text: Markup(marked_up(text, "<sub>{}</sub>"))
    environment.filters["code"] = lambda text: Markup(
        re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text)))
    )
    environment.filters["sign"] = lambda colour, dash: Markup(key(colour, dash))
    return environment.get_template(name)
