"""Bounds of signals over time, and claims as a run has them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray

if TYPE_CHECKING:
    import pandas as pd

ERRORS = ("chi_err", "gamma_err")

# Half width (rad) below which bounds count as that wide: a tube may begin at a point
NARROWEST = 1e-9

# Tubes are proven, bands are counted.
Kind: TypeAlias = Literal["proven", "counted"]


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """Lowest and highest values of m signals at n times."""

    t: FloatArray  # (n,), s
    # `low` and `high`: (n, m), in the units of the signals; NaN where nothing is claimed
    low: FloatArray
    high: FloatArray
    names: tuple[str, ...] = ERRORS

    @property
    def pairs(self) -> FloatArray:
        """Lower and upper bounds, shape (n, m, 2)."""
        return np.stack([self.low, self.high], axis=-1)

    @property
    def half_widths(self) -> FloatArray:
        """Half the distance between the bounds, shape (n, m)."""
        return 0.5 * (self.high - self.low)

    def of(self, names: Sequence[str]) -> "Bounds":
        """The bounds of some of the signals."""
        places = [self.names.index(name) for name in names]
        return Bounds(self.t, self.low[:, places], self.high[:, places], tuple(names))

    def lasting(self, t: FloatArray) -> "Bounds":
        """The bounds at the samples `t` of a flight, which they share; NaN where they end."""
        missing = np.full((max(len(t) - len(self.t), 0), len(self.names)), np.nan)
        low, high = (np.concatenate([end, missing])[: len(t)] for end in (self.low, self.high))
        return Bounds(t, low, high, self.names)

    def contain(self, signals: "pd.DataFrame") -> bool:
        """Whether a flight with these signals is inside, as far as the bounds last."""
        values = np.column_stack([signals[name] for name in self.names])
        n = min(len(values), len(self.t))
        low, high = self.low[:n], self.high[:n]
        return bool(((values[:n] >= low) & (values[:n] <= high) | np.isnan(low)).all())

    def distances(self, signals: "pd.DataFrame") -> FloatArray:
        """Distance of the signals of a flight from the middle of the bounds, shape (samples, m)."""
        middle, t = 0.5 * (self.low + self.high), signals.index.to_numpy(dtype=float)
        return np.column_stack(
            [
                np.abs(signals[name].to_numpy() - np.interp(t, self.t, column))
                for name, column in zip(self.names, middle.T, strict=True)
            ]
        )

    def share(self, signals: "pd.DataFrame") -> float:
        """Largest share of the bounds that a flight uses; it leaves them beyond 1.

        Inside, it is the largest distance from the middle over the largest half width of its
        signal: a share of the width at each time would be large at the start of every flight,
        where a tube is narrow.
        """
        t = signals.index.to_numpy(dtype=float)
        widths = [np.interp(t, self.t, column) for column in self.half_widths.T]
        pointwise = self.distances(signals) / np.maximum(np.column_stack(widths), NARROWEST)
        largest = float(pointwise.max())
        return largest if largest > 1.0 else float(self.reach(signals).max())

    def reach(self, signals: "pd.DataFrame") -> FloatArray:
        """Largest distance of a flight from the middle over the largest half width, shape (m,)."""
        half = np.maximum(self.half_widths.max(axis=0), NARROWEST)
        return self.distances(signals).max(axis=0) / half

    def ratios(self, signals: "pd.DataFrame") -> dict[str, float]:
        """Largest half width over the largest distance of a flight from the middle, by channel."""
        ratios = self.half_widths.max(axis=0) / self.distances(signals).max(axis=0)
        names = [name.removesuffix("_err") for name in self.names]
        return dict(zip(names, ratios.tolist(), strict=True))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunClaim:
    """A claim about flights, as one run that it covers has it."""

    kind: Kind
    title: str  # a few words, for legends
    sentence: str  # the claim in words
    bounds: Bounds  # of the signals that it is about, at the samples of the run
    units: Mapping[str, str]  # of these signals
    # rings of the fences that it is about, longitudes and latitudes, deg
    fences: tuple[list[list[float]], ...] = ()

    def contains(self, signals: "pd.DataFrame") -> bool:
        """Whether the flight with these signals is inside the bounds."""
        return self.bounds.contain(signals)

    def around(self, signal: str) -> FloatArray | None:
        """Lower and upper bound of a signal, shape (2, samples); None if it has none."""
        if signal not in self.bounds.names:
            return None
        return self.bounds.pairs[:, self.bounds.names.index(signal)].T


def claims_around(claims: Sequence[RunClaim], signal: str) -> Iterator[tuple[RunClaim, FloatArray]]:
    """The claims that bound a signal, with its bounds, shape (2, samples) each."""
    for claim in claims:
        if (ends := claim.around(signal)) is not None:
            yield claim, ends
