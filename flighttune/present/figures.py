"""One style for every figure: sizes, colours, lines and limits, on white ground and in print."""

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.present.palette import LIMIT, NEUTRAL, LineStyle, rgb
from flighttune.present.thinning import peaks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#222222"
REFERENCE = NEUTRAL
FAINT = 0.16
"""Opacity of regions."""

DASHES = (0, (4.0, 1.6))
"""Of light shades, which a full line would lose on white paper."""

LIMIT_DASHES = (0, (6.0, 3.0))

RC: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    # the margins leave room for the title: where it may stand by itself, matplotlib lays out all
    # tick labels once more to find out, a third of the time of a figure
    "axes.titley": 1.0,
    "axes.labelsize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.edgecolor": "#666666",
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "path.simplify_threshold": 0.2,
    "svg.hashsalt": "flighttune",
}

PANEL = (5.2, 2.7)
"""Width and height of a panel in inches: readable where a phone shows it at three quarters."""

MARGINS = (0.66, 0.14, 0.5, 0.28)
"""Left, right, bottom and top of a panel, inches: panels that stand together line up."""

LEAST_CONTRAST = 2.1
"""Of a line against white."""

MOST_POINTS = 600
"""Points of a line; of more only the lowest and highest of each stretch are drawn."""


@contextmanager
def panel(title: str, y: str, x: str = "t [s]", *, height: float = PANEL[1]) -> "Iterator[Axes]":
    """A figure of one panel, in the common style while the block draws.

    Parameters
    ----------
    title : str
        What is shown, in words.
    y, x : str
        Labels of the axes, with units.
    height : float, inches
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(RC):
        figure = Figure(figsize=(PANEL[0], height))
        left, right, bottom, top = MARGINS
        width, tall = PANEL[0] - left - right, height - bottom - top
        axes = figure.add_axes((left / PANEL[0], bottom / height, width / PANEL[0], tall / height))
        axes.set_title(title)
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        yield axes


def on_white(colour: str) -> str:
    """`colour`, darkened until it can be seen on white paper; its hue stays.

    Parameters
    ----------
    colour : str
        ``#RRGGBB``.
    """
    channels = np.array(rgb(colour), dtype=float)
    while contrast_on_white(channels) < LEAST_CONTRAST:
        channels *= 0.97
    red, green, blue = (round(value) for value in channels)
    return f"#{red:02X}{green:02X}{blue:02X}"


def contrast_on_white(channels: FloatArray) -> float:
    """Contrast ratio of WCAG 2 between white and red, green and blue (0 to 255), 1 to 21."""
    part = channels / 255.0
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    return 1.05 / (float(linear @ [0.2126, 0.7152, 0.0722]) + 0.05)


def line(
    axes: "Axes",
    x: FloatArray,
    y: FloatArray,
    style: LineStyle,
    *,
    most: int = MOST_POINTS,
    **more: Any,
) -> None:
    """Draw the line of a run: its colour and width, broken where the shade is light.

    Parameters
    ----------
    axes : Axes
    x, y : ndarray, shape (n,)
    style : LineStyle
    most : int
        Points to draw; see `thinned`.
    more
        Keyword arguments that override the style.
    """
    drawn: dict[str, Any] = {"color": on_white(style.colour), "lw": 0.9 * style.width}
    drawn |= {"ls": DASHES if style.dashed else "-", **more}
    axes.plot(*thinned(x, y, most), **drawn)


def levels(axes: "Axes", *values: float) -> None:
    """Draw horizontal limit lines."""
    for value in values:
        axes.axhline(value, color=LIMIT, lw=1.1, ls=LIMIT_DASHES)


def thinned(x: FloatArray, y: FloatArray, most: int = MOST_POINTS) -> tuple[FloatArray, FloatArray]:
    """At most about `most` points that keep every peak.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
    most : int

    Returns
    -------
    x, y : ndarray
        Of each of `most` / 2 stretches the lowest and the highest point, and a nan where there is
        one; all where there are fewer.
    """
    if len(x) <= most:
        return x, y
    kept = peaks(y, most=most)
    return x[kept], y[kept]


def svg_uri(figure: "Figure") -> str:
    """A figure as the address of an SVG image that is part of a page."""
    import matplotlib as mpl

    with mpl.rc_context(RC), io.BytesIO() as file:
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
        text = file.getvalue()
    return f"data:image/svg+xml;base64,{base64.b64encode(text).decode()}"
