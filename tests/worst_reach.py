"""The exact ultimate radius of a disturbed loop, and the disturbance that takes it there.

An independent figure to hold the bounds of `flighttune.control.theory` against.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.optimize import minimize

STARTS = 12  # random directions, besides the axes
SLOPE = 1e-8
TAIL = 1e-12  # part of the integral in the last panel of the mesh
PHASE = 0.25  # width of a panel times the fastest eigenvalue


@dataclass(frozen=True)
class ReachableSet:
    """The impulse response ``exp(At) E`` of a loop at Gauss nodes, ready to be integrated."""

    A: np.ndarray
    E: np.ndarray
    L_d: float
    weights: np.ndarray
    response: np.ndarray  # (N, n, m)

    @classmethod
    def of(cls, A, E, *, L_d):
        A, E = np.asarray(A), np.asarray(E)
        nodes, node_weights = np.polynomial.legendre.leggauss(6)
        width = PHASE / np.abs(np.linalg.eigvals(A)).max()
        inside = np.array([expm(A * width * (node + 1.0) / 2.0) for node in nodes])
        across, X, responses, total = expm(A * width), E, [], 0.0
        while np.linalg.norm(X, 2) * width > TAIL * total:
            responses.append(inside @ X)
            total += width * np.linalg.norm(X, 2)
            X = across @ X
        weights = np.tile(width * node_weights / 2.0, len(responses))
        return cls(A, E, L_d, weights, np.concatenate(responses))

    def reach(self, direction):
        """Largest ``direction @ s`` that is reached from s = 0."""
        norms = np.linalg.norm(np.asarray(direction) @ self.response, axis=-1)
        return self.L_d * float(self.weights @ norms)


def largest_reach(reachable):
    """The largest distance from s = 0 that is reached, and its direction, by ascent from many.

    The reach h of a direction c is convex and homogeneous.
    """
    best = max((ascend(reachable, c) for c in starts(reachable)), key=reachable.reach)
    return reachable.reach(best), best


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


def worst_disturbance(reachable, direction, duration):
    """The v(t) on [0, duration] that takes ``direction @ s`` farthest at the end."""
    c = np.asarray(direction, dtype=float)

    def v(t):
        pull = c @ expm(reachable.A * (duration - t)) @ reachable.E
        norm = float(np.linalg.norm(pull))
        return reachable.L_d * pull / norm if norm > 0.0 else np.zeros(reachable.E.shape[1])

    return v
