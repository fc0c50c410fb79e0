"""Gains under a bound on the sensitivity: fastest decay, least errors in turbulence, least E_K.

Inner feedback is sought with them. Such gains lie where eigenvalues or peaks meet, at which there
are no slopes.
"""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import inner_feedback
from flighttune.theory.lyapunov import solution_of_checked
from flighttune.tuning.peaks import FINE, GRID, Peaks
from flighttune.tuning.problem import TuningProblem, search_space

# Starts: the gains of the largest R_K times these, with these of the inner feedback
STARTS = (1.6, 0.2), (2.0, 0.4)

# Price of a logarithm of sensitivity, and of 1/s of decay, beyond the bound
PENALTY = 100.0
# The search of the decay, which has kinks, is begun anew where it stopped.
SIMPLEX = {"xatol": 1e-3, "fatol": 1e-5, "maxfev": 200}
RESTARTS = {"decay": 3, "rms": 1, "E_K": 2}

# Times at which a response is integrated, denser at first, over so many slowest time constants
NODES, SPAN = 600, 14.0

# What a search with feedback takes off the logarithm of the largest sensitivity at first, and then
# any of what its frequencies miss; how often it does.
ROOM, MORE_THAN_MISSED, MAX_TIGHTENINGS = 2e-3, 1.1, 5

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

    first, space, f = problems[0], search_space(problems[0]), len(k)
    limit, aim = math.log(first.sensitivity_max), first.objective
    coarse, fine = ([Peaks(case.model, space, n) for case in problems] for n in (GRID, FINE))
    loops = [GustLoop(case) for case in problems]

    def decay(K: FloatArray, fed: FloatArray) -> float:
        return max(float(np.linalg.eigvals(loop.matrix(K, fed)).real.max()) for loop in loops)

    slowest = decay(space.K(k), np.zeros(1))

    def value(z: FloatArray) -> float:
        K, fed = space.K(k * z[:f]), z[f:] if first.feedback else np.zeros(1)
        rate = decay(K, fed)
        if aim == "decay" or rate >= 0.0:
            return rate + PENALTY * (rate >= 0.0)
        if aim == "E_K":
            return math.log(max(loop.largest_error(K, fed) for loop in loops))
        rms = max(float(loop.errors(K, fed).max()) for loop in loops)
        return math.log(rms) + PENALTY * max(rate - slowest, 0.0)

    def over(z: FloatArray, peaks: Sequence[Peaks], most: float) -> float:
        fed = z[f:] if first.feedback else np.zeros(1)
        return max(each.largest(k * z[:f], fed) for each in peaks) - most

    ends = np.sort([space.k_min / k, space.k_max / k], axis=0)
    low, high = np.maximum(ends[0], 0.0), ends[1]
    if first.feedback:
        low, high = np.append(low, 0.0), np.append(high, MOST_FEEDBACK)
    answers: list[tuple[float, FloatArray]] = []
    for factor, fed in STARTS:
        z, room = np.append(np.full(f, factor), fed)[: len(low)], ROOM * first.feedback
        for tightening in range(MAX_TIGHTENINGS):
            for _ in range(RESTARTS[aim] if tightening == 0 else 1):
                z = minimize(
                    lambda z, most=limit - room: value(z) + PENALTY * max(over(z, coarse, most), 0),
                    np.clip(z, low, high),
                    method="Nelder-Mead",
                    bounds=np.column_stack([low, high]),
                    options=SIMPLEX,
                ).x
            if (missed := over(z, fine, limit)) <= 0.0:
                answers.append((value(z), z))
                break
            room += MORE_THAN_MISSED * missed
    if not answers:
        return None
    best, z = min(answers, key=lambda answer: answer[0])
    agreeing = sum(reached <= best + SAME_END for reached, _ in answers)
    return k * z[:f], float(z[f]) if first.feedback else 0.0, agreeing


class GustLoop:
    """The loop of a problem by stacked gains and inner feedback, and its errors in gusts."""

    def __init__(self, problem: TuningProblem) -> None:
        from scipy.linalg import block_diag

        self.model = problem.model
        p = len(self.model.errors)
        if problem.gusts is not None:
            a = np.asarray(problem.gusts)
            self._air = block_diag(*([[0.0, 1.0], [-w * w, -2.0 * w]] for w in a))
            # d, of variance one, and its rate, of the states of the air
            self._gust = block_diag(*([[w**1.5, math.sqrt(3.0 * w)]] for w in a))
            self._white = np.kron(np.eye(p), [[0.0], [1.0]])
            self._rows = np.hstack([self.model.C, np.zeros((p, p)), -self._gust])

    def matrix(self, K: FloatArray, feedback: FloatArray) -> FloatArray:
        """A_K of stacked gains K, shape (m, 2 p), with the inner feedback of the first inputs."""
        (n, _, p), model = self.model.shape, self.model
        k, k_M = inner_feedback(model, feedback)
        A_K, B = np.zeros((n + p, n + p)), model.B * (1.0 + k)
        A_K[:n, :n] = model.A - model.B @ k_M + B @ K[:, :p] @ model.C
        A_K[:n, n:], A_K[n:, :n] = B @ K[:, p:], model.C
        return A_K

    def largest_error(self, K: FloatArray, feedback: FloatArray) -> float:
        """E_K of a stable loop to some 1e-4: the integral of its response to a step of d'."""
        (n, _, p), A_K = self.model.shape, self.matrix(K, feedback)
        rates, modes = np.linalg.eig(A_K)
        t = SPAN / -float(np.max(np.real(rates))) * np.linspace(0.0, 1.0, NODES) ** 2
        entry = np.eye(n + p)[:, :n][:, self.model.C.any(axis=0)]
        response = (modes[n:, :, None] * np.linalg.solve(modes, entry)).transpose(0, 2, 1)
        sizes = np.linalg.norm(np.real(response @ np.exp(np.outer(rates, t))), axis=1)
        return float(np.trapezoid(sizes, t).max())

    def errors(self, K: FloatArray, feedback: FloatArray) -> FloatArray:
        """Rms of each error in its gusts over that of their angle, shape (p,), of a stable loop.

        Notes
        -----
        Gusts across the flight turn the path by their speed over the airspeed, at once:
        ``e = C x - d`` with the Dryden spectrum of MIL-F-8785C,
        ``(1 + 3 (w/a)^2) / (1 + (w/a)^2)^2``, a the airspeed over its scale. The path turns with a
        force that is measured, so that the inner feedback sees d': the errors are those of the
        sensitivity at the commands. White noise makes d by
        ``(sqrt(3) s/a + 1) / (s/a + 1)^2``; the covariance of all states together is the solution
        of a Lyapunov equation.
        """
        (n, _, p), model = self.model.shape, self.model
        N, k = n + p, inner_feedback(model, feedback)[0]
        fed = model.B * k  # what d' adds to x'
        whole = np.zeros((N + 2 * p, N + 2 * p))
        whole[:N, :N], whole[N:, N:] = self.matrix(K, feedback), self._air
        whole[:n, N:] = (
            -(model.B * (1.0 + k)) @ K[:, :p] @ self._gust - fed @ self._gust @ self._air
        )
        whole[n:N, N:] = -self._gust
        noise = np.vstack([-fed @ self._gust @ self._white, np.zeros((p, p)), self._white])
        covariance = solution_of_checked(whole.T, noise @ noise.T)
        return np.sqrt(np.einsum("pi,ij,pj->p", self._rows, covariance, self._rows))
