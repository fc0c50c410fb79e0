"""Gains and inner feedback at once: the fastest decay, or the least errors in turbulence."""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import closed_loops, fed_by, inner_feedback
from flighttune.tuning.peaks import FINE, GRID, Peaks
from flighttune.tuning.problem import TuningProblem, search_space

# Starts: the gains of the largest R_K times these, with these of the inner feedback
STARTS = (1.6, 0.2), (2.0, 0.4)

# Price of a logarithm of sensitivity, and of 1/s of decay, beyond the bound
PENALTY = 100.0
# The search of the decay, which has kinks, is begun anew where it stopped.
SIMPLEX = {"xatol": 1e-3, "fatol": 1e-5, "maxfev": 200}
RESTARTS = {"decay": 3, "rms": 1}

# What a search takes off the logarithm of the largest sensitivity at first, and then of what its
# frequencies miss; how often it does.
ROOM, MORE_THAN_MISSED, MAX_TIGHTENINGS = 2e-3, 1.1, 4

# `feedback` must be below 1.
MOST_FEEDBACK = 0.95

# Difference of ends that agree
SAME_END = 1e-2


def searched(
    problems: Sequence[TuningProblem], k: FloatArray
) -> tuple[FloatArray, float, int] | None:
    """Free gains and inner feedback of one command, and how many searches agree on them.

    `problems`: of the same free gains; the first says what is sought and the largest sensitivity.
    `k` (shape (f,)): gains that stabilise all of them; with the aim "rms" the loop must decay as
    fast as with these, or the integrals would be given up. None if no search keeps the sensitivity.
    """
    from scipy.optimize import minimize

    first, space = problems[0], search_space(problems[0])
    limit = math.log(first.sensitivity_max)
    coarse, fine = ([Peaks(case.model, space, n) for case in problems] for n in (GRID, FINE))

    def decay(z: FloatArray) -> float:
        loops = (loop_of(case, space.K(k * z[:-1]), z[-1:]) for case in problems)
        return max(float(np.linalg.eigvals(loop).real.max()) for loop in loops)

    slowest = decay(np.append(np.ones(len(k)), 0.0))

    def value(z: FloatArray) -> float:
        rate = decay(z)
        if first.objective == "decay" or rate >= 0.0:
            return rate + PENALTY * (rate >= 0.0)
        K = space.K(k * z[:-1])
        rms = max(errors_in_gusts(case, K, z[-1:]).max() for case in problems)
        return math.log(rms) + PENALTY * max(rate - slowest, 0.0)

    def over(z: FloatArray, peaks: Sequence[Peaks], most: float) -> float:
        return max(each.largest(k * z[:-1], z[-1:]) for each in peaks) - most

    top = MOST_FEEDBACK if first.feedback else 0.0
    ends = np.sort([space.k_min / k, space.k_max / k], axis=0)
    low, high = np.append(np.maximum(ends[0], 0.0), 0.0), np.append(ends[1], top)
    found: list[tuple[float, FloatArray]] = []
    for factor, fed in STARTS:
        z, room = np.append(np.full(len(k), factor), fed), ROOM
        for tightening in range(MAX_TIGHTENINGS):
            for _ in range(RESTARTS[first.objective] if tightening == 0 else 1):
                z = minimize(
                    lambda z, most=limit - room: value(z) + PENALTY * max(over(z, coarse, most), 0),
                    np.clip(z, low, high),
                    method="Nelder-Mead",
                    bounds=np.column_stack([low, high]),
                    options=SIMPLEX,
                ).x
            if (missed := over(z, fine, limit)) <= 0.0:
                found.append((value(z), z))
                break
            room += MORE_THAN_MISSED * missed
    if not found:
        return None
    best, z = min(found, key=lambda end: end[0])
    return k * z[:-1], float(z[-1]), sum(end <= best + SAME_END for end, _ in found)


def loop_of(problem: TuningProblem, K: FloatArray, feedback: FloatArray) -> FloatArray:
    """The loop of stacked gains K, shape (m, 2 p), with the inner feedback of the first inputs."""
    return closed_loops(fed_by(problem.model, feedback), K)


def errors_in_gusts(problem: TuningProblem, K: FloatArray, feedback: FloatArray) -> FloatArray:
    """Rms of each error in its gusts over that of their angle, shape (p,), of a stable loop.

    `K` (shape (m, 2 p)): stacked gains; `feedback`: of the first inputs.

    Notes
    -----
    Gusts across the flight turn the path by their speed over the airspeed, at once: ``e = C x - d``
    with the Dryden spectrum of MIL-F-8785C, ``(1 + 3 (w/a)^2) / (1 + (w/a)^2)^2``, a the airspeed
    over its scale. The path turns with a force that is measured, so that the inner feedback sees
    d': the errors are those of the sensitivity at the commands. White noise makes d by
    ``(sqrt(3) s/a + 1) / (s/a + 1)^2``; the covariance of all states together is the solution of a
    Lyapunov equation.
    """
    from scipy.linalg import block_diag, solve_continuous_lyapunov

    assert problem.gusts is not None
    model = fed_by(problem.model, feedback)
    n, _, p = model.shape
    a = np.asarray(problem.gusts)
    air = block_diag(*([[0.0, 1.0], [-w * w, -2.0 * w]] for w in a))
    gust = block_diag(*([[w**1.5, math.sqrt(3.0 * w)]] for w in a))  # d, of variance one
    fed = problem.model.B * inner_feedback(problem.model, feedback)[0]  # what d' adds to x'
    whole = block_diag(closed_loops(model, K), air)
    whole[: n + p, n + p :] = -np.vstack([model.B @ K[:, :p], np.eye(p)]) @ gust
    whole[:n, n + p :] -= fed @ gust @ air
    white = np.kron(np.eye(p), [[0.0], [1.0]])
    noise = np.vstack([-fed @ gust @ white, np.zeros((p, p)), white])
    covariance = solve_continuous_lyapunov(whole, -noise @ noise.T)
    rows = np.hstack([model.C, np.zeros((p, p)), -gust])
    return np.sqrt(np.einsum("pi,ij,pj->p", rows, covariance, rows))
