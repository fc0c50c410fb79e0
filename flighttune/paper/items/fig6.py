"""Figure 6: eigenvalues of A_K(0) with K*, and the disturbance."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flighttune.paper import style
from flighttune.paper.items.base import PRINTED_STAR, TABLE_1_DISTURBANCE, Item, Made
from flighttune.paper.parameters import DURATION, PRINTED_DISTURBANCE, STAR, disturbance
from flighttune.paper.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def make(study: Study) -> Made:
    """Draw both panels."""
    found = study.indicators[STAR]
    t = np.linspace(0.0, DURATION, 401)
    d = np.array([disturbance(PRINTED_DISTURBANCE)(moment) for moment in t.tolist()])
    figure = _panels(found.eigenvalues, t, d)
    return Made(
        figures={"fig6": ("Panels (a) and (b) as in the paper.", figure)},
        tables={
            "fig6": pd.DataFrame(
                {
                    "real_1_per_s": np.real(found.eigenvalues),
                    "imag_1_per_s": np.imag(found.eigenvalues),
                }
            ),
            "fig6_b": pd.DataFrame({"t_s": t, "d_chi_radps": d[:, 0], "d_gamma_radps": d[:, 1]}),
        },
        values={
            "eigenvalues": [[value.real, value.imag] for value in found.eigenvalues.tolist()],
            "spectral_abscissa": found.spectral_abscissa,
        },
        outcome=(f"The largest real part is {found.spectral_abscissa:.4f} 1/s.",),
    )


def _panels(eigenvalues: np.ndarray, t: np.ndarray, d: np.ndarray) -> "Figure":
    figure, (a, b) = style.grid(
        1, 2, size=(8.0, 3.2), titles=("eigenvalues of $A_K(0)$, K*", "disturbance")
    )
    a.axvline(0.0, color=style.RED, lw=1.1, ls=(0, (6, 3)))
    a.plot(np.real(eigenvalues), np.imag(eigenvalues), "o", color=style.INK, ms=6)
    a.set_xlim(-0.6, 0.1)
    a.set_ylim(-1.6, 1.6)
    a.set_xlabel("real part [1/s]")
    a.set_ylabel("imaginary part [1/s]")
    b.plot(t, d[:, 0], color=style.CHI, label=r"$d_\chi$")
    b.plot(t, d[:, 1], color=style.GAMMA, label=r"$d_\gamma$")
    b.set_ylim(-0.115, 0.16)
    style.over_time(b, "disturbance [rad/s]", DURATION)
    style.legend(b, loc="upper right", ncols=2)
    return figure


ITEM = Item(
    name="fig6",
    title="eigenvalues and disturbance",
    printed="The second figure (label Fig:6)",
    make=make,
    parameters=(PRINTED_STAR, "Table 1: V = 25 m/s, γ_c = π/12", TABLE_1_DISTURBANCE),
)
