"""K*, K1 to K6 and the true optimum: indicators, eigenvalues, constraints, without any flight."""

import math

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.control.gains import PAPER_EPSILON, PIGains
from flighttune.control.linear_model import closed_loop, closed_loops
from flighttune.paper import parameters as printed
from flighttune.paper.flight import initial_commands, largest_share
from flighttune.paper.items.base import (
    CHI,
    GAIN_COLOURS,
    GAMMA,
    GREEN,
    INDICATOR_LABELS,
    MAGENTA,
    Made,
    sheet,
)
from flighttune.paper.parameters import DURATION, STAR
from flighttune.paper.study import Study
from flighttune.present.chart import Chart, Sheet
from flighttune.present.palette import INK, LIMIT, NEUTRAL
from flighttune.theory.indicators import IndicatorArrays, indicators, indicators_batch

OPTIMUM = "optimum without input constraints"
NEAREST = "smallest I_K within the input constraints"
GAIN_SET_COLOURS = {STAR: INK, OPTIMUM: GREEN, NEAREST: MAGENTA}

# R_K and I_K as printed: the rows of Table 2, and the line below K*.
PAIRS_PRINTED = {**printed.TABLE_2, STAR: (printed.R_K_PRINTED, printed.I_K_PRINTED)}


def _indicators_over(study: Study, epsilon: FloatArray) -> IndicatorArrays:
    """Indicators of K* - epsilon (I, I), for a curve."""
    shift = np.hstack([np.eye(2), np.eye(2)])
    gains = study.star.K - epsilon[:, None, None] * shift
    return indicators_batch(closed_loops(study.model, gains))


def gains(study: Study) -> Made:
    """Compare K* with the optimum, its indicators with the printed ones, and its constraints."""
    star, best, near = study.indicators[STAR], study.optimum, study.constrained
    candidates = {STAR: study.star, OPTIMUM: best.gains, NEAREST: near.gains}
    sets = {name: gain_set for name, gain_set in candidates.items() if gain_set is not None}
    table = pd.DataFrame({name: _row(study, gain_set) for name, gain_set in sets.items()}).T
    optimal = best.gains.as_lists() if best.gains else {"K_P": None, "K_I": None}
    constrained = {"status": near.status, "smallest_I_K": near.I_K, "R_K": near.R_K}
    uses = initial_commands(study.star)
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
            "optimum": {"R_K": best.R_K, "I_K": best.I_K, **optimal},
            "with_input_constraints": constrained,
            "command_use": {name: use._asdict() for name, use in uses.items()},
        },
        numbers={"largest_share": largest_share(study.star)},
    )


def _row(study: Study, gain_set: PIGains) -> dict[str, float]:
    loop = indicators(closed_loop(study.model, gain_set))
    places = ("11", "12", "21", "22")
    return {
        **{f"K_P_{place}": x for place, x in zip(places, gain_set.K_P.ravel(), strict=True)},
        **{f"K_I_{place}": x for place, x in zip(places, gain_set.K_I.ravel(), strict=True)},
        "R_K_1_per_s": loop.R_K,
        "I_K_s2": loop.I_K,
        "spectral_abscissa_1_per_s": loop.spectral_abscissa,
        "largest_use_of_a_limit": largest_share(gain_set),
    }


def _plane(study: Study) -> Sheet:
    chart = Chart(
        title="The plane of the indicators",
        x=INDICATOR_LABELS["R_K"],
        y=INDICATOR_LABELS["I_K"],
        height=300.0,
        x_range=(0.15, 0.85),
        y_range=(4.5, 10.0),
    )
    curve = _indicators_over(study, np.linspace(-6.0, 1.25, 300))
    chart.line(curve.R_K, curve.I_K, NEUTRAL, name="K* − ε (I, I)", hover=False)
    chart.level(printed.I_STAR, name=f"I* = {printed.I_STAR:g}")
    for name, row in study.indicators.items():
        chart.points(row.R_K, row.I_K, GAIN_COLOURS[name])
    cross = {"shape": "cross", "size": 5.0}
    chart.points(printed.R_K_PRINTED, printed.I_K_PRINTED, LIMIT, name="K* as printed", **cross)
    best = study.optimum
    if math.isfinite(best.I_K):
        chart.points(best.R_K, best.I_K, GREEN, name=OPTIMUM, shape="plus", size=6.0)
    chart.label_points([(row.R_K, row.I_K, name) for name, row in study.indicators.items()])
    return sheet([chart])


def _disagreement(study: Study) -> Sheet:
    charts = []
    for k, (key, unit) in enumerate((("R_K", "1/s"), ("I_K", "s²"))):
        chart = Chart(
            title=f"{key}, printed against computed",
            x="gain set",
            y=f"difference [last digits, {unit}]",
            log="y",
            y_range=(1e-3, 1e3),
            x_ticks=list(enumerate(PAIRS_PRINTED)),
        )
        digits = {STAR: printed.STAR_LAST_DIGIT}
        sizes = [
            abs(pair[k] - getattr(study.indicators[name], key))
            / digits.get(name, printed.LAST_DIGITS[k])
            for name, pair in PAIRS_PRINTED.items()
        ]
        # A logarithmic axis has no zero: the bar of full agreement ends at its lower edge.
        tops = np.maximum(sizes, 1e-3)
        chart.bars(np.full(len(tops), 1e-3), tops, [GAIN_COLOURS[name] for name in PAIRS_PRINTED])
        chart.level(1.0, name="one unit of the last printed digit")
        for place, (size, top) in enumerate(zip(sizes, tops, strict=True)):
            text = f"{size:.2g}" if size < 10.0 else f"{size:.0f}"
            chart.text(place, top, text, anchor="middle", shift=(0.0, -5.0))
        charts.append(chart)
    return sheet(charts)


def _constraints(sets: dict[str, PIGains]) -> Sheet:
    labels = {"phi": "φ(t_0)", "phi rate": "φ̇(t_0)", "n_z": "n_z(t_0)", "n_z rate": "ṅ_z(t_0)"}
    group = len(sets) + 1  # bars of one command, and a gap behind them
    chart = Chart(
        title="Commands and their rates at t_0",
        x="",
        y="share of the printed limit [1]",
        height=280.0,
        x_ticks=[(group * k + (group - 2) / 2, label) for k, label in enumerate(labels.values())],
    )
    for k, (name, gain_set) in enumerate(sets.items()):
        uses = initial_commands(gain_set)
        shares, places = [uses[key].share for key in labels], group * np.arange(len(labels)) + k
        colour = GAIN_SET_COLOURS[name]
        chart.bars(np.zeros(len(labels)), shares, [colour] * len(labels), x=places)
        chart.legend.append((name, colour, "dot"))
        for share, place in zip(shares, places.tolist(), strict=True):
            text = f"{share:.2f}" if share < 1.0 else f"{share:.1f}"
            chart.text(place, share, text, anchor="middle", shift=(0.0, -4.0))
    chart.level(1.0, name="limit")
    chart.y_range = 0.0, 1.05 * chart.y_ends()[1]
    return sheet([chart])


def table2(study: Study) -> Made:
    """Compare the printed table with the computed one."""
    rows = {}
    for name, row in study.indicators.items():
        R_K, I_K = PAIRS_PRINTED[name]
        pairs = {"R_K_printed": R_K, "R_K": row.R_K, "I_K_printed": I_K, "I_K": row.I_K}
        epsilon = PAPER_EPSILON.get(name, 0.0)
        rows[name] = {"epsilon": epsilon, **pairs, "spectral_abscissa": row.spectral_abscissa}
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("type")
    distance = (table["R_K"] - table["R_K_printed"]).abs()
    return Made(
        figures={"table2": _table2_panels(study, table)},
        tables={"table2": table.reset_index()},
        values={name: {"R_K": row.R_K, "I_K": row.I_K} for name, row in study.indicators.items()},
        numbers={"largest_distance": distance.drop(STAR).max(), "distance_of_star": distance[STAR]},
    )


def _table2_panels(study: Study, table: pd.DataFrame) -> Sheet:
    epsilon = np.linspace(-4.5, 1.15, 300)
    curve = _indicators_over(study, epsilon)
    charts = []
    for key, values in (("R_K", curve.R_K), ("I_K", curve.I_K)):
        chart = Chart(
            title=f"{key} of K* − ε (I, I)", x="ε [1]", y=INDICATOR_LABELS[key], x_room=0.05
        )
        chart.line(epsilon, values, NEUTRAL, name="computed")
        for name, row in table.drop(STAR).iterrows():
            chart.points(row["epsilon"], row[f"{key}_printed"], GAIN_COLOURS[str(name)])
        star = table.loc[STAR, f"{key}_printed"]
        chart.points(0.0, star, LIMIT, name="K* as printed", shape="cross", size=5.0)
        chart.label_points(
            [(row["epsilon"], row[f"{key}_printed"], str(name)) for name, row in table.iterrows()]
        )
        charts.append(chart)
    return sheet(charts)


def fig6(study: Study) -> Made:
    """Draw the eigenvalues of A_K(0) with K*, and the disturbance."""
    star = study.indicators[STAR]
    t = np.linspace(0.0, DURATION, 401)
    disturbance = printed.disturbance(printed.PRINTED_DISTURBANCE)
    d = np.array([disturbance(moment) for moment in t.tolist()])
    eigenvalues = pd.DataFrame(
        {"real_1_per_s": star.eigenvalues.real, "imag_1_per_s": star.eigenvalues.imag}
    )
    plane = Chart(
        title="eigenvalues of A_K(0) with K*",
        x="real part [1/s]",
        y="imaginary part [1/s]",
        x_range=(-0.6, 0.1),
        y_range=(-1.6, 1.6),
    )
    plane.upright(0.0, LIMIT)
    plane.points(star.eigenvalues.real, star.eigenvalues.imag, INK)
    history = Chart(title="disturbance", y="disturbance [rad/s]", x_range=(0.0, DURATION))
    history.line(t, d[:, 0], CHI, name="d_χ")
    history.line(t, d[:, 1], GAMMA, name="d_γ")
    return Made(
        figures={"fig6": sheet([plane, history])},
        tables={
            "fig6": eigenvalues,
            "fig6_b": pd.DataFrame({"t_s": t, "d_chi_radps": d[:, 0], "d_gamma_radps": d[:, 1]}),
        },
        values={
            "eigenvalues": eigenvalues.to_numpy().tolist(),
            "spectral_abscissa": star.spectral_abscissa,
        },
    )
