"""Flights in the velocity form of their loop: s = (e', e), errors and their rates."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray

REFERENCE_MOVED = 1e-9
"""Change of slope of the reference, rad a sample, beyond which it counts as moved.

A step of the reference is a jump of s that no bound of the mismatch covers: a claim starts anew.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorStates:
    """The states s of flights in n sample intervals."""

    # (..., n), rad/s and rad: Rates of the errors of course and flight-path angle, and
    # the errors, in the middle of each interval
    states: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    moved: npt.NDArray[np.bool_]  # (..., n): Where the reference changes its slope

    def level(self, shape: npt.ArrayLike) -> FloatArray:
        """``s' shape s`` in each interval, shape (..., n).

        Notes
        -----
        The sums are written out: einsum and @ add in an order that depends on the size of the
        arrays, and a flight among many must have the bits of a flight alone.
        """
        total = np.zeros_like(self.states[0])
        for row, s_i in zip(np.asarray(shape).tolist(), self.states, strict=True):
            product = row[0] * self.states[0]
            for entry, s_j in zip(row[1:], self.states[1:], strict=True):
                product += entry * s_j
            product *= s_i
            total += product
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
        Of course and of flight-path angle: the error as the controller has it (wrapped), and the
        reference.
    rates : tuple of ndarray, shape (..., n), rad/s
        Mean rates flown in each interval.

    Notes
    -----
    No derivative of a sampled signal is estimated: the mean rate of an angle over an interval is
    its increment over the sample time, exactly. It is the rate in the middle of the interval to
    second order in the sample time, and the error there is that at its start plus half the change.
    """
    dt = np.diff(t)
    error_rates: list[FloatArray] = []
    middles: list[FloatArray] = []
    moved = np.zeros(1, dtype=bool)
    for error, reference, rate_flown in zip(errors, references, rates, strict=True):
        step = np.diff(reference)
        rate = step / dt - rate_flown
        error_rates.append(rate)
        middles.append(error[..., :-1] + 0.5 * dt * rate)
        moved = moved | (np.abs(np.diff(step, prepend=step[..., :1])) > REFERENCE_MOVED)
    return ErrorStates(
        states=(error_rates[0], error_rates[1], middles[0], middles[1]),
        moved=np.broadcast_to(moved, error_rates[0].shape),
    )
