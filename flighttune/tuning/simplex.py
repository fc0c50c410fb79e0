"""Gains under a bound on the sensitivity: fastest decay, least errors in turbulence, least E_K.

Inner feedback is sought with them. Such gains lie where eigenvalues or peaks meet, at which there
are no slopes.
"""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import closed_loops, fed_by, inner_feedback, measured_rows
from flighttune.theory.lyapunov import solution_of_checked
from flighttune.tuning.problem import TuningProblem

# Starts: the gains of the largest R_K times these, with these of the inner feedback
STARTS = (1.6, 0.2), (2.0, 0.4)

# Price of a logarithm of sensitivity, and of 1/s of decay, beyond the bound
PENALTY = 100.0
# The search of the decay, which has kinks, is begun anew where it stopped.
SIMPLEX = {"xatol": 1e-3, "fatol": 1e-5, "maxfev": 200}
RESTARTS = {"decay": 3, "rms": 1, "E_K": 2}

# Numbers of frequencies during a search and at its end, and the lowest and highest one relative to
# the slowest and the fastest pole. Between two of them a peak is higher by less than 1e-3, which
# the last step of a search takes off.
GRID, FINE, SLOWER, FASTER = 160, 4000, 0.02, 20.0

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
    """Free gains and inner feedback of one command, and how many searches agree; None without any.

    `problems` have the same free gains; the first says what is sought and the largest sensitivity.
    `k` (shape (f,)) stabilises all of them; with the aim "rms" the loop must decay as fast as with
    these, or the integrals would be given up.
    """
    from scipy.optimize import minimize

    first, f = problems[0], len(k)
    limit, aim = math.log(first.sensitivity_max), first.objective
    coarse, fine = ([Peaks(case, n) for case in problems] for n in (GRID, FINE))
    loops = [GustLoop(case) for case in problems]

    def parts(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Free gains, and the inner feedback, which is zero unless it is searched too."""
        return k * z[:f], z[f:] if first.feedback else np.zeros(1)

    def decay(K: FloatArray, fed: FloatArray) -> float:
        return max(float(np.linalg.eigvals(loop.matrix(K, fed)).real.max()) for loop in loops)

    slowest = decay(first.K(k), np.zeros(1))

    def value(z: FloatArray) -> float:
        free, fed = parts(z)
        K = first.K(free)
        rate = decay(K, fed)
        if aim == "decay" or rate >= 0.0:
            return rate + PENALTY * (rate >= 0.0)
        if aim == "E_K":
            return math.log(max(loop.largest_error(K, fed) for loop in loops))
        rms = max(float(loop.errors(K, fed).max()) for loop in loops)
        return math.log(rms) + PENALTY * max(rate - slowest, 0.0)

    def over(z: FloatArray, peaks: Sequence[Peaks], most: float) -> float:
        return max(each.largest(*parts(z)) for each in peaks) - most

    ends = np.sort(first.k_bounds / k, axis=0)
    size = f + 1 if first.feedback else f  # of z: factors on the free gains, then the feedback
    low = np.append(np.maximum(ends[0], 0.0), 0.0)[:size]
    high = np.append(ends[1], MOST_FEEDBACK)[:size]
    answers: list[tuple[float, FloatArray]] = []
    for factor, fed in STARTS:
        z = np.append(np.full(f, factor), fed)[:size]
        room = ROOM if first.feedback else 0.0
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
    free, fed = parts(z)
    return free, float(fed[0]), agreeing


class Peaks:
    """Largest singular value of ``S = 1 / (1 - K G)`` at the commands, over frequencies."""

    def __init__(self, problem: TuningProblem, count: int) -> None:
        self._problem, model = problem, problem.model
        poles = np.abs(np.linalg.eigvals(model.A))
        fastest = float(poles.max(initial=1.0))
        slowest = float(poles[poles > 1e-6 * fastest].min(initial=fastest))
        omega = np.geomspace(SLOWER * min(slowest, 1.0), FASTER * fastest, count)[:, None, None]
        x = np.linalg.solve(
            1j * omega * np.eye(len(model.A)) - model.A,
            np.broadcast_to(model.B, (count, *model.B.shape)),
        )
        # The sign is minus because errors fall with the commands.
        G, self._followed = -model.C @ x, measured_rows(model) @ x
        # A stacked gain (K_P, K_I) acts on G and on its integral.
        self._GI = np.concatenate([G, G / (1j * omega)], axis=1)

    def largest(self, k: FloatArray, feedback: FloatArray) -> float:
        """Logarithm of the largest of all, with the inner feedback (shape (m,)) of each command."""
        L = (1.0 + feedback)[:, None] * (self._problem.K(k) @ self._GI)
        L = np.eye(L.shape[-1]) + L + feedback[:, None] * self._followed
        if L.shape[-1] == 1:
            return -math.log(np.abs(L).min())
        # the largest singular value of an inverse
        return -math.log(np.linalg.svd(L, compute_uv=False)[:, -1].min())


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
        return closed_loops(fed_by(self.model, feedback), K)

    def largest_error(self, K: FloatArray, feedback: FloatArray) -> float:
        """E_K of a stable loop to some 1e-4: the integral of its response to a step of d'."""
        n, _, p = self.model.shape
        rates, modes = np.linalg.eig(self.matrix(K, feedback))
        t = SPAN / -float(np.max(np.real(rates))) * np.linspace(0.0, 1.0, NODES) ** 2
        entry = np.eye(n + p)[:, :n][:, self.model.C.any(axis=0)]
        response = (modes[n:, :, None] * np.linalg.solve(modes, entry)).transpose(0, 2, 1)
        sizes = np.linalg.norm(np.real(response @ np.exp(np.outer(rates, t))), axis=1)
        return float(np.trapezoid(sizes, t).max())

    def errors(self, K: FloatArray, feedback: FloatArray) -> FloatArray:
        """Rms of each error in its gusts over that of their angle, shape (p,), of a stable loop.

        Gusts across the flight turn the path by their speed over the airspeed, at once:
        ``e = C x - d`` with the Dryden spectrum of MIL-F-8785C,
        ``(1 + 3 (w/a)^2) / (1 + (w/a)^2)^2``, a the airspeed over its scale; white noise makes d by
        ``(sqrt(3) s/a + 1) / (s/a + 1)^2``. The path turns with a force that is measured, so that
        the inner feedback sees d': the errors are those of the sensitivity at the commands.
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
