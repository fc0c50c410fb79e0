"""The claim that errors end in a set and stay there, and what became of it in flights."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, closed_loop, disturbance_entry
from flighttune.guarantee.mismatch import LEAST_SAMPLES
from flighttune.metrics import signal_arrays
from flighttune.simulate.run import Run
from flighttune.theory.attractor import Ellipsoid, invariant_ellipsoid
from flighttune.theory.indicators import Indicators, indicators

ROUNDING = 1e-6
"""Part by which a bound may be exceeded before it counts as broken."""

SETTLED_FROM = 0.5
"""Part of the flight from which it counts as settled."""

LOOSE = 0.5
"""Part of the largest change commanded beyond which a bound on the errors is vacuous."""

NEVER_LOOSE = math.radians(5.0)
"""A bound below this is useful in any flight, also in one without a change of reference."""

REFERENCE_MOVED = 1e-9
"""Change of slope of the reference, rad a sample, beyond which it counts as moved.

A step of the reference is a jump of s that no bound of the mismatch covers: a claim starts anew.
"""

Outcome: TypeAlias = Literal["held", "broken", "not entered"]


def certified_loop(model: LinearModel, gains: PIGains) -> tuple[Indicators, Ellipsoid] | None:
    """R_K and the Q that proves it, and the invariant ellipsoid for ``|v| <= 1``, of a loop.

    None where the loop in velocity form, ``s' = A_K s + E v``, is not stable.

    Parameters
    ----------
    model : LinearModel
        `kinematic_model`, as the mismatch is measured against the kinematic law.
    """
    A_K = closed_loop(model, gains)
    values = indicators(A_K)
    if values.status != "stable":
        return None
    return values, invariant_ellipsoid(A_K, disturbance_entry(model), L_d=1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UltimateSet:
    """Claim: the errors end in an ellipsoid while the mismatch changes no faster than `L_d`.

    Notes
    -----
    With W of `invariant_ellipsoid` for L_d = 1 and its multiplier a, ``V = s' W^-1 s`` obeys
    ``V' <= a (|d'|^2 - V)``: once below L_d^2 it stays there.
    """

    unit: Ellipsoid  # invariant ellipsoid of the loop for L_d = 1
    L_d: float  # rad/s^2: Bound of the norm of the mismatch's derivative
    t_from: float  # s: Time from which the claim is made
    # rad: Largest change of course or of flight-path angle commanded in the flight: from where it
    # began to the reference
    commanded: float

    @property
    def radius(self) -> float:
        """Largest norm of s = (e', e) in the set, in rad/s and rad."""
        return self.unit.radius * self.L_d

    @property
    def tube(self) -> tuple[float, float]:
        """Largest errors of course and of flight-path angle in the set, rad."""
        chi, gamma = (np.sqrt(np.diag(self.unit.W))[2:] * self.L_d).tolist()
        return chi, gamma

    @property
    def vacuous(self) -> bool:
        """Whether the bound is too loose to be useful: hardly a flight would be outside.

        It lets an error be more than half of the largest change commanded (and more than 5 deg),
        half a circle of course, or a path to the vertical.
        """
        chi, gamma = self.tube
        anywhere = chi >= math.pi or gamma >= math.pi / 2.0
        return anywhere or max(chi, gamma) > max(LOOSE * self.commanded, NEVER_LOOSE)

    def contains(self, level: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether states are in the set, from their ``s' W^-1 s`` for L_d = 1."""
        return level <= (self.L_d * (1.0 + ROUNDING)) ** 2

    def outcome(self, run: Run) -> str | None:
        """`Outcome` of a run; None where it was not completed."""
        if run.status != "completed" or len(run.signals) < LEAST_SAMPLES:
            return None
        names = ("chi", "gamma", "chi_ref", "gamma_ref", "chi_err", "gamma_err")
        signals = signal_arrays(run, names)
        return self.outcomes(
            run.t,
            errors=(signals["chi_err"], signals["gamma_err"]),
            references=(signals["chi_ref"], signals["gamma_ref"]),
            angles=(signals["chi"], signals["gamma"]),
        ).item()

    def outcomes(
        self,
        t: FloatArray,
        *,
        errors: Sequence[FloatArray],
        references: Sequence[FloatArray],
        angles: Sequence[FloatArray],
    ) -> npt.NDArray[np.str_]:
        """Outcomes of the claim in completed flights.

        Parameters
        ----------
        t : ndarray, shape (k,), s
            Times of the samples.
        errors, references, angles : tuple of ndarray, shape (..., k), rad
            Pairs for course and flight-path angle.

        Returns
        -------
        ndarray of str, shape (...)
            As `Outcome`.
        """
        first = int(np.searchsorted(t[:-1] + 0.5 * np.diff(t), self.t_from))
        before = max(first - 1, 0)  # one interval more: whether the reference moved at the first
        dt = np.diff(t[before:])
        errors, references, angles = (
            tuple(signal[..., before:] for signal in pair) for pair in (errors, references, angles)
        )
        flown = [np.diff(angle) / dt for angle in angles]
        states, moved = error_states(t[before:], errors=errors, references=references, rates=flown)
        inside = self.contains(quadratic_form(states, np.linalg.inv(self.unit.W)))
        late = slice(first - before, None)
        return outcomes(inside[..., late], moved[..., late])


def largest_command(chi_ref: FloatArray, gamma_ref: FloatArray, e_0: tuple[float, float]) -> float:
    """Largest change commanded in a flight: from where it began to the reference, rad.

    Parameters
    ----------
    chi_ref, gamma_ref : ndarray, shape (n,), rad
        References.
    e_0 : tuple of float, rad
        First errors of course (wrapped) and flight-path angle.
    """
    changes = [ref - ref[0] + error for ref, error in zip((chi_ref, gamma_ref), e_0, strict=True)]
    return float(np.abs(changes).max())


def outcomes(inside: npt.NDArray[np.bool_], moved: npt.NDArray[np.bool_]) -> npt.NDArray[np.str_]:
    """`Outcome` of flights, shape (...), from where they are inside, shape (..., n).

    ``broken`` where a flight left its set, ``held`` where it did not and ends in it, else ``not
    entered``: also where the reference moved (`moved`) and the flight did not come in again.
    """
    within = inside & ~moved
    left = (within[..., :-1] & ~inside[..., 1:] & ~moved[..., 1:]).any(axis=-1)
    ends_in = within[..., -1:].any(axis=-1)
    return np.where(left, "broken", np.where(ends_in, "held", "not entered"))


def error_states(
    t: FloatArray,
    *,
    errors: Sequence[FloatArray],
    references: Sequence[FloatArray],
    rates: Sequence[FloatArray],
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """The states s = (e', e) of flights, errors and their rates, and where the reference moves.

    Parameters
    ----------
    t : ndarray, shape (n + 1,), s
        Times of the samples.
    errors, references : tuple of ndarray, shape (..., n + 1), rad
        Of course and of flight-path angle: the error as the controller has it (wrapped), and the
        reference.
    rates : tuple of ndarray, shape (..., n), rad/s
        Mean rates flown in each interval.

    Returns
    -------
    states : ndarray, shape (4, ..., n), rad/s and rad
        Rates of the errors of course and flight-path angle, and the errors, in the middle of each
        interval.
    moved : ndarray of bool, shape (..., n)
        Where the reference changes its slope.

    Notes
    -----
    No derivative of a sampled signal is estimated: the mean rate of an angle over an interval is
    its increment over the sample time, exactly. It is the rate in the middle of the interval to
    second order in the sample time, and the error there is that at its start plus half the change.
    """
    dt = np.diff(t)
    slopes: list[FloatArray] = []
    middles: list[FloatArray] = []
    moved = np.zeros(1, dtype=bool)
    for error, reference, rate_flown in zip(errors, references, rates, strict=True):
        step = np.diff(reference)
        slopes.append(step / dt - rate_flown)
        middles.append(error[..., :-1] + 0.5 * dt * slopes[-1])
        moved = moved | (np.abs(np.diff(step, prepend=step[..., :1])) > REFERENCE_MOVED)
    return np.stack([*slopes, *middles]), np.broadcast_to(moved, slopes[0].shape)


def quadratic_form(states: FloatArray, shape: npt.ArrayLike) -> FloatArray:
    """``s' shape s`` of states, shape (4, ..., n), in each interval.

    Notes
    -----
    The sums are written out: einsum and @ add in an order that depends on the size of the
    arrays, and a flight among many must have the bits of a flight alone.
    """
    total = np.zeros_like(states[0])
    for row, s_i in zip(np.asarray(shape).tolist(), states, strict=True):
        product = row[0] * states[0]
        for entry, s_j in zip(row[1:], states[1:], strict=True):
            product += entry * s_j
        product *= s_i
        total += product
    return total
