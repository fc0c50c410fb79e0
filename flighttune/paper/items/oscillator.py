"""Figure 3: Theorem 1 on the Duffing oscillator, and the region in which it holds."""

import numpy as np
import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper.duffing import Duffing, DuffingCases
from flighttune.paper.items.base import CHI, GAMMA, GREEN, STRONG, Made, marked_line, sheet
from flighttune.paper.study import Study
from flighttune.present.chart import DASHED, Chart, Sheet
from flighttune.present.palette import INK, LIMIT, NEUTRAL

HARD_COLOURS = {"constant L_d": GAMMA, "along the motion": GREEN}

# Widest strip drawn, as a share of the region: at its edge R(f) is zero and I(f) infinite.
WIDEST_STRIP = 0.999


def fig3(study: Study) -> Made:
    """Draw panels (a) to (d) and the region."""
    duffing = study.duffing
    case, hard = duffing.noisy, duffing.hard
    cases, strips = duffing.table.reset_index(), _strips(duffing.model)
    return Made(
        figures={"fig3": _panels(duffing), "fig3_region": _region(duffing, strips)},
        tables={"fig3": _time_histories(duffing), "fig3_cd": cases, "fig3_region": strips},
        values={
            **dict(zip(("R_f", "I_f"), case.theorem, strict=True)),
            "region_half_width": case.model.region,
            "smooth_region": case.model.smooth_region,
            "largest_x1": {
                "noise": case.farthest,
                **{name: pushed.farthest for name, pushed in hard.items()},
            },
            "largest_norm_f": float(np.max(case.norm_f)),
            "cases": cases.to_dict(orient="records"),
        },
        numbers={"largest_norm_f_along_the_motion": hard["along the motion"].norm_f.max()},
    )


def _strips(model: Duffing) -> pd.DataFrame:
    """Rate and bound of Theorem 1 when it is to hold in ``|x1| <= c``."""
    widths = np.linspace(0.0, 1.0, 200) * WIDEST_STRIP * model.region
    bounds = [model.bound(printed.DUFFING_L_D, half_width=c) for c in widths.tolist()]
    table = pd.DataFrame(bounds, columns=pd.Index(["R_f_1_per_s", "I_f"]))
    table.insert(0, "epsilon", model.margin(widths))
    table.insert(0, "c", widths)
    return table


def _time_histories(duffing: DuffingCases) -> pd.DataFrame:
    case = duffing.noisy
    columns = {
        "t_s": case.t,
        "a_bound": case.bound_over_time,
        "a_noise_run_1": case.norm_f[:, 0],
        "a_noise_smallest": case.norm_f.min(axis=1),
        "a_noise_largest": case.norm_f.max(axis=1),
        "a_undisturbed": duffing.undisturbed.norm_f[:, 0],
    }
    for name, flight in duffing.hard.items():
        columns[f"a_{name.replace(' ', '_')}"] = flight.norm_f[:, 0]
    for alpha, flight in duffing.family.items():
        columns[f"b_mean_norm_f_alpha_{alpha:g}"] = flight.norm_f.mean(axis=1)
    return pd.DataFrame(columns)


def _panels(duffing: DuffingCases) -> Sheet:
    symbols = zip("αβδ", printed.DUFFING_A.values(), strict=True)
    parameters = ", ".join(f"{symbol} = {value:g}" for symbol, value in symbols)
    a = Chart(
        title=f"{parameters}, L_d = {printed.DUFFING_L_D:g}",
        y="‖f(x)‖ [1/s]",
        log="y",
        x_range=(0.0, printed.DURATION),
        y_range=(1e-3, 1e5),
    )
    case, calm = duffing.noisy, duffing.undisturbed
    # The logarithmic axis begins at 1e-3: a smaller value would leave a gap in the band.
    low, high = np.maximum(case.norm_f.min(axis=1), 1e-3), case.norm_f.max(axis=1)
    a.band(case.t, low, high, CHI, name=f"{case.norm_f.shape[1]} noise runs")
    a.line(case.t, case.norm_f[:, 0], CHI, width=0.9, name="one of them")
    for name, flight in duffing.hard.items():
        a.line(flight.t, flight.norm_f[:, 0], HARD_COLOURS[name], name=name)
    a.line(calm.t, calm.norm_f[:, 0], NEUTRAL, dash=DASHED, name="no disturbance")
    a.line(case.t, case.bound_over_time, INK, width=2.0, name="bound of Theorem 1")
    b = Chart(
        title=f"mean over the runs, β = α/2, δ = {printed.DUFFING_A['delta']:g}",
        y="mean of ‖f(x)‖ [1/s]",
        x_range=(0.0, printed.DURATION),
    )
    for colour, (alpha, flight) in zip(STRONG, duffing.family.items(), strict=True):
        b.line(flight.t, flight.norm_f.mean(axis=1), colour, name=f"α = {alpha:g}")
    b.y_range = 0.0, b.y_ends()[1]
    c = Chart(title="measures of ‖f(x)‖ against R(f)", x="R(f) [1/s]", y="‖f(x)‖ [1/s]")
    d = Chart(title="measures of ‖f(x)‖ against I(f)", x="I(f) [1/s]", y="‖f(x)‖ [1/s]", log="x")
    for chart, key in ((c, "R_f"), (d, "I_f")):
        chart.x_room, chart.y_range = 0.05, (0.0, 0.75)
        for measure, name, colour in (("mean", "mean", CHI), ("std", "standard deviation", GAMMA)):
            marked_line(chart, duffing.table[key], duffing.table[measure], colour, name=name)
    return sheet([a, b, c, d])


def _region(duffing: DuffingCases, strips: pd.DataFrame) -> Sheet:
    c, x = duffing.model.region, duffing.noisy.x[:, :8]
    plane = Chart(
        title="where the condition of Theorem 1 holds",
        x="x_1 [1]",
        y="x_2 [1/s]",
        x_range=(-3.2, 3.2),
        y_range=(-2.8, 2.8),
    )
    plane.band([-c, c], [-2.8, -2.8], [2.8, 2.8], CHI, name=f"it holds: |x_1| < {c:.3f}")
    for run in range(x.shape[1]):
        name = "" if run else f"noise, {x.shape[1]} runs"
        plane.line(x[:, run, 0], x[:, run, 1], CHI, width=0.5, name=name, hover=False)
    for name, case in duffing.hard.items():
        plane.line(case.x[:, 0, 0], case.x[:, 0, 1], HARD_COLOURS[name], name=name, hover=False)
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
    return sheet(charts)
