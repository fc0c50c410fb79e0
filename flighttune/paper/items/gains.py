"""K*, its indicators, and the true optimum of the problem that it is printed for."""

import math
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flighttune.control.closed_loop import closed_loop, closed_loops
from flighttune.control.gains import PIGains
from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.commands import command_use, worst_use
from flighttune.paper.items.base import PRINTED_STAR, Item, Made
from flighttune.paper.parameters import STAR
from flighttune.paper.study import Study
from flighttune.theory.indicators import indicators, indicators_batch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OPTIMUM = "optimum without input constraints"
NEAREST = "smallest I_K within the input constraints"
EPSILONS = np.linspace(-6.0, 1.25, 300)


def make(study: Study) -> Made:
    """Set K* beside the optimum, its indicators beside the printed ones, and its constraints."""
    sets = {STAR: study.star}
    for name, result in ((OPTIMUM, study.optimum), (NEAREST, study.constrained)):
        if result.gains is not None:
            sets[name] = result.gains
    table = pd.DataFrame({name: _row(study, gains) for name, gains in sets.items()}).T
    star, best, near = study.indicators[STAR], study.optimum, study.constrained
    return Made(
        figures={
            "gains": (
                "K* and the true optimum in the plane of the indicators; the curve is the family "
                "K* − ε (I, I).",
                _plane(study),
            ),
            "gains_indicators": (
                "Printed indicators minus those of the printed gains, in units of the last digit: "
                "Table 2 agrees, the line below K* does not.",
                _disagreement(study),
            ),
            "gains_constraints": (
                "Commands and rates at t_0 as a part of their printed limits. The gains that keep "
                f"them all with the smallest I_K have an I_K of {near.I_K:.1f} s².",
                _constraints(sets),
            ),
        },
        tables={"gains": table.rename_axis("gains").reset_index()},
        values={
            "K_P": study.star.K_P.tolist(),
            "K_I": study.star.K_I.tolist(),
            "R_K": star.R_K,
            "I_K": star.I_K,
            "R_K_printed": printed.R_K_PRINTED,
            "I_K_printed": printed.I_K_PRINTED,
            "optimum": {
                "R_K": best.R_K,
                "I_K": best.I_K,
                "K_P": None if best.gains is None else best.gains.K_P.tolist(),
                "K_I": None if best.gains is None else best.gains.K_I.tolist(),
            },
            "with_input_constraints": {
                "status": near.status,
                "smallest_I_K": near.I_K,
                "R_K": near.R_K,
            },
            "command_use": {
                key: {"value": value, "lower": low, "upper": high}
                for key, (value, low, high) in command_use(study.star).items()
            },
        },
        outcome=(
            f"The printed gains have R_K {star.R_K:.4f} and I_K {star.I_K:.4f}; printed are "
            f"{printed.R_K_PRINTED} and {printed.I_K_PRINTED}.",
            f"At t_0 they ask for {worst_use(study.star):.2f} times what a limit allows.",
            f"With all printed constraints the model is {near.status} for I* = {printed.I_STAR}: "
            f"the smallest I_K is {near.I_K:.2f}.",
            f"Without the input constraints the highest R_K is {best.R_K:.5f}.",
        ),
    )


def _row(study: Study, gains: PIGains) -> dict[str, float]:
    found = indicators(closed_loop(study.model, gains))
    entries = {
        f"{part}_{i + 1}{j + 1}": float(matrix[i, j])
        for part, matrix in (("K_P", gains.K_P), ("K_I", gains.K_I))
        for i in (0, 1)
        for j in (0, 1)
    }
    return {
        **entries,
        "R_K_1_per_s": found.R_K,
        "I_K_s2": found.I_K,
        "spectral_abscissa_1_per_s": found.spectral_abscissa,
        "largest_use_of_a_limit": worst_use(gains),
    }


def _plane(study: Study) -> "Figure":
    figure, (panel,) = style.grid(1, 1, size=(6.2, 4.2))
    shift = np.hstack([np.eye(2), np.eye(2)])
    curve = indicators_batch(
        closed_loops(study.model, study.star.K - EPSILONS[:, None, None] * shift)
    )
    panel.plot(curve.R_K, curve.I_K, color=style.GREY, label="K* − ε (I, I)")
    for name, found in study.indicators.items():
        panel.plot(found.R_K, found.I_K, "o", color=style.GAIN_COLOURS[name])
        style.note(panel, name, (found.R_K, found.I_K), by=(0, 11))
    panel.plot(
        printed.R_K_PRINTED,
        printed.I_K_PRINTED,
        "x",
        color=style.RED,
        ms=8,
        mew=2,
        label="K*, indicators as printed",
    )
    best = study.optimum
    if math.isfinite(best.I_K):
        label = f"optimum for I* = {printed.I_STAR:g}, no input constraints"
        panel.plot(best.R_K, best.I_K, "*", color=style.GREEN, ms=12, label=label)
    style.level(panel, printed.I_STAR, label=f"I* = {printed.I_STAR:g}")
    panel.set_xlim(0.15, 0.85)
    panel.set_ylim(4.5, 10.0)
    panel.set_xlabel(style.R_K_AXIS)
    panel.set_ylabel(style.I_K_AXIS)
    style.legend(panel, loc="upper center")
    return figure


def _disagreement(study: Study) -> "Figure":
    figure, panels = style.grid(1, 2, size=(8.0, 3.2), titles=("$R_K$", "$I_K$"))
    rows = {**printed.TABLE_2, STAR: (printed.R_K_PRINTED, printed.I_K_PRINTED)}
    digits = (printed.LAST_DIGITS, (1e-4, 1e-4))
    for k, (panel, unit) in enumerate(zip(panels, ("1/s", "s²"), strict=True)):
        for name, pair in rows.items():
            found = study.indicators[name]
            off = pair[k] - (found.R_K, found.I_K)[k]
            size = abs(off) / digits[name == STAR][k]
            panel.bar(name, max(size, 1e-3), color=style.GAIN_COLOURS[name], width=0.6)
            shown = f"{size:.2g}" if size < 10.0 else f"{size:.0f}"
            style.note(panel, shown, (list(rows).index(name), size), by=(0, 6))
        panel.axhline(1.0, color=style.RED, lw=1.1, ls=(0, (6, 3)))
        panel.set_yscale("log")
        panel.set_ylim(1e-3, 600.0)
        panel.set_ylabel(f"|printed − computed|\n[last printed digits, {unit}]")
    return figure


def _constraints(sets: dict[str, PIGains]) -> "Figure":
    figure, (panel,) = style.grid(1, 1, size=(7.4, 3.4))
    colours = {STAR: style.INK, OPTIMUM: style.GREEN, NEAREST: style.MAGENTA}
    labels = {
        "phi": "φ(t₀)",
        "phi rate": "φ̇(t₀)",
        "n_z": "$n_z$(t₀)",
        "n_z rate": r"$\dot n_z$(t₀)",
    }
    height = 0.8 / len(sets)
    for k, (name, gains) in enumerate(sets.items()):
        use = command_use(gains)
        for row, key in enumerate(labels):
            value, low, high = use[key]
            part = value / (high if value > 0.0 else low)
            where = row + (k - (len(sets) - 1) / 2.0) * height
            label = name.replace("I_K", "$I_K$") if row == 0 else ""
            panel.barh(where, part, height=0.9 * height, color=colours[name], label=label)
            style.note(panel, f"{part:.2f}", (part, where), by=(12, 0))
    panel.axvline(1.0, color=style.RED, lw=1.3, ls=(0, (6, 3)))
    panel.set_yticks(range(len(labels)), list(labels.values()))
    panel.invert_yaxis()
    panel.set_xlabel("command or rate at t₀ / its printed limit")
    style.legend(panel, loc="lower right")
    return figure


ITEM = Item(
    name="gains",
    title="K*, its indicators and the true optimum",
    printed="Section 5.2, the gains printed below the control law",
    make=make,
    parameters=(
        PRINTED_STAR,
        "Table 1: V = 25 m/s, g = 9.81 m/s², γ_c = π/12",
        "section 4.4: Δt = 0.1 s, x_0 = e(0) = (−π/3, −π/6); Table 1: limits of φ, n_z and rates",
    ),
    assumed=(
        printed.Assumption(
            "I*, the bound on I_K",
            f"{printed.I_STAR:g}",
            "the I_K printed for K*: the printed optimum has to satisfy it",
        ),
        printed.Assumption(
            "which of many optimal Q gives I_K",
            "the solution of the Lyapunov equation, the smallest",
            "it gives the numbers of Table 2",
        ),
    ),
)
