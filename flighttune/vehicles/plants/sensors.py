"""Imperfect sensors: the controller sees signals with an error."""

import math
from collections.abc import Callable, Iterator, MutableSequence, Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_not_negative
from flighttune.base.errors import InputError
from flighttune.base.signals import SIGNALS
from flighttune.control.wind import level_speed, speed_over
from flighttune.vehicles.plants import navigation
from flighttune.vehicles.plants.base import COMMON_SIGNALS, Plant, WrappedPlant, places
from flighttune.vehicles.plants.weather import WIND

# Signals that the controller sees through sensors, in the order of every array of them.
SENSED = "chi", "gamma", "V_a"

# Errors in a row: of sensors, to which those of navigation are added or follow.
ERRORS = (*SENSED, *(name for name in navigation.ERRORS if name not in SENSED))

# Signals that the controller sees with errors of navigation: the true one and its error, and others
ADDED = tuple(name for name in ERRORS if name in COMMON_SIGNALS and name not in SENSED)
FURTHER = (*ADDED, "h", "V_g")

# Places of errors, of true signals, and of seen signals among themselves
ERROR, TRUE, SEEN = map(places, (ERRORS, COMMON_SIGNALS, (*SENSED, *FURTHER, *WIND)))
_SENSED, _ADDED = (
    tuple((getattr(SEEN, x), getattr(TRUE, x), getattr(ERROR, x)) for x in names)
    for names in (SENSED, ADDED)
)
_WIND = tuple((getattr(SEEN, x), getattr(ERROR, x)) for x in WIND)


def seen_as(names: Sequence[str]) -> tuple[str, ...]:
    """Names of signals as the controller sees them."""
    return tuple(SIGNALS[name].measured for name in names)


MEASURED, NAVIGATED, WIND_MEASURED = map(seen_as, (SENSED, FURTHER, WIND))

# Share of a sample by which rounding may put a time after its sample
ON_SAMPLE = 1e-6

# Spawn key of the sensors' noise; each signal has a stream of its own.
_STREAM = 0x5E45


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """Bias and noise on (chi, gamma, V_a) as the controller sees them.

    Attributes
    ----------
    bias : tuple of three floats, rad, rad, m/s
        Measured minus true value, constant over the flight.
    noise_sd : tuple of three floats, rad, rad, m/s
        Standard deviation of the noise, not negative.
    late : tuple of two floats, s and m/s
        Time from which the measured airspeed has an additional error, and this error.
    time_constant : float, s
        Time constant of the noise, a first-order Gauss-Markov sequence; 0 for white noise.
    seed : int
        Seed of the noise, which depends on nothing else drawn from it.

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

        In rad, rad and m/s. A seed gives the same bits; the errors of a longer flight begin with
        those of a shorter one.
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


def seen_errors(
    sensors: Sensors | None,
    of_navigation: navigation.Navigation | None,
    dt: float,
    V_a: float,
    followed: bool,
    by: navigation.Arithmetic,
    n: int,
) -> FloatArray:
    """`ERRORS` at the first n samples, a row each; without navigation only those of sensors.

    `followed`: whether the law is given the load factor that the inner loop follows.
    """
    errors = np.zeros((n, len(SENSED if of_navigation is None else ERRORS)))
    if sensors is not None:
        errors[:, : len(SENSED)] = sensors.errors(n, dt)
    if of_navigation is not None:
        drawn = of_navigation.errors(n, dt, V_a, by)
        for name, column in zip(navigation.ERRORS, drawn.T, strict=True):
            errors[:, ERRORS.index(name)] += column
        if followed and of_navigation.inner_loop:  # which has the errors of its accelerometers
            errors[:, ERROR.n_z] = 0.0
    return errors


class DrawnErrors:
    """Errors (seen minus true) at the samples of a flight, drawn as far as the flight needs them.

    `draw` returns the rows of that many first samples; a longer draw begins with a shorter one. A
    flight along a route may last long after the time in which it is expected to arrive, so the
    first draw has `expected` samples of at most `samples`.
    """

    def __init__(self, draw: Callable[[int], FloatArray], samples: int, expected: int) -> None:
        self._draw, self._samples = draw, samples
        self.values = draw(min(samples, max(expected, 1)))

    def reach(self, sample: int) -> FloatArray:
        """All rows drawn so far, among them the row of a sample of the flight."""
        if sample >= len(self.values):
            self.values = self._draw(min(max(2 * len(self.values), sample + 1), self._samples))
        return self.values

    def __iter__(self) -> Iterator[list[float]]:
        at = 0
        while at < self._samples:
            yield from self.reach(at)[at:].tolist()
            at = len(self.values)


class SensedPlant(WrappedPlant):
    """A plant that also shows its signals as the controller sees them.

    `errors` has a row for each observation, `dt` s apart: `ERRORS`, or those of sensors alone.
    `h_0` (m) is the height of the start; `share` is the share of the wind at a sample in its
    estimate.
    """

    def __init__(
        self, plant: Plant, errors: DrawnErrors, dt: float, h_0: float, share: float = 1.0
    ) -> None:
        signals = plant.signals
        self.navigated = errors.values.shape[1] > len(SENSED)
        wind = signals.index(WIND[0]) if WIND[0] in signals else -1
        further = (
            (*MEASURED, *NAVIGATED, *WIND_MEASURED * (wind >= 0)) if self.navigated else MEASURED
        )
        super().__init__(plant, further)
        height = signals.index("h") if "h" in signals else -1
        # Arguments of `sense`, also in compiled flights.
        self.places, self.numbers = (len(signals), height, wind), (dt, h_0, share)
        self.error: Sequence[float] = ()
        self._errors, self._blank = iter(errors), [0.0] * len(further)
        self._before: list[float] | None = None

    @property
    def n_z_followed(self) -> Callable[[], float] | None:
        """The reader of the plant, with the error of navigation."""
        followed = super().n_z_followed
        if followed is None or not self.navigated:
            return followed
        return lambda: followed() + self.error[ERROR.n_z]

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians; each call uses up one sample."""
        row, self.error = [*self._observe(), *self._blank], next(self._errors)
        before = self._before
        sense(row, before or row, before is not None, self.error, self.places, self.numbers)
        self._before = row
        return tuple(row)


# Numba compiles the functions below too.


def sense(
    row: MutableSequence[float],
    before: Sequence[float],
    begun: bool,
    error: Sequence[float],
    places: tuple[int, int, int],
    numbers: tuple[float, float, float],
) -> None:
    """Write the seen signals behind the true signals of a row; `before` is the previous row.

    `places`: of the seen signals, the height and the wind, or -1. `numbers`: sample time (s),
    height of the start (m), and share of the wind in its estimate.
    """
    (at, h, wind), (dt, h_0, share) = places, numbers
    for seen, true, of in _SENSED:
        row[at + seen] = row[true] + error[of]
    if len(error) == len(_SENSED):
        return
    for seen, true, of in _ADDED:
        row[at + seen] = row[true] + error[of]
    chi, gamma, V_a = row[TRUE.chi], row[TRUE.gamma], row[TRUE.V_a]
    air = (row[wind], row[wind + 1], row[wind + 2]) if wind >= 0 else (0.0, 0.0, 0.0)
    if begun:
        north, east = row[TRUE.north] - before[TRUE.north], row[TRUE.east] - before[TRUE.east]
        V_g = speed_over(north, east, dt)
    else:
        V_g = level_speed(chi, gamma, V_a, air)
    velocity = error[ERROR.v_north], error[ERROR.v_east], error[ERROR.v_up]
    turned, climbed, V_g = motion_seen(chi, gamma, V_g, velocity)
    row[at + SEEN.chi] += turned
    row[at + SEEN.gamma] += climbed
    row[at + SEEN.h] = (row[h] if h >= 0 else h_0 - row[TRUE.down]) + error[ERROR.h]
    row[at + SEEN.V_g] = V_g
    if wind >= 0:
        for j, (seen, of) in enumerate(_WIND):
            last = before[at + seen] if begun else air[j]
            row[at + seen] = share * air[j] + (1.0 - share) * last + error[of]


def motion_seen(
    chi: float, gamma: float, V_g: float, error: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Errors of course and path angle (rad), and the seen level speed (m/s), by a velocity error.

    `error`: north, east and up, m/s. A zero error gives zero errors and the true speed, to the bit.
    """
    north, east, up = error
    c, s = math.cos(chi), math.sin(chi)
    along, aside = V_g + (north * c + east * s), east * c - north * s
    seen = math.sqrt(along * along + aside * aside)
    level, rise = math.cos(gamma), math.sin(gamma)
    faster = seen - V_g
    ahead = V_g / level + faster * level + up * rise
    return math.atan2(aside, along), math.atan2(up * level - faster * rise, ahead), seen
