"""Imperfect sensors: the controller sees course, climb and airspeed with an error."""

import math
from dataclasses import dataclass

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_not_negative
from flighttune.base.errors import InputError
from flighttune.base.signals import SIGNALS
from flighttune.vehicles.plants.base import COMMON_SIGNALS, Plant, WrappedPlant

# Signals that the controller sees through sensors, in the order of every array of them.
SENSED = tuple(name for name, signal in SIGNALS.items() if signal.measured)

# Names of the same signals as the controller saw them.
MEASURED = tuple(SIGNALS[name].measured for name in SENSED)

_CHI, _GAMMA, _V_A = (COMMON_SIGNALS.index(name) for name in SENSED)

# Share of a sample by which rounding may put a time after it
ON_SAMPLE = 1e-6

# Key of the seed's child that sensors draw from, which has one child for each signal.
_STREAM = 0x5E45


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """Bias and noise on (chi, gamma, V_a) as the controller sees them.

    Attributes
    ----------
    bias : tuple of three floats, rad, rad, m/s
        Measured minus true value, on the whole flight.
    noise_sd : tuple of three floats, rad, rad, m/s
        Standard deviation of the noise, not negative.
    late : tuple of two floats, s and m/s
        Time from which the measured airspeed has a further error, and this error.
    time_constant : float, s
        Time constant of the noise, a first-order Gauss-Markov sequence; 0 for white noise.
    seed : int
        The noise is a function of it alone, the same whatever else is drawn from that seed.

    Raises
    ------
    InputError
        If a value cannot be used.

    Examples
    --------
    >>> ft.loop.Sensors(bias=(0.01, 0.0, 0.0), seed=1).noise_sd
    (0.0, 0.0, 0.0)
    """

    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise_sd: tuple[float, float, float] = (0.0, 0.0, 0.0)
    late: tuple[float, float] = (0.0, 0.0)
    time_constant: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, values in (("bias", self.bias), ("noise_sd", self.noise_sd)):
            if len(values) != len(SENSED) or not all(map(math.isfinite, values)):
                raise InputError(f"`{name}` must be {len(SENSED)} finite numbers, got {values}.")
        if min(self.noise_sd) < 0.0:
            raise InputError(f"`noise_sd` must not be negative, got {self.noise_sd}.")
        check_not_negative("s", time_constant=self.time_constant)
        check_not_negative(seed=self.seed)

    def errors(self, samples: int, dt: float) -> FloatArray:
        """Measured minus true value at each of the samples, `dt` s apart, shape (samples, 3).

        In rad, rad and m/s: the same bits for the same seed; a longer flight begins as a shorter
        one.
        """
        errors = np.empty((samples, len(SENSED)))
        for j, (bias, sd) in enumerate(zip(self.bias, self.noise_sd, strict=True)):
            errors[:, j] = bias + sd * self._noise(j, samples, dt) if sd else bias
        begin, further = self.late
        errors[math.ceil(begin / dt - ON_SAMPLE) :, SENSED.index("V_a")] += further
        return errors

    def _noise(self, signal: int, samples: int, dt: float) -> FloatArray:
        """Noise of unit variance."""
        stream = np.random.SeedSequence(self.seed, spawn_key=(_STREAM, signal))
        white = np.random.default_rng(stream).standard_normal(samples)
        if not self.time_constant:
            return white
        from scipy.signal import lfilter

        decay = math.exp(-dt / self.time_constant)
        fresh = math.sqrt(1.0 - decay * decay)
        begun = white[0]  # stationary from the first sample on
        later, _ = lfilter([fresh], [1.0, -decay], white[1:], zi=[decay * begun])
        return np.concatenate(([begun], later))


class SensedPlant(WrappedPlant):
    """A plant that also shows its course, climb and airspeed as sensors have them, `MEASURED`."""

    # `errors`, shape (n, 3), rad, rad and m/s, are measured minus true value at each of the n times
    # the plant is observed.
    def __init__(self, plant: Plant, errors: FloatArray) -> None:
        super().__init__(plant, MEASURED)
        self._errors = zip(*errors.T.tolist(), strict=True)

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians; each call takes one sample."""
        signals, (chi, gamma, V_a) = self._observe(), next(self._errors)
        return (*signals, signals[_CHI] + chi, signals[_GAMMA] + gamma, signals[_V_A] + V_a)
