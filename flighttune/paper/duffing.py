"""The Duffing oscillator of the paper, Theorem 1 on it, and the experiments of figure 3.

``x1' = x2, x2' = -delta x2 - alpha x1 - beta x1^3 + d`` with ``|d| <= L_d``. P solves the Lyapunov
equation ``J(0)' P + P J(0) + I = 0``, so that epsilon at the origin is one.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import pandas as pd

from flighttune.arrays import FloatArray, check_not_negative, check_positive
from flighttune.paper import parameters as printed
from flighttune.theory.lyapunov import lyapunov_solution

# Intervals in which the disturbance is constant.
INTERVALS = round(printed.DURATION / printed.DUFFING_HOLD)

# Steps of integration in each interval of the disturbance.
STEPS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Duffing:
    """A Duffing oscillator with a stable origin."""

    # 1/s^2, 1/s^2 per square of x1, 1/s: linear and cubic stiffness (beta not negative) and
    # damping; alpha and delta positive
    alpha: float
    beta: float
    delta: float

    def __post_init__(self) -> None:
        check_positive(alpha=self.alpha, delta=self.delta)
        check_not_negative(beta=self.beta)

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
    """Result of Theorem 1 with the Jacobian taken over a strip ``|x1| <= c``."""

    rate: float  # 1/s: ``R(f) = epsilon / lambda_max(P)``; the norm of f decays at half of it
    # ``I(f) = 2 L_d L_f lambda_max(P)^2 / (epsilon lambda_min(P))``: ultimate bound on |f|
    radius: float
    # s: extreme eigenvalues of P
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
    """Theorem 1 for disturbances up to `L_d` in the strip ``|x1| <= half_width``.

    A strip of no width is the paper's choice, the Jacobian at the origin, and says nothing about
    any other point. Where the condition does not hold in the strip, the rate is 0 and the radius
    inf.
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
    """States over time under disturbances d, shape (k, runs), held for `hold` seconds each.

    Every path starts at `x_0`. The result, shape (k * `STEPS` + 1, runs, 2), stands at equal steps
    of ``hold / STEPS``, by the classical Runge-Kutta rule.
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DuffingCase:
    """One oscillator under the noise of all runs."""

    model: Duffing
    theorem: Bound  # Theorem 1 with the Jacobian at the origin, as the paper takes it
    t: FloatArray  # (k,), s
    x: FloatArray  # (k, runs, 2)
    norm_f: FloatArray  # (k, runs): |f(x)| over time

    @property
    def bound_over_time(self) -> FloatArray:
        """Upper bound of Theorem 1 on |f| over time, shape (k,)."""
        f_0 = self.model.rates(self.x[0, 0])
        return self.theorem.norm_over_time(self.t, float(f_0 @ self.model.P @ f_0))

    @property
    def farthest(self) -> float:
        """Largest |x1| of any run."""
        return float(np.max(np.abs(self.x[..., 0])))


def simulated(model: Duffing, d: FloatArray) -> DuffingCase:
    """The oscillator under disturbances `d`, shape (intervals, runs), from the assumed start."""
    x = paths(model, printed.DUFFING_X_0, d, hold=printed.DUFFING_HOLD)
    t = np.linspace(0.0, len(d) * printed.DUFFING_HOLD, len(x))
    return DuffingCase(
        model=model,
        theorem=bound(model, printed.DUFFING_L_D),
        t=t,
        x=x,
        norm_f=np.linalg.norm(model.rates(x), axis=-1),
    )


def along_the_motion(model: Duffing) -> FloatArray:
    """The disturbance that always pushes the way the mass moves, shape (intervals, 1)."""
    L_d, d = printed.DUFFING_L_D, np.empty((INTERVALS, 1))
    x = np.array(printed.DUFFING_X_0)
    for k in range(INTERVALS):
        d[k] = L_d if x[1] > 0.0 else -L_d
        x = paths(model, x, d[k : k + 1], hold=printed.DUFFING_HOLD)[-1, 0]
    return d


class DuffingCases:
    """Figure 3, computed when asked for."""

    @cached_property
    def noise(self) -> FloatArray:
        """Disturbance of all runs, shape (intervals, runs)."""
        L_d = printed.DUFFING_L_D
        generator = np.random.default_rng(np.random.SeedSequence(printed.DUFFING_SEED))
        return generator.uniform(-L_d, L_d, size=(INTERVALS, printed.DUFFING_RUNS))

    @cached_property
    def model(self) -> Duffing:
        """The oscillator of figure 3 (a)."""
        return Duffing(**printed.DUFFING_A)

    @cached_property
    def noisy(self) -> DuffingCase:
        """Figure 3 (a) under the assumed noise."""
        return simulated(self.model, self.noise)

    @cached_property
    def hard(self) -> dict[str, DuffingCase]:
        """Figure 3 (a) under the hard end of what the bound allows, by name."""
        return {
            "constant L_d": simulated(self.model, np.full((INTERVALS, 1), printed.DUFFING_L_D)),
            "along the motion": simulated(self.model, along_the_motion(self.model)),
        }

    @cached_property
    def undisturbed(self) -> DuffingCase:
        """Figure 3 (a) without disturbance."""
        return simulated(self.model, np.zeros((INTERVALS, 1)))

    @cached_property
    def family(self) -> dict[float, DuffingCase]:
        """Figure 3 (b) to (d): the oscillators of the assumed set, by alpha."""
        delta = printed.DUFFING_A["delta"]
        return {
            alpha: simulated(Duffing(alpha=alpha, beta=alpha / 2.0, delta=delta), self.noise)
            for alpha in printed.DUFFING_ALPHAS
        }

    @cached_property
    def table(self) -> pd.DataFrame:
        """R(f), I(f), mean and standard deviation of |f| over time and runs; index alpha."""
        return pd.DataFrame.from_dict(
            {
                alpha: {
                    "beta": case.model.beta,
                    "delta": case.model.delta,
                    "R_f": case.theorem.rate,
                    "I_f": case.theorem.radius,
                    "mean": float(np.mean(case.norm_f)),
                    "std": float(np.mean(np.std(case.norm_f, axis=0))),
                    "region": case.model.region,
                }
                for alpha, case in self.family.items()
            },
            orient="index",
        ).rename_axis("alpha")

    @cached_property
    def slowest_decay(self) -> float:
        """Smallest rate at which |f| really decays over R(f), on a grid of alpha and delta."""
        ratios = []
        for alpha in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0):
            for delta in (0.2, 0.5, 1.0, 1.5, 3.0):
                model = Duffing(alpha=alpha, beta=0.0, delta=delta)
                abscissa = float(np.linalg.eigvals(model.jacobian(np.zeros(2))).real.max())
                ratios.append(-abscissa / bound(model, 1.0).rate)
        return min(ratios)
