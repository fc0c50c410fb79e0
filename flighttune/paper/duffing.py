"""The Duffing oscillator of the paper, and Theorem 1 checked on it.

``x1' = x2, x2' = -delta x2 - alpha x1 - beta x1^3 + d`` with ``|d| <= L_d``. P solves the Lyapunov
equation ``J(0)' P + P J(0) + I = 0``, so that epsilon at the origin is one.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.theory.lyapunov import lyapunov_solution


@dataclass(frozen=True, slots=True, kw_only=True)
class Duffing:
    """A Duffing oscillator with a stable origin.

    Attributes
    ----------
    alpha, beta, delta : float, 1/s^2, 1/s^2 per square of x1, 1/s
        Linear and cubic stiffness (beta not negative) and damping; alpha and delta positive.
    """

    alpha: float
    beta: float
    delta: float

    def __post_init__(self) -> None:
        for name in ("alpha", "delta"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"`{name}` must be positive, got {value}.")
        if not (math.isfinite(self.beta) and self.beta >= 0.0):
            raise InputError(f"`beta` must not be negative, got {self.beta}.")

    def rates(self, x: FloatArray) -> FloatArray:
        """f(x): the undisturbed rates, shape (..., 2) to (..., 2)."""
        x1, x2 = x[..., 0], x[..., 1]
        return np.stack([x2, -self.delta * x2 - self.alpha * x1 - self.beta * x1**3], axis=-1)

    def jacobian(self, x: npt.ArrayLike) -> FloatArray:
        """df/dx at states x, shape (..., 2) to (..., 2, 2)."""
        x1 = np.asarray(x, dtype=float)[..., 0]
        J = np.zeros((*x1.shape, 2, 2))
        J[..., 0, 1] = 1.0
        J[..., 1, 0] = -self.alpha - 3.0 * self.beta * x1**2
        J[..., 1, 1] = -self.delta
        return J

    @property
    def P(self) -> FloatArray:
        """Solution of the Lyapunov equation at the origin, shape (2, 2), s."""
        return lyapunov_solution(self.jacobian(np.zeros(2)))

    def margin(self, x1: npt.ArrayLike) -> FloatArray:
        """epsilon(x): smallest eigenvalue of ``-(J' P + P J)``, shape (...) to (...).

        The condition of Theorem 1 holds at x where it is positive; it does not depend on x2.
        """
        x1 = np.asarray(x1, dtype=float)
        J = self.jacobian(np.stack([x1, np.zeros_like(x1)], axis=-1))
        return np.asarray(np.linalg.eigvalsh(-(J.mT @ self.P + self.P @ J))[..., 0], dtype=float)

    @property
    def region(self) -> float:
        """Half-width of the strip ``|x1| < c`` in which the condition of Theorem 1 holds for P.

        Notes
        -----
        With ``a = 3 beta x1^2`` the matrix is ``-I - a (e1 (P e2)' + (P e2) e1')``. It is negative
        as long as ``1 + 2 a p - a^2 q^2 > 0`` for ``P e2 = (p, q)``.
        """
        p, q = self.P[:, 1]
        a = (p + math.hypot(p, q)) / q**2
        return math.sqrt(a / (3.0 * self.beta)) if self.beta else math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Bound:
    """What Theorem 1 says with the Jacobian taken over a strip ``|x1| <= c``.

    Attributes
    ----------
    rate : float, 1/s
        ``R(f) = epsilon / lambda_max(P)``; the norm of f decays at half of it.
    radius : float
        ``I(f) = 2 L_d L_f lambda_max(P)^2 / (epsilon lambda_min(P))``: ultimate bound on |f|.
    P_max, P_min : float, s
        Extreme eigenvalues of P.
    """

    rate: float
    radius: float
    P_max: float
    P_min: float

    def norm_over_time(self, t: FloatArray, V_0: float) -> FloatArray:
        """Upper bound on |f| over time from ``V_0 = f' P f`` at the start (Lemma 5).

        ``sqrt(V) <= b + (sqrt(V_0) - b) exp(-rate t / 2)`` with b the ultimate value.
        """
        ultimate = self.radius * math.sqrt(self.P_min)
        decaying = (math.sqrt(V_0) - ultimate) * np.exp(-0.5 * self.rate * t)
        return (ultimate + decaying) / math.sqrt(self.P_min)


def bound(model: Duffing, L_d: float, *, half_width: float = 0.0) -> Bound:
    """Theorem 1 for disturbances up to `L_d`.

    Parameters
    ----------
    model : Duffing
    L_d : float
        Largest magnitude of the disturbance.
    half_width : float
        c of the strip ``|x1| <= c`` in which it is to hold. Zero is the paper's choice, the
        Jacobian at the origin, and says nothing about any other point.

    Returns
    -------
    Bound
        With rate 0 and radius inf where the condition does not hold in the strip.
    """
    edges = np.array([0.0, half_width])
    epsilon = float(np.min(model.margin(edges)))
    J = model.jacobian(np.stack([edges, np.zeros(2)], axis=-1))
    L_f = float(np.max(np.linalg.norm(J, 2, axis=(-2, -1))))
    P_min, P_max = np.linalg.eigvalsh(model.P).tolist()
    if epsilon <= 0.0:
        return Bound(rate=0.0, radius=math.inf, P_max=P_max, P_min=P_min)
    radius = 2.0 * L_d * L_f * P_max**2 / (epsilon * P_min)
    return Bound(rate=epsilon / P_max, radius=radius, P_max=P_max, P_min=P_min)


def paths(model: Duffing, x_0: npt.ArrayLike, d: npt.ArrayLike, *, hold: float) -> FloatArray:
    """States over time under disturbances that are held for `hold` seconds at a time.

    Parameters
    ----------
    model : Duffing
    x_0 : array_like, shape (2,)
        Start of every path.
    d : array_like, shape (k, runs)
        Disturbance of each run in each interval.
    hold : float, s

    Returns
    -------
    ndarray, shape (k * `STEPS` + 1, runs, 2)
        At equal steps of ``hold / STEPS``, by the classical Runge-Kutta rule.
    """
    d = np.asarray(d, dtype=float)
    x = np.broadcast_to(np.asarray(x_0, dtype=float), (d.shape[1], 2)).copy()
    states = np.empty((len(d) * STEPS + 1, *x.shape))
    states[0] = x
    step = hold / STEPS
    for k, now in enumerate(d):
        push = np.stack([np.zeros_like(now), now], axis=-1)
        for i in range(STEPS):
            k1 = model.rates(x) + push
            k2 = model.rates(x + 0.5 * step * k1) + push
            k3 = model.rates(x + 0.5 * step * k2) + push
            k4 = model.rates(x + step * k3) + push
            x = x + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
            states[k * STEPS + i + 1] = x
    return states


STEPS = 10
"""Steps of integration in each interval of the disturbance."""
