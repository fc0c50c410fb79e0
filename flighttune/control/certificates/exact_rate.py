"""The exact rate of one loop in a certificate: continuous, or sampled as it is flown."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flighttune.base.arrays import FloatArray, check_positive, set_read_only, square_matrices
from flighttune.base.errors import InputError
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag, sampled_loop, with_inner_loop, with_input_delay
from flighttune.control.law import made_law
from flighttune.control.linear_model import LinearModel, closed_loop
from flighttune.control.theory.decay import decay, decay_checks, true_rate
from flighttune.control.theory.exact import Check, exact

# Relative tolerance for entries of a model that another machine computes again.
SAME_MODEL = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampling:
    """How a loop is sampled: arguments of `flighttune.control.inner_loop.sampled_loop`."""

    model: LinearModel  # model of the law alone
    lags: tuple[InnerLag, ...]  # one for each input, or none for a model without an inner loop
    dt: float  # s
    trapezoidal: bool

    def loop(self, gains: PIGains) -> FloatArray:
        """The map over a sample, in units in which commands count by the rate that they cause."""
        with np.errstate(all="ignore"):  # a later check refuses numbers that are not finite
            loop, units = sampled_loop(
                self.model, self.lags, gains, dt=self.dt, trapezoidal=self.trapezoidal
            )
            return square_matrices("loop", loop * units / units[:, None], 2)

    def checks(self, model: LinearModel, gains: PIGains) -> list[Check]:
        """Check that the loop of `model` behind its lags is sampled by the rule of its law."""
        alone = with_inner_loop(self.model, self.lags) if self.lags else self.model
        hold = 0.5 * self.dt  # a held command is late by this
        # Lags of a model without the hold, or with a hold of its own, must have no delay: else a
        # delay of the lags could take the place of the hold.
        prompt = not any(lag.delay for lag in self.lags)
        behind = [alone, with_input_delay(alone, hold)] if prompt else []
        if self.lags:
            behind.append(with_inner_loop(self.model, [lag.delayed(hold) for lag in self.lags]))
        same = any(
            model.names == other.names
            and all(
                np.allclose(getattr(model, name), getattr(other, name), rtol=SAME_MODEL, atol=0.0)
                for name in "ABC"
            )
            for other in behind
        )
        rule = self.trapezoidal == made_law(gains.law).trapezoidal
        return [
            Check(name=name, margin=0.0 if holds else -math.inf, exact=holds)
            for name, holds in (
                ("the model and lags are those of the certificate's model", same),
                ("the integral is that of the law of the gains", rule),
            )
        ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactRate:
    """A proven rate at which a norm of one loop decays, and the matrix that proves it.

    Attributes
    ----------
    rate : float, 1/s
    Q : ndarray, shape (N, N)
        The norm is ``sqrt(s' Q s)``, s in `units`.
    units : ndarray, shape (N,)
        Units of the state of the loop in which `Q` was found.
    sampling : Sampling or None
        None: the continuous loop of the certificate's model.
    """

    rate: float
    Q: FloatArray
    units: FloatArray
    sampling: Sampling | None = None

    def __post_init__(self) -> None:
        check_positive(rate=self.rate)
        n = np.size(self.units)
        set_read_only(self, units=(n,), Q=(n, n))
        if not (self.units > 0.0).all():
            raise InputError(f"`units` must be positive, got {self.units.tolist()}.")

    def _loop(self, model: LinearModel, gains: PIGains) -> tuple[FloatArray, float | None]:
        """The loop that `gains` close on `model`, and its sample time."""
        if self.sampling is None:
            return closed_loop(model, gains), None
        return self.sampling.loop(gains), self.sampling.dt

    def growth(self, model: LinearModel) -> float:
        """Largest factor by which the norm of s may grow before it decays, in `lag_units`."""
        scale = (lag_units(model) if self.sampling is None else np.ones(len(self.Q))) / self.units
        return math.sqrt(float(np.linalg.cond(self.Q * scale * scale[:, None])))

    def checks(self, model: LinearModel, gains: PIGains) -> list[Check]:
        """The inequalities that prove the rate of the loop that `gains` close on `model`."""
        loop, dt = self._loop(model, gains)
        if loop.shape != self.Q.shape:
            raise InputError(f"`Q` must have the shape {loop.shape} of its loop.")
        units = exact(self.units)
        checks = decay_checks(exact(loop) * units / units[:, None], self.Q, rate=self.rate, dt=dt)
        if self.sampling is not None:
            checks = [*self.sampling.checks(model, gains), *checks]
        place = " (continuous loop)" if dt is None else " (sampled loop)"
        return [replace(check, name=check.name + place) for check in checks]

    def values(self, model: LinearModel, gains: PIGains) -> dict[str, Any]:
        """The figures that are printed: the loop, rate, growth, and the rate by eigenvalues."""
        (loop, dt), name = self._loop(model, gains), "continuous"
        if self.sampling is not None:
            name = f"sampled at {1.0 / self.sampling.dt:g} Hz"
            if not self.sampling.trapezoidal:
                name += ", each error summed after its command"
        return {
            "loop": name,
            "decay": self.rate,
            "growth": self.growth(model),
            "true_rate": true_rate(loop, dt),
        }


def lag_units(model: LinearModel) -> FloatArray:
    """Units of s = (x', e) in which states of lags count by the rate that they cause."""
    n, _, p = model.shape
    units, states = np.ones(n + p), model.states
    behind = {x: [s == x or s.startswith(f"{x}_") for s in states] for x in model.inputs}
    law = ~np.any(list(behind.values()), axis=0)
    for name in behind.keys() & {*states}:
        effect = np.linalg.norm(model.A[law, states.index(name)])
        units[:n][behind[name]] = 1.0 / effect if effect > 0.0 else 1.0
    return units


def exact_rates(
    model: LinearModel,
    gains: PIGains,
    *,
    scaling: FloatArray | None = None,
    sampling: Sampling | None = None,
) -> tuple[tuple[ExactRate, ...], str]:
    """The exact rates of the continuous and the sampled loop; why the sampled loop has none."""
    loop = closed_loop(model, gains)
    # The norm is sought in these units of s = (x', e).
    units = np.ones(len(loop)) if scaling is None else np.asarray(scaling, dtype=float)
    rates = []
    if (proven := decay(loop * units / units[:, None])) is not None:
        rates.append(ExactRate(rate=proven[0], Q=proven[1], units=units))
    if sampling is None:
        return tuple(rates), ""
    absent = f"no exact rate of the loop sampled at {1.0 / sampling.dt:g} Hz"
    try:
        sampled = sampling.loop(gains)
    except InputError as error:
        return tuple(rates), f"{absent}: {error}"
    if (proven := decay(sampled, dt=sampling.dt)) is None:
        return tuple(rates), f"{absent}: it is not proven to be stable."
    rate, Q = proven
    rates.append(ExactRate(rate=rate, Q=Q, units=np.ones(len(Q)), sampling=sampling))
    return tuple(rates), ""
