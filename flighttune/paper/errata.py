"""Where the paper's print and computation disagree, and its slips: text with computed numbers."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from flighttune.control.closed_loop import closed_loop, disturbance_entry
from flighttune.paper import parameters as printed
from flighttune.paper.commands import command_use, worst_use
from flighttune.paper.parameters import STAR
from flighttune.paper.study import Study
from flighttune.theory.attractor import invariant_ellipsoid, paper_balls


@dataclass(frozen=True, slots=True)
class Erratum:
    """One slip.

    Attributes
    ----------
    where : str
        Where it stands.
    says : str
        What is printed.
    is_so : str
        What holds instead, with the numbers.
    """

    where: str
    says: str
    is_so: str


def numbers(study: Study) -> Iterator[Erratum]:
    """Printed numbers that the printed formulas and gains do not give."""
    star, best, near = study.indicators[STAR], study.optimum, study.constrained
    use = command_use(study.star)
    peaks = {channel: study.flights[STAR].peak(channel)[1] for channel in ("chi", "gamma")}
    limited = study.readings["ranges and rate limits"]
    cured = study.readings["with rate limits and anti-windup"]
    late = max(limited.after(channel, 18.0) for channel in ("chi", "gamma"))
    yield Erratum(
        "5.2, below K*",
        f"R_K* = {printed.R_K_PRINTED}, I_K* = {printed.I_K_PRINTED}",
        f"the printed gains have R_K = {star.R_K:.4f} and I_K = {star.I_K:.4f}; the six rows of "
        "Table 2, made from the same gains, agree",
    )
    yield Erratum(
        "4.4 and 5.2, K*",
        "K* meets the input constraints",
        f"u(t_0) = ({use['phi'][0]:.3f}, {use['n_z'][0]:.3f}) against ±{use['phi'][2]:.3f} and "
        f"±{use['n_z'][2]:.1f}; u̇(t_0) = ({use['phi rate'][0]:.3f}, {use['n_z rate'][0]:.3f}) "
        f"against ±{use['phi rate'][2]:.3f} and ±{use['n_z rate'][2]:.0f}: up to "
        f"{worst_use(study.star):.2f} times a limit",
    )
    yield Erratum(
        "4.4, optimisation model",
        "it has a solution near I_K = 4.9",
        f"with all printed constraints the smallest I_K is {near.I_K:.2f} (R_K {near.R_K:.3f}); I* "
        "itself is not printed",
    )
    yield Erratum(
        "5.2, K*; conclusions",
        "K* is the optimum",
        f"without the input constraints, and for I* = {printed.I_STAR}, the optimum is "
        f"R_K = {best.R_K:.4f} at diagonal gains; K* has {star.R_K:.4f}",
    )
    yield Erratum(
        "5.2.1, Fig. 5",
        "the maximum peak time is less than 4 s",
        f"{peaks['chi']:.2f} s for e_chi and {peaks['gamma']:.2f} s for e_gamma",
    )
    yield Erratum(
        "Table 1 and 5.2.1, Fig. 12",
        "the commands satisfy the constraints, rates included",
        f"with the printed rate limits and no anti-windup the loop does not converge (an error of "
        f"{late:.1f} rad from 18 s on); with conditional anti-windup it does, and e_chi overshoots "
        f"by {cured.peak('chi')[0]:.3f} rad only. The printed overshoots come out only without "
        "rate limits",
    )
    growth = max(
        float((table.loc[0.3] - table.loc[0.1]).abs().max())
        for channel in ("s_chi", "s_gamma")
        for table in [study.of_disturbances(channel, "ST_rad")]
    )
    yield Erratum(
        "5.2.3, Fig. 10 (c)",
        "ST grows by the order of 1e-3",
        f"by up to {growth:.3f} rad from L_d = 0.1 to 0.3",
    )


def theory(study: Study) -> Iterator[Erratum]:
    """Statements of the theory that do not follow, or not as printed."""
    star = study.indicators[STAR]
    duffing = study.duffing
    slowest = float(min(duffing.rates["decay"].to_numpy() / duffing.rates["R_f"].to_numpy()))
    yield Erratum(
        "remark after Lemma 5, Theorems 1 and 2",
        "the norm converges at the rate ε/λ_max(P)",
        "that is the rate of V; the norm decays at half of it, as Lemma 5 has it: "
        f"{star.R_K / 2.0:.3f} 1/s for K*. Over 30 damped oscillators the norm of f decays at "
        f"{slowest:.2f} times R(f) in the worst case",
    )
    if star.status == "stable":
        yield _theorem_2(study)
    c = duffing.model.region
    yield Erratum(
        "Theorem 1, the remark after it, 5.1",
        "for any initial value, with the condition checked at the origin",
        "the condition has to hold with one P wherever the state goes; a Jacobian that is stable "
        "at every point is not enough. For the printed oscillator it is stable everywhere, yet the "
        f"condition holds for the chosen P only where |x1| < {c:.4f}; a constant disturbance of "
        f"the printed size takes x1 to {duffing.hard['constant L_d'].farthest:.3f}",
    )
    diverging = study.readings["no limits"]
    yield Erratum(
        "4.1, remark after Theorem 2",
        "stabilising the linearised loop stabilises the nonlinear one globally",
        "it does so near the equilibrium: without any limits, with tan φ as printed, the manoeuvre "
        f"with K* ends at {diverging.t[-1]:.1f} s with γ beyond 1000 rad"
        if diverging.status == "diverged"
        else "it does so near the equilibrium",
    )
    yield Erratum(
        "4.3, eigenvalue problem",
        "Q* is the argument of the minimum",
        "it is not unique, and I_K depends on the choice. R_K needs no solver: it is 1/λ_max of "
        "the solution of the Lyapunov equation, the smallest feasible Q, which also gives the I_K "
        "of Table 2",
    )
    yield Erratum(
        "4.3, R_K",
        "R_K measures the speed of convergence",
        "it stays below 1 for any gains, because the lower block of A_K is the identity, and it "
        "changes with the unit of time and the scaling of the state",
    )


def _theorem_2(study: Study) -> Erratum:
    A_K = closed_loop(study.model, study.star)
    L_d = printed.disturbance(printed.PRINTED_DISTURBANCE).rate_bound
    safe, proportional, open_loop = paper_balls(
        A_K, study.model.A, I_K=study.indicators[STAR].I_K, L_d=L_d
    )
    ellipsoid = invariant_ellipsoid(A_K, disturbance_entry(study.model), L_d=L_d)
    return Erratum(
        "Theorem 2",
        "L_f bounds ∂f(0)/∂x",
        "the proof applies Theorem 1 to the velocity form, whose Jacobian is A_K(0). For K* and "
        f"L_d = {L_d:.3f} the ball has the radius {safe.radius:.3f} with ‖A_K‖, "
        f"{proportional.radius:.3f} with ‖∂f/∂x + ∂f/∂u K_P‖ and {open_loop.radius:.3f} with the "
        f"open loop; only the first is covered. The invariant ellipsoid has {ellipsoid.radius:.4f}",
    )


def slips(_: Study) -> Iterator[Erratum]:
    """Slips of print."""
    steady = math.cos(printed.GAMMA_C)
    rate = printed.G / printed.V_A * (steady - steady / printed.G)
    yield Erratum("2.1", "‖x‖₂ = xᵀx", "the root is missing")
    yield Erratum(
        "4.1, Theorem 2",
        "s = (xᵀ, ẋᵀ)ᵀ",
        "the velocity form and A_K(0) belong to s = (ẋ, x), as the proof has it",
    )
    yield Erratum(
        "4.4",
        "“a predefined exponential convergence rate R*”",
        "the model maximises R_K and bounds I_K by I*",
    )
    yield Erratum(
        "5.1",
        "λ_max(J_D) < 0",
        "J_D is not symmetric: the real parts of its eigenvalues are meant",
    )
    yield Erratum(
        "5.2, equilibrium",
        "n_z = cos γ_c / g",
        f"n_z = cos γ_c = {steady:.4f}; at the printed value γ would change at {rate:.3f} rad/s",
    )
    yield Erratum("Table 1", "reference overload 0", f"cos γ_c = {steady:.4f}")
    yield Erratum(
        "Table 1",
        "initial roll angle π/3",
        f"{math.degrees(printed.PHI_0):.0f} deg, outside the range ±π/4 of the same table",
    )
    yield Erratum(
        "Table 1",
        "Lipschitz constants of d",
        "they are amplitudes; the L_d of Theorem 2 bounds the derivative, which is "
        f"{printed.disturbance(printed.PRINTED_DISTURBANCE).rate_bound:.3f} rad/s²",
    )
    yield Erratum(
        "4.2 against 5.2.2",
        "a larger R_K “is prone to inducing oscillations”; a small one oscillates",
        "the second is what the simulations show; the eigenfrequency does rise with R_K over "
        "Table 2",
    )
    yield Erratum("Table 2", "columns R(f) and I(f)", "R_K and I_K are meant")


PARTS = (
    ("Numbers", numbers),
    ("Theory", theory),
    ("Slips of print", slips),
)

HEAD = """# Errata of arXiv 2411.13140

“Robust Convergency Indicator using MIMO-PI Controller in the presence of disturbances.” Where print
and computation disagree, both are given. `flighttune reproduce` makes this file anew from the
printed parameters.
"""


def errata(study: Study) -> dict[str, tuple[Erratum, ...]]:
    """All errata by part."""
    return {title: tuple(part(study)) for title, part in PARTS}


def errata_text(study: Study) -> str:
    """The errata as Markdown."""
    lines = [HEAD]
    for title, found in errata(study).items():
        lines += [f"## {title}", "", "| where | printed | what holds |", "| --- | --- | --- |"]
        lines += [
            "| "
            + " | ".join(cell.replace("|", "\\|") for cell in (e.where, e.says, e.is_so))
            + " |"
            for e in found
        ]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"
