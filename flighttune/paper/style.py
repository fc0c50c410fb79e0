"""One look for every figure of the paper: sizes, colours and the files they become."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flighttune.figures import INK
from flighttune.figures import RC as COMMON
from flighttune.palette import HUES, LIMIT, NEUTRAL, looks
from flighttune.paper.parameters import STAR, TABLE_2, TABLE_3
from flighttune.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY = NEUTRAL
RED = LIMIT

_STRONG = [strong for (strong, _), _ in HUES]
_LIGHT = [light for _, (light, _) in HUES]

CHI, GAMMA = _STRONG[0], _STRONG[1]
"""Course and path angle where there is one flight."""

GREEN, MAGENTA = _STRONG[2], _STRONG[3]
SHADE = _LIGHT[0]
"""Ground of a region."""

_GAIN_LOOKS = looks(("kinematic", name) for name in TABLE_2)
GAIN_COLOURS = {STAR: INK, **{name: look.colour for (_, name), look in _GAIN_LOOKS.items()}}
"""Colour of each gain set, the same as in the recording."""

AMPLITUDE_COLOURS = dict(zip((0.1, 0.2, 0.3), (_STRONG[0], _STRONG[2], _STRONG[3]), strict=True))
OMEGA_DASHES = dict(zip((0.1, 0.15, 0.2), ("-", (0, (5, 2)), (0, (1.5, 1.5))), strict=True))
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
R_K_AXIS, I_K_AXIS = r"$R_K$ [1/s]", r"$I_K$ [s²]"

SERIES: dict[str, dict[str, Any]] = {
    "chi": {"color": CHI, "marker": "o"},
    "gamma": {"color": GAMMA, "marker": "s"},
    "chi_dot": {"color": CHI, "marker": "o", "ls": "--", "markerfacecolor": "white"},
    "gamma_dot": {"color": GAMMA, "marker": "s", "ls": "--", "markerfacecolor": "white"},
    "s_chi": {"color": CHI, "marker": "o"},
    "s_gamma": {"color": GAMMA, "marker": "s"},
}
"""Marks of each channel where a measure is drawn over something."""

RC: dict[Any, Any] = {
    **COMMON,
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
}
"""The common style, a little smaller: many panels stand together."""

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
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(RC):
        figure = Figure(figsize=size, layout="constrained")
        panels = list(np.ravel(figure.subplots(rows, columns)))
        for letter, panel, title in zip("abcdefgh", panels, titles, strict=False):
            panel.set_title(f"({letter}) {title}" if len(panels) > 1 else title, loc="left")
    return figure, panels


def over_time(panel: "Axes", label: str, end: float) -> None:
    """Label a panel that shows something over the time of a flight."""
    panel.set_xlabel("t [s]")
    panel.set_ylabel(label)
    panel.set_xlim(0.0, end)


def note(panel: "Axes", text: str, at: tuple[float, float], *, by: tuple[float, float]) -> None:
    """Write beside a point, on a white ground; `by` is the offset in points."""
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


def level(panel: "Axes", *values: float, label: str = "") -> None:
    """Draw horizontal limit lines; the first carries the label."""
    for k, value in enumerate(values):
        panel.axhline(value, color=RED, lw=1.1, ls=(0, (6, 3)), label=label if not k else "")


def legend_above(figure: "Figure", *panels: "Axes", columns: int) -> None:
    """One legend outside of all panels, with the lines of those given."""
    import matplotlib as mpl

    handles, labels = [], []
    for panel in panels:
        more, names = panel.get_legend_handles_labels()
        handles += more
        labels += names
    with mpl.rc_context(RC):
        figure.legend(handles, labels, loc="outside upper center", ncols=columns)


def legend(panel: "Axes", **where: Any) -> None:
    """A legend inside a panel."""
    import matplotlib as mpl

    with mpl.rc_context(RC):
        panel.legend(**where)


def save(figures: "Mapping[str, Figure]", folder: Path) -> list[Path]:
    """Write each figure as PNG and SVG, laid out once; return the files."""
    import matplotlib as mpl

    files = []
    with mpl.rc_context(RC):
        for name, figure in figures.items():
            png, svg = folder / f"{name}.png", folder / f"{name}.svg"
            with whole_file(png) as part:
                figure.savefig(part, dpi=DPI, metadata={"Software": None})
            figure.set_layout_engine("none")
            with whole_file(svg) as part:
                figure.savefig(part, metadata={"Date": None, "Creator": None})
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
