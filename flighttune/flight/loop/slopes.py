"""A compiled flight with the slopes of its signals with respect to parameters, in forward mode."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.flight.loop.aircraft import CompiledAircraft
from flighttune.flight.loop.batch import Motion, SampledLaw
from flighttune.flight.loop.duals import Dual, DualArray, Rows, on_duals, step_of_rows
from flighttune.flight.loop.loop import Flight, Seen

# Arrays that the step accesses by address, and other arrays that the loop writes.
STEPPED, WRITTEN = ("states", "parameters", "shown"), ("wind", "memory")

# A quantity below and above the value of a parameter, and the distance between the two.
Sides: TypeAlias = tuple[Any, Any, float]


class Sampled(NamedTuple):
    """A flight after its start: the arguments of `fly_samples`, and its first signals."""

    aircraft: CompiledAircraft
    motion: Motion
    law: SampledLaw
    fed_back: bool  # whether the law sees the load factor that the inner loop follows
    seen: Seen  # errors of the signals that the law sees
    end: float  # m: length of the route
    first: FloatArray
    shape: tuple[int, int]  # samples and columns
    table: Callable[[FloatArray], pd.DataFrame]  # makes the table of the flight from its rows


class SlopedFlight(NamedTuple):
    """A flight and its slopes."""

    rows: FloatArray  # (samples, columns)
    slopes: FloatArray  # (p, samples, columns)
    how: int  # how it ended
    table: Callable[[FloatArray], pd.DataFrame]


def sampled(flight: Flight, aircraft: CompiledAircraft) -> Sampled:
    """The arguments of a compiled flight whose plant and controller have started."""
    (_, motion, law, fed_back, seen), end = flight.sampled(aircraft)
    first = np.array(aircraft.observe())
    shape, table = flight.shape, flight.table
    return Sampled(aircraft, motion, law, fed_back, seen, end, first, shape, table)


def fly_with_slopes(flight: Sampled, sides: Mapping[str, Sides]) -> SlopedFlight:
    """Fly with slopes; `sides` has, for each parameter, the flights below and above its value."""
    from flighttune.flight.loop.compiled import fly_samples

    for name, (*ends, _) in sides.items():
        pairs = (pair for side in ends for pair in zip(side.seen, flight.seen, strict=True))
        if not all(np.array_equal(a, b) for a, b in pairs):
            raise InputError(
                f"`by` must have slopes, got {name}, which changes the errors that the law sees."
            )
    step, normals = flight.aircraft.sloped
    n, slopes = flight.shape[0], np.zeros((len(sides), *flight.shape))
    rows = DualArray(np.zeros(flight.shape), slopes)
    signals = slice(len(flight.first))
    first = {name: (low.first, high.first, width) for name, (low, high, width) in sides.items()}
    rows.values[0, signals] = flight.first
    slopes[:, 0, signals] = _between(flight.first, first)
    motion, law = (
        _tuple_with_slopes(
            getattr(flight, field),
            {x: (getattr(a, field), getattr(b, field), w) for x, (a, b, w) in sides.items()},
        )
        for field in ("motion", "law")
    )
    arguments = motion, law, flight.fed_back, flight.seen, (0, n, flight.end)
    flown, how, _ = on_duals(fly_samples)(step_of_rows(step), normals, *arguments, rows)
    return SlopedFlight(rows.values[:flown], slopes[:, :flown], how, flight.table)


def _tuple_with_slopes(base: Any, sides: Mapping[str, Sides]) -> Any:
    """A tuple with those numbers and arrays as duals that parameters change."""
    fields = {}
    for field, value in base._asdict().items():
        ends = {x: (getattr(a, field), getattr(b, field), w) for x, (a, b, w) in sides.items()}
        fields[field] = _with_slopes(field, value, ends)
    return base._replace(**fields)


def _with_slopes(field: str, value: Any, sides: Mapping[str, Sides]) -> Any:
    if isinstance(value, tuple):
        parts = (
            (x, {name: (a[i], b[i], w) for name, (a, b, w) in sides.items()})
            for i, x in enumerate(value)
        )
        make = getattr(value, "_make", tuple)
        return make(_with_slopes(field, *part) for part in parts)
    array = np.asarray(value)
    counts = array.dtype.kind != "f"
    for name, (*ends, _) in sides.items():
        if any(np.shape(x) != array.shape or (counts and np.any(x != value)) for x in ends):
            raise InputError(
                f"`by` must be numbers that have slopes, got {name}, which changes in steps."
            )
    if counts or field == "stream":  # the stream is a buffer of random numbers
        return value
    slopes = _between(array, sides)
    if field in STEPPED:
        return Rows(array, slopes)
    if field == "numbers":  # read at each sample; most have no slope and stay plain numbers
        pairs = zip(array.tolist(), slopes.T, strict=True)
        return [Dual(x, d.copy()) if d.any() else x for x, d in pairs]
    if not array.shape:
        return Dual(float(value), slopes) if slopes.any() else value
    return DualArray(array, slopes) if slopes.any() or field in WRITTEN else value


def _between(value: FloatArray, sides: Mapping[str, Sides]) -> FloatArray:
    """Slopes by differences of both sides, shape (p, *S) for a value of shape S."""
    with np.errstate(invalid="ignore"):  # limits may be infinite, and feed-forward NaN
        rows = [np.subtract(b, a) / width for a, b, width in sides.values()]
    return np.where(np.isfinite(value), np.array(rows), 0.0)
