"""Bounds of a tube over time, and how near a flight comes to them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.simulate.run import Run

ERRORS = ("chi_err", "gamma_err")

NARROWEST = 1e-9
"""Half width (rad) below which a tube counts as that wide: it may begin at a point."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TubeBounds:
    """Bounds of the errors of a flight."""

    t: FloatArray  # (n,), s
    low: FloatArray  # (n, 2), rad; errors of course and flight-path angle
    high: FloatArray  # (n, 2), rad

    @classmethod
    def read(cls, path: str | Path) -> "TubeBounds":
        """The bounds in the Parquet file of signals that ``flighttune tube`` wrote."""
        from flighttune.tube.sealed import AboutTube, read_sealed

        names = [f"{name}_{end}" for end in ("low", "high") for name in ERRORS]
        _, t, bounds = read_sealed(Path(path), AboutTube, names)
        low, high = bounds[:, :2], bounds[:, 2:]
        if not (len(t) and (high >= low).all()):
            raise InputError(f"{path}: must hold lower bounds below upper ones, got others.")
        return cls(t=t, low=low, high=high)

    def distances(self, run: Run) -> FloatArray:
        """Distance of the errors of a flight from the middle of the tube, shape (samples, 2)."""
        t = run.signals.index.to_numpy(dtype=float)
        middle = 0.5 * (self.low + self.high)
        return np.column_stack(
            [
                np.abs(run.signals[name].to_numpy() - np.interp(t, self.t, column))
                for name, column in zip(ERRORS, middle.T, strict=True)
            ]
        )

    def share(self, run: Run) -> float:
        """Largest share of the tube that a flight uses; it leaves the tube beyond 1.

        Inside the tube it is the largest distance from the middle over the largest half width of
        its channel: a share of the width at each time would be large at the start of every
        flight, where the tube is narrow.
        """
        t = run.signals.index.to_numpy(dtype=float)
        half = 0.5 * (self.high - self.low)
        widths = np.column_stack([np.interp(t, self.t, column) for column in half.T])
        pointwise = float(np.max(self.distances(run) / np.maximum(widths, NARROWEST)))
        return pointwise if pointwise > 1.0 else max(self.reach(run))

    def reach(self, run: Run) -> list[float]:
        """Largest distance of a flight from the middle over the largest half width, by channel."""
        half = np.maximum(0.5 * (self.high - self.low).max(axis=0), NARROWEST)
        return (self.distances(run).max(axis=0) / half).tolist()

    def ratios(self, run: Run) -> dict[str, float]:
        """Largest half width over the largest distance of a flight from the middle, by channel."""
        half, away = 0.5 * (self.high - self.low), self.distances(run)
        return {
            name.removesuffix("_err"): float(half[:, i].max() / away[:, i].max())
            for i, name in enumerate(ERRORS)
        }

    def as_dict(self) -> dict[str, Any]:
        """The bounds as plain values; `of` reads them."""
        return {name: getattr(self, name).tolist() for name in ("t", "low", "high")}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "TubeBounds":
        """The bounds that `as_dict` wrote."""
        return cls(**{name: np.array(values[name]) for name in ("t", "low", "high")})
