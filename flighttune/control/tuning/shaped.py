"""Gains under a bound on sensitivity: fastest decay, or smallest errors in turbulence or E_K.

The search includes inner feedback. The fastest decay lies where poles meet and slopes do not exist,
so a simplex method finds it. The other two goals are smooth, and SLSQP handles all bounds.
"""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.stop import go_on
from flighttune.control.linear_model import closed_loops, fed_by, inner_feedback
from flighttune.control.theory.lyapunov import solution_of_checked
from flighttune.control.tuning.noise import NoisyLoop, Responses, Rms
from flighttune.control.tuning.problem import TuningProblem
from flighttune.control.tuning.program import UNSTABLE_LOG

# Starts: factors on the gains of the largest R_K, and values of the inner feedback
STARTS = (1.6, 0.2), (2.0, 0.4)
LAST_START = (1.0, 0.0)  # decays fast enough: tried where all others end too slow

# Gains of the smallest errors in turbulence must decay at this share of the rate of the largest
# R_K. Without this bound the search would drop the integrals; the whole rate costs 3 to 4 % of ITAE
# in wind.
LEAST_DECAY, DECAY_ROUNDING, RATE_ROUNDING = 0.5, 1e-2, 1e-3

# Penalty of a simplex search on the logarithm of sensitivity beyond the bound; the search is
# restarted from its last point.
PENALTY = 100.0
SIMPLEX = {"xatol": 1e-3, "fatol": 1e-5, "maxfev": 200}
RESTARTS = 3

SMOOTH = {"maxiter": 100, "ftol": 1e-7}

# Numbers of frequencies during a search and at its end, and the lowest and highest frequency
# relative to the slowest and the fastest pole. Between two frequencies a peak is higher by less
# than 1e-3, which the last step of a search removes.
GRID, FINE, SLOWER, FASTER = 160, 4000, 0.02, 20.0

# Number of integration points of a response, denser at first, and its length in slowest time
# constants
NODES, SPAN = 600, 14.0

# Reduction of the logarithm of the largest sensitivity, first for a simplex with feedback, then for
# peaks between the frequencies; number of such repeats.
ROOM, MORE_THAN_MISSED, MAX_TIGHTENINGS = 2e-3, 1.1, 5

# `feedback` must be below 1.
MOST_FEEDBACK = 0.95

# Ends of searches that differ by less agree.
SAME_END = 1e-2

# Decay given to an integrator whose gain vanishes, 1/s: errors excite it by nothing.
AT_REST = 1e-9


def searched(
    problems: Sequence[TuningProblem], k: FloatArray
) -> tuple[FloatArray, float, int] | None:
    """Free gains and inner feedback of one command, and number of agreeing searches; or None.

    `problems` have the same free gains; the first states the objective and the largest sensitivity.
    `k` (shape (f,)) are the gains of the largest R_K, which stabilise all problems.
    """
    search = _Search(problems, k)
    answers: list[tuple[float, FloatArray]] = []
    too_slow = False
    for factor, fed in (*STARTS, LAST_START):
        if (factor, fed) == LAST_START and (answers or not too_slow):
            break
        z, room = search.start(factor, fed), search.room
        for tightening in range(MAX_TIGHTENINGS):
            z = search.end(z, room, restarts=RESTARTS if tightening == 0 else 1)
            if (missed := search.peaks(z, search.fine).max() - search.limit) <= 0.0:
                if search.decays(z) and search.is_calm(z):
                    answers.append((float(search.costs(z).max()), z))
                else:
                    too_slow = True
                break
            room += MORE_THAN_MISSED * missed
    if not answers:
        return None
    best, z = min(answers, key=lambda answer: answer[0])
    agreeing = sum(reached <= best + SAME_END for reached, _ in answers)
    free, fed = search.parts(z)
    return free, float(fed[0]), agreeing


class _Search:
    """The search for z: factors on the gains `k`, then the inner feedback if it is free."""

    def __init__(self, problems: Sequence[TuningProblem], k: FloatArray) -> None:
        self._first, self._k, first = problems[0], k, problems[0]
        self._aim, self.limit = first.objective, math.log(first.sensitivity_max)
        self._coarse, self.fine = ([Peaks(case, n) for case in problems] for n in (GRID, FINE))
        self._loops = [GustLoop(case) for case in problems]
        noisy = [(case.model, case.noise) for case in problems if case.noise is not None]
        self._noisy = [NoisyLoop(*each) for each in noisy if self._aim == "rms"]
        ends = np.sort(first.k_bounds / k, axis=0)
        low, high = np.append(np.maximum(ends[0], 0.0), 0.0), np.append(ends[1], MOST_FEEDBACK)
        self._bounds = np.column_stack([low, high])[: len(k) + first.feedback]
        self.room = ROOM if first.feedback and self._aim == "decay" else 0.0
        # The largest real part of a pole
        self._slowest = LEAST_DECAY * self._rates(self.start(1.0, 0.0))[-1]
        self._slowest *= self._aim == "rms"

    def start(self, factor: float, fed: float) -> FloatArray:
        """All gains times a factor, with this feedback."""
        return np.append(np.full(len(self._k), factor), fed)[: len(self._bounds)]

    def parts(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Free gains, and the inner feedback, which is zero unless it is sought."""
        f = len(self._k)
        return self._k * z[:f], z[f:] if self._first.feedback else np.zeros(1)

    def peaks(self, z: FloatArray, frequencies: Sequence["Peaks"]) -> FloatArray:
        """Logarithms of the sensitivities of all models."""
        return np.concatenate([each.logs(*self.parts(z)) for each in frequencies])

    def costs(self, z: FloatArray) -> FloatArray:
        """Costs to minimise: minus the decay, or the logarithms of the errors of each model."""
        go_on()  # every step of a search comes here
        free, fed = self.parts(z)
        poles = self._rates(z)
        if self._aim == "decay":
            return poles[-1:]
        if poles[-1] >= 0.0:
            return np.full(len(self._loops), UNSTABLE_LOG)
        if self._noisy:
            return np.concatenate([np.log(rms.errors) for rms in self._rms(z)])
        errors = GustLoop.largest_error if self._aim == "E_K" else GustLoop.errors
        return np.log([np.max(errors(loop, self._first.K(free), fed)) for loop in self._loops])

    def _rms(self, z: FloatArray) -> list[Rms]:
        """Errors and command rates of each model in its noise."""
        free, fed = self.parts(z)
        return [loop.rms(self._first.K(free), fed) for loop in self._noisy]

    def calmness(self, z: FloatArray) -> FloatArray:
        """Shares of the bounds on the command rates that each model leaves."""
        if not self._noisy:
            return np.empty(0)
        bound = self._noisy[0].noise.rates_max
        return np.concatenate([1.0 - rms.rates / bound for rms in self._rms(z)])

    def _rates(self, z: FloatArray) -> FloatArray:
        """Real parts of the poles of all models, the largest last."""
        free, fed = self.parts(z)
        K = self._first.K(free)
        poles = [np.linalg.eigvals(loop.matrix(K, fed)).real for loop in self._loops]
        return np.sort(np.concatenate(poles, dtype=np.float64))

    def decays(self, z: FloatArray) -> bool:
        """Whether the slowest pole is fast enough, which a search that fails may forget."""
        # Without gains the integrators stand still, up to rounding of either sign.
        least = min((1.0 - DECAY_ROUNDING) * self._slowest, -AT_REST)
        return bool(self._rates(z)[-1] <= least)

    def is_calm(self, z: FloatArray) -> bool:
        """Whether the rms rates of the commands are within their bounds."""
        return bool((self.calmness(z) >= -RATE_ROUNDING).all())

    def end(self, z: FloatArray, room: float, *, restarts: int) -> FloatArray:
        """The end of a search from `z`, with `room` to the logarithm of the largest sensitivity."""
        from scipy.optimize import minimize

        most, bounds = self.limit - room, self._bounds
        z = np.clip(z, *bounds.T)
        if self._aim == "decay":
            for _ in range(restarts):
                z = minimize(
                    lambda z: self.costs(z)[0] + PENALTY * self._over(z, most),
                    z,
                    method="Nelder-Mead",
                    bounds=bounds,
                    options=SIMPLEX,
                ).x
            return z

        def slack(y: FloatArray) -> FloatArray:
            z, bound = y[:-1], y[-1]  # bound on the costs, which have a kink where two are equal
            left = bound - self.costs(z), self._slowest - self._rates(z), self.calmness(z)
            return np.concatenate([*left, most - self.peaks(z, self._coarse)])

        y = minimize(
            lambda y: (y[-1], np.eye(len(y))[-1]),
            np.append(z, self.costs(z).max()),
            jac=True,
            method="SLSQP",
            bounds=[*bounds, (None, None)],
            constraints={"type": "ineq", "fun": slack},
            options=SMOOTH,
        ).x
        return np.clip(y[:-1], *bounds.T)

    def _over(self, z: FloatArray, most: float) -> float:
        return max(float(self.peaks(z, self._coarse).max()) - most, 0.0)


class Peaks:
    """Largest singular value of ``S = 1 / (1 - K G)`` at the commands, over frequencies."""

    def __init__(self, problem: TuningProblem, count: int) -> None:
        self._problem, model = problem, problem.model
        poles = np.abs(np.linalg.eigvals(model.A))
        fastest = float(poles.max(initial=1.0))
        slowest = float(poles[poles > 1e-6 * fastest].min(initial=fastest))
        omega = np.geomspace(SLOWER * min(slowest, 1.0), FASTER * fastest, count)
        self._responses = Responses.of(model, omega)

    def logs(self, k: FloatArray, feedback: FloatArray) -> FloatArray:
        """Logarithms of the peaks, with the inner feedback (shape (m,)) of each command."""
        L = self._responses.returned(self._problem.K(k), feedback)
        if L.shape[-1] == 1:
            return -np.log(np.abs(L).ravel())
        # the largest singular value of an inverse
        return -np.log(np.linalg.svd(L, compute_uv=False)[:, -1])


class GustLoop:
    """The loop of a problem for stacked gains and inner feedback, and its errors in gusts."""

    def __init__(self, problem: TuningProblem) -> None:
        from scipy.linalg import block_diag

        self.model = problem.model
        p = len(self.model.errors)
        if problem.gusts is not None:
            a = np.asarray(problem.gusts)
            self._air = block_diag(*([[0.0, 1.0], [-w * w, -2.0 * w]] for w in a))
            # rows that give d, of variance one, and its rate from the states of the gusts
            self._gust = block_diag(*([[w**1.5, math.sqrt(3.0 * w)]] for w in a))
            self._white = np.kron(np.eye(p), [[0.0], [1.0]])
            self._rows = np.hstack([self.model.C, np.zeros((p, p)), -self._gust])

    def matrix(self, K: FloatArray, feedback: FloatArray) -> FloatArray:
        """A_K of stacked gains K, shape (m, 2 p), with the inner feedback of the first inputs."""
        return closed_loops(fed_by(self.model, feedback), K)

    def largest_error(self, K: FloatArray, feedback: FloatArray) -> float:
        """E_K of a stable loop to about 1e-4: the integral of its response to a step of d'."""
        n, _, p = self.model.shape
        rates, modes = np.linalg.eig(self.matrix(K, feedback))
        t = SPAN / -float(np.max(np.real(rates))) * np.linspace(0.0, 1.0, NODES) ** 2
        entry = np.eye(n + p)[:, :n][:, self.model.C.any(axis=0)]
        response = (modes[n:, :, None] * np.linalg.solve(modes, entry)).transpose(0, 2, 1)
        sizes = np.linalg.norm(np.real(response @ np.exp(np.outer(rates, t))), axis=1)
        return float(np.trapezoid(sizes, t).max())

    def errors(self, K: FloatArray, feedback: FloatArray) -> FloatArray:
        """Rms of each error in its gusts divided by the rms of their angle, shape (p,), if stable.

        Gusts across the flight turn the path at once, by their speed over the airspeed: ``e = C x -
        d`` with the Dryden spectrum of MIL-F-8785C, ``(1 + 3 (w/a)^2) / (1 + (w/a)^2)^2``, and a
        the airspeed over its scale. The filter ``(sqrt(3) s/a + 1) / (s/a + 1)^2`` makes d from
        white noise. The force that turns the path is measured, so that the inner feedback sees d':
        the sensitivity at the commands sets the errors.
        """
        (n, _, p), model = self.model.shape, self.model
        N, k = n + p, inner_feedback(model, feedback)[0]
        fed = model.B * k  # contribution of d' to x'
        whole = np.zeros((N + 2 * p, N + 2 * p))
        whole[:N, :N], whole[N:, N:] = self.matrix(K, feedback), self._air
        whole[:n, N:] = (
            -(model.B * (1.0 + k)) @ K[:, :p] @ self._gust - fed @ self._gust @ self._air
        )
        whole[n:N, N:] = -self._gust
        noise = np.vstack([-fed @ self._gust @ self._white, np.zeros((p, p)), self._white])
        try:
            covariance = solution_of_checked(whole.T, noise @ noise.T)
        except np.linalg.LinAlgError:  # a vanishing integral gain: a pole at zero, at rest
            slow = whole - AT_REST * np.eye(len(whole))
            covariance = solution_of_checked(slow.T, noise @ noise.T)
        return np.sqrt(np.einsum("pi,ij,pj->p", self._rows, covariance, self._rows))
