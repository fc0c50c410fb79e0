"""Results of an optimiser, checked against the problem without trust in the optimiser."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.words import pick
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import closed_loops
from flighttune.control.theory.indicators import indicators
from flighttune.control.tuning.noise import Rms
from flighttune.control.tuning.problem import TuningProblem, quadratic_cost

if TYPE_CHECKING:
    from flighttune.control.certificates.bound import RateBound

Status = Literal["optimal", "found", "infeasible", "failed"]

# Relative excess over a limit that counts as rounding
ROUNDING = 1e-9

# Relative distance within which a limit counts as binding
BINDING = 1e-5


class Assessment(NamedTuple):
    """Gains measured against a problem."""

    K: FloatArray  # shape (m, 2 p): the stacked gains assessed
    # Indicators as in `flighttune.control.theory.indicators.Indicators`
    R_K: float
    I_K: float
    E_K: float
    spectral_abscissa: float
    within_limits: bool  # whether input limits and gain bounds hold, regardless of I_K and E_K
    # Constraints that bind, and limits that are exceeded: ``I_K``, ``E_K``, ``<input>_max``,
    # ``<input>_rate_min``, ``K_P[<input>,<error>]_max`` and the like.
    active: tuple[str, ...]
    cost: float  # quadratic cost; nan without `weights`

    def meets(self, problem: TuningProblem) -> bool:
        """Whether the loop is stable and meets every constraint of a problem."""
        fast = self.R_K > 0.0 and self.R_K >= (1.0 - ROUNDING) * problem.R_min
        small = self.I_K <= problem.I_star and self.E_K <= problem.E_star
        return self.within_limits and fast and small

    def why_not(self, problem: TuningProblem) -> str:
        """A sentence on the gains of the smallest I_K, and on the limits that bind there."""
        if self.I_K <= problem.I_star:
            return (
                f"No gains were found with an E_K of at most `E_star` {problem.E_star:g}; those of "
                f"the smallest I_K within the limits have {self.E_K:.6g}."
            )
        binding = f" with {', '.join(self.active)} binding" if self.active else ""
        return (
            f"`I_star` must be at least {self.I_K:.6g}, the smallest I_K reached{binding}, "
            f"got {problem.I_star:g}."
        )


class Diagnosis(NamedTuple):
    """Distance of a problem from feasibility, or the room to tighten its limits."""

    # s^2: smallest I_K found within the input limits; inf without stable gains
    smallest_I_K: float
    # 1/s: largest R_K found within the input limits, for any I_K; 0 without stable gains
    largest_R_K: float
    # Smallest common factor on all input limits with which the problem is feasible. Above 1 the
    # problem is infeasible; below 1 the limits could be tighter by the factor. inf if no factor
    # helps; 0 if the problem is feasible and has no input limits.
    common_factor: float
    gains: PIGains | None  # gains that are feasible at the common factor
    binding: tuple[str, ...]  # limits that bind at these gains
    # A record for each finite limit, starting with the limit whose relaxation helps most: ``name``
    # (``<input>`` or ``<input>_rate``, both its sides); ``factor_alone``, the smallest factor on
    # this limit alone that makes the problem feasible, or inf; ``smallest_I_K_without`` (s^2), the
    # smallest I_K found without it; ``use``, the share of it that the gains at the common factor
    # use, above 1 if they exceed it.
    limits: tuple[Mapping[str, Any], ...]


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TuningResult(Answering):
    """Gains that an optimiser found for a problem, or the reason for none.

    Attributes
    ----------
    status : "optimal", "found", "infeasible" or "failed"
        "found": a local optimum over an envelope.
        "infeasible": no gains were found that meet all constraints, although the search for the
        smallest I_K converged. "failed": no stabilising gains were found at all.
    reason : str
        Why it is not optimal; empty otherwise.
    method : str
        The optimiser.
    problem : TuningProblem
        The stated problem, with the first model if there are several.
    gains : PIGains or None
        The best gains; if infeasible, the gains of the smallest I_K; None if failed.
    R_K, I_K, E_K, spectral_abscissa : float
        Indicators of `gains`, computed again; 0, inf, inf and nan without gains.
    active : tuple of str
        Names of the constraints that bind at `gains`.
    cost : float
        Quadratic cost of `gains` from the problem's `x_0`; nan without `weights`.
    smallest_I_K : float or None
        If infeasible and the method computes it: the smallest I_K within the input limits.
    starts, agreeing : int
        Number of searches, and number that ended within a relative 1e-4 of the best value.
    wall_s : float
        Elapsed time, s.
    R_envelope, R_envelope_bound : float or None, 1/s
        Over an envelope: the rate there, 0 if infeasible, and an upper bound for any common Q of
        these gains.
    factor : float or None
        Reached share of the envelope, scaled about the trim; 1 if found.
    diagnosis : Diagnosis or None
        For an infeasible problem, the limits that would have to change.
    tuned_for : mapping or None
        Names of ``aircraft`` and range of airspeeds, ``V_a_mps``, for which it was tuned, and the
        assumptions of the model, ``assumed``, if any.
    bound : RateBound or None
        If a proof was requested: the bound on R_K that no gains exceed.
    sensitivity : float or None
        If the problem bounds it: the largest sensitivity of the loop at its commands.
    errors_in_gusts : sequence of float or None, length p
        With the objective "rms": rms of each error, relative to the rms of the gusts' angle.
    in_noise : Rms or None
        If the problem has `noise`: rms of the errors, and of the rates of the commands.

    Examples
    --------
    >>> result = ft.tune("paper")
    >>> result.gains.K_P.diagonal().round(2).tolist(), result.active
    ([2.22, 2.48], ('I_K',))
    """

    status: Status
    reason: str
    method: str
    problem: TuningProblem
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
    R_envelope: float | None = None
    R_envelope_bound: float | None = None
    factor: float | None = None
    diagnosis: Diagnosis | None = None
    tuned_for: Mapping[str, Any] | None = None
    bound: "RateBound | None" = None
    sensitivity: float | None = None
    errors_in_gusts: Sequence[float] | None = None
    in_noise: Rms | None = None

    @property
    def solved(self) -> bool:
        """Whether the gains meet all constraints."""
        return self.status in ("optimal", "found")


def assessment(problem: TuningProblem, K: FloatArray) -> Assessment:
    """The stacked gains K, shape (m, 2 p), measured against `problem`."""
    A_K, p = closed_loops(problem.model, K), len(problem.model.errors)
    measured = indicators(A_K, scaling=problem.scaling, errors=p)
    names, *_, bound = problem.limit_rows
    slack, size = problem.slack(K[problem.free]), np.abs(bound)
    lower, upper = problem.gain_bounds
    bounds = {"I_K": problem.I_star, "E_K": problem.E_star}
    active = [
        name
        for name, bound in bounds.items()
        if abs(getattr(measured, name) - bound) <= BINDING * bound < math.inf
    ]
    active += ["R_K"] if 0.0 < measured.R_K <= (1.0 + BINDING) * problem.R_min else []
    active += [name for name, low in zip(names, slack <= BINDING * size, strict=True) if low]
    for side, bound in zip(("min", "max"), problem.gain_bounds, strict=True):
        touching = problem.free & (np.abs(K - bound) <= BINDING * np.maximum(np.abs(bound), 1.0))
        active += [f"{name}_{side}" for name in problem.gain_names[touching]]
    within = bool((slack >= -ROUNDING * size).all() and (lower <= K).all() and (K <= upper).all())
    return Assessment(
        K=K,
        **pick(measured, "R_K I_K E_K spectral_abscissa"),
        within_limits=within,
        active=tuple(active) if math.isfinite(measured.I_K) else (),
        cost=math.nan if problem.weights is None else quadratic_cost(problem, K)[0],
    )


def result(problem: TuningProblem, best: Assessment | None, **outcome: Any) -> TuningResult:
    """A `TuningResult` of an outcome (other attributes) with the indicators of its best gains."""
    if best is None:
        return TuningResult(problem=problem, **outcome)
    figures = pick(best, "R_K I_K E_K spectral_abscissa active cost")
    return TuningResult(problem=problem, gains=problem.gains(best.K), **figures, **outcome)
