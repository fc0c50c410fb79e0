"""Bands: bounds of signals over time, learned from some flights and counted on fresh ones."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias
from zipfile import ZipFile

import numpy as np
import numpy.typing as npt
from pydantic import Field

from flighttune.array_file import FLOAT, SINGLE, TEXT, check_shapes, read_arrays
from flighttune.arrays import FloatArray, check_between
from flighttune.errors import InputError
from flighttune.guarantee.bounds import Bounds
from flighttune.guarantee.count import allowed_outside, counted_scale
from flighttune.present.tables import number
from flighttune.seal import BLANK, MARK, seal, sealed_bytes
from flighttune.table_file import json_object
from flighttune.value_file import STRICT, tables_of, value_of
from flighttune.whole_file import whole_file

# Axis of the windows.
Over: TypeAlias = Literal["time", "along"]

# Most windows of a flight, and most numbers kept of all flights that are counted.
MAX_WINDOWS, MAX_NUMBERS = 200, 2**27

# Fewest learned flights that must have been completed.
MIN_LEARNED = 10

# Shapes that are tried: the part of the learned flights inside at each time, before it is scaled,
# and a constant added to every half-width, as a share of the largest. Without a constant the band
# is narrow where flights agree; with a large one it is equally wide at all times.
INSIDE = (0.98, 0.99, 0.995, 1.0)
ADDED = (0.0, 0.03, 0.06, 0.1, 0.2, 0.4, 0.8, 1.6)

# Parts of the learned flights; a shape is learned from all but one of them, and scaled by that one.
FOLDS = 5

# Smallest half-width, as a share of the largest of its signal, and absolute: flights that agree to
# the last digit need some width.
LEAST_SHARE, LEAST = 1e-3, 1e-9

# Flights scored at a time: those of the largest count do not fit into memory as doubles.
PART = 4096

# Rounding of the scale between machines, relative.
ROUNDING = 1e-9

# Lowest and highest value of each signal in each window in single precision, shape (N, windows,
# signals, 2) of N flights. A flight that was not completed has -inf and inf.
Extremes: TypeAlias = npt.NDArray[np.floating]

ARRAYS = {"band": TEXT, "extremes": SINGLE, "wind": FLOAT}


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """The shape of a band, the flights that it is about, and its claim."""

    signals: dict[str, str]  # units by name
    over: Over = "time"  # axis of the windows: time, or the distance along a route
    edges: FloatArray  # (windows + 1,), s or m
    # (1 or 10, windows, signals): the middle of the band, by the terms of the wind
    coefficients: FloatArray
    half: FloatArray  # (windows, signals): half-width at scale 1
    predicted_from: Literal["wind"] | None  # what the middle is predicted from
    distribution: str  # of the flights, in words
    plan: dict[str, Any]  # of the campaign; draws from `learned` on are counted
    learned: Annotated[
        int, Field(ge=MIN_LEARNED, le=10**9)
    ]  # number of draws that the shape was learned from
    readings: tuple[int, ...]  # numbers of flights counted each time that the band was read
    epsilon: float
    confidence: float  # of each reading
    scale: float | None  # None if too many flights were not completed

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune band 1"
    UNITS: ClassVar[Mapping[str, str]] = {"edges": "s, or m along", "half": "as in signals"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Band:
    """A band with its claim, and what is kept of the flights that were counted."""

    about: About
    extremes: Extremes
    wind: FloatArray  # (N, 2), m/s north and east if the band is given the wind, else (N, 0)
    scores: FloatArray = field(init=False)  # (N,): scale at which each flight is just inside

    def __post_init__(self) -> None:
        about = self.about
        scores = scores_of(self.extremes, self.wind, about.coefficients, about.half)
        object.__setattr__(self, "scores", scores)

    @property
    def scale(self) -> float:
        """Factor on the half-widths; infinite if nothing is claimed."""
        return np.inf if self.about.scale is None else self.about.scale

    @property
    def outside(self) -> int:
        """Number of counted flights outside."""
        return int(np.sum(self.scores > self.scale))

    @property
    def not_completed(self) -> int:
        """Number of counted flights that were not completed."""
        return int(np.isinf(self.scores).sum())

    @property
    def confidence(self) -> float:
        """Confidence of all readings together: each spends its part of the error probability."""
        return 1.0 - len(self.about.readings) * (1.0 - self.about.confidence)

    @property
    def half_widths(self) -> FloatArray:
        """Half the width of each window and signal, shape (windows, signals)."""
        return self.scale * self.about.half

    @property
    def nearest(self) -> int:
        """Draw of the flight inside that is nearest to leaving."""
        inside = np.where(self.scores <= self.scale, self.scores, -np.inf)
        return self.about.learned + int(np.argmax(inside))

    @property
    def sentence(self) -> str:
        """The claim in words."""
        about, flights = self.about, len(self.scores)
        if about.scale is None:
            allowed = allowed_outside(flights, about.epsilon, about.confidence)
            return (
                f"of {flights} fresh flights {self.not_completed} did not complete, and at most "
                f"{allowed} may: nothing is claimed of a flight of {about.distribution}"
            )
        knowing = ", around the middle that its wind predicts," if about.predicted_from else ""
        times = len(about.readings)
        read = f" (the count was read {times} times)" if times > 1 else ""
        return (
            f"of {flights} fresh flights {self.outside} lie outside: a new flight of "
            f"{about.distribution}{knowing} leaves the band with probability at most "
            f"{number(about.epsilon)}, confidence {self.confidence:.10g}{read}"
        )

    def claiming(self, epsilon: float, confidence: float) -> "Band":
        """The same count with another claim; InputError if its flights are too few."""
        scale, _ = counted_scale(self.scores, epsilon, confidence)
        stated = scale if np.isfinite(scale) else None
        about = replace(self.about, epsilon=epsilon, confidence=confidence, scale=stated)
        band = replace(self, about=about)
        check_between(0.0, 1.0, confidence=band.confidence)
        return band

    def with_flights(self, extremes: Extremes, wind: FloatArray) -> "Band":
        """The band after more flights were counted and it was read once more."""
        about = self.about
        readings = (*about.readings, len(self.extremes) + len(extremes))
        grown = Band(
            about=replace(about, readings=readings),
            extremes=np.concatenate([self.extremes, extremes]),
            wind=np.concatenate([self.wind, wind]),
        )
        return grown.claiming(about.epsilon, about.confidence)

    def bounds(self, t: FloatArray, wind: FloatArray | None = None) -> Bounds:
        """The band at the times `t` (s), or the distances along a route (m).

        `wind`, (2,), is the wind that it is given, if any.
        """
        about = self.about
        winds = np.zeros((1, 0)) if wind is None else np.reshape(wind, (1, 2))
        if (about.predicted_from is None) != (wind is None):
            raise InputError(f"`wind` must be there for a band that is given it only, got {wind}.")
        window = np.searchsorted(about.edges, t, side="right") - 1
        window = np.clip(window, 0, len(about.half) - 1)
        middle = predicted(winds, about.coefficients)[0]
        low, high = (middle + sign * self.half_widths for sign in (-1.0, 1.0))
        return Bounds(np.asarray(t, dtype=float), low[window], high[window], tuple(about.signals))


def window_edges(samples: int, flights: int, signals: int) -> npt.NDArray[np.intp]:
    """First samples of the windows of a flight, and the last sample of all.

    There are fewer windows if so many `flights` are counted that their extremes would not fit.
    """
    fitting = MAX_NUMBERS // (2 * flights * signals)
    count = max(1, min(MAX_WINDOWS, fitting, samples - 1))
    return np.round(np.linspace(0, samples - 1, count + 1)).astype(np.intp)


def window_extremes(values: FloatArray, edges: npt.NDArray[np.intp]) -> Extremes:
    """Extremes of one flight in windows that include both of their edges, rounded outwards.

    `values` has shape (samples, signals); the result (windows, signals, 2). A signal without a
    value in a window may have had any.
    """
    low, high = (
        extreme(extreme.reduceat(values[:-1], edges[:-1]), values[edges[1:]])
        for extreme in (np.fmin, np.fmax)
    )
    outwards = [
        np.nextafter(np.nan_to_num(ends, nan=far).astype(np.float32), np.float32(far))
        for ends, far in ((low, -np.inf), (high, np.inf))
    ]
    return np.stack(outwards, axis=-1)


def scores_of(
    extremes: Extremes, wind: FloatArray, coefficients: FloatArray, half: FloatArray
) -> FloatArray:
    """Scale at which each flight is just inside at all times; infinite if it was not completed."""
    parts = [np.zeros(0)]
    for first in range(0, len(extremes), PART):
        part = slice(first, first + PART)
        middle = predicted(wind[part], coefficients)
        away = np.abs(extremes[part] - middle[..., None]).max(axis=-1)
        parts.append((away / half).max(axis=(1, 2)))
    return np.concatenate(parts)


def learned_shape(
    extremes: Extremes, wind: FloatArray, epsilon: float
) -> tuple[FloatArray, FloatArray]:
    """Middle and half-widths of a band, `About.coefficients` and `About.half`.

    The middle is fitted by least squares. Of all shapes each signal takes the one that is narrowest
    after it is learned from some of the flights and scaled by the others: in its largest half-width
    and in its geometric mean over time. The scale is that of the last `epsilon` of the flights, so
    that all signals are left about equally often. Raises InputError if fewer than `MIN_LEARNED`
    flights were completed.
    """
    completed = np.isfinite(extremes).all(axis=(1, 2, 3))
    extremes, wind = extremes[completed], wind[completed]
    if len(extremes) < MIN_LEARNED:
        raise InputError(
            f"`learn` must have {MIN_LEARNED} flights that are completed, got {len(extremes)}."
        )
    middles = extremes.mean(axis=-1, dtype=float)
    fit, *_ = np.linalg.lstsq(_terms(wind), middles.reshape(len(middles), -1), rcond=None)
    coefficients = fit.reshape(-1, *middles.shape[1:])
    away = extremes - predicted(wind, coefficients)[..., None]
    shapes = [_narrowest(away[:, :, i], epsilon) for i in range(away.shape[2])]
    centres, halves = (np.stack(columns, axis=1) for columns in zip(*shapes, strict=True))
    coefficients[0] += centres
    return coefficients, halves


def _narrowest(away: FloatArray, epsilon: float) -> tuple[FloatArray, FloatArray]:
    """Centre and half-width of the narrowest shape of one signal, shape (windows,) each."""
    flights, best = np.arange(len(away)), (np.inf, 0.0, 0.0, 0.0)
    for inside in INSIDE:
        folds = [
            (away[flights % FOLDS == fold], *_hull(away[flights % FOLDS != fold], inside))
            for fold in range(FOLDS)
        ]
        for added in ADDED:
            scores, logs = [], []
            for others, centre, hull in folds:
                half = _widened(hull, added)
                scores.append(np.abs(others - centre[:, None]).max(axis=-1) / half)
                logs.append(np.log(half))
            largest = np.sort(np.concatenate(scores).max(axis=1))[-1 - int(epsilon * len(away)) :]
            scale, log = np.mean(np.log(largest)), np.mean(logs, axis=0)
            best = min(best, (2.0 * scale + log.max() + log.mean(), inside, added, scale))
    _, inside, added, scale = best
    centre, hull = _hull(away, inside)
    return centre, np.exp(scale) * _widened(hull, added)


def _hull(away: FloatArray, inside: float) -> tuple[FloatArray, FloatArray]:
    """Centre and half-width that have a share `inside` of flights below, and above, at each time.

    Each window also takes those of its neighbours: the quantiles of few flights are ragged.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    low = minimum_filter1d(np.quantile(away[..., 0], 1.0 - inside, axis=0), 3, mode="nearest")
    high = maximum_filter1d(np.quantile(away[..., 1], inside, axis=0), 3, mode="nearest")
    return 0.5 * (low + high), 0.5 * (high - low)


def _widened(half: FloatArray, added: float) -> FloatArray:
    """Half-widths with a share of the largest of them added."""
    largest = max(half.max(), LEAST)
    return np.maximum(half, LEAST_SHARE * largest) + added * largest


def predicted(wind: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Middles of the band in these winds, shape (N, windows, signals)."""
    return np.einsum("nc,cws->nws", _terms(wind), coefficients)


def _terms(wind: FloatArray) -> FloatArray:
    """All products of at most three wind components, shape (N, 10); (N, 1) without them."""
    if not wind.shape[1]:
        return np.ones((len(wind), 1))
    north, east = wind.T
    return np.column_stack([north**i * east**j for i in range(4) for j in range(4 - i)])


def save_band(band: Band, path: str | Path) -> None:
    """Write a band with its SHA-256, whole or not at all; OutputError if it cannot be written."""
    about = np.array(json.dumps(tables_of(band.about)))
    with whole_file(Path(path)) as part:
        with part.open("wb") as file:
            np.savez_compressed(file, band=about, extremes=band.extremes, wind=band.wind)
        with ZipFile(part, "a") as archive:
            archive.comment = BLANK.encode()  # at the end of the file, and of no checksum of it
        part.write_bytes(seal(part.read_bytes()))


def is_band_file(path: str | Path) -> bool:
    """Whether `path` is a file of the kind that `save_band` writes: its seal stands at its end."""
    return Path(path).is_file() and Path(path).read_bytes()[-len(BLANK) :].startswith(MARK)


def load_band(path: str | Path) -> Band:
    """Read a band, and compute its scores and scale.

    Raises InputError if the file cannot be read, is not as it was written, is no band, or claims
    what its flights do not support; the message names the file and what is wrong.
    """
    sealed_bytes(Path(path), "band file", "count it again with flighttune band")
    size = 4 * MAX_NUMBERS + 2**24
    try:
        arrays = read_arrays(Path(path), "band", ARRAYS, size, size, ("extremes",))
        about = value_of(json_object(str(arrays.pop("band")), "`band`"), About)
        _check(about, arrays)
        band = Band(about=about, **arrays)
        scale = band.claiming(about.epsilon, about.confidence).scale
        if not np.isclose(scale, band.scale, rtol=ROUNDING, atol=0.0):
            raise InputError(f"`scale` must be {scale} for the flights, got {about.scale}.")
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return band


def _check(about: About, arrays: dict[str, Any]) -> None:
    """Refuse a shape that cannot be one, and arrays of other flights than the readings state."""
    signals, flights = len(about.signals), [0, *about.readings]
    windows, terms = len(about.half) if about.half.ndim else 0, 10 if about.predicted_from else 1
    for name, shape in (
        ("half", (windows, signals)),
        ("coefficients", (terms, windows, signals)),
        ("edges", (windows + 1,)),
    ):
        if not windows * signals or getattr(about, name).shape != shape:
            raise InputError(f"`{name}` must have shape {shape}.")
    if not (about.half > 0.0).all() or not (np.diff(about.edges) > 0.0).all():
        raise InputError("`half` must be positive, and `edges` must rise.")
    if len(flights) < 2 or any(a >= b for a, b in pairwise(flights)):
        raise InputError(f"`readings` must rise, got {list(about.readings)}.")
    shapes = {
        "extremes": (flights[-1], windows, signals, 2),
        "wind": (flights[-1], 2 if about.predicted_from else 0),
    }
    check_shapes("band", arrays, shapes)
    low, high = np.moveaxis(arrays["extremes"], -1, 0)
    if not (low <= high).all():  # also catches NaN
        raise InputError("`extremes` must be lowest and highest values.")
