"""Sizes, colours and files of the paper's figures.

Items are drawn inside ``matplotlib.rc_context(RC)``; `flighttune.paper.reproduce` enters it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flighttune.paper.parameters import STAR, TABLE_2, TABLE_3
from flighttune.present.palette import HUES, INK, LIMIT
from flighttune.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STRONG = [strong for (strong, _), _ in HUES]
CHI, GAMMA, GREEN, MAGENTA = STRONG[:4]
"""The first two for course and path angle where there is one flight."""

SHADE = HUES[0][1][0]
"""Background of a region."""

GAIN_COLOURS = {STAR: INK, **dict(zip(TABLE_2, STRONG, strict=True))}
"""Colour of each gain set, the same as in the recording."""

AMPLITUDE_COLOURS = {0.1: CHI, 0.2: GREEN, 0.3: MAGENTA}
OMEGA_DASHES = {0.1: "-", 0.15: (0, (5, 2)), 0.2: (0, (1.5, 1.5))}
"""Disturbances: the hue tells the amplitude L_d, the dashes the frequency omega_d."""

LABELS = {
    "chi": r"$e_\chi$",
    "gamma": r"$e_\gamma$",
    "chi_dot": r"$\dot e_\chi$",
    "gamma_dot": r"$\dot e_\gamma$",
    "s_chi": r"$s_\chi$",
    "s_gamma": r"$s_\gamma$",
}
UNITS = {"chi": "rad", "gamma": "rad", "chi_dot": "rad/s", "gamma_dot": "rad/s"}
AXES = {"R_K": r"$R_K$ [1/s]", "I_K": r"$I_K$ [s²]"}

RC: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    # the margins leave room for the title: where it may stand by itself, matplotlib lays out all
    # tick labels once more to find out, a third of the time of a figure
    "axes.titley": 1.0,
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.edgecolor": "#666666",
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "path.simplify_threshold": 0.2,
    "svg.hashsalt": "flighttune",
}
"""Small text: many panels stand together."""

DPI = 150


def grid(
    rows: int, columns: int, *, size: tuple[float, float], titles: Sequence[str] = ()
) -> "tuple[Figure, list[Axes]]":
    """A figure and its panels, row by row.

    Parameters
    ----------
    rows, columns : int
    size : tuple of float, inches
        Width and height.
    titles : sequence of str, optional
        Of the panels; they are lettered (a), (b), ... where there are several.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=DPI, layout="constrained")
    panels = list(np.ravel(figure.subplots(rows, columns)))
    for letter, panel, title in zip("abcdefgh", panels, titles, strict=False):
        panel.set_title(f"({letter}) {title}" if len(panels) > 1 else title)
    return figure, panels


def over_time(panel: "Axes", label: str, end: float) -> None:
    """Label a panel that shows something over the time of a flight."""
    panel.set(xlabel="t [s]", ylabel=label, xlim=(0.0, end))


def note(panel: "Axes", text: str, at: tuple[float, float], *, by: tuple[float, float]) -> None:
    """Write next to a point, on a white background; `by` is the offset in points."""
    panel.annotate(
        text,
        at,
        xytext=by,
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=8,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85},
    )


def limits(panel: "Axes", *, x: Sequence[float] = (), y: Sequence[float] = (), label="") -> None:
    """Draw vertical limit lines at `x` and horizontal ones at `y`; the first has the label."""
    look: dict[str, Any] = {"color": LIMIT, "lw": 1.1, "ls": (0, (6.0, 3.0))}
    lines = [panel.axvline(value, **look) for value in x]
    lines += [panel.axhline(value, **look) for value in y]
    lines[0].set_label(label)


def legend_above(figure: "Figure", *panels: "Axes", columns: int) -> None:
    """One legend above all panels, with the lines of those given."""
    handles, labels = [], []
    for panel in panels:
        more, names = panel.get_legend_handles_labels()
        handles += more
        labels += names
    figure.legend(handles, labels, loc="outside upper center", ncols=columns)


def save(figures: "Mapping[str, Figure]", folder: Path) -> list[Path]:
    """Write each figure as PNG and SVG; return the files."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    files = []
    for name, figure in figures.items():
        png, svg = folder / f"{name}.png", folder / f"{name}.svg"
        # Not `savefig`, which draws everything twice, and the layout of the PNG is kept for the
        # SVG: drawing and layout are most of the time of a reproduction.
        with whole_file(png) as part:
            FigureCanvasAgg(figure).print_png(part, metadata={"Software": None})
        figure.set_layout_engine("none")
        with whole_file(svg) as part:
            FigureCanvasSVG(figure).print_svg(part, metadata={"Date": None, "Creator": None})
        files += [png, svg]
    return files


def disturbance_style(name: str) -> dict[str, Any]:
    """Line of one of the disturbances d1 to d9."""
    amplitude, omega = TABLE_3[name]
    return {
        "color": AMPLITUDE_COLOURS[amplitude],
        "ls": OMEGA_DASHES[omega],
        "lw": 1.2,
        "label": rf"{name}: $L_d$ {amplitude:g}, $\omega_d$ {omega:g}",
    }
