"""The claim that errors end in a set and stay there, and what became of it in flights."""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, closed_loop, disturbance_entry
from flighttune.guarantee.error_states import error_states
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

Outcome: TypeAlias = Literal["held", "broken", "not entered"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CertifiedLoop:
    """A stable linear loop of the kinematic law in velocity form, ``s' = A_K s + E v``."""

    A_K: FloatArray  # (4, 4), 1/s
    E: FloatArray  # (4, 2): Where v, minus the derivative of the mismatch, enters
    indicators: Indicators  # With R_K and the Q that proves it
    unit: Ellipsoid  # Invariant ellipsoid for ``|v| <= 1``
    # (4, 4): Inverse of its W: s is in the ellipsoid for L_d where ``s' shape s <= L_d^2``
    shape: FloatArray


def certified_loop(model: LinearModel, gains: PIGains) -> CertifiedLoop | None:
    """The loop of gains on a linear model of the law; None where it is not stable.

    Parameters
    ----------
    model : LinearModel
        `kinematic_model`, as the mismatch is measured against the kinematic law.
    """
    A_K, E = closed_loop(model, gains), disturbance_entry(model)
    values = indicators(A_K)
    if values.status != "stable":
        return None
    unit = invariant_ellipsoid(A_K, E, L_d=1.0)
    shape = np.asarray(np.linalg.inv(unit.W), dtype=np.float64)
    return CertifiedLoop(A_K=A_K, E=E, indicators=values, unit=unit, shape=shape)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UltimateSet:
    """Claim: the errors end in an ellipsoid while the mismatch changes no faster than `L_d`.

    Notes
    -----
    With W of `invariant_ellipsoid` for L_d = 1 and its multiplier a, ``V = s' W^-1 s`` obeys
    ``V' <= a (|d'|^2 - V)``: once below L_d^2 it stays there.
    """

    loop: CertifiedLoop
    L_d: float  # rad/s^2: Bound of the norm of the mismatch's derivative
    t_from: float  # s: Time from which the claim is made
    # rad: Largest change of course or of flight-path angle commanded in the flight: from where it
    # began to the reference
    commanded: float

    @property
    def radius(self) -> float:
        """Largest norm of s = (e', e) in the set, in rad/s and rad."""
        return self.loop.unit.radius * self.L_d

    @property
    def tube(self) -> tuple[float, float]:
        """Largest errors of course and of flight-path angle in the set, rad."""
        chi, gamma = (np.sqrt(np.diag(self.loop.unit.W))[2:] * self.L_d).tolist()
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
        """Whether states are in the set, from their ``s' shape s``."""
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
        errors: tuple[FloatArray, FloatArray],
        references: tuple[FloatArray, FloatArray],
        angles: tuple[FloatArray, FloatArray],
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
        states = error_states(
            t[before:],
            errors=(errors[0][..., before:], errors[1][..., before:]),
            references=(references[0][..., before:], references[1][..., before:]),
            rates=(np.diff(angles[0][..., before:]) / dt, np.diff(angles[1][..., before:]) / dt),
        )
        inside = self.contains(states.level(self.loop.shape))
        late = slice(first - before, None)
        return outcomes(inside[..., late], states.moved[..., late])


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
