"""Results of an optimiser, checked against the problem without trusting the optimiser."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import closed_loops
from flighttune.present.tables import facts_table, matrix, number
from flighttune.theory.indicators import indicators
from flighttune.tuning.cost import quadratic_cost
from flighttune.tuning.problem import TuningProblem, search_space

Status = Literal["optimal", "infeasible", "failed"]

# Relative amount by which rounding may exceed a limit
ROUNDING = 1e-9

# Relative distance within which a limit counts as binding
BINDING = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assessment:
    """Gains measured against a problem."""

    K: FloatArray  # shape (m, 2 p): the stacked gains assessed
    # Indicators as in `flighttune.theory.indicators.Indicators`
    R_K: float
    I_K: float
    E_K: float
    spectral_abscissa: float
    within_limits: bool  # whether input limits and gain bounds hold, whatever I_K and E_K
    # Constraints that bind, and limits that are exceeded: ``I_K``, ``E_K``, ``<input>_max``,
    # ``<input>_rate_min``, ``K_P[<input>,<error>]_max`` and the like.
    active: tuple[str, ...]
    cost: float  # quadratic cost; nan without `weights`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TuningResult:
    """Gains that an optimiser found for a problem, or why it found none.

    Attributes
    ----------
    status : "optimal", "infeasible" or "failed"
        "infeasible": no gains were found that meet all constraints, although the search for the
        smallest I_K converged. "failed": no stabilising gains were found at all.
    reason : str
        Why it is not optimal; empty otherwise.
    method : str
        The optimiser.
    gains : PIGains or None
        The best ones; if infeasible those of the smallest I_K; None if failed.
    R_K, I_K, E_K, spectral_abscissa : float
        Indicators of `gains`, computed anew from them; 0, inf, inf and nan without gains.
    active : tuple of str
        Names of the constraints that bind at `gains`.
    cost : float
        Quadratic cost of `gains` from the problem's `x_0`; nan without `weights`.
    smallest_I_K : float or None
        If infeasible and the method looks for it: the smallest I_K within the input limits.
    starts, agreeing : int
        Searches made, and those that ended within 1e-4 of the best value, relative.
    wall_s : float
        Time it took, s.

    Examples
    --------
    >>> result = ft.tune_scenario(ft.load_scenario("paper"))
    >>> result.gains.K_P.diagonal().round(2).tolist(), result.active
    ([2.22, 2.48], ('I_K',))
    """

    status: Status
    reason: str
    method: str
    gains: PIGains | None = None
    R_K: float = 0.0
    I_K: float = math.inf
    E_K: float = math.inf
    spectral_abscissa: float = math.nan
    active: tuple[str, ...] = ()
    cost: float = math.nan
    smallest_I_K: float | None = None
    starts: int = 0
    agreeing: int = 0
    wall_s: float = 0.0

    def _repr_html_(self) -> str:
        facts = {
            "R_K": f"{number(self.R_K, '.5g')} 1/s",
            "I_K": f"{number(self.I_K, '.5g')} s²",
            "E_K": f"{number(self.E_K, '.5g')} s²",
            "spectral abscissa": f"{number(self.spectral_abscissa, '.5g')} 1/s",
            "binding": ", ".join(self.active) or "nothing",
            "found by": f"{self.method}, {self.agreeing} of {self.starts} starts agree",
        }
        if self.gains is not None:
            facts |= {"K_P": matrix(self.gains.K_P), "K_I": matrix(self.gains.K_I)}
        if self.reason:
            facts["reason"] = self.reason
        return facts_table(f"Tuning: {self.status}", facts).html()


def assessment(problem: TuningProblem, K: FloatArray) -> Assessment:
    """The stacked gains K, shape (m, 2 p), measured against `problem`."""
    A_K, p = closed_loops(problem.model, K), len(problem.model.errors)
    measured = indicators(A_K, scaling=problem.scaling, errors=p)
    space = search_space(problem)
    k = K[space.free]
    slack, size = space.slack(k), np.abs(space.bound)
    lower, upper = problem.gain_bounds
    bounds = {"I_K": problem.I_star, "E_K": problem.E_star}
    active = [
        name
        for name, bound in bounds.items()
        if abs(getattr(measured, name) - bound) <= BINDING * bound < math.inf
    ]
    active += ["R_K"] if 0.0 < measured.R_K <= (1.0 + BINDING) * problem.R_min else []
    active += [name for name, low in zip(space.names, slack <= BINDING * size, strict=True) if low]
    for side, bound in zip(("min", "max"), problem.gain_bounds, strict=True):
        touching = space.free & (np.abs(K - bound) <= BINDING * np.maximum(np.abs(bound), 1.0))
        active += [f"{name}_{side}" for name in problem.gain_names[touching]]
    within = bool((slack >= -ROUNDING * size).all() and (lower <= K).all() and (K <= upper).all())
    return Assessment(
        K=K,
        R_K=measured.R_K,
        I_K=measured.I_K,
        E_K=measured.E_K,
        spectral_abscissa=measured.spectral_abscissa,
        within_limits=within,
        active=tuple(active) if math.isfinite(measured.I_K) else (),
        cost=math.nan if problem.weights is None else quadratic_cost(problem, K)[0],
    )


def result(problem: TuningProblem, best: Assessment | None, **outcome: Any) -> TuningResult:
    """A `TuningResult` of an outcome (its other attributes) with the figures of its best gains."""
    if best is None:
        return TuningResult(**outcome)
    names = ("R_K", "I_K", "E_K", "spectral_abscissa", "active", "cost")
    figures = {name: getattr(best, name) for name in names}
    return TuningResult(gains=problem.gains(best.K), **figures, **outcome)


def is_feasible(problem: TuningProblem, gains: Assessment) -> bool:
    """Whether a loop is stable and meets every constraint."""
    fast = gains.R_K > 0.0 and gains.R_K >= (1.0 - ROUNDING) * problem.R_min
    small = gains.I_K <= problem.I_star and gains.E_K <= problem.E_star
    return gains.within_limits and fast and small


def why_infeasible(problem: TuningProblem, best: Assessment | None) -> str:
    """One sentence on the smallest I_K that was reached and on the limits that bind there."""
    if best is None:
        return "No stabilising gains were found within the limits."
    if best.I_K <= problem.I_star:
        return (
            f"No gains were found with an E_K of at most `E_star` {problem.E_star:g}; those of the "
            f"smallest I_K within the limits have {best.E_K:.6g}."
        )
    binding = f" with {', '.join(best.active)} binding" if best.active else ""
    return (
        f"`I_star` must be at least {best.I_K:.6g}, the smallest I_K reached{binding}, "
        f"got {problem.I_star:g}."
    )
