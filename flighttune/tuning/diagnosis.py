"""Why a problem is infeasible, and what would have to give."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.tuning.gradient import STARTS, searches, smallest_radius
from flighttune.tuning.problem import SearchSpace, TuningProblem, search_space
from flighttune.tuning.program import Program
from flighttune.tuning.result import Assessment, assessment, is_feasible
from flighttune.tuning.starts import stabilising_starts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitDiagnosis:
    """What one input limit, both its sides, does to a problem.

    Attributes
    ----------
    name : str
        ``<input>`` or ``<input>_rate``.
    factor_alone : float
        Smallest factor on this limit alone that makes the problem feasible; inf if none does.
    smallest_I_K_without : float, s^2
        Smallest I_K found without this limit: the lower, the more it is worth relaxing.
    use : float
        Share of this limit that the gains at the common factor use; above 1 they break it.
    """

    name: str
    factor_alone: float
    smallest_I_K_without: float
    use: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Diagnosis:
    """How far a problem is from being feasible, or how far its limits could be tightened.

    Attributes
    ----------
    smallest_I_K : float, s^2
        Smallest I_K found within the input limits; inf if no stable gains were.
    largest_R_K : float, 1/s
        Largest R_K found within the input limits, whatever I_K; 0 if no stable gains were.
    common_factor : float
        Smallest factor on all input limits at once that leaves the problem feasible: above 1 it
        is infeasible, below 1 the limits could be that much tighter. inf if no factor helps; 0
        where there are no input limits and the problem is feasible.
    gains : PIGains or None
        Gains that are feasible at the common factor.
    binding : tuple of str
        Limits that bind there.
    limits : tuple of LimitDiagnosis
        One for each finite limit, the most worth relaxing first.
    """

    smallest_I_K: float
    largest_R_K: float
    common_factor: float
    gains: PIGains | None
    binding: tuple[str, ...]
    limits: tuple[LimitDiagnosis, ...]


def diagnosis(problem: TuningProblem, *, starts: int = STARTS) -> Diagnosis:
    """How far a problem is from being feasible, and which input limit is in the way.

    Parameters
    ----------
    problem : TuningProblem
    starts : int
        Searches for each figure.

    Returns
    -------
    Diagnosis
        Of what was found; the problem is not convex, so none of it is a proof.

    Notes
    -----
    The common factor is a variable of the smooth program: its smallest value is searched for
    directly, by the gradient method, not by trial of factors.
    """
    space = search_space(problem)
    k = stabilising_starts(problem, space, starts)
    smallest = smallest_radius(problem, k)
    unlimited = replace(problem, I_star=math.inf)
    fastest = [one for one in searches(unlimited, k, "R_K") if one.within_limits]
    factor, at_factor = _smallest_factor(problem, np.ones(len(space.names), dtype=bool), k)
    groups = dict.fromkeys(_group(name) for name in space.names)
    used = _use(space, at_factor)
    limits = [_limit_diagnosis(problem, name, k, used.get(name, math.nan)) for name in groups]
    return Diagnosis(
        smallest_I_K=smallest.I_K if smallest else math.inf,
        largest_R_K=max((one.R_K for one in fastest), default=0.0),
        common_factor=factor,
        gains=problem.gains(at_factor.K) if at_factor else None,
        binding=tuple(name for name in at_factor.active if name != "I_K") if at_factor else (),
        limits=tuple(sorted(limits, key=lambda one: (one.smallest_I_K_without, one.factor_alone))),
    )


def _limit_diagnosis(
    problem: TuningProblem, name: str, k: FloatArray, use: float
) -> LimitDiagnosis:
    space = search_space(problem)
    own = np.array([_group(row) == name for row in space.names])
    without = smallest_radius(_with_factor(problem, own, math.inf), k)
    alone = math.inf
    if without is not None and without.I_K <= problem.I_star:
        alone, _ = _smallest_factor(problem, own, np.vstack([without.K[space.free], k]))
    return LimitDiagnosis(
        name=name,
        factor_alone=alone,
        smallest_I_K_without=without.I_K if without else math.inf,
        use=use,
    )


def _smallest_factor(
    problem: TuningProblem, relaxable: npt.NDArray[np.bool_], k: FloatArray
) -> tuple[float, Assessment | None]:
    """Smallest factor on the relaxable rows that is feasible, with its gains; inf if none is."""
    space = search_space(problem)
    if not relaxable.any():
        found = [one for one in searches(problem, k, "R_K") if is_feasible(problem, one)]
        return (0.0, found[0]) if found else (math.inf, None)
    task = Program([problem], "factor", relaxable=relaxable)
    best: tuple[float, Assessment | None] = (math.inf, None)
    for gains, factor in zip(*task.descend(k), strict=True):
        relaxed = _with_factor(problem, relaxable, factor)
        found = assessment(relaxed, space.K(gains))
        if factor < best[0] and is_feasible(relaxed, found):
            best = float(factor), found
    return best


def _with_factor(
    problem: TuningProblem, rows: npt.NDArray[np.bool_], factor: float
) -> TuningProblem:
    """The problem with the limits of the given rows multiplied."""
    names = {
        _group(n) for n, chosen in zip(search_space(problem).names, rows, strict=True) if chosen
    }
    factors = [
        np.array(
            [factor if f"{channel}{kind}" in names else 1.0 for channel in problem.model.inputs]
        )
        for kind in ("", "_rate")
    ]
    return problem.relaxed(*factors)


def _use(space: SearchSpace, gains: Assessment | None) -> dict[str, float]:
    """Largest share of each limit that gains use."""
    shares: dict[str, float] = {}
    if gains is None:
        return shares
    used = space.bound - space.slack(gains.K[space.free])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(used > 0.0, used / np.maximum(space.bound, 0.0), 0.0)
    for name, one in zip(space.names, share, strict=True):
        shares[_group(name)] = max(float(one), shares.get(_group(name), 0.0))
    return shares


def _group(row: str) -> str:
    """``phi_rate`` of ``phi_rate_min``."""
    return row.removesuffix("_max").removesuffix("_min")
