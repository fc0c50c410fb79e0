"""Bounds of signals over time: of a tube, a certificate, counted boxes, and a flight's share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.simulate.run import BAND_ENDS, Run

ERRORS = ("chi_err", "gamma_err")

# Half width (rad) below which bounds count as that wide: a tube may begin at a point
NARROWEST = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """Lowest and highest values of m signals at n times."""

    t: FloatArray  # (n,), s
    # `low` and `high`: (n, m), in the units of the signals; NaN where nothing is claimed
    low: FloatArray
    high: FloatArray
    names: tuple[str, ...] = ERRORS

    @classmethod
    def of(cls, columns: Mapping[str, Any], names: tuple[str, ...] = ERRORS) -> "Bounds":
        """The bounds in `columns`, which are named as those of the property."""
        low, high = (
            np.column_stack([columns[f"{name}_{end}"] for name in names]) for end in ("low", "high")
        )
        return cls(np.asarray(columns["t"], dtype=float), low, high, names)

    @property
    def columns(self) -> dict[str, FloatArray]:
        """``t``, and ``chi_err_low``, ``chi_err_high`` and so on for each signal."""
        ends = {
            f"{name}_{end}": values[:, i]
            for i, name in enumerate(self.names)
            for end, values in (("low", self.low), ("high", self.high))
        }
        return {"t": self.t, **ends}

    @property
    def pairs(self) -> FloatArray:
        """Lower and upper bounds, shape (n, m, 2)."""
        return np.stack([self.low, self.high], axis=-1)

    @property
    def half_widths(self) -> FloatArray:
        """Half the distance between the bounds, shape (n, m)."""
        return 0.5 * (self.high - self.low)

    def contain(self, signals: Any) -> bool:
        """Whether a flight with these signals is inside, as far as the bounds last."""
        flown = np.column_stack([signals[name] for name in self.names])
        n = min(len(flown), len(self.t))
        return bool(((flown[:n] >= self.low[:n]) & (flown[:n] <= self.high[:n])).all())

    def around(self, run: Run) -> Run:
        """The run with the bounds as signals; NaN where they do not last."""
        columns = self.columns
        del columns["t"]
        return with_columns(run, columns)

    def distances(self, run: Run) -> FloatArray:
        """Distance of the signals of a flight from the middle of the bounds, shape (samples, m)."""
        middle = 0.5 * (self.low + self.high)
        return np.column_stack(
            [
                np.abs(run.signals[name].to_numpy() - np.interp(run.t, self.t, column))
                for name, column in zip(self.names, middle.T, strict=True)
            ]
        )

    def share(self, run: Run) -> float:
        """Largest share of the bounds that a flight uses; it leaves them beyond 1.

        Inside, it is the largest distance from the middle over the largest half width of its
        signal: a share of the width at each time would be large at the start of every flight,
        where a tube is narrow.
        """
        widths = [np.interp(run.t, self.t, column) for column in self.half_widths.T]
        pointwise = self.distances(run) / np.maximum(np.column_stack(widths), NARROWEST)
        largest = float(pointwise.max())
        return largest if largest > 1.0 else float(self.reach(run).max())

    def reach(self, run: Run) -> FloatArray:
        """Largest distance of a flight from the middle over the largest half width, shape (m,)."""
        half = np.maximum(self.half_widths.max(axis=0), NARROWEST)
        return self.distances(run).max(axis=0) / half

    def ratios(self, run: Run) -> dict[str, float]:
        """Largest half width over the largest distance of a flight from the middle, by channel."""
        ratios = self.half_widths.max(axis=0) / self.distances(run).max(axis=0)
        names = [name.removesuffix("_err") for name in self.names]
        return dict(zip(names, ratios.tolist(), strict=True))


def band_of(run: Run, signal: str) -> FloatArray | None:
    """Lower and upper end of the counted band around a signal, shape (2, samples)."""
    names = [f"{signal}{end}" for end in BAND_ENDS]
    return run.signals[names].to_numpy().T if {*names} <= {*run.signals} else None


def band_along(run: Run, signal: str, s: FloatArray) -> FloatArray | None:
    """Both ends of the band around a signal at distances along a route (m), shape (2, n)."""
    if (ends := band_of(run, signal)) is None:
        return None
    return np.array([np.interp(s, along_route(run), end) for end in ends])


def along_route(run: Run) -> FloatArray:
    """Distance of each sample along the route, m; its nearest point may go back a little."""
    return np.maximum.accumulate(run.signals["along"].to_numpy())


def inside_bands(runs: Sequence[Run]) -> dict[str, bool]:
    """Whether each run around which a counted band is drawn is inside, by label."""
    inside = {}
    for run in runs:
        low, high = (run.signals.filter(regex=f"{end}$") for end in BAND_ENDS)
        names = [str(name).removesuffix(BAND_ENDS[0]) for name in low]
        if names:
            bounds = Bounds(run.t, low.to_numpy(), high.to_numpy(), tuple(names))
            inside[run.label] = bounds.contain(run.signals)
    return inside


def band_notes(runs: Sequence[Run]) -> list[str]:
    """Whether runs are inside the counted bands drawn around them, and what these claim."""
    inside = inside_bands(runs)
    words = {True: "inside", False: "outside"}
    said = [f"{label}: {words[is_inside]} the band" for label, is_inside in inside.items()]
    return said + [f"Band: {claim}" for claim in dict.fromkeys(run.band for run in runs) if claim]


def with_columns(run: Run, columns: Mapping[str, FloatArray]) -> Run:
    """The run with more signals, which are cut to its length or end with NaN."""
    longer = {name: cut_to(len(run.signals), values) for name, values in columns.items()}
    return replace(run, signals=run.signals.assign(**longer))


def cut_to(samples: int, values: FloatArray) -> FloatArray:
    """The first of `values`, followed by NaN where there are fewer than `samples`."""
    return np.append(values, np.full(max(samples - len(values), 0), np.nan))[:samples]
