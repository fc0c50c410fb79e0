"""A tube: the proven bounds, and what makes their proof short to check."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from flighttune.arrays import FloatArray
from flighttune.conformance.file import CountedProbability
from flighttune.guarantee.bounds import Bounds
from flighttune.tube.hand_over import HandOver
from flighttune.tube.problem import TubeProblem

QUANTITIES = ("chi_err", "gamma_err", "phi_cmd", "n_z_cmd")
"""Quantities that a tube bounds: errors in rad, commands in rad and 1."""

MAX_PIECES, MAX_SYMBOLS = 4096, 20000
"""Numbers in a file above which a proof would only take up time and memory."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of an enclosure."""

    sides: Annotated[int, Field(ge=1, le=64)]  # pieces of the starts along each axis
    symbols: Annotated[int, Field(ge=1, le=MAX_SYMBOLS)]  # most symbols of a piece
    tolerance: float  # see `Search`
    most: Annotated[int, Field(ge=1, le=MAX_PIECES)]  # most pieces, see `Search`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tube:
    """Bounds that hold for every flight of a problem."""

    problem: TubeProblem
    status: Literal["bounded", "unbounded"]  # whether the bounds last for the whole time
    reason: str  # time and cause where they do not
    # Bounds on `QUANTITIES` up to where they last. The errors stay between the straight lines from
    # sample to sample, measured to the reference that moves straight as well.
    bounds: Bounds
    # shape (k, 2): whether a limit can hold the command of roll and of load factor
    can_limit: npt.NDArray[np.bool_]
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
    def probability(self) -> CountedProbability | None:
        """Probability counted for an aircraft, of its flights if all of them are in the tube.

        None without a conformance.
        """
        problem = self.problem
        if problem.conformance is None:
            return None
        return problem.conformance.probability(
            problem.scenario, problem.table, problem.start, counted_only=self.lost == 0
        )

    def held_intervals(self, channel: int) -> list[tuple[float, float]]:
        """Intervals, s, in which a limit can hold the command of a channel."""
        edges = np.diff(np.concatenate([[False], self.can_limit[:, channel], [False]]).astype(int))
        begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
        t = self.bounds.t
        return [(float(t[a]), float(t[b])) for a, b in zip(begins, ends, strict=True)]


def bounds_of(t: FloatArray, pairs: FloatArray) -> Bounds:
    """Bounds on `QUANTITIES` from lower and upper ones, shape (k, 4, 2)."""
    return Bounds(t, pairs[..., 0], pairs[..., 1], QUANTITIES)


def within_counted(tube: Tube) -> Tube:
    """An unbounded tube of an aircraft, within the errors that were counted for its flights."""
    problem, lost = tube.problem, len(tube.bounds.t)
    pairs = counted_bounds(problem)
    pairs[:lost] = tightest(tube.bounds.pairs, pairs[:lost])
    can_limit = np.ones((len(pairs), 2), dtype=bool)
    can_limit[:lost] = tube.can_limit
    bounds = bounds_of(problem.t, pairs)
    return replace(tube, status="bounded", bounds=bounds, can_limit=can_limit, lost=lost)


def counted_bounds(problem: TubeProblem) -> FloatArray:
    """Bounds on `QUANTITIES` that need no model, shape (k, 4, 2): errors counted, and limits."""
    assert problem.boxes is not None
    errors = problem.boxes.bounds.pairs[:, 4:6]
    limits = np.stack([problem.limits.lower, problem.limits.upper], axis=1)
    return np.concatenate([errors, np.broadcast_to(limits, errors.shape)], axis=1)


def tightest(*bounds: FloatArray) -> FloatArray:
    """Bounds, shape (..., 2), that hold where all of these do."""
    low = np.max([limits[..., 0] for limits in bounds], axis=0)
    high = np.min([limits[..., 1] for limits in bounds], axis=0)
    return np.stack([low, high], axis=-1)
