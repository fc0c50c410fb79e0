"""Figure 3: Theorem 1 on the Duffing oscillator, and the region in which it holds."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.duffing import DuffingCases, bound
from flighttune.paper.items.base import Made
from flighttune.paper.study import Study
from flighttune.present.palette import INK, NEUTRAL

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HARD_COLOURS = {"constant L_d": style.GAMMA, "along the motion": style.GREEN}

WIDEST_STRIP = 0.999
"""Widest strip drawn, as a share of the region: at its edge R(f) is zero and I(f) infinite."""


def fig3(study: Study) -> Made:
    """Draw panels (a) to (d) and the region."""
    duffing = study.duffing
    case, hard = duffing.noisy, duffing.hard
    cases, strips = duffing.table.reset_index(), _strips(duffing)
    return Made(
        figures={"fig3": _panels(duffing), "fig3_region": _region(duffing, strips)},
        tables={"fig3": _time_histories(duffing), "fig3_cd": cases, "fig3_region": strips},
        values={
            "R_f": case.theorem.rate,
            "I_f": case.theorem.radius,
            "region_half_width": case.model.region,
            "largest_x1": {
                "noise": case.farthest,
                **{name: one.farthest for name, one in hard.items()},
            },
            "largest_norm_f": float(np.max(case.norm_f)),
            "cases": cases.to_dict(orient="records"),
        },
        numbers={"largest_norm_f_along_the_motion": hard["along the motion"].norm_f.max()},
    )


def _strips(duffing: DuffingCases) -> pd.DataFrame:
    """Rate and bound of Theorem 1 when it is to hold in ``|x1| <= c``."""
    widths = np.linspace(0.0, 1.0, 200) * WIDEST_STRIP * duffing.model.region
    bounds = [bound(duffing.model, printed.DUFFING_L_D, half_width=c) for c in widths.tolist()]
    return pd.DataFrame(
        {
            "c": widths,
            "epsilon": [one.rate * one.P_max for one in bounds],
            "R_f_1_per_s": [one.rate for one in bounds],
            "I_f": [one.radius for one in bounds],
        }
    )


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
    for name, one in duffing.hard.items():
        columns[f"a_{name.replace(' ', '_')}"] = one.norm_f[:, 0]
    for alpha, one in duffing.family.items():
        columns[f"b_mean_norm_f_alpha_{alpha:g}"] = one.norm_f.mean(axis=1)
    return pd.DataFrame(columns)


def _panels(duffing: DuffingCases) -> "Figure":
    letters = {name: f"{value:g}" for name, value in printed.DUFFING_A.items()}
    titles = (
        f"α = {letters['alpha']}, β = {letters['beta']}, δ = {letters['delta']}, "
        f"$L_d$ = {printed.DUFFING_L_D:g}",
        f"β = α/2, δ = {letters['delta']}: mean over the runs",
        "against R(f)",
        "against I(f)",
    )
    figure, (a, b, c, d) = style.grid(2, 2, size=(8.6, 6.2), titles=titles)
    case, calm = duffing.noisy, duffing.undisturbed
    a.semilogy(case.t, case.bound_over_time, color=INK, lw=2.0, label="bound of Theorem 1")
    # The logarithmic axis begins at 1e-3: a smaller value would leave a gap in the band.
    low, high = np.maximum(case.norm_f.min(axis=1), 1e-3), case.norm_f.max(axis=1)
    a.fill_between(case.t, low, high, color=style.SHADE, label=f"{case.norm_f.shape[1]} noise runs")
    a.semilogy(case.t, case.norm_f[:, 0], color=style.CHI, lw=0.9, label="one of them")
    for name, one in duffing.hard.items():
        label = name.replace("L_d", "$L_d$")
        a.semilogy(one.t, one.norm_f[:, 0], color=HARD_COLOURS[name], label=label)
    a.semilogy(calm.t, calm.norm_f[:, 0], color=NEUTRAL, ls="--", label="no disturbance")
    style.over_time(a, "‖f(x)‖", printed.DURATION)
    a.set_ylim(1e-3, 1e5)
    a.legend(ncols=2, loc="upper right")
    for colour, (alpha, one) in zip(style.STRONG, duffing.family.items(), strict=True):
        label = f"α = {alpha:g}, R(f) = {one.theorem.rate:.3f} 1/s"
        b.plot(one.t, one.norm_f.mean(axis=1), color=colour, label=label)
    style.over_time(b, "mean of ‖f(x)‖", printed.DURATION)
    b.set_ylim(bottom=0.0)
    b.legend()
    for panel, key, label in ((c, "R_f", "R(f) [1/s]"), (d, "I_f", "I(f)")):
        for measure, name, colour, marker in (
            ("mean", "mean", style.CHI, "o"),
            ("std", "standard deviation", style.GAMMA, "s"),
        ):
            values = duffing.table[measure]
            label_of_line = f"{name} of ‖f(x)‖"
            panel.plot(duffing.table[key], values, color=colour, marker=marker, label=label_of_line)
        panel.set(xlabel=label, ylabel="‖f(x)‖", ylim=(0.0, 0.75))
        panel.legend(loc="lower center")
    d.set_xscale("log")
    ticks = [60, 100, 200, 400, 800]
    d.set_xticks(ticks, [f"{tick}" for tick in ticks])
    d.set_xticks([], minor=True)
    return figure


def _region(duffing: DuffingCases, strips: pd.DataFrame) -> "Figure":
    titles = "where the condition holds", "as the strip |x₁| ≤ c widens"
    figure, (plane, reach) = style.grid(1, 2, size=(8.6, 3.7), titles=titles)
    c, x = duffing.model.region, duffing.noisy.x[:, :8]
    plane.axvspan(-c, c, color=style.SHADE, alpha=0.45, lw=0, label="condition of Theorem 1 holds")
    lines = plane.plot(x[..., 0], x[..., 1], color=style.CHI, lw=0.5)
    lines[0].set_label(f"noise, {len(lines)} runs")
    for name, one in duffing.hard.items():
        label = name.replace("L_d", "$L_d$")
        plane.plot(one.x[:, 0, 0], one.x[:, 0, 1], color=HARD_COLOURS[name], label=label)
    plane.plot(*printed.DUFFING_X_0, marker="o", color=INK, ls="none", label="start")
    style.limits(plane, x=(-c, c))
    style.note(plane, f"|x₁| = {c:.3f}", (c, -2.5), by=(0, 0))
    plane.set(xlim=(-3.2, 3.2), ylim=(-2.8, 2.8), xlabel="x₁", ylabel="x₂ [1/s]")
    style.legend_above(figure, plane, columns=5)
    reach.plot(strips["c"], strips["R_f_1_per_s"], color=style.CHI)
    reach.set(xlim=(0.0, 1.05 * c), ylim=(0.0, 0.5), xlabel="half-width c of the strip")
    reach.set_ylabel("R(f) [1/s]", color=style.CHI)
    style.limits(reach, x=(c,))
    other = reach.twinx()
    other.grid(False)
    other.spines["right"].set_visible(True)
    other.semilogy(strips["c"], strips["I_f"], color=style.GAMMA)
    other.set_ylabel("I(f): ultimate bound on ‖f(x)‖", color=style.GAMMA)
    return figure
