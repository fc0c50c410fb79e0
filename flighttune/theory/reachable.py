"""The reachable set of ``s' = A s + E v``, ``||v|| <= L_d``: exact figures and the worst case.

Its support function in direction c is L_d times the integral over all time of ``||E' exp(A't) c||``
(the best that v can do at every instant is to point along the integrand). Everything here is a sum
over one mesh of the impulse response; what is cut off behind its end is bounded and added.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm
from scipy.optimize import minimize

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.theory.attractor import stable_system
from flighttune.theory.lyapunov import lyapunov_solution

TAIL = 1e-9
"""The mesh ends where what is left adds less than this fraction."""

PHASE = 0.25
"""Width of a panel of the mesh times the fastest eigenvalue still alive in it."""

MAX_PANELS = 50_000
"""A loop that needs more is too lightly damped for its speed."""

STARTS = 12
"""Random directions from which the largest reach is climbed to, besides the axes."""

CLIMBED = 1e-8
"""A climb ends where the relative slope is below this."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeakGain:
    """Bounds on the ultimate size of s and of its parts, for ``||v|| <= L_d``.

    Attributes
    ----------
    s : float
        L_d times the integral of ``||exp(At) E||``.
    channels : ndarray, shape (n,)
        The same for each row of ``exp(At) E``: bounds on each ``|s_i|``, and exact.
    """

    s: float
    channels: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LargestReach:
    """The exact ultimate radius: the reachable set's largest extent over all directions.

    Attributes
    ----------
    radius : float
        Reached, in `direction`.
    upper : float
        No direction reaches farther; the search is proven complete where it meets `radius`.
    direction : ndarray, shape (n,)
        Unit vector.
    """

    radius: float
    upper: float
    direction: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReachableSet:
    """The impulse response of a disturbed loop, ready to be integrated.

    Attributes
    ----------
    A : ndarray, shape (n, n), 1/s
    E : ndarray, shape (n, m)
    L_d : float
    t, weights : ndarray, shape (N,), s
        Nodes and weights of the integral over time.
    response : ndarray, shape (N, n, m)
        ``exp(A t) E``.
    tail : float, s
        Bound on the integral of ``||exp(A t) E||`` behind the mesh.
    """

    A: FloatArray
    E: FloatArray
    L_d: float
    t: FloatArray
    weights: FloatArray
    response: FloatArray
    tail: float

    @classmethod
    def of(cls, A: npt.ArrayLike, E: npt.ArrayLike, *, L_d: float) -> "ReachableSet":
        """The reachable set of a stable loop.

        Parameters
        ----------
        A : array_like, shape (n, n), 1/s
        E : array_like, shape (n, m)
        L_d : float
            Bound on the norm of the disturbance, positive.

        Raises
        ------
        ShapeError, InputError
            If the matrices do not fit, `A` is not stable or so lightly damped that its response
            cannot be tabulated, or `L_d` is not positive.
        """
        A, E = stable_system(A, E)
        if not (math.isfinite(L_d) and L_d > 0.0):
            raise InputError(f"`L_d` must be positive, got {L_d}.")
        t, weights, response, tail = _mesh(A, E)
        return cls(A=A, E=E, L_d=L_d, t=t, weights=weights, response=response, tail=tail)

    def reach(self, direction: npt.ArrayLike) -> float:
        """Largest value ``direction @ s`` can reach from s = 0, in unit of s."""
        c = np.asarray(direction, dtype=float)
        norms = np.linalg.norm(c @ self.response, axis=-1)
        return self.L_d * float(self.weights @ norms)

    def peak_gain(self, rows: slice = slice(None)) -> PeakGain:
        """The peak-gain bound for s, or for the part of it that `rows` selects.

        Notes
        -----
        S. Boyd and C. Barratt, *Linear Controller Design*, section 5.2.4: the gain from peak to
        peak is the integral of the norm of the impulse response.
        """
        part = self.response[:, rows]
        largest = np.linalg.norm(part, ord=2, axis=(1, 2))
        channels = np.linalg.norm(part, axis=2)
        return PeakGain(
            s=self.L_d * (float(self.weights @ largest) + self.tail),
            channels=self.L_d * (self.weights @ channels + self.tail),
        )

    def largest_reach(self) -> LargestReach:
        """The exact ultimate radius, by ascent from many directions, with a bound from above.

        Notes
        -----
        The reach h of direction c is convex and homogeneous. By Cauchy and Schwarz, for any weight
        w > 0 of integral one,
        ``h(c)^2 <= c' M c`` with M the integral of ``L_d^2 exp(At) E E' exp(A't) / w``, so that
        h^2 is at most lambda_max(M); with w proportional to the integrand at the best c, M has
        that c as an eigenvector, with eigenvalue h(c)^2. Mixed with the weight of the invariant
        ellipsoid the bound stays finite where the integrand vanishes.
        """
        best = max((self._climb(c) for c in self._starts()), key=self.reach)
        radius = self.reach(best)
        return LargestReach(radius=radius, upper=self._upper(best), direction=best)

    def worst_disturbance(
        self, direction: npt.ArrayLike, *, duration: float
    ) -> Callable[[float], FloatArray]:
        """The v(t) on [0, duration] that takes ``direction @ s`` farthest at the end.

        Parameters
        ----------
        direction : array_like, shape (n,)
        duration : float, s
            Positive.

        Returns
        -------
        callable
            v of t, shape (m,): norm L_d, along ``E' exp(A' (duration - t)) direction``.

        Raises
        ------
        InputError
            If `duration` is not positive.
        """
        if not duration > 0.0:
            raise InputError(f"`duration` must be positive, got {duration} s.")
        c = np.asarray(direction, dtype=float)

        def v(t: float) -> FloatArray:
            pull = c @ expm(self.A * (duration - t)) @ self.E
            norm = float(np.linalg.norm(pull))
            return self.L_d * pull / norm if norm > 0.0 else np.zeros(self.E.shape[1])

        return v

    def _starts(self) -> FloatArray:
        n = len(self.A)
        random = np.random.default_rng(0).normal(size=(STARTS, n))
        energy = np.einsum("t,tij,tkj->ik", self.weights, self.response, self.response)
        starts = np.vstack([np.eye(n), np.linalg.eigh(energy)[1].T, random])
        return starts / np.linalg.norm(starts, axis=1, keepdims=True)

    def _climb(self, c: FloatArray) -> FloatArray:
        """A unit direction of locally largest reach, from c.

        Quasi-Newton on ``-log(h(c)/|c|)``: stepping to the direction of the gradient alone is slow
        where two directions reach about as far.
        """

        def descent(c: FloatArray) -> tuple[float, FloatArray]:
            pull = c @ self.response
            norms = np.maximum(np.linalg.norm(pull, axis=-1), 1e-300)
            value, length = float(self.weights @ norms), float(np.linalg.norm(c))
            gradient = np.einsum("t,tij,tj->i", self.weights / norms, self.response, pull)
            return math.log(length / value), c / length**2 - gradient / value

        found = minimize(descent, c, jac=True, method="BFGS", options={"gtol": CLIMBED})
        return found.x / np.linalg.norm(found.x)

    def _upper(self, c: FloatArray) -> float:
        """The least bound over mixtures of the two weights."""
        along = np.linalg.norm(c @ self.response, axis=-1)
        overall = np.linalg.norm(self.response, ord=2, axis=(1, 2))
        along, overall = along / (self.weights @ along), overall / (self.weights @ overall)
        bounds = []
        for share in (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0):
            weight = (1.0 - share) * along + share * overall
            M = np.einsum("t,tij,tkj->ik", self.weights / weight, self.response, self.response)
            bounds.append(math.sqrt(float(np.linalg.eigvalsh(M)[-1])))
        return self.L_d * (min(bounds) + self.tail)


def _mesh(A: FloatArray, E: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Gauss nodes, weights and responses in panels as wide as the modes still alive allow."""
    nodes, node_weights = np.polynomial.legendre.leggauss(6)
    nodes, node_weights = (nodes + 1.0) / 2.0, node_weights / 2.0
    eigenvalues = np.linalg.eigvals(A)
    spectrum = np.linalg.eigvalsh(lyapunov_solution(A))
    if not spectrum[0] > 0.0:
        raise InputError("`A` must be stable by more than rounding.")
    per_norm = 2.0 * float(spectrum[-1]) * math.sqrt(float(spectrum[-1] / spectrum[0]))
    propagators: dict[float, tuple[FloatArray, FloatArray]] = {}
    t, weights, responses = [], [], []
    start, X, total = 0.0, E, 0.0
    while (tail := per_norm * float(np.linalg.norm(X, 2))) > TAIL * total:
        if len(t) == MAX_PANELS:
            raise InputError(
                f"`A` must be damped well enough to be tabulated, got {eigenvalues.tolist()} 1/s."
            )
        alive = np.abs(eigenvalues[eigenvalues.real * start > math.log(1e-14)])
        width = 2.0 ** math.floor(math.log2(PHASE / float(alive.max())))
        if width not in propagators:
            inside, across = expm(A * width * nodes[:, None, None]), expm(A * width)
            propagators[width] = np.asarray(inside, dtype=float), np.asarray(across, dtype=float)
        inside, across = propagators[width]
        t.append(start + width * nodes)
        weights.append(width * node_weights)
        responses.append(inside @ X)
        total += float(weights[-1] @ np.linalg.norm(responses[-1], ord=2, axis=(1, 2)))
        start, X = start + width, across @ X
    return np.concatenate(t), np.concatenate(weights), np.concatenate(responses), tail
