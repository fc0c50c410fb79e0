"""Items without a flight: Theorem 1 on the oscillator; K*, K1 to K6 and the true optimum."""

import math

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray
from flighttune.control.gains import PAPER_EPSILON, PIGains
from flighttune.control.linear_model import closed_loop, closed_loops
from flighttune.control.theory.indicators import IndicatorArrays, indicators, indicators_batch
from flighttune.outputs.drawing.chart import DASHED, Chart, Sheet
from flighttune.outputs.drawing.palette import INK, LIMIT, NEUTRAL
from flighttune.outputs.paper.items import base
from flighttune.studies.paper import parameters as printed
from flighttune.studies.paper.duffing import Duffing, DuffingCases
from flighttune.studies.paper.flight import initial_commands, largest_share
from flighttune.studies.paper.parameters import DURATION, INDICATORS, STAR
from flighttune.studies.paper.study import Study

# Disturbances of the oscillator besides noise
HARD_COLOURS = {"constant L_d": base.GAMMA, "along the motion": base.GREEN}

# Widest strip drawn, as a share of the region: at its edge R(f) is zero and I(f) infinite.
WIDEST_STRIP = 0.999

OPTIMUM = "optimum without input constraints"
NEAREST = "smallest I_K within the input constraints"
GAIN_SET_COLOURS = {STAR: INK, OPTIMUM: base.GREEN, NEAREST: base.MAGENTA}


def fig1(study: Study) -> base.Made:
    """Draw panels (a) to (d) and the region."""
    duffing, cases = study.duffing, study.duffing.table.reset_index()
    noisy, strips = duffing.disturbed["noise"], _strips(duffing.model)
    return base.Made(
        figures={"fig1": _oscillator_panels(duffing), "fig1_region": _region(duffing, strips)},
        tables={"fig1": _time_histories(duffing), "fig1_cd": cases, "fig1_region": strips},
        values={
            **dict(zip(("R_f", "I_f"), noisy.theorem, strict=True)),
            "region_half_width": duffing.model.region,
            "smooth_region": duffing.model.smooth_region,
            "largest_x1": {name: case.farthest for name, case in duffing.disturbed.items()},
            "largest_norm_f": float(np.max(noisy.norm_f)),
            "cases": cases.to_dict(orient="records"),
        },
        numbers={
            "largest_norm_f_along_the_motion": duffing.disturbed["along the motion"].norm_f.max()
        },
    )


def _strips(model: Duffing) -> pd.DataFrame:
    """Rate and bound of Theorem 1 for the region ``|x1| <= c``."""
    widths = np.linspace(0.0, 1.0, 200) * WIDEST_STRIP * model.region
    bounds = [model.bound(printed.DUFFING_L_D, half_width=c) for c in widths.tolist()]
    R_f, I_f = zip(*bounds, strict=True)
    columns = {"c": widths, "epsilon": model.margin(widths), "R_f_1_per_s": R_f, "I_f": I_f}
    return pd.DataFrame(columns)


def _time_histories(duffing: DuffingCases) -> pd.DataFrame:
    case = duffing.disturbed["noise"]
    columns = {
        "t_s": case.t,
        "a_bound": case.bound_over_time,
        "a_noise_run_1": case.norm_f[:, 0],
        "a_noise_smallest": case.norm_f.min(axis=1),
        "a_noise_largest": case.norm_f.max(axis=1),
        "a_undisturbed": duffing.undisturbed.norm_f[:, 0],
    }
    for name in HARD_COLOURS:
        columns[f"a_{name.replace(' ', '_')}"] = duffing.disturbed[name].norm_f[:, 0]
    for alpha, flight in duffing.family.items():
        columns[f"b_mean_norm_f_alpha_{alpha:g}"] = flight.norm_f.mean(axis=1)
    return pd.DataFrame(columns)


def _oscillator_panels(duffing: DuffingCases) -> Sheet:
    symbols = zip("αβδ", printed.DUFFING_A.values(), strict=True)
    parameters = ", ".join(f"{symbol} = {value:g}" for symbol, value in symbols)
    a = Chart(
        title=f"{parameters}, L_d = {printed.DUFFING_L_D:g}",
        y="‖f(x)‖ [1/s]",
        log="y",
        x_range=(0.0, DURATION),
        y_range=(1e-3, 1e5),
    )
    case, calm = duffing.disturbed["noise"], duffing.undisturbed
    # The logarithmic axis begins at 1e-3: a smaller value would leave a gap in the band.
    low, high = np.maximum(case.norm_f.min(axis=1), 1e-3), case.norm_f.max(axis=1)
    a.band(case.t, low, high, base.CHI, name=f"{case.norm_f.shape[1]} noise runs")
    a.line(case.t, case.norm_f[:, 0], base.CHI, width=0.9, name="one of them")
    for name, colour in HARD_COLOURS.items():
        a.line(case.t, duffing.disturbed[name].norm_f[:, 0], colour, name=name)
    a.line(calm.t, calm.norm_f[:, 0], NEUTRAL, dash=DASHED, name="no disturbance")
    a.line(case.t, case.bound_over_time, INK, width=2.0, name="bound of Theorem 1")
    title = f"mean over the runs, β = α/2, δ = {printed.DUFFING_A['delta']:g}"
    b = Chart(title=title, y="mean of ‖f(x)‖ [1/s]", x_range=(0.0, DURATION))
    for colour, (alpha, flight) in zip(base.STRONG, duffing.family.items(), strict=True):
        b.line(flight.t, flight.norm_f.mean(axis=1), colour, name=f"α = {alpha:g}")
    b.y_range = 0.0, b.y_ends()[1]
    c = Chart(title="measures of ‖f(x)‖ against R(f)", x="R(f) [1/s]", y="‖f(x)‖ [1/s]")
    d = Chart(title="measures of ‖f(x)‖ against I(f)", x="I(f) [1/s]", y="‖f(x)‖ [1/s]", log="x")
    for chart, key in ((c, "R_f"), (d, "I_f")):
        chart.x_room, chart.y_range = 0.05, (0.0, 0.75)
        for measure, name, colour in (
            ("mean", "mean", base.CHI),
            ("std", "standard deviation", base.GAMMA),
        ):
            base.marked_line(
                chart, duffing.table[key], duffing.table[measure], (colour, ""), name=name
            )
    return base.sheet([a, b, c, d])


def _region(duffing: DuffingCases, strips: pd.DataFrame) -> Sheet:
    c, x = duffing.model.region, duffing.disturbed["noise"].x[:, :8]
    title, x_range, y_range = "where the condition of Theorem 1 holds", (-3.2, 3.2), (-2.8, 2.8)
    plane = Chart(title=title, x="x_1 [1]", y="x_2 [1/s]", x_range=x_range, y_range=y_range)
    plane.band([-c, c], [-2.8, -2.8], [2.8, 2.8], base.CHI, name=f"it holds: |x_1| < {c:.3f}")
    for run in range(x.shape[1]):
        name = "" if run else f"noise, {x.shape[1]} runs"
        plane.line(x[:, run, 0], x[:, run, 1], base.CHI, width=0.5, name=name, hover=False)
    for name, colour in HARD_COLOURS.items():
        x_1, x_2 = duffing.disturbed[name].x[:, 0].T
        plane.line(x_1, x_2, colour, name=name, hover=False)
    plane.points(*printed.DUFFING_X_0, INK, name="start")
    for edge in (-c, c):
        plane.upright(edge, LIMIT, dash=DASHED)
    charts = [plane]
    for key, label, log in (("R_f_1_per_s", "R(f) [1/s]", ""), ("I_f", "I(f) [1/s]", "y")):
        chart = Chart(
            title=f"{label.split()[0]} as the strip |x_1| ≤ c widens",
            x="half-width c of the strip [1]",
            y=label,
            log=log,
            x_range=(0.0, 1.05 * c),
        )
        chart.line(strips["c"], strips[key], INK)
        chart.upright(c, LIMIT, dash=DASHED)
        charts.append(chart)
    return base.sheet(charts)


def _shifted_by(study: Study, epsilon: FloatArray) -> IndicatorArrays:
    """Indicators of K* - epsilon (I, I), for a curve."""
    gains = study.star.K - epsilon[:, None, None] * np.hstack([np.eye(2), np.eye(2)])
    return indicators_batch(closed_loops(study.model, gains))


def gains(study: Study) -> base.Made:
    """Compare K* with the optimum, its indicators with the printed ones, and its constraints."""
    star, best, near = study.indicators[STAR], study.optimum, study.constrained
    candidates = {STAR: study.star, OPTIMUM: best.gains, NEAREST: near.gains}
    sets = {name: gain_set for name, gain_set in candidates.items() if gain_set is not None}
    table = pd.DataFrame({name: _row(study, gain_set) for name, gain_set in sets.items()}).T
    optimal = best.gains.as_lists() if best.gains else {"K_P": None, "K_I": None}
    (R_K, I_K), uses = INDICATORS[STAR], initial_commands(study.star)
    return base.Made(
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
            "R_K_printed": R_K,
            "I_K_printed": I_K,
            "optimum": {"R_K": best.R_K, "I_K": best.I_K, **optimal},
            "with_input_constraints": {
                "status": near.status,
                "smallest_I_K": near.I_K,
                "R_K": near.R_K,
            },
            "command_use": uses.drop(columns="share").to_dict("index"),
        },
        numbers={"largest_share": largest_share(study.star)},
    )


def _row(study: Study, gain_set: PIGains) -> dict[str, float]:
    loop = indicators(closed_loop(study.model, gain_set))
    names = [f"{K}_{place}" for K in ("K_P", "K_I") for place in ("11", "12", "21", "22")]
    return {
        **dict(zip(names, [*gain_set.K_P.ravel(), *gain_set.K_I.ravel()], strict=True)),
        "R_K_1_per_s": loop.R_K,
        "I_K_s2": loop.I_K,
        "spectral_abscissa_1_per_s": loop.spectral_abscissa,
        "largest_use_of_a_limit": largest_share(gain_set),
    }


def _plane(study: Study) -> Sheet:
    chart = Chart(title="The plane of the indicators", height=300.0)
    chart.x, chart.y = base.INDICATOR_LABELS.values()
    chart.x_range, chart.y_range = (0.15, 0.85), (4.5, 10.0)
    curve = _shifted_by(study, np.linspace(-6.0, 1.25, 300))
    chart.line(curve.R_K, curve.I_K, NEUTRAL, name="K* − ε (I, I)", hover=False)
    chart.level(printed.I_STAR, name=f"I* = {printed.I_STAR:g}")
    for name, row in study.indicators.items():
        chart.points(row.R_K, row.I_K, base.GAIN_COLOURS[name])
    chart.points(*INDICATORS[STAR], LIMIT, name="K* as printed", shape="cross", size=5.0)
    best = study.optimum
    if math.isfinite(best.I_K):
        chart.points(best.R_K, best.I_K, base.GREEN, name=OPTIMUM, shape="plus", size=6.0)
    chart.label_points([(row.R_K, row.I_K, name) for name, row in study.indicators.items()])
    return base.sheet([chart])


def _disagreement(study: Study) -> Sheet:
    charts = []
    for k, (key, unit) in enumerate((("R_K", "1/s"), ("I_K", "s²"))):
        chart = Chart(
            title=f"{key}, printed against computed",
            x="gain set",
            y=f"difference [last digits, {unit}]",
            log="y",
            y_range=(1e-3, 1e3),
            x_ticks=list(enumerate(INDICATORS)),
        )
        sizes = [
            abs(pair[k] - getattr(study.indicators[name], key)) / printed.last_digits(name)[k]
            for name, pair in INDICATORS.items()
        ]
        # A logarithmic axis has no zero: the bar of full agreement ends at its lower edge.
        tops = np.maximum(sizes, 1e-3)
        chart.bars(np.full(len(tops), 1e-3), tops, [base.GAIN_COLOURS[name] for name in INDICATORS])
        chart.level(1.0, name="one unit of the last printed digit")
        for place, (size, top) in enumerate(zip(sizes, tops, strict=True)):
            text = f"{size:.2g}" if size < 10.0 else f"{size:.0f}"
            chart.text(place, top, text, anchor="middle", shift=(0.0, -5.0))
        charts.append(chart)
    return base.sheet(charts)


def _constraints(sets: dict[str, PIGains]) -> Sheet:
    labels = "φ(t_0)", "φ̇(t_0)", "n_z(t_0)", "ṅ_z(t_0)"  # in the order of `initial_commands`
    group = len(sets) + 1  # bars of one command, and a gap behind them
    chart = Chart(
        title="Commands and their rates at t_0",
        x="",
        y="share of the printed limit [1]",
        height=280.0,
        x_ticks=[(group * k + (group - 2) / 2, label) for k, label in enumerate(labels)],
    )
    for k, (name, gain_set) in enumerate(sets.items()):
        shares, colour = initial_commands(gain_set)["share"], GAIN_SET_COLOURS[name]
        places = group * np.arange(len(labels)) + k
        chart.bars(np.zeros(len(labels)), shares, [colour] * len(labels), x=places)
        chart.legend.append((name, colour, "dot"))
        for share, place in zip(shares, places.tolist(), strict=True):
            text = f"{share:.2f}" if share < 1.0 else f"{share:.1f}"
            chart.text(place, share, text, anchor="middle", shift=(0.0, -4.0))
    chart.level(1.0, name="limit")
    chart.y_range = 0.0, 1.05 * chart.y_ends()[1]
    return base.sheet([chart])


def table2(study: Study) -> base.Made:
    """Compare the printed table with the computed one."""
    rows = {}
    for name, row in study.indicators.items():
        R_K, I_K = INDICATORS[name]
        pairs = {"R_K_printed": R_K, "R_K": row.R_K, "I_K_printed": I_K, "I_K": row.I_K}
        epsilon = PAPER_EPSILON.get(name, 0.0)
        rows[name] = {"epsilon": epsilon, **pairs, "spectral_abscissa": row.spectral_abscissa}
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("type")
    distance = (table["R_K"] - table["R_K_printed"]).abs()
    return base.Made(
        figures={"table2": _table2_panels(study, table)},
        tables={"table2": table.reset_index()},
        values=table[["R_K", "I_K"]].to_dict("index"),
        numbers={"largest_distance": distance.drop(STAR).max(), "distance_of_star": distance[STAR]},
    )


def _table2_panels(study: Study, table: pd.DataFrame) -> Sheet:
    epsilon, charts = np.linspace(-4.5, 1.15, 300), []
    curve = _shifted_by(study, epsilon)
    for key, label in base.INDICATOR_LABELS.items():
        chart = Chart(title=f"{key} of K* − ε (I, I)", x="ε [1]", y=label, x_room=0.05)
        chart.line(epsilon, getattr(curve, key), NEUTRAL, name="computed")
        rows = table[["epsilon", f"{key}_printed"]].itertuples()
        marks = [(x, y, str(name)) for name, x, y in rows]
        for x, y, name in marks:
            if name != STAR:
                chart.points(x, y, base.GAIN_COLOURS[name])
        star = table.loc[STAR, f"{key}_printed"]
        chart.points(0.0, star, LIMIT, name="K* as printed", shape="cross", size=5.0)
        chart.label_points(marks)
        charts.append(chart)
    return base.sheet(charts)


def fig2(study: Study) -> base.Made:
    """Draw the eigenvalues of A_K(0) with K*, and the disturbance."""
    values, t = study.indicators[STAR].eigenvalues, np.linspace(0.0, DURATION, 401)
    disturbance = printed.disturbance(printed.PRINTED_DISTURBANCE)
    d_chi, d_gamma = np.array([disturbance(moment) for moment in t.tolist()]).T
    eigenvalues = pd.DataFrame({"real_1_per_s": values.real, "imag_1_per_s": values.imag})
    plane = Chart(title="eigenvalues of A_K(0) with K*", x="real part [1/s]")
    plane.y, plane.x_range, plane.y_range = "imaginary part [1/s]", (-0.6, 0.1), (-1.6, 1.6)
    plane.upright(0.0, LIMIT)
    plane.points(values.real, values.imag, INK)
    history = Chart(title="disturbance", y="disturbance [rad/s]", x_range=(0.0, DURATION))
    history.line(t, d_chi, base.CHI, name="d_χ")
    history.line(t, d_gamma, base.GAMMA, name="d_γ")
    return base.Made(
        figures={"fig2": base.sheet([plane, history])},
        tables={
            "fig2": eigenvalues,
            "fig2_b": pd.DataFrame({"t_s": t, "d_chi_radps": d_chi, "d_gamma_radps": d_gamma}),
        },
        values={
            "eigenvalues": eigenvalues.to_numpy().tolist(),
            "spectral_abscissa": study.indicators[STAR].spectral_abscissa,
        },
    )
