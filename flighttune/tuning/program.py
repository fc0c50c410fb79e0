"""One objective over gains as a smooth program, and a barrier method for many starts at once."""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, Floats
from flighttune.control.linear_model import closed_loops
from flighttune.theory.indicators import scaled
from flighttune.theory.lyapunov import solution_of_checked
from flighttune.tuning.problem import TuningProblem, search_space

Objective = Literal["R_K", "I_K", "factor", "trace"]

COSTS = {
    "R_K": (1.0, 0.0, 0.0, 0.0),
    "I_K": (2.0, -1.0, -1.0, 0.0),
    "factor": (0.0, 0.0, 0.0, 1.0),
    "trace": (0.0, 0.0, 0.0, 0.0),
}
"""Of the objectives in (top, bottom, sigma_floor, factor)."""
SMALLEST_FACTOR = 1e-6

FIRST_WEIGHT, LAST_WEIGHT, FALL = 0.1, 1e-10, 0.1
"""Of the barrier. At the end the objective is within some 20 times the last of its optimum."""
CENTRED = 0.3
"""Decrease that Newton's next step promises, in weights, below which the weight falls."""
SADDLE = 1e-4
"""Of the scaled curvature: below minus this a point is none to stay at, however flat."""
STEPS = 300
HALVINGS = 30
DECREASE = 1e-4
"""Share of the promised decrease that a step must bring."""
MARGIN = 0.7
"""Of the first bounds on the logarithms of the spectra."""
FROM_BOUNDS = 1e-3
"""Distance of the first gains from their bounds: a barrier begins inside."""
SHARE_OF_ROOM = 0.95
"""Of the way to the nearest linear bound, the longest step."""
SMALLEST_CURVATURE = 1e-16
ROUNDING = 1e-13
SINGULAR = 1e-15
"""Ratio of eigenvalues below which a matrix may have no inverse in floating point."""
UNUSED = -300.0
"""Logarithm of a bound that plays no part."""
POWERS = 1, -1, -2
"""Of exp(top), exp(bottom), exp(sigma_floor) in the matrices, with their signs."""
SIGNS = np.array([1.0, 1.0, 1.0, -1.0, -1.0])[:, None]
"""Of the five matrices of the barrier."""


class Program:
    """One objective over the gains of a problem, or of several models at once.

    R_K and I_K have kinks where eigenvalues of Q or singular values of A_K meet, and optima like to
    lie there. So the variables are z = (k, top, bottom, sigma_floor, factor, log I_star, excess):
    free gains and bounds on the spectra, ``Q < exp(top) I``, ``Q > exp(bottom) I`` and
    ``A_K' A_K > exp(2 sigma_floor) I``. Then ``log R_K = -top`` and ``log I_K = 2 top - bottom -
    sigma_floor`` are linear, and the determinants of the differences are smooth at every kink. The
    factor multiplies chosen limits. A start outside has an excess, which widens all limits by that
    share and I_star by that logarithm, and is minimised until it is gone.

    Parameters
    ----------
    problems : sequence of TuningProblem
        One a model, of the same free gains. Input limits, `I_star` and the bounds on gains are
        those of the first; the spectra of all are bounded by the same (top, bottom, sigma_floor).
    objective : "R_K" (maximised), "I_K", "factor" or "trace" (minimised)
        The last is the trace of Q. ``I_K <= I_star`` is a constraint unless I_K is minimised.
    relaxable : ndarray of bool, shape (r,), optional
        Which limit rows the factor multiplies; none by default.
    min_R_K : float, 1/s
        A smaller rate is not allowed; the start must be faster.

    Notes
    -----
    Minimised by Newton's method on ``objective - weight * sum log(slack)`` with a falling weight,
    on exact slopes and curvatures (S. Boyd, L. Vandenberghe, *Convex Optimization*, Cambridge 2004,
    sections 11.3 and 11.4). The program is not convex: negative curvatures count by their size
    (J. Nocedal, S. J. Wright, *Numerical Optimization*, Springer 2006, section 3.4), and what is
    found is a local optimum.
    """

    def __init__(
        self,
        problems: Sequence[TuningProblem],
        objective: Objective,
        *,
        relaxable: npt.NDArray[np.bool_] | None = None,
        min_R_K: float = 0.0,
    ) -> None:
        problem = problems[0]
        self.space = space = search_space(problem)
        self._f = f = len(space.k_min)
        self._loops = [_affine_loops(one) for one in problems]
        I_star = math.inf if objective == "I_K" else problem.I_star
        self._cost = np.array([*np.zeros(f), *COSTS[objective], 0.0, 0.0])
        self._trace = min_R_K if objective == "trace" else 0.0  # makes the trace of order one
        bounds_I_K = objective == "I_K" or math.isfinite(I_star)
        used = [True, bounds_I_K, bounds_I_K, objective == "factor", False, False]
        self._used = np.array([*[True] * f, *used])
        # keeps bounds that nothing else holds from drifting off
        self._pull = np.array([*np.zeros(f), 2.0, -1.0, -1.0, 1.0, 0.0, 0.0])
        self._min_R_K = min_R_K
        self._I_star = I_star
        self._rows, self._constants = _rows(problem, I_star, relaxable, min_R_K)
        self._rounding = ROUNDING * np.abs(self._constants)

    def descend(
        self, k: FloatArray, I_star: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Free gains and factors where the method ends.

        Parameters
        ----------
        k : ndarray, shape (N, f)
            Of stable loops.
        I_star : ndarray, shape (N,), s^2, optional
            In place of a finite one of the problem.

        Returns
        -------
        k, factor : ndarray, shapes (N, f) and (N,)
            A start ends outside the limits, or above `I_star`, where the least excess found is not
            zero, and where it is where it has no stable neighbour inside the bounds of gains.
        """
        z, live = self._start(k, self._I_star if I_star is None else I_star)
        weight, centred = np.full(len(z), FIRST_WEIGHT), np.zeros(len(z), dtype=bool)
        inside = z[:, -1] == 0.0
        live &= np.isfinite(self.merit(z, weight, inside))
        for _ in range(STEPS):
            at = np.flatnonzero(live)
            if not len(at):
                break
            z[at], weight[at], centred[at] = self._step(z[at], weight[at], centred[at], inside[at])
            arrived = live & ~inside & (z[:, -1] < 0.0)
            z[arrived, -1], weight[arrived], centred[arrived] = 0.0, FIRST_WEIGHT, False
            inside |= arrived
            live &= ~(centred & (weight <= LAST_WEIGHT))
        return z[:, : self._f], z[:, self._f + 3]

    def merit(self, z: FloatArray, weight: FloatArray, inside: npt.NDArray[np.bool_]) -> FloatArray:
        """What a step has to reduce, shape (N,): inf where a constraint is broken.

        Parameters
        ----------
        z : ndarray, shape (N, f + 6)
        weight : ndarray, shape (N,)
            Of the barrier.
        inside : ndarray of bool, shape (N,)
            Whether the objective counts, or the excess.
        """
        cost, trace = self._objective(inside)
        slack = z @ self._rows.T + self._constants
        feasible = np.all(slack > self._rounding, axis=1)
        with np.errstate(all="ignore"):  # what is not feasible is replaced
            barrier = z @ self._pull - np.log(slack).sum(axis=1)
            merit = (cost * z).sum(axis=1)
            for base, in_k in self._loops:
                try:
                    _, Q, D = self._matrices(z, base, in_k)
                except np.linalg.LinAlgError:  # one of them is at the very edge of stability
                    return np.full(len(z), np.inf)
                feasible &= np.all(np.isfinite(D), axis=(0, 2, 3))
                spectra = np.linalg.eigvalsh(np.where(feasible[:, None, None], D, 0.0))
                feasible &= np.all(spectra[..., 0] > SINGULAR * spectra[..., -1], axis=0)
                barrier += len(base) * z[:, self._f]
                barrier -= (SIGNS * np.log(spectra).sum(axis=2)).sum(axis=0)
                merit += trace * np.trace(Q, axis1=1, axis2=2)
        return np.where(feasible, merit + weight * barrier, np.inf)

    def derivatives(
        self, z: FloatArray, weight: FloatArray, inside: npt.NDArray[np.bool_]
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Slope of the merit, that of the barrier alone, curvature of the merit, and its scale.

        Shapes (N, d), (N, d), (N, d, d) and (N, d) with d = f + 6. The scale is the square root of
        what is positive in the diagonal of the curvature.
        """
        f = self._f
        cost, trace = self._objective(inside)
        by_weight = weight[:, None, None]
        slack = z @ self._rows.T + self._constants
        barrier = self._pull - (1.0 / slack) @ self._rows
        slope = cost.copy()
        curvature = by_weight * ((self._rows.T / slack[:, None] ** 2) @ self._rows)
        scale = np.diagonal(curvature, axis1=1, axis2=2) + weight[:, None]
        for base, in_k in self._loops:
            n, one = len(base), np.eye(len(base))
            A, Q, D = self._matrices(z, base, in_k)
            load = Q[:, None] @ in_k
            Q_k = solution_of_checked(np.broadcast_to(A[:, None], load.shape), load + load.mT)
            gram_k = A.mT[:, None] @ in_k
            D_z = np.zeros((len(D), *z.shape, n, n))
            D_z[0, :, :f], D_z[1, :, :f], D_z[3, :, :f] = -Q_k, Q_k, Q_k
            D_z[2, :, :f] = D_z[4, :, :f] = gram_k + gram_k.mT
            for part, power in enumerate(POWERS):
                bound = power * np.exp(abs(power) * z[:, f + part])
                D_z[part, :, f + part] = bound[:, None, None] * one
            inverse = np.linalg.inv(D)
            relative = inverse[:, :, None] @ D_z
            traces = np.trace(relative, axis1=-2, axis2=-1)
            barrier -= (SIGNS[:, :, None] * traces).sum(axis=0)
            barrier[:, f] += n
            slope[:, :f] += trace[:, None] * np.trace(Q_k, axis1=-2, axis2=-1)
            flat, flipped = (x.reshape(len(D), *z.shape, n * n) for x in (relative, relative.mT))
            squares = by_weight * (flat @ flipped.mT)
            own = np.diagonal(squares[:3].sum(axis=0), axis1=1, axis2=2)
            scale = scale + np.maximum(own, 0.0)  # rounding
            curvature += (SIGNS[:, :, None, None] * squares).sum(axis=0)
            for part, power in enumerate(POWERS):
                own = f + part
                curvature[:, own, own] -= weight * abs(power) * traces[part, :, own]
            # The second derivatives of Q are not needed one by one: X weighs all of them.
            load = by_weight * (inverse[0] - inverse[1] + inverse[3])
            X = solution_of_checked(A.mT, load + trace[:, None, None] * one)
            in_Q = (X[:, None] @ Q_k).reshape(len(z), f, n * n) @ in_k.mT.reshape(f, n * n).T
            gram = by_weight * (inverse[2] - inverse[4])
            in_gram = (in_k @ gram[:, None]).reshape(len(z), f, n * n) @ in_k.reshape(f, n * n).T
            curvature[:, :f, :f] += 2.0 * (in_Q + in_Q.mT - in_gram)
        return slope + weight[:, None] * barrier, barrier, curvature, np.sqrt(scale)

    def _step(
        self,
        z: FloatArray,
        weight: FloatArray,
        centred: npt.NDArray[np.bool_],
        inside: npt.NDArray[np.bool_],
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """One step of Newton's method; the weight falls where it is centred."""
        slope, barrier, curvature, scale = self.derivatives(z, weight, inside)
        # The curvature of the old weight leads along the path: with that of the new one the step
        # would overshoot every active constraint.
        lower = np.where(centred, np.maximum(FALL * weight, LAST_WEIGHT), weight)
        free = np.tile(self._used, (len(z), 1))
        free[:, -1] = ~inside
        slope = np.where(free, slope + (lower - weight)[:, None] * barrier, 0.0) / scale
        curvature = curvature / (scale[:, :, None] * scale[:, None])
        curvature = np.where(free[:, :, None] & free[:, None], curvature, np.eye(z.shape[1]))
        values, vectors = np.linalg.eigh(curvature)
        along = (vectors.mT @ slope[..., None])[..., 0]
        along /= np.maximum(np.abs(values), SMALLEST_CURVATURE)
        step = -(vectors @ along[..., None])[..., 0]
        promised = -(slope * step).sum(axis=1)
        step /= scale
        use = -(step @ self._rows.T) / (z @ self._rows.T + self._constants)
        length = np.minimum(1.0, SHARE_OF_ROOM / np.maximum(use.max(axis=1), SHARE_OF_ROOM))
        before = self.merit(z, lower, inside)
        rounding = ROUNDING * np.abs(before)
        after, short = before, np.ones(len(z), dtype=bool)
        for _ in range(HALVINGS):
            after = self.merit(z + length[:, None] * step, lower, inside)
            short = ~(after <= before + rounding - DECREASE * length * promised)
            if not short.any():
                break
            length = np.where(short, length / 2.0, length)
        length = np.where(short, 0.0, length)
        settled = (promised <= CENTRED * lower) | (before - after <= rounding)
        settled &= values[:, 0] > -SADDLE
        return z + length[:, None] * step, lower, short | settled

    def _objective(self, inside: npt.NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        """Costs of z, shape (N, f + 6), and of the trace of Q, shape (N,)."""
        excess = np.eye(len(self._cost))[-1]
        return np.where(inside[:, None], self._cost, excess), np.where(inside, self._trace, 0.0)

    def _start(self, k: FloatArray, I_star: Floats) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """First z inside the barrier, and where there is one."""
        f, space = self._f, self.space
        margin = FROM_BOUNDS * np.minimum(space.k_max - space.k_min, 1.0)
        z = np.zeros((len(k), f + 6))
        z[:, :f] = np.clip(k, space.k_min + margin, space.k_max - margin)
        z[:, f:] = -np.inf, np.inf, np.inf, 1.0, 0.0, 0.0
        z[:, -2] = np.log(I_star) if math.isfinite(self._I_star) else 0.0
        for base, in_k in self._loops:
            A = self._A(z, base, in_k)
            Q = solution_of_checked(A, np.broadcast_to(np.eye(len(base)), A.shape))
            spectrum, sigma = np.linalg.eigvalsh(Q), np.linalg.svd(A, compute_uv=False)
            with np.errstate(invalid="ignore", divide="ignore"):
                logs = np.log(np.array([spectrum[:, -1], spectrum[:, 0], sigma[:, -1]]))
            z[:, f] = np.maximum(z[:, f], logs[0])
            z[:, f + 1 : f + 3] = np.minimum(z[:, f + 1 : f + 3], logs[1:].T)
        stable = np.all(np.isfinite(z), axis=1)
        z[~stable, :f] = k[~stable]
        slowest = -math.log(self._min_R_K) if self._min_R_K else math.inf
        z[:, f] = np.minimum(z[:, f] + MARGIN, (z[:, f] + slowest) / 2.0)
        z[:, f + 1 : f + 3] -= MARGIN
        z[:, ~self._used] = np.where(self._pull < 0.0, UNUSED, z)[:, ~self._used]
        room = z @ self._rows.T + self._constants - self._rounding
        worst = room[:, self._rows[:, -1] > 0.0].min(axis=1, initial=np.inf)
        z[:, -1] = np.where(worst > 0.0, 0.0, MARGIN - worst)
        return z, stable

    def _A(self, z: FloatArray, base: FloatArray, in_k: FloatArray) -> FloatArray:
        """Scaled A_K of one model, shape (N, n, n)."""
        f, n = self._f, len(base)
        return base + (z[:, :f] @ in_k.reshape(f, n * n)).reshape(-1, n, n)

    def _matrices(
        self, z: FloatArray, base: FloatArray, in_k: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A_K, Q, and the five matrices of the barrier, shape (5, N, n, n).

        The last two take out what the second and third gain where Q and A_K grow: a barrier that
        rewards that would leave the stable gains.
        """
        A = self._A(z, base, in_k)
        one = np.eye(len(base))
        Q, gram = solution_of_checked(A, np.broadcast_to(one, A.shape)), A.mT @ A
        top, bottom, sigma = np.exp(z[:, self._f : self._f + 3] * np.abs(POWERS)).T[..., None, None]
        return A, Q, np.stack([top * one - Q, Q - bottom * one, gram - sigma * one, Q, gram])


def _affine_loops(problem: TuningProblem) -> tuple[FloatArray, FloatArray]:
    """A_K without gains and its slopes in the free gains, shapes (n, n) and (f, n, n)."""
    space = search_space(problem)
    f = len(space.k_min)
    loops = closed_loops(problem.model, space.K(np.vstack([np.zeros(f), np.eye(f)])))
    loops = scaled(loops, np.asarray(problem.scaling))
    return loops[0], loops[1:] - loops[0]


def _rows(
    problem: TuningProblem,
    I_star: float,
    relaxable: npt.NDArray[np.bool_] | None,
    min_R_K: float,
) -> tuple[FloatArray, FloatArray]:
    """Linear constraints ``rows @ z + constants > 0``, shapes (r, f + 6) and (r,)."""
    space = search_space(problem)
    f, bound = len(space.k_min), space.bound
    relaxable = np.zeros(len(bound), dtype=bool) if relaxable is None else relaxable
    size = np.where(bound == 0.0, 1.0, np.abs(bound))[:, None]
    z = np.eye(f + 6)
    top, bottom, sigma_floor, factor, log_I_star, excess = z[f:]
    limits = np.zeros((len(bound), f + 6))
    limits[:, :f] = -space.G
    limits[:, f + 3] = np.where(relaxable, bound, 0.0)
    slack = np.where(relaxable, 0.0, bound) - space.offset
    radius = log_I_star + excess + bottom + sigma_floor - 2.0 * top
    rows = np.vstack([z[:f], -z[:f], limits / size + excess, radius, factor, -top])
    last = (
        0.0 if math.isfinite(I_star) else math.inf,
        -SMALLEST_FACTOR,
        -math.log(min_R_K) if min_R_K else math.inf,
    )
    constants = np.array([*-space.k_min, *space.k_max, *slack / size[:, 0], *last])
    finite = np.isfinite(constants)
    return rows[finite], constants[finite]
