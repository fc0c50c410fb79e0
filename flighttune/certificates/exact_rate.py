"""The exact rate of one loop in a certificate: continuous, or sampled as it is flown."""

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from flighttune.arrays import (
    FloatArray,
    check_positive,
    read_only_vector,
    set_read_only,
    square_matrices,
)
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.linear_model import LinearModel, closed_loop
from flighttune.control.sampled_loop import sampled_loop
from flighttune.errors import InputError
from flighttune.theory.decay import decay, decay_checks, true_rate
from flighttune.theory.exact import Check, exact


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampling:
    """How a loop is sampled: what `flighttune.control.sampled_loop.sampled_loop` takes."""

    model: LinearModel  # of the law alone
    lags: tuple[InnerLag, ...]  # one an input, or none for a model without an inner loop
    dt: float  # s
    trapezoidal: bool

    def loop(self, gains: PIGains) -> FloatArray:
        """The map over a sample, in units in which commands count by the rate they cause."""
        with np.errstate(all="ignore"):  # numbers of a damaged file are refused as not finite
            loop, units = sampled_loop(
                self.model, self.lags, gains, dt=self.dt, trapezoidal=self.trapezoidal
            )
            return square_matrices("loop", loop * units / units[:, None], 2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactRate:
    """A proven rate at which a norm of one loop decays, and the matrix that proves it.

    Attributes
    ----------
    rate : float, 1/s
    Q : ndarray, shape (N, N)
        The norm is ``sqrt(s' Q s)``, s in `units`.
    units : ndarray, shape (N,)
        The units of the state of the continuous loop; ones for a sampled loop, which has its own.
    sampling : Sampling or None
        None: the continuous loop of the certificate's model.
    """

    rate: float
    Q: FloatArray
    units: FloatArray
    sampling: Sampling | None = None

    def __post_init__(self) -> None:
        check_positive(rate=self.rate)
        object.__setattr__(self, "units", read_only_vector("units", self.units))
        set_read_only(self, Q=(len(self.units),) * 2)
        if not (self.units > 0.0).all():
            raise InputError(f"`units` must be positive, got {self.units.tolist()}.")

    @property
    def growth(self) -> float:
        """Largest factor by which the norm of s may grow before it decays."""
        return math.sqrt(float(np.linalg.cond(self.Q)))

    def checks(self, model: LinearModel, gains: PIGains) -> list[Check]:
        """The inequalities that prove the rate of the loop that `gains` close on `model`."""
        if self.sampling is None:
            name, dt, loop = "continuous", None, exact(closed_loop(model, gains))
        else:
            name, dt, loop = "sampled", self.sampling.dt, exact(self.sampling.loop(gains))
        if loop.shape != self.Q.shape:
            raise InputError(f"`Q` must have the shape {loop.shape} of its loop.")
        units = np.array([Fraction(unit) for unit in self.units.tolist()], dtype=object)
        loop = loop * units / units[:, None]
        return [
            Check(name=f"{check.name} ({name} loop)", margin=check.margin, exact=check.exact)
            for check in decay_checks(loop, self.Q, rate=self.rate, dt=dt)
        ]

    def values(self, model: LinearModel, gains: PIGains) -> dict[str, Any]:
        """The figures that are printed: the loop, rate, growth, and the rate by eigenvalues."""
        if self.sampling is None:
            loop, dt = closed_loop(model, gains), None
        else:
            loop, dt = self.sampling.loop(gains), self.sampling.dt
        return {
            "loop": "continuous" if dt is None else f"sampled at {1.0 / dt:g} Hz",
            "decay": self.rate,
            "growth": self.growth,
            "true_rate": true_rate(loop, dt),
        }


def exact_rates(
    model: LinearModel,
    gains: PIGains,
    *,
    scaling: FloatArray | None = None,
    sampling: Sampling | None = None,
) -> tuple[tuple[ExactRate, ...], str]:
    """The exact rates of the continuous loop and of the sampled one; empty where none is proven.

    `scaling` (shape (n + p,)): units of s = (x', e) in which the growth is measured. Without
    `sampling` there is the continuous rate alone. The text says why a sampled loop has no rate: it
    has too many states for the exact check, or is not stable.
    """
    loop = closed_loop(model, gains)
    units = np.ones(len(loop)) if scaling is None else np.asarray(scaling, dtype=float)
    rates = []
    proven = decay(loop * units / units[:, None])
    if proven is not None:
        rates.append(ExactRate(rate=proven.rate, Q=proven.Q, units=units))
    if sampling is None:
        return tuple(rates), ""
    absent = f"no exact rate of the loop sampled at {1.0 / sampling.dt:g} Hz"
    try:
        sampled = sampling.loop(gains)
    except InputError as error:
        return tuple(rates), f"{absent}: {error}"
    proven = decay(sampled, dt=sampling.dt)
    if proven is None:
        return tuple(rates), f"{absent}: it is not proven to be stable."
    ones = np.ones(len(sampled))
    rates.append(ExactRate(rate=proven.rate, Q=proven.Q, units=ones, sampling=sampling))
    return tuple(rates), ""
