"""The experiments of figure 3 on the Duffing oscillator, and the reach of Theorem 1."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.paper import parameters as printed
from flighttune.paper.duffing import Bound, Duffing, bound, paths

INTERVALS = round(printed.DURATION / printed.DUFFING_HOLD)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DuffingCase:
    """One oscillator under the noise of all runs.

    Attributes
    ----------
    model : Duffing
    theorem : Bound
        Theorem 1 with the Jacobian at the origin, as the paper takes it.
    t : ndarray, shape (k,), s
    x : ndarray, shape (k, runs, 2)
    norm_f : ndarray, shape (k, runs)
        |f(x)| over time.
    """

    model: Duffing
    theorem: Bound
    t: FloatArray
    x: FloatArray
    norm_f: FloatArray

    @property
    def bound_over_time(self) -> FloatArray:
        """Upper bound of Theorem 1 on |f| over time, shape (k,)."""
        f_0 = self.model.rates(self.x[0, 0])
        return self.theorem.norm_over_time(self.t, float(f_0 @ self.model.P @ f_0))

    @property
    def farthest(self) -> float:
        """Largest |x1| of any run."""
        return float(np.max(np.abs(self.x[..., 0])))


def flown(model: Duffing, d: FloatArray) -> DuffingCase:
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


def pushing(model: Duffing) -> FloatArray:
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
        return flown(self.model, self.noise)

    @cached_property
    def hard(self) -> dict[str, DuffingCase]:
        """Figure 3 (a) under the hard end of what the bound allows, by name."""
        return {
            "constant L_d": flown(self.model, np.full((INTERVALS, 1), printed.DUFFING_L_D)),
            "along the motion": flown(self.model, pushing(self.model)),
        }

    @cached_property
    def undisturbed(self) -> DuffingCase:
        """Figure 3 (a) without disturbance."""
        return flown(self.model, np.zeros((INTERVALS, 1)))

    @cached_property
    def family(self) -> dict[float, DuffingCase]:
        """Figure 3 (b) to (d): the oscillators of the assumed set, by alpha."""
        delta = printed.DUFFING_A["delta"]
        return {
            alpha: flown(Duffing(alpha=alpha, beta=alpha / 2.0, delta=delta), self.noise)
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
    def rates(self) -> pd.DataFrame:
        """R(f) and the rate at which |f| really decays, over a grid of alpha and delta."""
        rows = []
        for alpha in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0):
            for delta in (0.2, 0.5, 1.0, 1.5, 3.0):
                model = Duffing(alpha=alpha, beta=0.0, delta=delta)
                abscissa = float(np.linalg.eigvals(model.jacobian(np.zeros(2))).real.max())
                rows.append((alpha, delta, bound(model, 1.0).rate, -abscissa))
        return pd.DataFrame(rows, columns=["alpha", "delta", "R_f", "decay"])
