"""The claim that errors end in a set and stay there, and the check of flights against it.

Every output uses this check (reports, recordings and campaigns), so that all state the same bound
and the same verdict about the same flight. The loop is that of the law that flies, whatever model
the gains were tuned on: the mismatch is measured against that law. An aircraft has no such check:
its mismatch makes the bound wider than anything it could fly, and its tube says more.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, closed_loop, disturbance_entry
from flighttune.errors import InputError
from flighttune.guarantee.bounds import Bounds
from flighttune.guarantee.mismatch import LEAST_SAMPLES, Mismatch, flies_the_law, mismatch, trim_of
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

NEEDED = ("chi", "gamma", "chi_ref", "gamma_ref", "chi_err", "gamma_err", "phi_cmd", "n_z_cmd")
LIMITED = ("phi_limited", "n_z_limited")

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightCheck:
    """A flight in the velocity form of its loop, and the bound its gains guarantee."""

    unit: Ellipsoid  # invariant ellipsoid of the loop for L_d = 1
    t: FloatArray  # (n,), s: Middle of each sample interval
    states: FloatArray  # (n, 4), rad/s and rad: s = (e', e) there
    # (n,): ``s' W^-1 s`` for L_d = 1: the flight is in the ultimate set of L_d where it is at
    # most ``L_d^2``
    level: FloatArray
    strength: FloatArray  # (n - 1,), rad/s^2: Norm of the derivative of the mismatch
    moved: npt.NDArray[np.bool_]  # (n,): Where the reference changes its slope
    # (n,): Upper bound of `size`; NaN where there is no claim, because the reference moves or a
    # command is at a limit
    bound: FloatArray
    error_bounds: Bounds  # on the errors of course and path angle, which go with `bound`
    commanded: float  # rad: Largest change commanded; see `UltimateSet`
    duration: float  # s: Time flown
    # The plant is the law itself, so that the mismatch is rounding and bounds nothing
    of_the_law: bool

    @property
    def size(self) -> FloatArray:
        """``||s||``, shape (n,)."""
        return np.linalg.norm(self.states, axis=1)

    @property
    def broken(self) -> npt.NDArray[np.bool_]:
        """Where `size` is above `bound`, shape (n,)."""
        return self.size > self.bound * (1.0 + ROUNDING) + ROUNDING**2

    @property
    def t_broken(self) -> float | None:
        """When the bound is first broken, s; None where it holds."""
        return round(float(self.t[self.broken.argmax()]), 9) if self.broken.any() else None

    @property
    def share_broken(self) -> float:
        """Part of the samples with a claim at which it is broken, 0 to 1."""
        claimed = int(np.isfinite(self.bound).sum())
        return float(self.broken.sum()) / claimed if claimed else 0.0

    def claim(self, t_from: float) -> tuple[UltimateSet, Outcome]:
        """Ultimate set of the mismatch from `t_from` (s) on, and whether it holds from there."""
        first = int(np.searchsorted(self.t, t_from))
        L_d = float(self.strength[min(first, len(self.strength) - 1) :].max())
        claim = UltimateSet(unit=self.unit, L_d=L_d, t_from=t_from, commanded=self.commanded)
        outcome: Any = outcomes(claim.contains(self.level[first:]), self.moved[first:]).item()
        return claim, outcome

    @property
    def settled(self) -> tuple[UltimateSet, Outcome] | None:
        """`claim` about the second half of the flight; None of the law itself."""
        return None if self.of_the_law else self.claim(SETTLED_FROM * self.duration)


def flight_check(run: Run) -> FlightCheck | None:
    """Check a run against the guarantee of its gains.

    Parameters
    ----------
    run : Run
        A flight whose scenario says ``V_a_mps`` in its table ``flight``.

    Returns
    -------
    FlightCheck or None
        None if there is no guarantee: an aircraft, no gains, an unstable loop, a flight of fewer
        than four samples, or signals of the loop that are missing.
    """
    trim, gains, signals = trim_of(run), run.provenance.gains, run.signals
    if run.provenance.aircraft is not None:
        return None
    if trim is None or gains is None or len(signals) < LEAST_SAMPLES:
        return None
    if not set(NEEDED) <= set(signals) or not np.isfinite(signals[list(NEEDED)].to_numpy()).all():
        return None
    try:
        loop = certified_loop(run.provenance.law.linear_model(trim), gains)
        measured = mismatch(run)
    except InputError:  # a first reference at the vertical, gains of other channels
        return None
    return None if loop is None else check_against(run, *loop, measured)


def check_against(
    run: Run, indicators: Indicators, unit: Ellipsoid, mismatch: Mismatch
) -> FlightCheck:
    """Compare a run with the bound of its loop.

    Parameters
    ----------
    indicators, unit : Indicators and Ellipsoid
        Results of `certified_loop` for the run's gains.
    mismatch : Mismatch
        Mismatch of the run.

    Notes
    -----
    By superposition s is the free response from the start of a stretch plus what the mismatch adds
    from rest. With ``A_K' Q + Q A_K + I = 0`` the free response obeys
    ``||s|| <= sqrt(s_0' Q s_0 / lambda_min(Q)) exp(-R_K (t - t_0) / 2)``; the rest obeys
    ``V' <= a (|d'|^2 - V)`` from V = 0, see `UltimateSet`. The second inequality is integrated
    along the mismatch measured, so that the bound follows the departure of the aircraft from the
    law; with the largest |d'| of the flight in its place it would be that of the ultimate set.

    The loop is linear: a stretch begins behind every move of the reference and where a limit lets
    go of a command, and there is no claim while a limit holds one.
    """
    signals = run.signals
    references = signals["chi_ref"].to_numpy(), signals["gamma_ref"].to_numpy()
    errors = signals["chi_err"].to_numpy(), signals["gamma_err"].to_numpy()
    turning = mismatch.rates[:, 0], mismatch.rates[:, 1]
    states, moved = error_states(run.t, errors=errors, references=references, rates=turning)
    limited = (signals.filter(items=LIMITED).to_numpy()[:-1] != 0.0).any(axis=1)
    strength = np.linalg.norm(mismatch.d_dot, axis=1)
    middle, Q = mismatch.t + 0.5 * np.diff(run.t), indicators.Q
    assert Q is not None  # of a stable loop
    claimed = ~(moved | limited)
    free = _free_response(middle, quadratic_form(states, Q), claimed, indicators.R_K)
    forced = _forced_response(np.diff(middle), strength, claimed, unit.multiplier)
    smallest = float(np.linalg.eigvalsh(Q)[0])
    free_widths = np.sqrt(np.diag(np.linalg.inv(Q))[2:])
    forced_widths = np.sqrt(np.diag(unit.W)[2:])
    widths = np.sqrt(free)[:, None] * free_widths + np.sqrt(forced)[:, None] * forced_widths
    return FlightCheck(
        unit=unit,
        t=middle,
        states=states.T,
        level=quadratic_form(states, np.linalg.inv(unit.W)),
        strength=strength,
        moved=moved,
        bound=np.sqrt(free / smallest) + unit.radius * np.sqrt(forced),
        error_bounds=Bounds(middle, -widths, widths),
        commanded=largest_command(*references, (errors[0][0], errors[1][0])),
        duration=run.duration,
        of_the_law=flies_the_law(run),
    )


def _free_response(
    t: FloatArray, level: FloatArray, claimed: npt.NDArray[np.bool_], rate: float
) -> FloatArray:
    """Bound of ``s' Q s`` without mismatch: an exponential from the start of each stretch."""
    n = np.arange(len(t))
    begins = claimed & ~np.concatenate([[False], claimed[:-1]])
    start = np.maximum.accumulate(np.where(begins, n, 0))
    return np.where(claimed, level[start] * np.exp(-rate * (t - t[start])), math.nan)


def _forced_response(
    dt: FloatArray, strength: FloatArray, claimed: npt.NDArray[np.bool_], multiplier: float
) -> FloatArray:
    """Bound of ``s' W^-1 s`` for what the mismatch adds from the start of each stretch."""
    fades, squares = np.exp(-multiplier * dt).tolist(), (strength**2).tolist()
    bound = np.where(claimed, 0.0, math.nan)
    for k in np.flatnonzero(claimed[1:] & claimed[:-1]).tolist():
        bound[k + 1] = fades[k] * bound[k] + (1.0 - fades[k]) * squares[k]
    return bound
