"""The sensitivity of a loop at its commands, over frequencies."""

import math

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import LinearModel, measured_rows
from flighttune.tuning.problem import SearchSpace

# Frequencies: so many, from a part of the slowest pole's to many times the fastest's. Between two
# of them a peak is higher by less than 1e-3, which the last step of a search takes off.
GRID, FINE, SLOWER, FASTER = 160, 4000, 0.02, 20.0


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
        x = np.linalg.solve(resolvent, np.broadcast_to(model.B, (count, n, self._m)))
        G, self._followed = -model.C @ x, measured_rows(model) @ x
        # A stacked gain (K_P, K_I) acts on G and on its integral.
        self._GI = np.concatenate([G, G / (1j * omega[:, None, None])], axis=1)
        self._space = space

    def largest(self, k: FloatArray, feedback: FloatArray) -> float:
        """Logarithm of the largest of all, with the inner feedback (shape (m,)) of each command."""
        L = (1.0 + feedback)[:, None] * (self._space.K(k) @ self._GI)
        L = np.eye(self._m) + L + feedback[:, None] * self._followed
        if self._m == 1:
            return -math.log(np.abs(L).min())
        # the largest singular value of an inverse
        return -math.log(np.linalg.svd(L, compute_uv=False)[:, -1].min())
