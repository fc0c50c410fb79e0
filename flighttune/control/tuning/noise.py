"""Errors and command rates of a loop in gusts and estimation errors, by frequency."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_positive, set_read_only
from flighttune.base.errors import InputError
from flighttune.control.linear_model import LinearModel, measured_rows

Indices = npt.NDArray[np.intp]
Complexes = npt.NDArray[np.complex128]


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Noise:
    """Power spectral densities of gusts and estimation errors, and bounds on the command rates.

    The integral of a density over `omega` is a variance. All errors are independent.

    Attributes
    ----------
    omega : ndarray, shape (k,), rad/s
        Angular frequencies, rising, up to pi over the sample time.
    gusts : ndarray, shape (p, k), rad^2 s
        Density of the angle by which gusts turn the path.
    estimates : ndarray, shape (p, k), rad^2 s
        Density of the estimation error of each angle.
    measured : ndarray, shape (m, k), (command unit)^2 s
        Density of the error of each measured command, roll and load factor, which the inner
        feedback sees.
    units : ndarray, shape (m,), input unit per command unit
        A law may act on rates of turn instead of roll and load factor.
    rates_max : ndarray, shape (m,), command unit/s
        Largest rms rate of each command; inf for no bound.
    dt : float, s
        Sample time, over which a rate is measured.
    """

    omega: FloatArray
    gusts: FloatArray
    estimates: FloatArray
    measured: FloatArray
    units: FloatArray
    rates_max: FloatArray
    dt: float

    def __post_init__(self) -> None:
        k, p, m = len(self.omega), len(self.gusts), len(self.measured)
        check_positive(dt=self.dt)
        shapes = {"gusts": (p, k), "estimates": (p, k), "measured": (m, k), "units": (m,)}
        set_read_only(self, omega=(k,), **shapes)
        if not (self.omega[0] > 0.0 and (np.diff(self.omega) > 0.0).all()):
            raise InputError("`omega` must be positive and rise.")
        if self.rates_max.shape != (m,) or not (self.rates_max > 0.0).all():
            raise InputError(f"`rates_max` must be {m} positive numbers, got {self.rates_max}.")

    def of(self, inputs: Indices, errors: Indices) -> "Noise":
        """The noise of some channels."""
        return Noise(
            omega=self.omega,
            gusts=self.gusts[errors],
            estimates=self.estimates[errors],
            measured=self.measured[inputs],
            units=self.units[inputs],
            rates_max=self.rates_max[inputs],
            dt=self.dt,
        )


class Rms(NamedTuple):
    """Root mean squares of a loop in its noise."""

    errors: FloatArray  # shape (p,), rad: true tracking errors
    rates: FloatArray  # shape (m,), command unit/s: rates of the commands


class Responses(NamedTuple):
    """Frequency responses of a model, over k frequencies."""

    stacked: Complexes  # shape (k, 2 p, m): from commands to angles, and to their integrals
    measured: Complexes  # shape (k, m, m): from commands to measured inputs

    @classmethod
    def of(cls, model: LinearModel, omega: FloatArray) -> "Responses":
        """The responses at angular frequencies `omega`, shape (k,), rad/s."""
        s = 1j * omega[:, None, None]
        B = np.broadcast_to(model.B, (len(omega), *model.B.shape))
        x = np.linalg.solve(s * np.eye(len(model.A)) - model.A, B)
        G = -model.C @ x  # the sign is minus because errors fall with the commands
        return cls(np.concatenate([G, G / s], axis=1), measured_rows(model) @ x)

    def returned(self, K: FloatArray, feedback: FloatArray) -> Complexes:
        """The return difference ``1 - K G`` at the commands, shape (k, m, m).

        `K`: stacked gains, shape (m, 2 p); `feedback`, shape (m,), of each command.
        """
        L = (1.0 + feedback)[:, None] * (K @ self.stacked)
        return np.eye(L.shape[-1]) + L + feedback[:, None] * self.measured


class NoisyLoop:
    """The loop of a model in its noise."""

    def __init__(self, model: LinearModel, noise: Noise) -> None:
        self.noise, self._p = noise, len(model.errors)
        self._responses = Responses.of(model, noise.omega)
        self._s = 1j * noise.omega[:, None, None]
        self._rate = (2.0 * np.sin(0.5 * noise.omega * noise.dt) / noise.dt) ** 2

    def rms(self, K: FloatArray, feedback: FloatArray) -> Rms:
        """Rms of the errors and of the command rates of a stable loop.

        The law acts on ``e - n``, where the true error e is minus the angle d that gusts turn the
        path by, and minus the angle flown; n is the error of its estimate. The inner feedback sees
        d' and the error of its measurement.
        """
        noise, p, responses = self.noise, self._p, self._responses
        by_angle = (1.0 + feedback)[:, None] * (K[:, :p] + K[:, p:] / self._s)
        by_measured = np.broadcast_to(
            np.diag(feedback * noise.units), (len(noise.omega), *(len(K),) * 2)
        )
        entries = np.concatenate([by_angle, by_measured], axis=2)
        commands = np.linalg.solve(responses.returned(K, feedback), entries)
        by_angle, by_measured = commands[:, :, :p], commands[:, :, p:]
        by_gust = by_angle + self._s * by_measured[:, :, :p] / noise.units[:p]
        G = responses.stacked[:, :p]
        errors = self._power([G @ by_gust - np.eye(p), G @ by_angle, G @ by_measured])
        rates = self._power([by_gust, by_angle, by_measured]) * self._rate[:, None] / noise.units**2
        return Rms(*(np.sqrt(np.trapezoid(x, noise.omega, axis=0)) for x in (errors, rates)))

    def _power(self, responses: list[Any]) -> FloatArray:
        """Density of outputs that gusts, estimates and measurements drive, shape (k, outputs)."""
        densities = self.noise.gusts, self.noise.estimates, self.noise.measured
        parts: list[Any] = [
            np.einsum("koi,ik->ko", np.abs(response) ** 2, density)
            for response, density in zip(responses, densities, strict=True)
        ]
        return parts[0] + parts[1] + parts[2]
