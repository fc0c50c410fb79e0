"""The reachable set of ``s' = A s + E v``, ``||v|| <= L_d``: how far it reaches, exactly.

Its support function in direction c is L_d times the integral over all time of ``||E' exp(A't) c||``
(the best that v can do at every instant is to point along the integrand). Everything here is a sum
over one mesh of the impulse response; what is cut off behind its end is bounded and added.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.theory.attractor import stable_system
from flighttune.theory.lyapunov import lyapunov_solution

# The mesh ends where what is left adds less than this fraction.
TAIL = 1e-9

# Width of a panel of the mesh times the fastest eigenvalue still alive in it.
PHASE = 0.25

# A loop that needs more is too lightly damped for its speed.
MAX_PANELS = 50_000


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


def _mesh(A: FloatArray, E: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Gauss nodes, weights and responses in panels as wide as the modes still alive allow."""
    from scipy.linalg import expm

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
            inside = expm(A * width * nodes[:, None, None])
            propagators[width] = inside, expm(A * width)
        inside, across = propagators[width]
        t.append(start + width * nodes)
        weights.append(width * node_weights)
        responses.append(inside @ X)
        total += float(weights[-1] @ np.linalg.norm(responses[-1], ord=2, axis=(1, 2)))
        start, X = start + width, across @ X
    return np.concatenate(t), np.concatenate(weights), np.concatenate(responses), tail
