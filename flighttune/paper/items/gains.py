"""K*, K1 to K6 and the true optimum: indicators, eigenvalues, constraints, without any flight."""

import math
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.control.gains import PAPER_EPSILON, PIGains
from flighttune.control.linear_model import closed_loop, closed_loops
from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.commands import initial_commands, largest_share
from flighttune.paper.items.base import Made
from flighttune.paper.parameters import DURATION, STAR
from flighttune.paper.study import Study
from flighttune.present.palette import INK, LIMIT, NEUTRAL
from flighttune.theory.indicators import IndicatorArrays, indicators, indicators_batch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OPTIMUM = "optimum without input constraints"
NEAREST = "smallest I_K within the input constraints"
GAIN_SET_COLOURS = {STAR: INK, OPTIMUM: style.GREEN, NEAREST: style.MAGENTA}

PAIRS_PRINTED = {**printed.TABLE_2, STAR: (printed.R_K_PRINTED, printed.I_K_PRINTED)}
"""R_K and I_K as printed: the rows of Table 2, and the line below K*."""


def _indicators_over(study: Study, epsilon: FloatArray) -> IndicatorArrays:
    """Indicators of K* - epsilon (I, I), for a curve."""
    shift = np.hstack([np.eye(2), np.eye(2)])
    gains = study.star.K - epsilon[:, None, None] * shift
    return indicators_batch(closed_loops(study.model, gains))


def gains(study: Study) -> Made:
    """Compare K* with the optimum, its indicators with the printed ones, and its constraints."""
    sets = {STAR: study.star}
    for name, result in ((OPTIMUM, study.optimum), (NEAREST, study.constrained)):
        if result.gains is not None:
            sets[name] = result.gains
    table = pd.DataFrame({name: _row(study, one) for name, one in sets.items()}).T
    star, best, near = study.indicators[STAR], study.optimum, study.constrained
    return Made(
        figures={
            "gains": _plane(study),
            "gains_indicators": _disagreement(study),
            "gains_constraints": _constraints(sets),
        },
        tables={"gains": table.rename_axis("gains").reset_index()},
        values={
            **study.star.as_lists(),
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
                name: use._asdict() for name, use in initial_commands(study.star).items()
            },
        },
        numbers={"largest_share": largest_share(study.star)},
    )


def _row(study: Study, one: PIGains) -> dict[str, float]:
    found = indicators(closed_loop(study.model, one))
    entries = {
        f"{part}_{i + 1}{j + 1}": float(matrix[i, j])
        for part, matrix in (("K_P", one.K_P), ("K_I", one.K_I))
        for i in (0, 1)
        for j in (0, 1)
    }
    return {
        **entries,
        "R_K_1_per_s": found.R_K,
        "I_K_s2": found.I_K,
        "spectral_abscissa_1_per_s": found.spectral_abscissa,
        "largest_use_of_a_limit": largest_share(one),
    }


def _plane(study: Study) -> "Figure":
    figure, (panel,) = style.grid(1, 1, size=(6.2, 4.2))
    curve = _indicators_over(study, np.linspace(-6.0, 1.25, 300))
    panel.plot(curve.R_K, curve.I_K, color=NEUTRAL, label="K* − ε (I, I)")
    for name, found in study.indicators.items():
        panel.plot(found.R_K, found.I_K, "o", color=style.GAIN_COLOURS[name])
        style.note(panel, name, (found.R_K, found.I_K), by=(0, 11))
    cross = {"color": LIMIT, "ms": 8, "mew": 2, "label": "K*, indicators as printed"}
    panel.plot(printed.R_K_PRINTED, printed.I_K_PRINTED, "x", **cross)
    best = study.optimum
    if math.isfinite(best.I_K):
        label = f"optimum for I* = {printed.I_STAR:g}, no input constraints"
        panel.plot(best.R_K, best.I_K, "*", color=style.GREEN, ms=12, label=label)
    style.limits(panel, y=(printed.I_STAR,), label=f"I* = {printed.I_STAR:g}")
    panel.set(xlim=(0.15, 0.85), ylim=(4.5, 10.0))
    panel.set(xlabel=style.AXES["R_K"], ylabel=style.AXES["I_K"])
    panel.legend(loc="upper center")
    return figure


def _disagreement(study: Study) -> "Figure":
    figure, panels = style.grid(1, 2, size=(8.0, 3.2), titles=("$R_K$", "$I_K$"))
    for k, (panel, unit) in enumerate(zip(panels, ("1/s", "s²"), strict=True)):
        for place, (name, pair) in enumerate(PAIRS_PRINTED.items()):
            found = study.indicators[name]
            off = abs(pair[k] - (found.R_K, found.I_K)[k])
            size = off / (printed.STAR_LAST_DIGIT if name == STAR else printed.LAST_DIGITS[k])
            # A logarithmic axis has no zero: the bar of full agreement ends at its lower edge.
            panel.bar(name, max(size, 1e-3), color=style.GAIN_COLOURS[name], width=0.6)
            text = f"{size:.2g}" if size < 10.0 else f"{size:.0f}"
            style.note(panel, text, (place, size), by=(0, 6))
        style.limits(panel, y=(1.0,))
        panel.set(yscale="log", ylim=(1e-3, 600.0))
        panel.set_ylabel(f"|printed − computed|\n[last printed digits, {unit}]")
    return figure


def _constraints(sets: dict[str, PIGains]) -> "Figure":
    figure, (panel,) = style.grid(1, 1, size=(7.4, 3.4))
    labels = {
        "phi": "φ(t₀)",
        "phi rate": "φ̇(t₀)",
        "n_z": "$n_z$(t₀)",
        "n_z rate": r"$\dot n_z$(t₀)",
    }
    height = 0.8 / len(sets)
    for k, (name, one) in enumerate(sets.items()):
        uses = initial_commands(one)
        shares = [uses[key].share for key in labels]
        places = np.arange(len(labels)) + (k - (len(sets) - 1) / 2.0) * height
        colour, label = GAIN_SET_COLOURS[name], name.replace("I_K", "$I_K$")
        panel.barh(places, shares, height=0.9 * height, color=colour, label=label)
        for share, place in zip(shares, places, strict=True):
            style.note(panel, f"{share:.2f}", (share, place), by=(12, 0))
    style.limits(panel, x=(1.0,))
    panel.set_yticks(range(len(labels)), list(labels.values()))
    panel.invert_yaxis()
    panel.set_xlabel("command or rate at t₀ / its printed limit")
    panel.legend(loc="lower right")
    return figure


def table2(study: Study) -> Made:
    """Compare the printed table with the computed one."""
    rows = {
        name: {
            "epsilon": {**PAPER_EPSILON, STAR: 0.0}[name],
            "R_K_printed": PAIRS_PRINTED[name][0],
            "R_K": found.R_K,
            "I_K_printed": PAIRS_PRINTED[name][1],
            "I_K": found.I_K,
            "spectral_abscissa": found.spectral_abscissa,
        }
        for name, found in study.indicators.items()
    }
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("type")
    distance = (table["R_K"] - table["R_K_printed"]).abs()
    return Made(
        figures={"table2": _table2_panels(study, table)},
        tables={"table2": table.reset_index()},
        values={
            name: {"R_K": found.R_K, "I_K": found.I_K} for name, found in study.indicators.items()
        },
        numbers={
            "largest_distance": distance.drop(STAR).max(),
            "distance_of_star": distance[STAR],
        },
    )


def _table2_panels(study: Study, table: pd.DataFrame) -> "Figure":
    figure, panels = style.grid(1, 2, size=(8.0, 3.3), titles=("$R_K$", "$I_K$"))
    epsilon = np.linspace(-4.5, 1.15, 300)
    curve = _indicators_over(study, epsilon)
    for panel, key, values in zip(panels, ("R_K", "I_K"), (curve.R_K, curve.I_K), strict=True):
        panel.plot(epsilon, values, color=NEUTRAL, label="computed")
        for name, row in table.iterrows():
            mark = {"marker": "o", "ms": 5, "color": style.GAIN_COLOURS[str(name)], "label": name}
            if name == STAR:
                mark = {"marker": "x", "ms": 8, "mew": 2, "color": LIMIT, "label": "K* as printed"}
            panel.plot(row["epsilon"], row[f"{key}_printed"], ls="none", **mark)
        panel.set(xlabel="ε", ylabel=style.AXES[key])
    style.legend_above(figure, panels[0], columns=8)
    return figure


def fig6(study: Study) -> Made:
    """Draw the eigenvalues of A_K(0) with K*, and the disturbance."""
    found = study.indicators[STAR]
    t = np.linspace(0.0, DURATION, 401)
    disturbance = printed.disturbance(printed.PRINTED_DISTURBANCE)
    d = np.array([disturbance(moment) for moment in t.tolist()])
    eigenvalues = pd.DataFrame(
        {"real_1_per_s": found.eigenvalues.real, "imag_1_per_s": found.eigenvalues.imag}
    )
    titles = "eigenvalues of $A_K(0)$, K*", "disturbance"
    figure, (a, b) = style.grid(1, 2, size=(8.0, 3.2), titles=titles)
    style.limits(a, x=(0.0,))
    a.plot(*eigenvalues.to_numpy().T, "o", color=INK, ms=6)
    a.set(xlim=(-0.6, 0.1), ylim=(-1.6, 1.6))
    a.set(xlabel="real part [1/s]", ylabel="imaginary part [1/s]")
    b.plot(t, d[:, 0], color=style.CHI, label=r"$d_\chi$")
    b.plot(t, d[:, 1], color=style.GAMMA, label=r"$d_\gamma$")
    b.set_ylim(-0.115, 0.16)
    style.over_time(b, "disturbance [rad/s]", DURATION)
    b.legend(loc="upper right", ncols=2)
    return Made(
        figures={"fig6": figure},
        tables={
            "fig6": eigenvalues,
            "fig6_b": pd.DataFrame({"t_s": t, "d_chi_radps": d[:, 0], "d_gamma_radps": d[:, 1]}),
        },
        values={
            "eigenvalues": eigenvalues.to_numpy().tolist(),
            "spectral_abscissa": found.spectral_abscissa,
        },
    )
