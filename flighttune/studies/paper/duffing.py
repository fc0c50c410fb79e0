"""The Duffing oscillator of the paper, Theorem 1 on it, and the experiments of figure 1.

``x1' = x2, x2' = -delta x2 - alpha x1 - beta x1^3 + d`` with ``|d| <= L_d``. P solves the Lyapunov
equation ``J(0)' P + P J(0) + I = 0``, so that epsilon at the origin is one.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt
import pandas as pd

from flighttune.base.arrays import FloatArray
from flighttune.control.theory.lyapunov import lyapunov_solution
from flighttune.studies.paper import parameters as printed

# Number of intervals with a constant disturbance.
INTERVALS = round(printed.DURATION / printed.DUFFING_HOLD)

# Integration steps in each interval of the disturbance.
STEPS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Duffing:
    """A Duffing oscillator with a stable origin."""

    # 1/s^2, 1/s^2 per square of x1, 1/s: linear and cubic stiffness (beta not negative) and
    # damping; alpha and delta positive
    alpha: float
    beta: float
    delta: float

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
        """epsilon(x): smallest eigenvalue of ``-(J' P + P J)``, positive if Theorem 1 holds."""
        x1 = np.asarray(x1, dtype=float)
        J = self.jacobian(np.stack([x1, np.zeros_like(x1)], axis=-1))
        return np.asarray(np.linalg.eigvalsh(-(J.mT @ self.P + self.P @ J))[..., 0], dtype=float)

    @property
    def region(self) -> float:
        """Half-width of the strip ``|x1| < c`` that satisfies the condition of Theorem 1 for P."""
        # With ``a = 3 beta x1^2`` the matrix is ``-I - a (e1 (P e2)' + (P e2) e1')``. It is
        # negative as long as ``1 + 2 a p - a^2 q^2 > 0`` for ``P e2 = (p, q)``.
        p, q = self.P[:, 1]
        a = (p + math.hypot(p, q)) / q**2
        return math.sqrt(a / (3.0 * self.beta)) if self.beta else math.inf

    def smoothness(self, radius: float) -> float:
        """beta_f for ``|x| <= radius``: ``|J(x) - J(y)| = 3 beta |x1^2 - y1^2|``."""
        return 6.0 * self.beta * radius

    @property
    def smooth_region(self) -> float:
        """Largest r with ``r <= epsilon / (2 beta_f |P|)``, beta_f for the disc of radius r."""
        # This is Lemma 3 weighted with P: the condition of Theorem 1 holds in this disc.
        return math.sqrt(1.0 / (2.0 * self.smoothness(1.0) * float(np.linalg.norm(self.P, 2))))

    def bound(self, L_d: float, *, half_width: float = 0.0) -> tuple[float, float]:
        """Rate (1/s) and ultimate bound on |f| of Theorem 1 for disturbances up to `L_d`.

        The Jacobian is taken over the strip ``|x1| <= half_width``. Zero width is the paper's
        choice, the Jacobian at the origin, which does not cover any other point. If the condition
        fails in the strip, the rate is 0 and the bound inf.
        """
        edges = np.array([0.0, half_width])
        epsilon = float(np.min(self.margin(edges)))
        if epsilon <= 0.0:
            return 0.0, math.inf
        J = self.jacobian(np.stack([edges, np.zeros(2)], axis=-1))
        L_f = float(np.max(np.linalg.norm(J, 2, axis=(-2, -1))))
        P_min, P_max = np.linalg.eigvalsh(self.P).tolist()
        # ``R(f) = epsilon / lambda_max(P)``, at half of which the norm of f decays, and
        # ``I(f) = 2 L_d L_f lambda_max(P)^2 / (epsilon lambda_min(P))``.
        return epsilon / P_max, 2.0 * L_d * L_f * P_max**2 / (epsilon * P_min)


def paths(model: Duffing, x_0: npt.ArrayLike, d: npt.ArrayLike, *, hold: float) -> FloatArray:
    """States (k `STEPS` + 1, runs, 2) under disturbances (k, runs), each held for `hold` (s)."""
    d = np.asarray(d, dtype=float)
    x = np.broadcast_to(np.asarray(x_0, dtype=float), (d.shape[1], 2)).copy()
    states = np.empty((len(d) * STEPS + 1, *x.shape))
    states[0] = x
    # Every path starts at `x_0`, with equal steps of the classical Runge-Kutta method.
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


@dataclass(frozen=True, eq=False)
class DuffingCase:
    """One oscillator under disturbances of several runs, from the assumed start."""

    model: Duffing
    d: FloatArray  # (intervals, runs)

    @cached_property
    def x(self) -> FloatArray:
        """States over time, shape (k, runs, 2)."""
        return paths(self.model, printed.DUFFING_X_0, self.d, hold=printed.DUFFING_HOLD)

    @cached_property
    def t(self) -> FloatArray:
        """Time, shape (k,), s."""
        return np.linspace(0.0, len(self.d) * printed.DUFFING_HOLD, len(self.x))

    @cached_property
    def norm_f(self) -> FloatArray:
        """|f(x)| over time, shape (k, runs)."""
        return np.linalg.norm(self.model.rates(self.x), axis=-1)

    @cached_property
    def theorem(self) -> tuple[float, float]:
        """Rate and bound of Theorem 1 with the Jacobian at the origin, as in the paper."""
        return self.model.bound(printed.DUFFING_L_D)

    @property
    def bound_over_time(self) -> FloatArray:
        """Upper bound of Theorem 1 on |f| over time (Lemma 5), shape (k,)."""
        f_0, (rate, radius) = self.model.rates(self.x[0, 0]), self.theorem
        least = math.sqrt(np.linalg.eigvalsh(self.model.P)[0])
        start = math.sqrt(float(f_0 @ self.model.P @ f_0)) / least
        # With ``V = f' P f``: ``sqrt(V) <= b + (sqrt(V_0) - b) exp(-rate t / 2)``, with b its
        # limit.
        return radius + (start - radius) * np.exp(-0.5 * rate * self.t)

    @property
    def farthest(self) -> float:
        """Largest |x1| of any run."""
        return float(np.max(np.abs(self.x[..., 0])))


def along_the_motion(model: Duffing) -> FloatArray:
    """The disturbance that always acts in the direction of motion, shape (intervals, 1)."""
    L_d, d = printed.DUFFING_L_D, np.empty((INTERVALS, 1))
    x = np.array(printed.DUFFING_X_0)
    for k in range(INTERVALS):
        d[k] = L_d if x[1] > 0.0 else -L_d
        x = paths(model, x, d[k : k + 1], hold=printed.DUFFING_HOLD)[-1, 0]
    return d


class DuffingCases:
    """Figure 1, computed on demand."""

    model = Duffing(**printed.DUFFING_A)  # the oscillator of (a)

    @cached_property
    def noise(self) -> FloatArray:
        """Disturbance of all runs, shape (intervals, runs)."""
        L_d = printed.DUFFING_L_D
        generator = np.random.default_rng(np.random.SeedSequence(printed.DUFFING_SEED))
        return generator.uniform(-L_d, L_d, size=(INTERVALS, printed.DUFFING_RUNS))

    @cached_property
    def disturbed(self) -> dict[str, DuffingCase]:
        """Figure 1 (a) under the assumed noise, and under the hardest allowed disturbances."""
        disturbances = {
            "noise": self.noise,
            "constant L_d": np.full((INTERVALS, 1), printed.DUFFING_L_D),
            "along the motion": along_the_motion(self.model),
        }
        return {name: DuffingCase(self.model, d) for name, d in disturbances.items()}

    @cached_property
    def undisturbed(self) -> DuffingCase:
        """Figure 1 (a) without disturbance."""
        return DuffingCase(self.model, np.zeros((INTERVALS, 1)))

    @cached_property
    def family(self) -> dict[float, DuffingCase]:
        """Figure 1 (b) to (d): the oscillators of the assumed set, by alpha."""
        delta = printed.DUFFING_A["delta"]
        return {
            alpha: DuffingCase(Duffing(alpha=alpha, beta=alpha / 2.0, delta=delta), self.noise)
            for alpha in printed.DUFFING_ALPHAS
        }

    @cached_property
    def table(self) -> pd.DataFrame:
        """R(f), I(f), mean and standard deviation of |f| over time and runs; index alpha."""
        rows = {}
        for alpha, case in self.family.items():
            model, norm_f, (R_f, I_f) = case.model, case.norm_f, case.theorem
            theorem = {"beta": model.beta, "delta": model.delta, "R_f": R_f, "I_f": I_f}
            spread = {"mean": norm_f.mean(), "std": norm_f.std(axis=0).mean()}
            rows[alpha] = {**theorem, **spread, "region": model.region}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("alpha")

    @cached_property
    def slowest_decay(self) -> float:
        """Smallest actual decay rate of |f| relative to R(f), on a grid of alpha and delta."""
        ratios = []
        for alpha, delta in product((0.1, 0.2, 0.5, 1.0, 2.0, 5.0), (0.2, 0.5, 1.0, 1.5, 3.0)):
            model = Duffing(alpha=alpha, beta=0.0, delta=delta)
            abscissa = float(np.linalg.eigvals(model.jacobian(np.zeros(2))).real.max())
            ratios.append(-abscissa / model.bound(1.0)[0])
        return min(ratios)
