"""The last part of a flight, which no limit holds: how far the mismatch can have pushed it."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from flighttune.arrays import FloatArray
from flighttune.gap.certified_set import held_or_broken
from flighttune.gap.mismatch import Mismatch
from flighttune.gap.ultimate_set import ROUNDING, states_of_run
from flighttune.simulate.run import Run
from flighttune.units import DEG

SHORTEST = 1.0
"""Time without limits, s, from which there is something to say."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeFlight:
    """The flight since a limit held a command, or the reference moved, for the last time.

    Attributes
    ----------
    t : ndarray, shape (n,), s
        Middle of each sample interval since then.
    centre : ndarray, shape (n, 2), rad
        Errors of course and path angle that the linear loop has from its state then on, alone.
    width : ndarray, shape (n, 2), rad
        How far from there the mismatch can have pushed them, whatever its direction.
    errors : ndarray, shape (n, 2), rad
        As flown.
    L_d : float, rad/s^2
        Bound of the mismatch's derivative in that time.
    """

    t: FloatArray
    centre: FloatArray
    width: FloatArray
    errors: FloatArray
    L_d: float

    @property
    def t_from(self) -> float:
        """When it begins, s."""
        return round(float(self.t[0]), 9)

    @property
    def widest(self) -> tuple[float, float]:
        """Largest width of course and path angle, rad."""
        chi, gamma = self.width.max(axis=0).tolist()
        return chi, gamma

    @property
    def at_end(self) -> tuple[float, float]:
        """Largest errors of course and path angle that the tube leaves room for at the end, rad."""
        chi, gamma = (np.abs(self.centre[-1]) + self.width[-1]).tolist()
        return chi, gamma

    @property
    def outside(self) -> FloatArray:
        """How far each error is out of its tube, shape (n, 2), rad; 0 inside."""
        room = self.width * (1.0 + ROUNDING) + ROUNDING
        return np.maximum(np.abs(self.errors - self.centre) - room, 0.0)

    @property
    def t_broken(self) -> float | None:
        """When an error first was outside, s; None where none was."""
        out = (self.outside > 0.0).any(axis=1)
        return round(float(self.t[int(np.argmax(out))]), 9) if out.any() else None

    @property
    def sentence(self) -> str:
        """``held``, or when an error first was outside and how far any ever was."""
        by = f", by at most {self.outside.max() / DEG:.2f} deg"
        return held_or_broken(self.t_broken) + (by if self.t_broken is not None else "")


def free_flight(run: Run, found: Mismatch, A_K: FloatArray, E: FloatArray) -> FreeFlight | None:
    """Hold the part of a flight that no limit holds against the reach of its linear loop.

    Parameters
    ----------
    run : Run
        The flight.
    found : Mismatch
        Of that flight.
    A_K : ndarray, shape (4, 4), 1/s
        Loop in velocity form, s = (e', e).
    E : ndarray, shape (4, 2)
        Where the derivative of the mismatch enters.

    Returns
    -------
    FreeFlight or None
        None where limits held the commands, or the reference moved, until less than `SHORTEST`
        before the end.

    Notes
    -----
    ``e(t) = C exp(A t) s(0) - int C exp(A (t - tau)) E d'(tau) dtau``, so each error is off its
    free response by at most the integral of ``norm(c exp(A (t - tau)) E) |d'(tau)|``, and some
    direction of d' at each instant gets there: no ellipsoid is closer. What the law's own curvature
    adds, ``tan(phi) - phi``, is neither in d nor in the loop: by that much a flight can be outside.
    """
    signals, t = run.signals, run.signals.index.to_numpy(dtype=float)
    flown = states_of_run(run, found)
    limited = (signals[["phi_limited", "n_z_limited"]].to_numpy()[:-1] > 0.0).any(axis=1)
    disturbed = np.flatnonzero(limited | flown.moved)
    first = int(disturbed[-1]) + 1 if len(disturbed) else 0
    states = np.column_stack(flown.states)[first:]
    dt = float(t[1] - t[0])
    if len(states) * dt < SHORTEST:
        return None
    strength = np.linalg.norm(found.d_dot, axis=1)[first:]
    centre, pushes = _responses(A_K, E, states[0], len(states), dt)
    width = np.zeros_like(centre)
    for i in range(centre.shape[1]):
        width[1:, i] = np.convolve(pushes[:, i], strength)[: len(strength)]
    return FreeFlight(
        t=t[first:-1] + 0.5 * dt,
        centre=centre,
        width=width,
        errors=states[:, 2:],
        L_d=float(strength.max()),
    )


def _responses(
    A_K: FloatArray, E: FloatArray, start: FloatArray, count: int, dt: float
) -> tuple[FloatArray, FloatArray]:
    """Errors from `start` alone, and the most a unit of strength in one interval adds to them."""
    step, half = expm(A_K * dt), expm(A_K * 0.5 * dt)
    to_errors = np.eye(len(A_K))[2:]
    centre, pushes = np.empty((count, 2)), np.empty((count, 2))
    for k in range(count):
        centre[k] = to_errors @ start
        pushes[k] = np.linalg.norm(to_errors @ half @ E, axis=1) * dt
        to_errors = to_errors @ step
    return centre, pushes
