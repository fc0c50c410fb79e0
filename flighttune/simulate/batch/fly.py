"""Fly many kinematic loops at once: the sampled controller, or the paper's continuous law."""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import numpy as np

from flighttune.arrays import FloatArray, Floats
from flighttune.control.mimo_pi import AntiWindup, integral_time
from flighttune.errors import InputError, ShapeError
from flighttune.plants.kinematic import G_PAPER, LONGEST_STEP
from flighttune.plants.sensors import SENSED, Sensors
from flighttune.simulate.batch.flights import MEASURES, SIGNALS, Flights, FlownBatch
from flighttune.simulate.continuous import Roll

BLOCKS_PER_THREAD = 8
LONGEST_LOOK = 0.01
SENSED_AT_ONCE = 256
"""Flights a thread keeps the errors of sensors of."""


def fly_sampled(
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
    threads: int | None = None,
) -> FlownBatch:
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
    threads : int, optional
        Threads to use; by default one a core. The results do not depend on it.

    Returns
    -------
    FlownBatch
        Trajectories and metrics are those of the single run, to the bit.

    Raises
    ------
    InputError
        If a value cannot be used.
    ShapeError
        If a reference over time is not as long as the flight.

    Notes
    -----
    The controller is `pi_step`, the function of `MimoPI` itself, compiled. The first call in a new
    installation compiles for some seconds; the result is kept on disk.
    """
    _check_positive(dt=dt, tracking_time=tracking_time)
    _check_anti_windup(anti_windup, ("none", "conditional", "back_calculation"))
    t = _times(dt, duration)
    gravity = _one_each(flights, "g", g)
    per_speed = np.zeros(len(flights))
    if schedule_speed is not None:
        per_speed = 1.0 / _one_each(flights, "schedule_speed", schedule_speed)
    if flights.ref.shape[1] not in (1, len(t)):
        raise ShapeError(f"`ref` must have 1 or {len(t)} samples, got {flights.ref.shape[1]}.")
    sensors = sensors or ()
    if len(sensors) not in (0, 1, len(flights)):
        raise ShapeError(f"`sensors` must be 1 or {len(flights)}, got {len(sensors)}.")
    lead_back = np.zeros(len(flights))
    if anti_windup == "back_calculation":
        lead_back = dt / np.maximum(_tracking_times(flights, tracking_time), dt)
    settings = (
        anti_windup == "conditional",
        wrapped,
        feed_forward,
        dt,
        math.ceil(dt / LONGEST_STEP - 1e-9),
    )
    steady = np.cos(flights.ref[..., 1])
    inputs = (
        flights.K, flights.start, flights.ref, steady, flights.bounds, flights.waves, lead_back,
        per_speed, gravity,
    )  # fmt: skip
    from flighttune.simulate.batch.sampled import fly_block

    flown, outputs = _room(len(flights), t, trajectories)
    at_once = SENSED_AT_ONCE if sensors else len(flights)

    def fly_all_of(first: int, end: int) -> None:
        for part in _parts(first, end, at_once):
            fly_block(part, _sensor_errors(sensors, part, len(t), dt), inputs, settings, t, outputs)

    _in_blocks(fly_all_of, len(flights), threads)
    return flown


def fly_continuous(
    flights: Flights,
    *,
    dt: float,
    duration: float,
    anti_windup: Literal["none", "back_calculation"] = "none",
    tracking_time: float | None = None,
    roll: Roll = "below_90_deg",
    tolerance: float = 1e-9,
    trajectories: bool = False,
    g: float = G_PAPER,
    threads: int | None = None,
) -> FlownBatch:
    """Fly the paper's continuous law with magnitude limits, to within 1e-6 rad.

    Parameters
    ----------
    flights : Flights
        N flights, each with a constant reference and without rate limits.
    dt, duration : float, s
        Time between the samples reported, and time to fly.
    anti_windup, tracking_time, roll
        As in `continuous_flight`.
    tolerance : float, 1
        Absolute and relative tolerance of a step. The default keeps the errors below 1e-7 rad.
    trajectories, g, threads
        As in `fly_sampled`.

    Returns
    -------
    FlownBatch
        A flight that left the law ends with the first sample at which it had.

    Raises
    ------
    InputError
        If a value cannot be used, or there are rate limits.
    ShapeError
        If there is a reference over time.

    Notes
    -----
    The law is stated in `continuous_flight`, which also knows rate limits and conditional
    anti-windup. DOP853 with its interpolant runs from corner to corner: between two corners each
    command is either free or held, and the law is smooth; corners are looked for at least every
    10 ms and located to 1e-12 s.
    """
    _check_positive(dt=dt, tracking_time=tracking_time, tolerance=tolerance, g=g)
    _check_anti_windup(anti_windup, ("none", "back_calculation"))
    if roll not in ("below_90_deg", "any"):
        raise InputError(f"`roll` must be below_90_deg or any, got {roll!r}.")
    t = _times(dt, duration)
    if flights.ref.shape[1] != 1:
        raise ShapeError(f"`ref` must be constant, got {flights.ref.shape[1]} samples.")
    if np.isfinite(flights.bounds[:, 2:]).any():
        raise InputError("`bounds` must have no rate limits in the continuous law.")
    lead = np.zeros(len(flights))
    if anti_windup == "back_calculation":
        lead = 1.0 / _tracking_times(flights, tracking_time)
    inputs = (flights.K, flights.start, flights.ref, flights.bounds, flights.waves, lead)
    settings = (roll == "below_90_deg", math.ceil(dt / LONGEST_LOOK - 1e-9), tolerance, g)
    from flighttune.simulate.batch.exact import fly_block

    flown, outputs = _room(len(flights), t, trajectories)
    _in_blocks(
        lambda *block: fly_block(block, inputs, settings, t, outputs),
        len(flights),
        threads,
    )
    return flown


def _sensor_errors(
    sensors: Sequence[Sensors], part: tuple[int, int], samples: int, dt: float
) -> FloatArray:
    """Errors of the sensors of the flights of `part`, shape (flights, samples, 3)."""
    flights = part[1] - part[0]
    chosen = sensors[slice(*part)] if len(sensors) > 1 else sensors[:flights]
    made = np.array([one.errors(samples, dt) for one in chosen])
    return np.resize(made, (flights if sensors else 0, samples, len(SENSED)))


def _parts(first: int, end: int, most: int) -> list[tuple[int, int]]:
    """The range from `first` to `end` in parts of at most so many; an empty range is one part."""
    begins = range(first, end, max(most, 1)) or [first]
    return [(begin, min(begin + max(most, 1), end)) for begin in begins]


def _room(flights: int, t: FloatArray, trajectories: bool) -> tuple[FlownBatch, tuple[Any, ...]]:
    kept = np.full((flights if trajectories else 0, len(t), len(SIGNALS)), np.nan)
    flown = FlownBatch(
        t=t,
        metrics=np.empty((flights, 2, len(MEASURES))),
        samples=np.zeros(flights, dtype=np.int64),
        ends=np.zeros(flights, dtype=np.int64),
        last=np.empty((flights, len(SIGNALS))),
        trajectories=kept if trajectories else None,
    )
    return flown, (flown.metrics, flown.samples, flown.ends, flown.last, kept)


def _in_blocks(fly: Callable[[int, int], Any], flights: int, threads: int | None) -> None:
    """Fly all flights in blocks that the threads take one after the other."""
    threads = _cores() if threads is None else threads
    if threads < 1:
        raise InputError(f"`threads` must be at least 1, got {threads}.")
    if threads == 1:
        fly(0, flights)
        return
    edges = np.linspace(0, flights, min(flights, threads * BLOCKS_PER_THREAD) + 1).astype(int)
    fly(0, 0)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(fly, edges[:-1].tolist(), edges[1:].tolist()))


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _times(dt: float, duration: float) -> FloatArray:
    if not (math.isfinite(duration) and duration >= dt):
        raise InputError(f"`duration` must be at least one sample ({dt} s), got {duration} s.")
    return np.arange(round(duration / dt) + 1, dtype=np.float64) * dt


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


def _check_positive(**values: float | None) -> None:
    for name, value in values.items():
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"`{name}` must be positive, got {value}.")


def _check_anti_windup(given: str, known: tuple[str, ...]) -> None:
    if given not in known:
        raise InputError(
            f"`anti_windup` must be {', '.join(known[:-1])} or {known[-1]}, got {given!r}."
        )
