"""Draw docs/optimum.svg, the optimum of the paper beside K*: python docs/figures/optimum.py."""

from pathlib import Path

import numpy as np

import flighttune as ft
from flighttune.control.certificates.bound import optimal_channel
from flighttune.outputs.drawing.chart import Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, INK

FILE = Path(__file__).parents[1] / "optimum.svg"
I_STAR = 5.0
BOUNDS = np.geomspace(4.86, 20.0, 60)
(BLUE, _), (RUST, _) = HUES[0][0], HUES[1][0]


def main() -> None:
    """Draw the largest R_K for each bound on I_K, and the eigenvalues of both loops."""
    law = ft.loop.kinematic_model(V_a=25.0, gamma=np.deg2rad(15.0), g=9.81)
    optimum = ft.tune("paper").gains
    assert optimum is not None
    frontier = Chart(
        title="Largest R_K for each bound on I_K",
        x="I_K [s²]",
        y="R_K [1/s]",
        x_range=(4.0, 20.0),
        y_range=(0.4, 1.0),
    )
    rates = [found.R_K for found in map(optimal_channel, BOUNDS) if found is not None]
    frontier.line(BOUNDS, rates, INK, name="optimum, closed form")
    poles = Chart(
        title="Eigenvalues of the closed loop",
        x="real part [1/s]",
        y="imaginary part [1/s]",
        x_range=(-0.6, 0.05),
    )
    for gains, colour, name in (
        (ft.PAPER_GAINS, BLUE, "K* as printed"),
        (optimum, RUST, f"tune, I* = {I_STAR:g} s²"),
    ):
        A_K = ft.loop.closed_loop(law, gains)
        loop, eigenvalues = ft.loop.indicators(A_K), np.linalg.eigvals(A_K)
        frontier.points([loop.I_K], [loop.R_K], colour, name=name)
        poles.points(eigenvalues.real, eigenvalues.imag, colour, name=name)
    Sheet(charts=[frontier, poles]).save(FILE)


if __name__ == "__main__":
    main()
