"""A tube: the bounds found, and what makes their proof short to check."""

from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.conformance.probability import CountedProbability
from flighttune.tube.forms import Pieces
from flighttune.tube.hand_over import HandOver
from flighttune.tube.problem import TubeProblem
from flighttune.tube.sample import CONSTRAINTS, start_set

QUANTITIES = ("chi_err", "gamma_err", "phi_cmd", "n_z_cmd")
"""Quantities that a tube bounds: errors in rad, commands in rad and 1."""


class Settings(NamedTuple):
    """Settings of an enclosure."""

    sides: int  # pieces of the starts along each axis
    symbols: int  # most symbols of a piece
    tolerance: float  # see `Search`
    most: int  # most pieces, see `Search`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tube:
    """Bounds that hold for every flight of a problem."""

    problem: TubeProblem
    status: Literal["bounded", "unbounded"]  # whether the bounds last for the whole time
    reason: str  # time and cause where they do not
    t: FloatArray  # shape (k,), s: times of the samples, up to where the bounds last
    # shape (k, 4, 2): lower and upper bound of `QUANTITIES`. The errors stay between the straight
    # lines from sample to sample, measured to the reference that moves straight as well.
    bounds: FloatArray
    # shape (k, 2): whether a limit can hold the command of roll and of load factor
    held: npt.NDArray[np.bool_]
    settings: Settings
    # shape (n,), float32: choices that make the proof short: slopes, splits, symbols given up
    chosen: npt.NDArray[np.float32]
    # Set in which the flights stay for ever; None where no such set was found
    hand_over: HandOver | None = None
    # Sample from which on nothing is enclosed: there the errors are in the boxes counted for them,
    # before it in both. None where the whole time is enclosed.
    lost: int | None = None

    @property
    def counted_from(self) -> float | None:
        """Time from which on the bounds are those counted, s."""
        return None if self.lost is None else float(self.problem.t[self.lost])

    @property
    def handed_over(self) -> float | None:
        """Time from which on the flights are in a set that they never leave, s."""
        dt = 1.0 / self.problem.scenario.controller.rate_hz
        return None if self.hand_over is None else self.hand_over.sample * dt

    @property
    def model(self) -> str:
        """The model that flies, in words."""
        return self.problem.model

    @property
    def probability(self) -> CountedProbability | None:
        """Probability counted for an aircraft, of its flights if all of them are in the tube.

        None without a conformance.
        """
        problem = self.problem
        if problem.conformance is None:
            return None
        return problem.conformance.probability(
            problem.scenario,
            problem.scenario.plant_table(problem.plant),
            problem.start,
            counted_only=self.lost == 0,
        )

    @property
    def half_widths(self) -> FloatArray:
        """Half the distance between the bounds, shape (k, 4)."""
        return 0.5 * (self.bounds[:, :, 1] - self.bounds[:, :, 0])

    def contains(self, signals: Any) -> bool:
        """Whether the flight with these `signals` (a table with `QUANTITIES`) is inside."""
        flown = np.stack([np.asarray(signals[name]) for name in QUANTITIES], axis=1)
        n = min(len(flown), len(self.bounds))
        low, high = np.moveaxis(self.bounds[:n], 2, 0)
        return bool(((flown[:n] >= low) & (flown[:n] <= high)).all())

    def held_intervals(self, channel: int) -> list[tuple[float, float]]:
        """Intervals, s, in which a limit can hold the command of a channel."""
        edges = np.diff(np.concatenate([[False], self.held[:, channel], [False]]).astype(int))
        begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
        return [(float(self.t[a]), float(self.t[b])) for a, b in zip(begins, ends, strict=True)]


def within_counted(tube: Tube) -> Tube:
    """An unbounded tube of an aircraft, within the errors that were counted for its flights."""
    problem, lost = tube.problem, len(tube.t)
    counted = counted_bounds(problem)
    bounds = counted.copy()
    bounds[:lost] = tightest(tube.bounds, counted[:lost])
    limited = np.ones((len(counted), 2), dtype=bool)
    limited[:lost] = tube.held
    return replace(tube, status="bounded", t=problem.t, bounds=bounds, held=limited, lost=lost)


def counted_bounds(problem: TubeProblem) -> FloatArray:
    """Bounds on `QUANTITIES` that need no model, shape (k, 4, 2): errors counted, and limits."""
    assert problem.counted is not None
    limits = np.stack([problem.limits.lower, problem.limits.upper], axis=1)
    errors = problem.counted.reshape(-1, 2, 2)
    return np.concatenate([errors, np.broadcast_to(limits, errors.shape)], axis=1)


def tightest(*bounds: FloatArray) -> FloatArray:
    """Bounds, shape (..., 2), that hold where all of these do."""
    low = np.max([limits[..., 0] for limits in bounds], axis=0)
    high = np.min([limits[..., 1] for limits in bounds], axis=0)
    return np.stack([low, high], axis=-1)


def first_set(problem: TubeProblem, settings: Settings) -> Pieces:
    """The starts of a problem, in the pieces of the settings."""
    return start_set(problem.loop, problem.start, settings.sides, CONSTRAINTS, settings.symbols)
