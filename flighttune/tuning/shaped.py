"""Gains of the fastest decay, or of the least E_K, under a bound on the sensitivity of the loop."""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import LinearModel, closed_loops
from flighttune.theory.reachable import error_slopes
from flighttune.tuning.problem import SearchSpace, TuningProblem, search_space
from flighttune.tuning.program import UNSTABLE_LOG, loop_slopes

# Frequencies of the constraint: so many, from a part of the slowest pole's to many times the
# fastest's. Between two of them a peak is higher by less than 1e-3, which the last step takes off.
GRID, FINE, SLOWER, FASTER = 160, 4000, 0.02, 20.0

# Searches begin at the gains of the largest R_K times these.
FACTORS = 1.0, 1.6

ACCURACY, MAX_ITERATIONS = 1e-9, 150

# Of the simplex search of the decay: price of a logarithm of sensitivity too much, 1/s, and runs
PENALTY, RESTARTS = 100.0, 2
SIMPLEX = {"xatol": 1e-5, "fatol": 1e-7, "maxfev": 400}

# How often the bound is tightened by what the grid misses, each time by a little more
MAX_TIGHTENINGS, MORE_THAN_MISSED = 6, 1.1

# Relative excess of the sensitivity that counts as none, and difference of ends that agree
MISSED, AGREEMENT = 1e-6, 1e-3


def shaped(problems: Sequence[TuningProblem], k: FloatArray) -> tuple[FloatArray, int] | None:
    """Free gains of one objective over several models, and how many searches agree on it.

    `problems`: of the same free gains; the first says what is sought and the largest sensitivity.
    `k` (shape (f,)): gains that stabilise all of them. None if no search keeps the sensitivity.
    """
    first, space = problems[0], search_space(problems[0])
    limit = math.log(first.sensitivity_max)
    fine = [Peaks(case.model, space, FINE) for case in problems]
    search = _Search(problems, space)
    starts = [np.clip(factor * k, space.k_min, space.k_max) for factor in FACTORS]
    ends = [k]
    for start in starts:
        end, tightened = start, limit
        # The grid sees a peak too low: what it misses is taken off, and the search goes on.
        for _ in range(MAX_TIGHTENINGS):
            end = search.end(end, first.objective, tightened)
            over = max(peaks.logs(end)[0].max() for peaks in fine) - limit
            if over <= 0.0:
                break
            tightened -= MORE_THAN_MISSED * over
        ends.append(end)
    values = np.array([search.goals(end, first.objective)[0].max() for end in ends])
    peaks = np.array([max(each.logs(end)[0].max() for each in fine) for end in ends])
    values[peaks > limit + MISSED] = math.inf
    if not np.isfinite(values).any():
        return None
    best = int(np.argmin(values))
    return ends[best], int((values[1:] <= values[best] + AGREEMENT).sum())


class _Search:
    """Searches over the free gains of several models of one channel."""

    def __init__(self, problems: Sequence[TuningProblem], space: SearchSpace) -> None:
        self._problems, self._space = problems, space
        self._slopes = [loop_slopes(case.model, space) for case in problems]
        self._peaks = [Peaks(case.model, space, GRID) for case in problems]
        self._bounds = list(zip(space.k_min, space.k_max, strict=True))

    def end(self, k: FloatArray, objective: str, limit: float) -> FloatArray:
        """Gains where a search from `k` stops, with a logarithm of the sensitivity of `limit`."""
        if objective == "decay":
            return self._fastest(self._least_error(k, limit), limit)
        return self._least_error(k, limit)

    def _least_error(self, k: FloatArray, limit: float) -> FloatArray:
        """The least E_K: smooth, so that SLSQP has the slopes of everything."""
        from scipy.optimize import minimize

        def room(z: FloatArray) -> FloatArray:
            below = z[-1] - self.goals(z[:-1], "E_K")[0]
            return np.concatenate([below, *(limit - each.logs(z[:-1])[0] for each in self._peaks)])

        def slopes(z: FloatArray) -> FloatArray:
            errors = self.goals(z[:-1], "E_K")[1]
            in_k = -np.concatenate([errors, *(each.logs(z[:-1])[1] for each in self._peaks)])
            in_t = np.append(np.ones(len(errors)), np.zeros(len(in_k) - len(errors)))
            return np.column_stack([in_k, in_t])

        run = minimize(
            lambda z: (z[-1], np.append(np.zeros(len(k)), 1.0)),
            np.append(k, self.goals(k, "E_K")[0].max()),
            jac=True,
            method="SLSQP",
            bounds=[*self._bounds, (-UNSTABLE_LOG, UNSTABLE_LOG)],
            constraints=[{"type": "ineq", "fun": room, "jac": slopes}],
            options={"maxiter": MAX_ITERATIONS, "ftol": ACCURACY},
        )
        return np.clip(run.x[:-1], self._space.k_min, self._space.k_max)

    def _fastest(self, k: FloatArray, limit: float) -> FloatArray:
        """The fastest decay. It lies where eigenvalues meet, at which they have no slope."""
        from scipy.optimize import minimize

        def cost(k: FloatArray) -> float:
            over = max(float(each.logs(k)[0].max()) for each in self._peaks) - limit
            return float(self.goals(k, "decay")[0].max()) + PENALTY * max(over, 0.0)

        for _ in range(RESTARTS):
            k = minimize(cost, k, method="Nelder-Mead", bounds=self._bounds, options=SIMPLEX).x
        return k

    def goals(self, k: FloatArray, objective: str) -> tuple[FloatArray, FloatArray]:
        """Values whose largest is made small, over all models, and slopes of E_K in the gains.

        They are the logarithms of E_K of each error, or the real parts of the eigenvalues.
        """
        values, in_k = [], []
        for case, slope in zip(self._problems, self._slopes, strict=True):
            loop = closed_loops(case.model, self._space.K(k))
            if objective == "decay":
                values.append(np.linalg.eigvals(loop).real)
                continue
            errors, change = error_slopes(loop, slope, errors=len(case.model.errors))
            stable = np.isfinite(errors)
            values.append(np.log(np.where(stable, errors, math.exp(UNSTABLE_LOG))))
            in_k.append(np.where(stable[:, None], change / errors[:, None], 0.0))
        return np.concatenate(values), np.concatenate(in_k) if in_k else np.empty((0, len(k)))


class Peaks:
    """Largest singular value of ``S = 1 / (1 - K G)`` at the commands, over frequencies.

    Minus, because errors fall with the commands: ``G = C (s - A)^-1 B`` has their sign.
    """

    def __init__(self, model: LinearModel, space: SearchSpace, count: int) -> None:
        poles = np.abs(np.linalg.eigvals(model.A))
        fastest = float(poles.max(initial=1.0))
        slowest = float(poles[poles > 1e-6 * fastest].min(initial=fastest))
        omega = np.geomspace(SLOWER * min(slowest, 1.0), FASTER * fastest, count)
        n, self._m, _ = model.shape
        resolvent = 1j * omega[:, None, None] * np.eye(n) - model.A
        G = -model.C @ np.linalg.solve(resolvent, np.broadcast_to(model.B, (count, n, self._m)))
        # A stacked gain (K_P, K_I) acts on G and on its integral.
        self._GI = np.concatenate([G, G / (1j * omega[:, None, None])], axis=1)
        self._space, free = space, np.argwhere(space.free)
        self._rows, self._columns = free.T

    def logs(self, k: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Logarithms at each frequency and their slopes in the gains, shapes (w,) and (w, f)."""
        L = self._space.K(k) @ self._GI
        if self._m == 1:  # the rule; a hundredth of the time of the general way
            S = 1.0 / (1.0 + L)
            slopes = -(S[:, :, 0] * self._GI[:, self._columns, 0]).real
            return np.log(np.abs(S[:, 0, 0])), slopes
        S = np.linalg.inv(np.eye(self._m) + L)
        U, sigma, _ = np.linalg.svd(S)
        left = U[..., 0]
        # With S v = sigma u, d sigma = -Re(u' S dL S v) = -sigma Re(u' S dL u).
        before = np.einsum("wi,wij->wj", left.conj(), S)
        after = np.einsum("wij,wj->wi", self._GI, left)
        return np.log(sigma[:, 0]), -(before[:, self._rows] * after[:, self._columns]).real
