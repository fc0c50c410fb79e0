"""Bands: bounds of signals over time, learned from some flights and counted on fresh ones."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias
from zipfile import ZipFile

import numpy as np
import numpy.typing as npt
from pydantic import Field

from flighttune.arrays import FloatArray, check_between
from flighttune.claims.count import allowed_outside, counted_scale
from flighttune.errors import InputError
from flighttune.files.array import FLOAT, SINGLE, TEXT, check_shapes, read_arrays
from flighttune.files.seal import BLANK, seal, sealed_bytes
from flighttune.files.table import json_object
from flighttune.files.value import STRICT, tables_of, value_of
from flighttune.files.whole import whole_file
from flighttune.present.answer import Answer, Answering, pick
from flighttune.present.names import shown_unit
from flighttune.present.tables import Column, Table, number
from flighttune.simulate.bounds import Bounds
from flighttune.simulate.run import SIGNAL_UNITS

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

# Numbers of flights at which a count is read, over the first of them.
DOUBLED = 2 ** np.arange(31)

# Lowest and highest value of each signal in each window in single precision, shape (N, windows,
# signals, 2) of N flights. A flight that was not completed, or whose position its distances from a
# route do not give, has -inf and inf.
Extremes: TypeAlias = npt.NDArray[np.floating]

WIDTH_COLUMNS = [
    Column("signal", "signal"),
    Column("largest", "largest half-width", digits=".2f"),
    Column("last_quarter", "in the last quarter", digits=".2f"),
    Column("end", "at the end", digits=".2f"),
    Column("low", "lowest bound", digits=".2f"),
    Column("high", "highest bound", digits=".2f"),
    Column("unit", "unit"),
]

# Part of the time whose largest half-width is printed too: flights have settled by then.
LAST_QUARTER = 0.75

ARRAYS = {"band": TEXT, "extremes": SINGLE, "wind": FLOAT}


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """The shape of a band, the flights that it is about, and its claim."""

    signals: dict[str, str]  # units by name
    # (1 or 10, windows, signals): the middle of the band, by the terms of the wind
    coefficients: FloatArray
    half: FloatArray  # (windows, signals): half-width at scale 1
    predicted_from: Literal["wind"] | None  # what the middle is predicted from
    # of the campaign; its runs are the flights learned from, and those to be counted first
    plan: dict[str, Any]
    learned: Annotated[
        int, Field(ge=MIN_LEARNED, le=10**9)
    ]  # number of draws that the shape was learned from
    epsilon: float
    confidence: float  # of each claim at each number of flights
    fences: tuple[dict[str, Any], ...] = ()  # GeoJSON in which flights were counted

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune band 2"
    UNITS: ClassVar[Mapping[str, str]] = {"half": "as in signals"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axis:
    """What follows from the plan of a band, and is not in its file."""

    over: Over = "time"  # axis of the windows: time, or the distance along a route
    edges: FloatArray  # (windows + 1,), s or m
    distribution: str  # of the flights, in words
    flights: Table = field(default=Table((), ()))  # with the range of every key that is drawn


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Band(Answering):
    """A band with its claim, and what is kept of the flights that were counted."""

    about: About
    axis: Axis
    extremes: Extremes
    wind: FloatArray  # (N, 2), m/s north and east if the band is given the wind, else (N, 0)
    scores: FloatArray = field(init=False)  # (N,): scale at which each flight is just inside
    scale: float = field(init=False)  # factor on the half-widths; infinite if nothing is claimed

    def __post_init__(self) -> None:
        about = self.about
        scores = scores_of(self.extremes, self.wind, about.coefficients, about.half)
        scale, _ = counted_scale(scores, about.epsilon, about.confidence)
        object.__setattr__(self, "scores", scores)
        object.__setattr__(self, "scale", scale)
        check_between(0.0, 1.0, confidence=self.confidence)

    @property
    def claims(self) -> bool:
        """Whether enough of its flights were completed."""
        return bool(np.isfinite(self.scale))

    @property
    def readings(self) -> tuple[int, ...]:
        """Numbers of flights at which it may have been read, which are fixed beforehand.

        The first is planned, and each is twice the one before.
        """
        numbers = self._first * DOUBLED
        return tuple(numbers[numbers <= len(self.extremes)].tolist())

    @property
    def _first(self) -> int:
        return self.about.plan["runs"] - self.about.learned

    @property
    def draws(self) -> npt.NDArray[np.int64]:
        """Draws of the flights counted."""
        return self.draws_of(len(self.extremes))

    def draws_of(self, flights: int) -> npt.NDArray[np.int64]:
        """Draws of so many flights.

        One draw is left out where the number planned is doubled: a count that was continued then
        has other flights than one planned so long, and cannot pass for it.
        """
        i = np.arange(flights)
        return self.about.learned + i + np.searchsorted(self._first * DOUBLED, i, side="right")

    @property
    def outside(self) -> int:
        """Number of counted flights outside."""
        return int(np.sum(self.scores > self.scale))

    @property
    def not_completed(self) -> int:
        """Number of counted flights that did not complete, or count as if they had not."""
        return int(np.isinf(self.scores).sum())

    @property
    def lost(self) -> str:
        """How many counted flights have infinite extremes, and why, in words."""
        off = " or flew behind their start or back along the route" * (self.axis.over == "along")
        return f"{self.not_completed} did not complete{off}"

    @property
    def confidence(self) -> float:
        """Confidence of all claims together: each spends its part of the error probability."""
        claims = len(self.readings) * (1 + len(self.about.fences))
        return 1.0 - claims * (1.0 - self.about.confidence)

    @property
    def half_widths(self) -> FloatArray:
        """Half the width of each window and signal, shape (windows, signals)."""
        return self.scale * self.about.half

    @property
    def nearest(self) -> int:
        """Draw of the flight inside that is nearest to leaving."""
        inside = np.where(self.scores <= self.scale, self.scores, -np.inf)
        return int(self.draws[np.argmax(inside)])

    @property
    def shared(self) -> str:
        """How many claims share the confidence, in words; empty for a single one."""
        fences, readings = len(self.about.fences), len(self.readings)
        of = ["the band and its fence" if fences == 1 else f"the band and {fences} fences"]
        parts = of * bool(fences) + [f"{readings} numbers of flights"] * (readings > 1)
        return f" (shared by {' at '.join(parts)})" if parts else ""

    @property
    def sentence(self) -> str:
        """The claim in words."""
        about, flights = self.about, len(self.scores)
        if not self.claims:
            allowed = allowed_outside(flights, about.epsilon, about.confidence)
            return (
                f"of {flights} fresh flights {self.lost}, and at most {allowed} may: nothing is "
                f"claimed of {self.axis.distribution}"
            )
        knowing = ", around the middle that its wind predicts," if about.predicted_from else ""
        return (
            f"of {flights} fresh flights {self.outside} lie outside: a new one leaves the band"
            f"{knowing} with probability at most {number(about.epsilon)}, confidence "
            f"{self.confidence:.10g}{self.shared}, if it is of {self.axis.distribution}"
        )

    def claiming(self, epsilon: float, confidence: float) -> "Band":
        """The same count with another claim; InputError if its flights are too few."""
        return replace(self, about=replace(self.about, epsilon=epsilon, confidence=confidence))

    def with_flights(self, extremes: Extremes, wind: FloatArray) -> "Band":
        """The band after more flights were counted."""
        kept = np.concatenate([self.extremes, extremes]), np.concatenate([self.wind, wind])
        return replace(self, extremes=kept[0], wind=kept[1])

    def with_fence(self, tables: dict[str, Any]) -> "Band":
        """The band with a fence whose GeoJSON is `tables`; one that it has is its last then."""
        others = tuple(fence for fence in self.about.fences if fence != tables)
        return replace(self, about=replace(self.about, fences=(*others, tables)))

    def bounds(self, t: FloatArray, wind: FloatArray | None = None) -> Bounds:
        """The band at the times `t` (s), or the distances along a route (m).

        `wind`, (2,), is the wind that it is given, if any.
        """
        about = self.about
        winds = np.zeros((1, 0)) if wind is None else np.reshape(wind, (1, 2))
        if (about.predicted_from is None) != (wind is None):
            raise InputError(f"`wind` must be there for a band that is given it only, got {wind}.")
        window = np.searchsorted(self.axis.edges, t, side="right") - 1
        window = np.clip(window, 0, len(about.half) - 1)
        middle = predicted(winds, about.coefficients)[0]
        low, high = (middle + sign * self.half_widths for sign in (-1.0, 1.0))
        return Bounds(np.asarray(t, dtype=float), low[window], high[window], tuple(about.signals))

    def answer(self, file: str | Path = "FILE") -> Answer:
        """The half-widths of the band in `file` and its claim; a failure if nothing is claimed."""
        about, claims, edges = self.about, self.claims, self.axis.edges
        records = []
        for (name, unit), widths in zip(about.signals.items(), self.half_widths.T, strict=True):
            shown, factor = shown_unit(unit)
            late = edges[:-1] >= LAST_QUARTER * edges[-1]
            ends = {"largest": widths.max(), "last_quarter": widths[late].max(), "end": widths[-1]}
            if not about.predicted_from:
                bounds = self.bounds(edges[:-1])
                at = bounds.names.index(name)
                ends |= {"low": bounds.low[:, at].min(), "high": bounds.high[:, at].max()}
            in_unit = {key: float(width) * factor for key, width in ends.items()}
            records.append({"signal": name, **in_unit, "unit": shown})
        notes = []
        if about.predicted_from:
            notes.append(
                "The band is around a middle that is predicted from the wind of each flight."
            )
        if claims:
            seed = about.plan["campaign"]["seed"]
            notes.append(
                f"Of the flights inside, draw {self.nearest} (seed {seed}) is nearest to leaving: "
                f"flighttune refly {file} --run {self.nearest}"
            )
        return Answer(
            values={
                "status": "claimed" if claims else "nothing_claimed",
                **pick(about, "epsilon predicted_from learned"),
                **pick(self, "scale readings confidence outside not_completed sentence"),
                "distribution": self.axis.distribution,
                "flights": len(self.scores),
                "nearest_draw": self.nearest if claims else None,
            },
            tables=[
                Table(WIDTH_COLUMNS, records if claims else [], "band", name="half_widths"),
                self.axis.flights,
            ],
            notes=notes,
            verdict=self.sentence if claims else "",
            failure="" if claims else self.sentence,
        )


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


def read_band(path: str | Path, axis_of: Callable[[About], Axis]) -> Band:
    """Read a band, and compute its scores and scale; `axis_of` finds its axis from the plan.

    Raises InputError if the file cannot be read, is not as it was written, is no band, or claims
    what its flights do not support; the message names the file and what is wrong.
    """
    sealed_bytes(Path(path), "band file", "count it again with flighttune band")
    size = 4 * MAX_NUMBERS + 2**24
    try:
        arrays = read_arrays(Path(path), "band", ARRAYS, size, size, ("extremes",))
        about = value_of(json_object(str(arrays.pop("band")), "`band`"), About)
        axis = axis_of(about)
        _check(about, axis, arrays)
        band = Band(about=about, axis=axis, **arrays)
        if len(band.extremes) not in band.readings:
            raise InputError(
                "`extremes` must be of as many flights as were planned, or of 2, 4, 8 ... times as "
                f"many, got {len(band.extremes)}."
            )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return band


def _check(about: About, axis: Axis, arrays: dict[str, Any]) -> None:
    """Refuse a shape that cannot be one, and arrays of other windows than the plan has."""
    signals, windows = len(about.signals), len(axis.edges) - 1
    for name, shape in (
        ("half", (windows, signals)),
        ("coefficients", (10 if about.predicted_from else 1, windows, signals)),
    ):
        if not signals or getattr(about, name).shape != shape:
            raise InputError(f"`{name}` must have shape {shape}.")
    if not (about.half > 0.0).all():
        raise InputError("`half` must be positive.")
    for name, unit in about.signals.items():
        if unit != SIGNAL_UNITS.get(name, unit):
            raise InputError(f"`signals`: {name} must be in {SIGNAL_UNITS[name]}, got {unit!r}.")
    flights = len(arrays["extremes"])
    shapes = {
        "extremes": (flights, windows, signals, 2),
        "wind": (flights, 2 if about.predicted_from else 0),
    }
    check_shapes("band", arrays, shapes)
    low, high = np.moveaxis(arrays["extremes"], -1, 0)
    if not (low <= high).all():  # also catches NaN
        raise InputError("`extremes` must be lowest and highest values.")
