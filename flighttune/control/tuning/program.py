"""One objective over gains as a smooth program for SciPy's SLSQP, and gains to start it from."""

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.stop import go_on
from flighttune.control.linear_model import LinearModel, closed_loops, velocity_form
from flighttune.control.theory.indicators import indicators_batch, scaled
from flighttune.control.theory.lyapunov import solution_of_checked
from flighttune.control.theory.reachable import error_slopes
from flighttune.control.tuning.problem import TuningProblem, quadratic_cost

Objective = Literal["R_K", "I_K", "factor", "trace", "cost"]

# Cost coefficients of (top, bottom, sigma_floor, factor) for each linear objective
COSTS = {"R_K": (1.0, 0.0, 0.0, 0.0), "I_K": (2.0, -1.0, -1.0, 0.0), "factor": (0.0, 0.0, 0.0, 1.0)}
NO_COST = np.zeros(4)

SMALLEST_FACTOR = 1e-6

# SLSQP is restarted from its last point: a new estimate of the curvature often gets further.
ACCURACY, MAX_ITERATIONS, MAX_RUNS = 1e-10, 100, 3

# Status of SLSQP
OUT_OF_ITERATIONS = 9

# Relative distance from every limit: SLSQP meets a constraint only to about 1e-10, but gains must
# not exceed a limit.
MARGIN = 1e-9

# Replaces the logarithms of an unstable loop's spectra: worse than for any stable loop, so that the
# line search turns back.
UNSTABLE_LOG = 30.0

# `top` is above its spectrum; `bottom` and `sigma_floor` are below theirs
SIGNS = np.array([[1.0], [-1.0], [-1.0]])


class Program:
    """One objective over the gains of a problem, or of several models at once.

    R_K and I_K have kinks where eigenvalues of Q or singular values of A_K meet, and optima often
    lie there. So the variables are z = (k, top, bottom, sigma_floor, factor): free gains and bounds
    on the spectra, ``log(lambda_i) <= top``, ``log(lambda_i) >= bottom`` and ``log(sigma_i) >=
    sigma_floor`` for every i. Then ``log R_K = -top`` and ``log I_K = 2 top - bottom -
    sigma_floor`` are linear, and only the bounds are curved. The factor multiplies the limit rows
    that are `relaxable`, shape (r,), by default none.

    The `problems`, one for each model, have the same free gains. The first has the constraints; the
    same numbers bound the spectra of all. The `objective` R_K is maximised; I_K, the factor, the
    trace of Q or the first problem's quadratic cost is minimised. ``I_K <= I_star`` is a constraint
    unless I_K is minimised.
    """

    def __init__(
        self,
        problems: Sequence[TuningProblem],
        objective: Objective,
        *,
        relaxable: npt.NDArray[np.bool_] | None = None,
        min_R_K: float = 0.0,
    ) -> None:
        self._problems, self._problem, self._objective = problems, problems[0], objective
        problem, (k_min, k_max) = problems[0], problems[0].k_bounds
        self._I_star = math.inf if objective == "I_K" else problem.I_star
        # A_K without gains and its slopes in the free gains: the loops are affine in them
        f, base = len(k_min), problem.K(np.zeros(len(k_min)))
        self._loops = [
            [
                scaled(A, np.asarray(case.scaling))
                for A in (closed_loops(case.model, base), loop_slopes(case.model, problem))
            ]
            for case in problems
        ]
        # Limits are ``G k + offset <= bound``. In a relaxed row the factor multiplies the bound,
        # which is linear in z as well.
        _, G, offset, bound = problem.limit_rows
        bound = bound - MARGIN * np.abs(bound)
        relaxed = np.zeros(len(bound), dtype=bool) if relaxable is None else relaxable
        self._fixed_slack = np.where(relaxed, 0.0, bound) - offset
        rows = np.hstack([-G, np.zeros((len(bound), 3)), np.where(relaxed, bound, 0.0)[:, None]])
        # log I_K = 2 top - bottom - sigma_floor <= log I_star, written as a slack.
        radius = [*np.zeros(f), -2.0, 1.0, 1.0, 0.0]
        self._rows = np.vstack([rows, radius]) if math.isfinite(self._I_star) else rows
        varies = objective == "factor"
        # R_K = exp(-top): a minimum rate is an upper bound on top.
        slowest = -math.log(min_R_K) - MARGIN if min_R_K else math.inf
        lower = [*k_min, *[-math.inf] * 3, SMALLEST_FACTOR if varies else 1.0]
        upper = [*k_max, slowest, math.inf, math.inf, math.inf if varies else 1.0]
        self._bounds = np.column_stack([lower, upper])
        # SLSQP alternates between values and slopes: the spectra of the last k serve both.
        self._last: tuple[bytes, FloatArray, FloatArray] = (b"", np.empty(0), np.empty(0))

    def descend(
        self, k: FloatArray, I_star: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Free gains, (N, f), and factors, (N,), where SLSQP stops from `k`."""
        if not k.size:  # no start, or every gain is fixed
            return k, np.ones(len(k))
        # `I_star`, shape (N,), s^2, bounds I_K of each start instead of the problem's `I_star`.
        limits = np.full(len(k), self._I_star) if I_star is None else I_star
        z = np.array([self._minimum(*start) for start in zip(k, limits, strict=True)])
        # SLSQP stops at local optima or when progress ends, possibly with broken constraints. It
        # may leave the bounds by rounding; gains must not.
        return np.clip(z[:, :-4], *self._problem.k_bounds), z[:, -1]

    def _minimum(self, k: FloatArray, I_star: float) -> FloatArray:
        constant = self._fixed_slack
        if math.isfinite(I_star):
            constant = np.append(constant, math.log(I_star) - MARGIN)
        # The bounds begin at the spectra, so that the start is feasible except for limits.
        top, bottom, sigma = self._spectra(k)[0]
        z = np.array([*k, top.max(), bottom.min(), sigma.min(), 1.0])
        objective = {
            "type": "ineq",
            "fun": lambda z: np.concatenate([self.room(z), constant + self._rows @ z]),
            "jac": lambda z: np.vstack([self.room_slopes(z), self._rows]),
        }
        end = self._descended(z, [objective])
        if math.isinf(self._problem.E_star) or self._error_room(end).min() >= 0.0:
            return end
        # E_K costs far more than all other constraints, so it is added only if needed.
        error = {"type": "ineq", "fun": self._error_room, "jac": self._error_slopes}
        return self._descended(z, [objective, error])

    def _descended(self, z: FloatArray, constraints: list[dict[str, Any]]) -> FloatArray:
        from scipy.optimize import minimize

        settings = {"jac": True, "method": "SLSQP", "bounds": self._bounds}
        options = {"maxiter": MAX_ITERATIONS, "ftol": ACCURACY}
        for _ in range(MAX_RUNS):
            run = minimize(self._goal, z, constraints=constraints, options=options, **settings)
            z = run.x
            if run.status != OUT_OF_ITERATIONS:
                break
        return z

    def _goal(self, z: FloatArray) -> tuple[float, FloatArray]:
        """The objective and its slope."""
        k, problem = z[:-4], self._problem
        if self._objective == "cost":
            J, slope = quadratic_cost(problem, problem.K(k))
            if not math.isfinite(J):
                return UNSTABLE_LOG, np.zeros(len(z))
            return math.log(J), np.append(slope[problem.free] / J, NO_COST)
        if self._objective != "trace":
            slope = np.array([*np.zeros(len(k)), *COSTS[self._objective]])
            return float(slope @ z), slope
        # Its logarithm has the same minimum and a scale that suits SLSQP.
        logs, slopes = self._spectra(k)
        eigenvalues = np.exp(logs[0])
        # The slopes belong to log(lambda_i): d(sum lambda) = sum lambda_i d(log lambda_i).
        in_k = eigenvalues @ slopes[0] / eigenvalues.sum()
        return math.log(eigenvalues.sum()), np.append(in_k, NO_COST)

    def room(self, z: FloatArray) -> FloatArray:
        """Slack of the bounds on the spectra, shape (3 n,)."""
        return (SIGNS * (z[-4:-1, None] - self._spectra(z[:-4])[0])).ravel()

    def room_slopes(self, z: FloatArray) -> FloatArray:
        """Jacobian of `room`, shape (3 n, f + 4)."""
        slopes = -SIGNS[:, :, None] * self._spectra(z[:-4])[1]
        n = slopes.shape[1]
        # For (top, bottom, sigma_floor) each block of n rows has only its own sign.
        commands = np.repeat(np.diag(SIGNS[:, 0]), n, axis=0)
        return np.hstack([slopes.reshape(3 * n, -1), commands, np.zeros((3 * n, 1))])

    def _error_room(self, z: FloatArray) -> FloatArray:
        """``log E_star - log E_i`` of every error of every model."""
        K = self._problem.K(z[:-4])
        if not np.isfinite(K).all():
            K = np.zeros(K.shape)  # no stable loop
        errors = [problem.largest_errors(K) for problem in self._problems]
        logs = np.minimum(np.log(np.concatenate(errors)), UNSTABLE_LOG)
        return math.log(self._problem.E_star) - MARGIN - logs

    def _error_slopes(self, z: FloatArray) -> FloatArray:
        """Jacobian of `_error_room`, shape (errors of all models, f + 4)."""
        K, slopes = self._problem.K(z[:-4]), []
        for model in (problem.model for problem in self._problems):
            loop, in_k = closed_loops(model, K), loop_slopes(model, self._problem)
            values, slope = error_slopes(loop, in_k, errors=len(model.errors))
            slopes.append(np.where(np.isfinite(values)[:, None], -slope / values[:, None], 0.0))
        steep = np.concatenate(slopes)
        return np.hstack([steep, np.zeros((len(steep), 4))])

    def _spectra(self, k: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Logarithms of the spectra of Q, Q and A_K of all models, (3, n), and slopes (3, n, f)."""
        go_on()  # every step of a search comes here
        key = k.tobytes()
        if self._last[0] != key:
            parts = [
                _log_spectra(base + np.tensordot(k, in_k, 1), in_k) for base, in_k in self._loops
            ]
            logs, slopes = zip(*parts, strict=True)
            self._last = key, np.concatenate(logs, axis=1), np.concatenate(slopes, axis=1)
        return self._last[1:]


def _log_spectra(A: FloatArray, in_k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Logarithms of the spectra of a scaled loop A, and their slopes in gains from A's slopes."""
    unstable = SIGNS * UNSTABLE_LOG * np.ones(len(A)), np.zeros((3, len(A), len(in_k)))
    if not np.isfinite(A).all() or np.linalg.eigvals(A).real.max() >= 0.0:
        return unstable
    try:
        Q = solution_of_checked(A, np.eye(len(A)))
        values, vectors = np.linalg.eigh(Q)
        # With ``A X_i + X_i A' + v_i v_i' = 0`` the slope in A of the eigenvalue of Q with
        # eigenvector v_i is ``2 Q X_i``; the slope of a singular value is ``u_i v_i'``. One
        # Lyapunov equation of the transposed loop for each eigenvector.
        loads = vectors.T[:, :, None] * vectors.T[:, None, :]
        X = solution_of_checked(np.broadcast_to(A.T, loads.shape), loads)
    except np.linalg.LinAlgError:  # so close to instability that rounding decides
        return unstable
    if not values[0] > 0.0:
        return unstable
    U, sigma, right = np.linalg.svd(A)
    slopes = 2.0 * np.tensordot(Q @ X, in_k, ((1, 2), (1, 2))) / values[:, None]
    sigma_slopes = np.tensordot(U.T[:, :, None] * right[:, None, :], in_k, ((1, 2), (1, 2)))
    # The spectrum of Q twice: bounded from above by `top` and from below by `bottom`.
    return (
        np.stack([np.log(values), np.log(values), np.log(sigma)]),
        np.stack([slopes, slopes, sigma_slopes / sigma[:, None]]),
    )


def loop_slopes(model: LinearModel, problem: TuningProblem) -> FloatArray:
    """Slopes of A_K in a problem's free gains, shape (f, n + p, n + p): it is affine in them."""
    f = problem.k_bounds.shape[1]
    loops = closed_loops(model, problem.K(np.vstack([np.zeros(f), np.eye(f)])))
    return loops[1:] - loops[0]


REGULATORS = 16

# Number of regulators with random weights, and random variations of each
VARIANTS = 16


def stabilising_starts(problem: TuningProblem, starts: int) -> FloatArray:
    """Free gains of stable loops, shape (at most `starts`, f), the best R_K first."""
    if not starts:
        return np.empty((0, problem.k_bounds.shape[1]))
    # Candidates are linear-quadratic regulators of the velocity form with random weights, projected
    # on the allowed feedback, scaled and disturbed at random, and moved inside the bounds. Half of
    # them are shrunk into the input limits. The result is spread over the better half of the stable
    # candidates; it may be empty.
    rng = np.random.default_rng(np.random.SeedSequence(problem.seed))
    regulators = _regulators(problem.model, rng)[:, None, :, :]
    shape = (len(regulators), VARIANTS, *problem.free.shape)
    size = 10.0 ** rng.uniform(-1.0, 0.3, (*shape[:2], 1, 1))
    disturbed = regulators * size * (1.0 + 0.3 * rng.standard_normal(shape))
    # Relative changes alone would keep zero gains at zero.
    coupling = 0.2 * np.abs(regulators).max(axis=(-2, -1), keepdims=True) * size
    disturbed += coupling * rng.standard_normal(shape)
    k = np.clip(disturbed.reshape(-1, *shape[2:])[:, problem.free], *problem.k_bounds)
    # The largest factor up to 1 that keeps gains inside the limits. Only half are shrunk, because
    # tight limits may destabilise a shrunk loop.
    _, G, offset, bound = problem.limit_rows
    use, room = k[::2] @ G.T, np.maximum(bound - offset, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(use > room, room / use, 1.0)
    k[::2] *= ratio.min(axis=1, initial=1.0)[:, None]
    k = np.clip(k, *problem.k_bounds)
    measured = indicators_batch(closed_loops(problem.model, problem.K(k)), scaling=problem.scaling)
    ranking = np.argsort(-measured.R_K, kind="stable")[: int(measured.stable.sum())]
    if not len(ranking):
        return k[:0]
    better_half = ranking[: (len(ranking) + 1) // 2]
    spread = np.linspace(0, len(better_half) - 1, min(starts, len(better_half)))
    return k[better_half[spread.astype(int)]]


def _regulators(model: LinearModel, rng: np.random.Generator) -> FloatArray:
    """Stacked gains of linear-quadratic regulators, shape (`REGULATORS`, m, 2 p)."""
    from scipy.linalg import solve_continuous_are

    A, B = velocity_form(model)
    n = len(model.states)
    Q, R = (10.0 ** rng.uniform(-1.5, 1.5, (REGULATORS, size)) for size in B.shape)
    gains = []
    for q, r in zip(Q, R, strict=True):
        try:
            X = solve_continuous_are(A, B, np.diag(q), np.diag(r))
        except np.linalg.LinAlgError:  # a mode on the axis that no input reaches
            X = np.zeros(A.shape)
        gains.append(-(B / r).T @ X)
    K = np.array(gains, dtype=np.float64)
    return np.concatenate([K[..., :n] @ np.linalg.pinv(model.C), K[..., n:]], axis=-1)
