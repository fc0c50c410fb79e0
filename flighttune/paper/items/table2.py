"""Table 2: R_K and I_K over epsilon."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flighttune.control.closed_loop import closed_loops
from flighttune.control.gains import PAPER_EPSILON
from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.items.base import FAMILY, PRINTED_STAR, Item, Made
from flighttune.paper.parameters import STAR
from flighttune.paper.study import Study
from flighttune.theory.indicators import indicators_batch

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def make(study: Study) -> Made:
    """Set the printed table beside the computed one."""
    pairs = {**printed.TABLE_2, STAR: (printed.R_K_PRINTED, printed.I_K_PRINTED)}
    rows = {
        name: {
            "epsilon": {**PAPER_EPSILON, STAR: 0.0}[name],
            "R_K_printed": pairs[name][0],
            "R_K": found.R_K,
            "I_K_printed": pairs[name][1],
            "I_K": found.I_K,
            "spectral_abscissa": found.spectral_abscissa,
        }
        for name, found in study.indicators.items()
    }
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("type")
    largest = (table["R_K"] - table["R_K_printed"]).drop(STAR).abs().max()
    return Made(
        figures={"table2": ("Lines: computed. Marks: printed.", _panels(study, table))},
        tables={"table2": table.reset_index()},
        values={
            name: {"R_K": found.R_K, "I_K": found.I_K} for name, found in study.indicators.items()
        },
        outcome=(
            f"The six rows differ from the printed ones by {largest:.1e} in R_K at most; the pair "
            f"printed below K* by {abs(rows[STAR]['R_K'] - printed.R_K_PRINTED):.4f}.",
        ),
    )


def _panels(study: Study, table: pd.DataFrame) -> "Figure":
    figure, panels = style.grid(1, 2, size=(8.0, 3.3), titles=("$R_K$", "$I_K$"))
    epsilon = np.linspace(-4.5, 1.15, 300)
    shift = np.hstack([np.eye(2), np.eye(2)])
    curve = indicators_batch(
        closed_loops(study.model, study.star.K - epsilon[:, None, None] * shift)
    )
    for panel, key, values in zip(panels, ("R_K", "I_K"), (curve.R_K, curve.I_K), strict=True):
        panel.plot(epsilon, values, color=style.GREY, label="computed")
        for name, row in table.iterrows():
            cross = name == STAR
            panel.plot(
                row["epsilon"],
                row[f"{key}_printed"],
                "x" if cross else "o",
                color=style.RED if cross else style.GAIN_COLOURS[str(name)],
                ms=8 if cross else 5,
                mew=2 if cross else 1,
                ls="none",
                label="K* as printed" if cross else f"{name}",
            )
        panel.set_xlabel("ε")
        panel.set_ylabel(style.R_K_AXIS if key == "R_K" else style.I_K_AXIS)
    style.legend_above(figure, panels[0], columns=8)
    return figure


ITEM = Item(
    name="table2",
    title="R_K and I_K of K1 to K6",
    printed="Table 2",
    make=make,
    parameters=(PRINTED_STAR, FAMILY),
    assumed=(
        printed.Assumption(
            "which of many optimal Q gives I_K",
            "the solution of the Lyapunov equation, the smallest",
            "the paper's program has many minimisers; this one gives the printed numbers",
        ),
    ),
)
