"""Does the set that the certificate promises for the mismatch measured hold in flight?"""

import math
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.gap.mismatch import Mismatch
from flighttune.gap.ultimate_set import ROUNDING, entered_and_left, states_of_run
from flighttune.simulate.run import Run
from flighttune.theory.attractor import Ellipsoid, invariant_ellipsoid
from flighttune.theory.reachable import ReachableSet

TOO_WIDE = 0.5
"""Part of the largest change asked for from which a set is too wide to say anything."""

NEVER_TOO_WIDE = math.radians(5.0)
"""Width that says something of any flight, also of one that nothing is asked of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Whether a flight stayed in its certified ultimate set.

    Attributes
    ----------
    held : bool
        It came into the set, and once in it was never outside again unless the reference moved.
    t_entered : float or None, s
        When it first was inside; None where it never was.
    t_broken : float or None, s
        When it first left; None where it did not.
    t_from : float, s
        The time from which the flight is looked at and the mismatch is bounded.
    L_d : float, rad/s^2
        Bound of the mismatch's derivative from `t_from` on.
    radius : float
        Of the invariant ellipsoid: largest norm of s = (e', e) in it, in rad/s and rad.
    tube : tuple of float, rad
        Largest errors of course and of flight-path angle in the ellipsoid.
    reach : tuple of float, rad
        The exact ones: largest errors that the linear loop can be pushed to; never above `tube`.
    asked : float, rad
        Largest change of course or of flight-path angle asked for in the flight: from where it
        began to the reference.
    """

    held: bool
    t_entered: float | None
    t_broken: float | None
    t_from: float
    L_d: float
    radius: float
    tube: tuple[float, float]
    reach: tuple[float, float]
    asked: float

    @property
    def says_nothing(self) -> bool:
        """Whether hardly a flight would be outside: see `too_wide`."""
        return too_wide(self.tube, self.asked)

    @property
    def sentence(self) -> str:
        """``held`` or ``broken at t = ...``, or that the set was never entered or says nothing."""
        found = "never entered" if self.t_entered is None else held_or_broken(self.t_broken)
        return f"{found}, but too wide to say anything" if self.says_nothing else found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopFlown:
    """A flight as the velocity form of its loop sees it, beside the certificate of that loop.

    Attributes
    ----------
    t : ndarray, shape (n,), s
        Middle of each sample interval.
    level : ndarray, shape (n,), s^-4
        ``s' W^-1 s`` for L_d = 1: the flight is inside the ellipsoid of L_d where it is at most
        ``L_d^2``.
    promised : ndarray, shape (n,)
        What `level` may be at most, if the loop is the linear one, is not held by limits, and meets
        the mismatch measured up to then.
    moved : ndarray of bool, shape (n,)
        Where the reference changes its slope: `promised` begins anew behind it.
    strength : ndarray, shape (n - 1,), rad/s^2
        Norm of the derivative of the mismatch.
    unit : Ellipsoid
        Invariant ellipsoid for L_d = 1.
    reach : ndarray, shape (2,), rad
        Largest errors that the loop can be pushed to for L_d = 1.
    errors : ndarray, shape (n, 2), rad
        Of course and flight-path angle, as flown.
    asked : float, rad
        Largest change asked for; see `Verdict`.
    """

    t: FloatArray
    level: FloatArray
    promised: FloatArray
    moved: np.ndarray
    strength: FloatArray
    unit: Ellipsoid
    reach: FloatArray
    errors: FloatArray
    asked: float

    def verdict(self, t_from: float = 0.0) -> Verdict:
        """Whether the set of the mismatch from `t_from` (s) on holds from there on."""
        first = int(np.searchsorted(self.t, t_from))
        L_d = float(self.strength[min(first, len(self.strength) - 1) :].max())
        inside = self.level[first:] <= (L_d * (1.0 + ROUNDING)) ** 2
        within, left = entered_and_left(inside, self.moved[first:])
        entered, broken = (
            self._at(first + int(np.argmax(where))) if where.any() else None
            for where in (within, left)
        )
        widths = np.sqrt(np.diag(self.unit.W))[2:] * L_d
        return Verdict(
            held=bool(within[-1:].any()) and broken is None,
            t_entered=entered,
            t_broken=broken,
            t_from=t_from,
            L_d=L_d,
            radius=self.unit.radius * L_d,
            tube=(float(widths[0]), float(widths[1])),
            reach=(float(self.reach[0]) * L_d, float(self.reach[1]) * L_d),
            asked=self.asked,
        )

    def _at(self, k: int) -> float:
        return round(float(self.t[k]), 9)

    def t_promise_broken(self) -> float | None:
        """When `level` first exceeded what was promised, s; None where it never did."""
        over = self.level > self.promised * (1.0 + ROUNDING) + ROUNDING**2
        late = np.flatnonzero(over & ~self.moved)
        return self._at(late[0]) if len(late) else None

    @property
    def promise_sentence(self) -> str:
        """``held``, or when `level` first exceeded what was promised."""
        return held_or_broken(self.t_promise_broken())

    def t_error_outside(self, column: int) -> float | None:
        """When the error of course (0) or path angle (1) first was outside of `tube`, s, or None.

        The error alone may stay inside after the norm of s, with its rates, has left.
        """
        outside = np.abs(self.errors[:, column]) > self.tube()[:, column] * (1.0 + ROUNDING)
        late = np.flatnonzero(outside & ~self.moved)
        return self._at(late[0]) if len(late) else None

    def tube(self) -> FloatArray:
        """Largest errors of course and path angle that are promised, shape (n, 2), rad."""
        return np.sqrt(self.promised[:, None] * np.diag(self.unit.W)[2:])


def too_wide(tube: tuple[float, float], asked: float) -> bool:
    """Whether hardly a flight would be outside of a set.

    The set lets an error be more than half of the largest change asked for (and more than 5 deg),
    half a circle of course, or a path to the vertical.

    Parameters
    ----------
    tube : tuple of float, rad
        Largest errors of course and of flight-path angle in the set.
    asked : float, rad
        Largest change asked for; see `Verdict`.
    """
    all_of_it = tube[0] >= math.pi or tube[1] >= math.pi / 2.0
    return all_of_it or max(tube) > max(TOO_WIDE * asked, NEVER_TOO_WIDE)


def held_or_broken(t_broken: float | None) -> str:
    """``held``, or ``broken at t = ...`` in s."""
    return "held" if t_broken is None else f"broken at t = {t_broken:.2f} s"


def loop_flown(run: Run, found: Mismatch, A_K: FloatArray, E: FloatArray) -> LoopFlown:
    """Hold a flight against the invariant ellipsoid of its loop.

    Parameters
    ----------
    run : Run
        The flight.
    found : Mismatch
        Of that flight.
    A_K : ndarray, shape (4, 4), 1/s
        Stable loop in velocity form, s = (e', e).
    E : ndarray, shape (4, 2)
        Where the derivative of the mismatch enters.

    Returns
    -------
    LoopFlown

    Raises
    ------
    InputError
        If the loop is not stable.

    Notes
    -----
    With W of `invariant_ellipsoid` for L_d = 1 and its multiplier a, ``V = s' W^-1 s`` obeys
    ``V' <= a (|d'|^2 - V)``: once below L_d^2 it stays there. The promise integrates the inequality
    along the mismatch measured, from where the flight starts or the reference moved last.
    """
    unit = invariant_ellipsoid(A_K, E, L_d=1.0)
    first_errors = run.signals[["chi_err", "gamma_err"]].to_numpy()[0]
    references = run.signals[["chi_ref", "gamma_ref"]].to_numpy()
    dt = np.diff(run.signals.index.to_numpy(dtype=float))
    flown = states_of_run(run, found)
    level, moved = flown.level(np.linalg.inv(unit.W)), flown.moved
    strength = np.linalg.norm(found.d_dot, axis=1)
    promised = level.copy()
    for k in range(len(strength)):
        if not (moved[k] or moved[k + 1]):
            fade = math.exp(-unit.multiplier * dt[k])
            promised[k + 1] = fade * promised[k] + (1.0 - fade) * strength[k] ** 2
    return LoopFlown(
        t=found.t + 0.5 * dt,
        level=level,
        promised=promised,
        moved=moved,
        strength=strength,
        unit=unit,
        reach=ReachableSet.of(A_K, E, L_d=1.0).peak_gain(slice(2, 4)).channels,
        errors=np.column_stack(flown.states[2:]),
        asked=float(np.abs(references - references[0] + first_errors).max()),
    )
