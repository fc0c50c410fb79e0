"""The exact ultimate radius of a disturbed loop, and the disturbance that takes it there.

An independent figure to hold the bounds of `flighttune.theory` against.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.optimize import minimize

STARTS = 12  # random directions, besides the axes
SLOPE = 1e-8
TAIL = 1e-9  # part of the integral behind the mesh
PHASE = 0.25  # width of a panel times the fastest eigenvalue


@dataclass(frozen=True)
class ReachableSet:
    """The impulse response ``exp(At) E`` of a loop at Gauss nodes, ready to be integrated."""

    A: np.ndarray
    E: np.ndarray
    L_d: float
    weights: np.ndarray
    response: np.ndarray  # (N, n, m)
    tail: float

    @classmethod
    def of(cls, A, E, *, L_d):
        A, E = np.asarray(A), np.asarray(E)
        nodes, node_weights = np.polynomial.legendre.leggauss(6)
        width = PHASE / np.abs(np.linalg.eigvals(A)).max()
        inside = np.array([expm(A * width * (node + 1.0) / 2.0) for node in nodes])
        across, X, responses, total = expm(A * width), E, [], 0.0
        spectrum = np.linalg.eigvalsh(solve_continuous_lyapunov(A.T, -np.eye(len(A))))
        per_norm = 2.0 * spectrum[-1] * math.sqrt(spectrum[-1] / spectrum[0])
        while (tail := per_norm * np.linalg.norm(X, 2)) > TAIL * total:
            responses.append(inside @ X)
            total += width * np.linalg.norm(X, 2)
            X = across @ X
        weights = np.tile(width * node_weights / 2.0, len(responses))
        return cls(A, E, L_d, weights, np.concatenate(responses), tail)

    def reach(self, direction):
        """Largest ``direction @ s`` that is reached from s = 0."""
        norms = np.linalg.norm(np.asarray(direction) @ self.response, axis=-1)
        return self.L_d * float(self.weights @ norms)


@dataclass(frozen=True)
class LargestReach:
    radius: float  # reached, in `direction`
    upper: float  # no direction reaches farther
    direction: np.ndarray


def largest_reach(reachable):
    """By ascent from many directions, with a bound from above.

    The reach h of direction c is convex and homogeneous. By Cauchy and Schwarz, for any weight
    w > 0 of integral one, ``h(c)^2 <= c' M c`` with M the integral of
    ``L_d^2 exp(At) E E' exp(A't) / w``, so that h^2 is at most lambda_max(M). With w proportional
    to the integrand at the best c, M has that c as an eigenvector, with eigenvalue h(c)^2. Mixed
    with the weight of the invariant ellipsoid the bound stays finite where the integrand vanishes.
    """
    best = max((ascend(reachable, c) for c in starts(reachable)), key=reachable.reach)
    return LargestReach(reachable.reach(best), upper_bound(reachable, best), best)


def starts(reachable):
    n = len(reachable.A)
    random = np.random.default_rng(0).normal(size=(STARTS, n))
    energy = np.einsum("t,tij,tkj->ik", reachable.weights, reachable.response, reachable.response)
    directions = np.vstack([np.eye(n), np.linalg.eigh(energy)[1].T, random])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def ascend(reachable, c):
    """Quasi-Newton on ``-log(h(c)/|c|)``: the direction of the gradient alone is slow where two
    directions reach about as far.
    """

    def descent(c):
        pull = c @ reachable.response
        norms = np.maximum(np.linalg.norm(pull, axis=-1), 1e-300)
        value, length = float(reachable.weights @ norms), float(np.linalg.norm(c))
        gradient = np.einsum("t,tij,tj->i", reachable.weights / norms, reachable.response, pull)
        return math.log(length / value), c / length**2 - gradient / value

    found = minimize(descent, c, jac=True, method="BFGS", options={"gtol": SLOPE})
    return found.x / np.linalg.norm(found.x)


def upper_bound(reachable, c):
    """The smallest bound over mixtures of the two weights."""
    response, weights = reachable.response, reachable.weights
    along = np.linalg.norm(c @ response, axis=-1)
    overall = np.linalg.norm(response, ord=2, axis=(1, 2))
    along, overall = along / (weights @ along), overall / (weights @ overall)
    bounds = []
    for share in (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0):
        weight = (1.0 - share) * along + share * overall
        M = np.einsum("t,tij,tkj->ik", weights / weight, response, response)
        bounds.append(math.sqrt(float(np.linalg.eigvalsh(M)[-1])))
    return reachable.L_d * (min(bounds) + reachable.tail)


def worst_disturbance(reachable, direction, duration):
    """The v(t) on [0, duration] that takes ``direction @ s`` farthest at the end."""
    c = np.asarray(direction, dtype=float)

    def v(t):
        pull = c @ expm(reachable.A * (duration - t)) @ reachable.E
        norm = float(np.linalg.norm(pull))
        return reachable.L_d * pull / norm if norm > 0.0 else np.zeros(reachable.E.shape[1])

    return v
