"""The certified ultimate set as arrays: how deep in it flights are, and whether they stay there."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.gap.mismatch import Mismatch
from flighttune.simulate.run import Run

ROUNDING = 1e-6
"""Part by which a set may be exceeded before it counts as broken."""

REFERENCE_MOVED = 1e-9
"""A change of slope of the reference beyond this (rad a sample) starts the claim anew."""

Kept: TypeAlias = Literal["held", "broken", "not entered"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorStates:
    """Flights as the velocity form of their loop sees them, n intervals between samples.

    Attributes
    ----------
    states : tuple of ndarray, length 4, shape (..., n), rad/s and rad
        Rates of the errors of course and flight-path angle, and the errors, in the middle of each
        interval.
    moved : ndarray of bool, shape (..., n)
        Where the reference changes its slope.
    """

    states: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    moved: npt.NDArray[np.bool_]

    def level(self, shape: npt.ArrayLike) -> FloatArray:
        """``s' shape s`` at each interval, shape (..., n).

        Notes
        -----
        The sums are written out, so that a flight among many has the bits of a flight alone.
        """
        total = np.zeros_like(self.states[0])
        for row, s_i in zip(np.asarray(shape).tolist(), self.states, strict=True):
            pulled = row[0] * self.states[0]
            for entry, s_j in zip(row[1:], self.states[1:], strict=True):
                pulled += entry * s_j
            pulled *= s_i
            total += pulled
        return total


def error_states(
    t: FloatArray,
    *,
    errors: tuple[FloatArray, FloatArray],
    references: tuple[FloatArray, FloatArray],
    rates: tuple[FloatArray, FloatArray],
) -> ErrorStates:
    """The states s = (e', e) of flights.

    Parameters
    ----------
    t : ndarray, shape (n + 1,), s
        Times of the samples.
    errors, references : tuple of ndarray, shape (..., n + 1), rad
        Of course and of flight-path angle: the error as the controller has it (wrapped), and what
        is followed.
    rates : tuple of ndarray, shape (..., n), rad/s
        Mean rates flown in each interval.
    """
    dt = np.diff(t)
    error_rates: list[FloatArray] = []
    middles: list[FloatArray] = []
    moved = np.zeros(1, dtype=bool)
    for error, reference, flown in zip(errors, references, rates, strict=True):
        step = np.diff(reference)
        rate = step / dt - flown
        error_rates.append(rate)
        middles.append(error[..., :-1] + 0.5 * dt * rate)
        moved = moved | (np.abs(np.diff(step, prepend=step[..., :1])) > REFERENCE_MOVED)
    return ErrorStates(
        states=(error_rates[0], error_rates[1], middles[0], middles[1]),
        moved=np.broadcast_to(moved, error_rates[0].shape),
    )


def states_of_run(run: Run, found: Mismatch) -> ErrorStates:
    """The states s = (e', e) of one run.

    Parameters
    ----------
    run : Run
    found : Mismatch
        Of that run.
    """
    errors, references = (
        run.signals[[f"chi_{kind}", f"gamma_{kind}"]].to_numpy() for kind in ("err", "ref")
    )
    return error_states(
        run.signals.index.to_numpy(dtype=float),
        errors=(errors[:, 0], errors[:, 1]),
        references=(references[:, 0], references[:, 1]),
        rates=(found.rates[:, 0], found.rates[:, 1]),
    )


def entered_and_left(
    inside: npt.NDArray[np.bool_], moved: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Where flights are in their set, and where they are out of it straight after.

    Parameters
    ----------
    inside, moved : ndarray of bool, shape (..., n)
        Whether in the set, and whether the reference changed: it may leave the set then.

    Returns
    -------
    within, left : ndarray of bool, shape (..., n)
        Inside with the reference at rest; outside with the reference at rest, and within just
        before.
    """
    within = inside & ~moved
    left = np.zeros_like(within)
    left[..., 1:] = within[..., :-1] & ~inside[..., 1:] & ~moved[..., 1:]
    return within, left


def kept(inside: npt.NDArray[np.bool_], moved: npt.NDArray[np.bool_]) -> npt.NDArray[np.str_]:
    """How flights keep to their set, as `Kept`, shape (...) of `inside` without its last axis.

    ``broken`` where a flight left it, ``held`` where it did not and ends in it, else ``not
    entered``, which a flight also is whose reference moved and that did not come in again.
    """
    within, left = entered_and_left(inside, moved)
    ends_in = within[..., -1] if within.shape[-1] else np.zeros(within.shape[:-1], dtype=bool)
    return np.where(left.any(axis=-1), "broken", np.where(ends_in, "held", "not entered"))
