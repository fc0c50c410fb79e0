"""The figure of the frontier: R_K against I_K, with given gains marked."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flighttune.control.gains import PAPER_EPSILON
from flighttune.palette import HUES, NEUTRAL

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TWIN_SHIFT = 8
PAPER_NAMES = ("paper", *PAPER_EPSILON)


def frontier_figure(table: pd.DataFrame) -> "Figure":
    """Draw the frontier and the marked gains.

    Parameters
    ----------
    table : DataFrame
        What `flighttune.tuning.frontier.frontier` returns.

    Returns
    -------
    matplotlib.figure.Figure
        Nothing can lie above the curve. A mark that breaks the input
        limits is hollow, one without a stable loop is left out.
    """
    from matplotlib.figure import Figure

    along, marks = (table[(table["name"] == "frontier") == yes] for yes in (True, False))
    figure = Figure(figsize=(7.2, 4.8), layout="constrained")
    axes = figure.add_subplot()
    colour = HUES[0][0][0]
    axes.plot(along["I_K"], along["R_K"], color=colour, lw=2.0, label="largest R_K found for I_K")
    columns = (np.asarray(marks[key]) for key in ("name", "I_K", "R_K", "within_limits"))
    for name, I_K, R_K, within in zip(*columns, strict=True):
        if not R_K > 0.0:
            continue
        own = name not in PAPER_NAMES
        mark = HUES[2][0][0] if own else HUES[1][0][0]
        axes.plot(I_K, R_K, "o", ms=6, mec=mark, mfc=mark if within else "none")
        axes.annotate(
            "K*" if name == "paper" else name,
            (I_K, R_K),
            xytext=(TWIN_SHIFT, -12 if own else -4),
            textcoords="offset points",
            fontsize=9,
        )
    axes.set_xlabel("I_K, size of the ultimate set, in s²")
    axes.set_ylabel("R_K, guaranteed rate, in 1/s")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3, which="both", color=NEUTRAL, lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=9)
    return figure
