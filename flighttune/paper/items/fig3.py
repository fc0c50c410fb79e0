"""Figure 3: Theorem 1 on the Duffing oscillator, and the region in which it holds."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper import style
from flighttune.paper.duffing import bound
from flighttune.paper.duffing_cases import DuffingCases
from flighttune.paper.items.base import Item, Made
from flighttune.paper.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HARD = {"constant L_d": style.GAMMA, "along the motion": style.GREEN}
STRIPS = np.linspace(0.0, 1.0, 200)


def make(study: Study) -> Made:
    """Draw panels (a) to (d) and the region."""
    duffing = study.duffing
    case, table = duffing.noisy, duffing.table
    strips = _strips(duffing)
    hard = duffing.hard
    return Made(
        figures={
            "fig3": ("Panels (a) to (d) as in the paper.", _panels(duffing)),
            "fig3_region": (
                "The region in which the condition of Theorem 1 holds for the chosen P, and what "
                "becomes of rate and bound as the strip is widened to its edge.",
                _region(duffing, strips),
            ),
        },
        tables={
            "fig3": _time_histories(duffing),
            "fig3_cd": table.reset_index(),
            "fig3_region": strips,
        },
        values={
            "R_f": case.theorem.rate,
            "I_f": case.theorem.radius,
            "region_half_width": case.model.region,
            "largest_x1": {
                "noise": case.farthest,
                **{name: one.farthest for name, one in hard.items()},
            },
            "largest_norm_f": float(np.max(case.norm_f)),
            "cases": table.reset_index().to_dict(orient="records"),
        },
        outcome=(
            f"|f(x)| stays below its bound; the bound is loose: S(0) has the radius "
            f"{case.theorem.radius:.0f}, the noise takes |f| to {np.max(case.norm_f):.2f} and a "
            f"disturbance along the motion to {hard['along the motion'].norm_f.max():.2f}.",
            f"The condition of the theorem holds for the chosen P only where |x1| < "
            f"{case.model.region:.4f}, although the Jacobian is stable everywhere. A constant "
            f"disturbance of the printed size takes x1 to {hard['constant L_d'].farthest:.3f}, one "
            f"along the motion to {hard['along the motion'].farthest:.3f}: outside.",
            "The norm of f decays at R(f)/2 by the proof (Lemma 5), not at R(f) as the text says.",
            "Over the assumed set mean and deviation rise with R(f): a larger alpha also makes |f| "
            "at the common start larger.",
        ),
    )


def _strips(duffing: DuffingCases) -> pd.DataFrame:
    """Rate and bound of Theorem 1 when it is to hold in ``|x1| <= c``."""
    widths = STRIPS * 0.999 * duffing.model.region
    found = [bound(duffing.model, printed.DUFFING_L_D, half_width=c) for c in widths.tolist()]
    return pd.DataFrame(
        {
            "c": widths,
            "epsilon": [one.rate * one.P_max for one in found],
            "R_f_1_per_s": [one.rate for one in found],
            "I_f": [one.radius for one in found],
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
    letter = {k: f"{v:g}" for k, v in printed.DUFFING_A.items()}
    figure, (a, b, c, d) = style.grid(
        2,
        2,
        size=(8.6, 6.2),
        titles=(
            f"α = {letter['alpha']}, β = {letter['beta']}, δ = {letter['delta']}, $L_d$ = 2.5",
            "β = α/2, δ = 1.5: mean over the runs",
            "against R(f)",
            "against I(f)",
        ),
    )
    case = duffing.noisy
    a.semilogy(case.t, case.bound_over_time, color=style.INK, lw=2.0, label="bound of Theorem 1")
    low, high = np.maximum(case.norm_f.min(axis=1), 1e-3), case.norm_f.max(axis=1)
    a.fill_between(case.t, low, high, color=style.SHADE, label=f"{case.norm_f.shape[1]} noise runs")
    a.semilogy(case.t, case.norm_f[:, 0], color=style.CHI, lw=0.9, label="one of them")
    for name, one in duffing.hard.items():
        a.semilogy(one.t, one.norm_f[:, 0], color=HARD[name], label=name.replace("L_d", "$L_d$"))
    undisturbed = duffing.undisturbed
    a.semilogy(
        undisturbed.t, undisturbed.norm_f[:, 0], color=style.GREY, ls="--", label="no disturbance"
    )
    a.set_ylim(1e-3, 1e5)
    style.over_time(a, "‖f(x)‖", printed.DURATION)
    style.legend(a, ncols=2, loc="upper right")
    colours = list(style.GAIN_COLOURS.values())[1:]
    for colour, (alpha, one) in zip(colours, duffing.family.items(), strict=True):
        label = f"α = {alpha:g}, R(f) = {one.theorem.rate:.3f} 1/s"
        b.plot(one.t, one.norm_f.mean(axis=1), color=colour, label=label)
    style.over_time(b, "mean of ‖f(x)‖", printed.DURATION)
    b.set_ylim(bottom=0.0)
    style.legend(b)
    _against(c, duffing.table, "R_f", "R(f) [1/s]")
    _against(d, duffing.table, "I_f", "I(f)")
    d.set_xscale("log")
    ticks = [60, 100, 200, 400, 800]
    d.set_xticks(ticks, [f"{tick}" for tick in ticks])
    d.set_xticks([], minor=True)
    return figure


def _against(panel: "Axes", table: pd.DataFrame, key: str, label: str) -> None:
    panel.plot(table[key], table["mean"], color=style.CHI, marker="o", label="mean of ‖f(x)‖")
    panel.plot(
        table[key],
        table["std"],
        color=style.GAMMA,
        marker="s",
        label="standard deviation of ‖f(x)‖",
    )
    panel.set_xlabel(label)
    panel.set_ylabel("‖f(x)‖")
    panel.set_ylim(0.0, 0.75)
    style.legend(panel, loc="lower center")


def _region(duffing: DuffingCases, strips: pd.DataFrame) -> "Figure":
    figure, (plane, reach) = style.grid(
        1, 2, size=(8.6, 3.7), titles=("where the condition holds", "as the strip |x₁| ≤ c widens")
    )
    c, case = duffing.model.region, duffing.noisy
    plane.axvspan(-c, c, color=style.SHADE, alpha=0.45, lw=0, label="condition of Theorem 1 holds")
    runs = case.x[:, :8]
    plane.plot(runs[..., 0], runs[..., 1], color=style.CHI, lw=0.5)
    plane.plot([], [], color=style.CHI, lw=0.9, label="noise, 8 runs")
    for name, one in duffing.hard.items():
        label = name.replace("L_d", "$L_d$")
        plane.plot(one.x[:, 0, 0], one.x[:, 0, 1], color=HARD[name], label=label)
    plane.plot(*printed.DUFFING_X_0, marker="o", color=style.INK, ls="none", label="start")
    for edge in (-c, c):
        plane.axvline(edge, color=style.RED, lw=1.1, ls=(0, (6, 3)))
    style.note(plane, f"|x₁| = {c:.3f}", (c, -2.5), by=(0, 0))
    plane.set_xlim(-3.2, 3.2)
    plane.set_ylim(-2.8, 2.8)
    plane.set_xlabel("x₁")
    plane.set_ylabel("x₂ [1/s]")
    style.legend_above(figure, plane, columns=5)
    reach.plot(strips["c"], strips["R_f_1_per_s"], color=style.CHI)
    reach.set_xlabel("half-width c of the strip")
    reach.set_ylabel("R(f) [1/s]", color=style.CHI)
    reach.set_ylim(0.0, 0.5)
    reach.set_xlim(0.0, 1.05 * c)
    reach.axvline(c, color=style.RED, lw=1.1, ls=(0, (6, 3)))
    other = reach.twinx()
    other.grid(False)
    other.spines["right"].set_visible(True)
    other.semilogy(strips["c"], strips["I_f"], color=style.GAMMA)
    other.set_ylabel("I(f): ultimate bound on ‖f(x)‖", color=style.GAMMA)
    return figure


ITEM = Item(
    name="fig3",
    title="Theorem 1 on the Duffing oscillator",
    printed="The first figure (label Fig:3_)",
    make=make,
    parameters=(
        "Fig. 3 (a): α = 0.5, β = 0.25, δ = 1.5, L_d = 2.5",
        "R(f) = ε(0)/λ_max(P(0)), I(f) = 2 L_d ‖J(0)‖ λ_max(P(0))²/(ε(0) λ_min(P(0)))",
    ),
    assumed=printed.DUFFING_ASSUMED,
)
