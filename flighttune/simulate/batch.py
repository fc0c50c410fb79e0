"""Thousands of kinematic flights at once: the sampled controller on the paper's law."""

import math
import os
from collections import namedtuple
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, Floats, check_at_least, check_positive
from flighttune.control.exact_law import ExactOptions
from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import AntiWindup, check_anti_windup, integral_time
from flighttune.errors import InputError, ShapeError
from flighttune.plants.base import FlightCondition
from flighttune.plants.point_mass import LONGEST_STEP
from flighttune.plants.sensors import SENSED, Sensors
from flighttune.simulate.disturbance import Sinusoid
from flighttune.simulate.measures import ErrorMeasures
from flighttune.units import G_PAPER

T = TypeVar("T")

SIGNALS = (
    *("chi", "gamma", "chi_err", "gamma_err", "chi_err_rate", "gamma_err_rate"),
    *("phi_cmd", "n_z_cmd", "phi_unlimited", "n_z_unlimited"),
    *("phi_integral", "n_z_integral", "phi_limited", "n_z_limited"),
)
"""Columns of a trajectory: as in a run, and the rates of the errors by the law, rad/s."""

BLOCKS_PER_THREAD = 8

SENSED_AT_ONCE = 256
"""Flights a thread keeps the errors of sensors of."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flights:
    """N flights of the kinematic loop.

    Raises
    ------
    ShapeError
        If the shapes do not fit together.
    InputError
        If a value cannot be used.

    Notes
    -----
    Values are copied and checked; ``dataclasses.replace`` makes a changed set of flights.
    """

    # (N, 2, 4): Stacked gains (K_P, K_I), rows phi and n_z, columns e_chi and e_gamma
    K: FloatArray
    # (N, 5), rad, rad, rad, 1, m/s: Course, flight-path angle, roll, load factor and airspeed at
    # t = 0
    start: FloatArray
    # (N or 1, k or 1, 2), rad: Course and flight-path angle to follow: one pair, or one a sample
    ref: FloatArray
    # (N, 4, 2), input units: Rows lower, upper, rate_lower, rate_upper; infinite for no limit
    bounds: FloatArray
    # (N, 4), rad/s: Disturbance: chi_amplitude, chi_omega, gamma_amplitude, gamma_omega
    waves: FloatArray
    # as `ref`, rad/s: Rates of the reference, which the exact law follows; zero by default
    ref_rates: FloatArray | None = None

    def __post_init__(self) -> None:
        flights = len(np.asarray(self.K))
        if self.ref_rates is None:
            object.__setattr__(self, "ref_rates", np.zeros_like(self.ref, dtype=float))
        shapes = {
            "K": (flights, 2, 4),
            "start": (flights, 5),
            "bounds": (flights, 4, 2),
            "waves": (flights, 4),
        }
        for name in self.__slots__:
            array = np.array(getattr(self, name), dtype=float, order="C")
            array.flags.writeable = False
            wanted = shapes.get(name)
            if wanted is not None and array.shape != wanted:
                raise ShapeError(f"`{name}` must have shape {wanted}, got {array.shape}.")
            if name != "bounds" and not np.isfinite(array).all():
                raise InputError(f"`{name}` must be finite.")
            object.__setattr__(self, name, array)
        r = self.ref.shape
        if not (len(r) == 3 and r[0] in (1, flights) and r[1] >= 1 and r[2] == 2):
            raise ShapeError(f"`ref` must have shape ({flights} or 1, k or 1, 2), got {r}.")
        rates = np.asarray(self.ref_rates)
        if rates.shape != r:
            raise ShapeError(f"`ref_rates` must have the shape of `ref`, {r}, got {rates.shape}.")
        if not np.all(self.start[:, 4] > 0.0):
            raise InputError(f"`V_a` must be positive, got {self.start[:, 4].min():g} m/s.")
        if not np.all(np.abs(self.start[:, 1:3]) < math.pi / 2):
            raise InputError("`gamma` and `phi` must lie inside +-pi/2.")
        low, high = self.bounds[:, (0, 2)], self.bounds[:, (1, 3)]
        if not (np.all(low < high) and np.all(low[:, 1] <= 0.0) and np.all(high[:, 1] >= 0.0)):
            raise InputError("`bounds` must be ranges, and those of the rates must hold zero.")

    def __len__(self) -> int:
        return len(self.K)

    @classmethod
    def of(
        cls,
        gains: PIGains | Iterable[PIGains],
        *,
        condition: FlightCondition | Iterable[FlightCondition],
        ref: npt.ArrayLike,
        limits: Limits | Iterable[Limits] | None = None,
        disturbance: Sinusoid | Iterable[Sinusoid] | None = None,
        ref_rates: npt.ArrayLike | None = None,
    ) -> "Flights":
        """Flights from one or many of each: whatever is single serves all of them.

        Parameters
        ----------
        gains, condition, limits, disturbance
            One, or N of them; no limits and no disturbance by default.
        ref : array_like, shape (2,), (k, 2) or (N, k or 1, 2), rad
            Constant course and flight-path angle, or one a sample, for all or for each.
        ref_rates : array_like, shape of `ref`, rad/s, optional
            Their rates, which the exact law follows.

        Raises
        ------
        ShapeError
            If the numbers of things differ, or gains are not of two commands and two errors.
        InputError
            If a disturbance has switching times.
        """
        waves = _many(Sinusoid, Sinusoid() if disturbance is None else disturbance)
        for name in ("chi_switches", "gamma_switches"):
            if any(getattr(wave, name) is not None for wave in waves):
                raise InputError(f"`{name}` must be None: a batch flies sinusoids only.")
        rows = {
            "K": [g.K for g in _many(PIGains, gains)],
            "start": [
                (c.chi, c.gamma, c.phi, c.n_z_start, c.V_a)
                for c in _many(FlightCondition, condition)
            ],
            "bounds": [
                (ranges.lower, ranges.upper, ranges.rate_lower, ranges.rate_upper)
                for ranges in _many(Limits, Limits.none(2) if limits is None else limits)
            ],
            "waves": [
                (d.chi_amplitude, d.chi_omega, d.gamma_amplitude, d.gamma_omega) for d in waves
            ],
        }
        followed = np.asarray(ref, dtype=float)
        if followed.ndim < 3:
            followed = followed.reshape(1, -1, 2)
        flights = max(len(followed), *map(len, rows.values()))
        arrays = {name: _repeated(name, values, flights) for name, values in rows.items()}
        rates = None if ref_rates is None else np.asarray(ref_rates, float).reshape(followed.shape)
        return cls(ref=followed, ref_rates=rates, **arrays)


class BatchResult(NamedTuple):
    """Results of N flights as arrays."""

    t: FloatArray  # (k,), s: Times of the samples
    # (N, 2, 10): `ErrorMeasures` of the course (0) and of the flight-path angle (1); NaN where a
    # measure has no value or the flight has fewer than two samples
    measures: FloatArray
    # (N,): Samples of each flight, k unless it ended before its time
    samples: npt.NDArray[np.int64]
    # (N,): 0 where the flight was completed, 1 where it ended at 90 deg of roll, 2 where an angle
    # went beyond 1000 rad
    ends: npt.NDArray[np.int64]
    last: FloatArray  # (N, 14): `SIGNALS` at the last sample
    # (N, k, 14): `SIGNALS` over time, NaN after the end; of no flight where only measures were
    # asked for
    trajectories: FloatArray

    def measure(self, name: str) -> FloatArray:
        """One of `ErrorMeasures`, shape (N, 2): course, flight-path angle."""
        return self.measures[..., ErrorMeasures._fields.index(name)]

    def signal(self, name: str) -> FloatArray:
        """One of `SIGNALS` over time, shape (N, k)."""
        return self.trajectories[..., SIGNALS.index(name)]


class Settings(NamedTuple):
    """Settings of the kernel besides the flights; arrays have shape (N,)."""

    conditional: bool
    wrapped: bool
    feed_forward: bool
    dt: float
    steps: int
    step: float
    tracking_gain: FloatArray
    per_speed: FloatArray
    g: FloatArray
    exact: bool
    course_first: bool
    lift_floor: float
    braking: float


_FlightArrays = namedtuple("_FlightArrays", Flights.__slots__)
"""The arrays of `Flights`, as the kernel takes them."""


def fly_sampled(  # noqa: PLR0913
    flights: Flights,
    *,
    dt: float,
    duration: float,
    anti_windup: AntiWindup = "conditional",
    tracking_time: float | None = None,
    wrapped: bool = True,
    schedule_speed: Floats | None = None,
    feed_forward: bool = False,
    sensors: Sequence[Sensors] | None = None,
    trajectories: bool = False,
    g: Floats = G_PAPER,
    exact: ExactOptions | None = None,
    threads: int | None = None,
) -> BatchResult:
    """Fly the discrete controller on the kinematic plant, every flight as `simulate` would.

    Parameters
    ----------
    flights : Flights
        N flights; a reference over time has one entry a sample, ``duration / dt + 1``.
    dt : float, s
        Sample time of the controller.
    duration : float, s
        Time to fly, at least `dt`; rounded to whole samples.
    anti_windup, tracking_time
        As in `MimoPI`.
    schedule_speed : float or array_like, shape (N,), m/s, optional
        As in `MimoPI`.
    wrapped : bool
        Take the course error the short way round.
    feed_forward : bool
        As in `simulate`.
    sensors : sequence of Sensors, length N or 1, optional
        As in `simulate`, one a flight or one for all.
    trajectories : bool
        Keep all signals over time: 112 bytes a sample and flight.
    g : float or array_like, shape (N,), m/s^2
        Acceleration of gravity.
    exact : ExactOptions, optional
        Fly the exact law: gains are then in 1/s and 1/s^2, and neither schedule nor feed-forward
        has a meaning; its integrals (rad/s) stand in ``phi_integral`` and ``n_z_integral``.
    threads : int, optional
        Threads to use; by default one a core. The results do not depend on it.

    Returns
    -------
    BatchResult
        Trajectories and measures are those of the single run but for rounding (1e-12), and the same
        bits for any number of threads.

    Raises
    ------
    InputError
        If a value cannot be used.
    ShapeError
        If a reference over time is not as long as the flight.

    Notes
    -----
    The controller is `pi_step` or `exact_step`, the function of the law itself, compiled. The first
    call in a new installation compiles for some seconds; the result is kept on disk.
    """
    check_positive(dt=dt, tracking_time=tracking_time)
    check_anti_windup(anti_windup)
    if not (math.isfinite(duration) and duration >= dt):
        raise InputError(f"`duration` must be at least one sample ({dt} s), got {duration} s.")
    t = np.arange(round(duration / dt) + 1, dtype=np.float64) * dt
    if flights.ref.shape[1] not in (1, len(t)):
        raise ShapeError(f"`ref` must have 1 or {len(t)} samples, got {flights.ref.shape[1]}.")
    sensors = sensors or ()
    if len(sensors) not in (0, 1, len(flights)):
        raise ShapeError(f"`sensors` must be 1 or {len(flights)}, got {len(sensors)}.")
    N, steps = len(flights), math.ceil(dt / LONGEST_STEP - 1e-9)
    per_speed, tracking_gain = np.zeros(N), np.zeros(N)
    if schedule_speed is not None:
        per_speed = 1.0 / _one_each(flights, "schedule_speed", schedule_speed)
    if anti_windup == "back_calculation":
        tracking_gain = dt / np.maximum(_tracking_times(flights, tracking_time), dt)
    options = exact or ExactOptions()
    settings = Settings(
        conditional=anti_windup == "conditional",
        wrapped=wrapped,
        feed_forward=feed_forward,
        dt=dt,
        steps=steps,
        step=dt / steps,
        tracking_gain=tracking_gain,
        per_speed=per_speed,
        g=_one_each(flights, "g", g),
        exact=exact is not None,
        course_first=options.priority == "chi",
        lift_floor=options.lift_floor,
        braking=options.braking or math.inf,
    )
    arrays = _FlightArrays(*(getattr(flights, name) for name in Flights.__slots__))
    result = BatchResult(
        t=t,
        measures=np.empty((N, 2, len(ErrorMeasures._fields))),
        samples=np.zeros(N, dtype=np.int64),
        ends=np.zeros(N, dtype=np.int64),
        last=np.empty((N, len(SIGNALS))),
        trajectories=np.full((N if trajectories else 0, len(t), len(SIGNALS)), np.nan),
    )
    from flighttune.simulate.kernel import fly_block

    def fly(first: int, end: int) -> None:
        # Errors of sensors are made flight by flight in Python: only so many are kept at a time.
        most = SENSED_AT_ONCE if sensors else max(end - first, 1)
        for begin in range(first, end, most) or [first]:
            until = min(begin + most, end)
            errors = _sensor_errors(sensors, begin, until, len(t), dt)
            fly_block(begin, until, errors, arrays, settings, result)

    _in_blocks(fly, N, threads)
    return result


def _sensor_errors(
    sensors: Sequence[Sensors], first: int, end: int, samples: int, dt: float
) -> FloatArray:
    """Errors of the sensors of some flights, shape (flights, samples, 3)."""
    chosen = sensors[first:end] if len(sensors) > 1 else sensors[: end - first]
    made = np.array([sensor.errors(samples, dt) for sensor in chosen])
    return np.resize(made, (end - first if sensors else 0, samples, len(SENSED)))


def _in_blocks(fly: Callable[[int, int], Any], flights: int, threads: int | None) -> None:
    """Fly all flights in blocks that the threads take one after the other."""
    threads = cores() if threads is None else threads
    check_at_least(1, threads=threads)
    if threads == 1:
        fly(0, flights)
        return
    edges = np.linspace(0, flights, min(flights, threads * BLOCKS_PER_THREAD) + 1).astype(int)
    fly(0, 0)  # compiles before the threads start: each of them would
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(fly, edges[:-1].tolist(), edges[1:].tolist()))


def cores() -> int:
    """Processor cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _tracking_times(flights: Flights, tracking_time: float | None) -> FloatArray:
    if tracking_time is not None:
        return np.full(len(flights), tracking_time)
    different, which = np.unique(flights.K, axis=0, return_inverse=True)
    times = [integral_time(K[:, :2], K[:, 2:]) for K in different]
    return np.array(times)[which.reshape(-1)]


def _one_each(flights: Flights, name: str, value: Floats) -> FloatArray:
    """`value` for each flight, positive."""
    values = np.asarray(value, dtype=float)
    if values.shape not in ((), (len(flights),)):
        raise ShapeError(f"`{name}` must have shape ({len(flights)},), got {values.shape}.")
    if not (np.isfinite(values) & (values > 0.0)).all():
        raise InputError(f"`{name}` must be positive, got {values.min()}.")
    return np.ascontiguousarray(np.broadcast_to(values, len(flights)))


def _many(kind: type[T], values: T | Iterable[T]) -> list[T]:
    return [values] if isinstance(values, kind) else list(values)  # type: ignore[arg-type]


def _repeated(name: str, values: list[Any], flights: int) -> FloatArray:
    array = np.array(values, dtype=float)
    if len(array) not in (1, flights):
        raise ShapeError(f"`{name}` must be given once or {flights} times, got {len(array)}.")
    return np.broadcast_to(array, (flights, *array.shape[1:]))
