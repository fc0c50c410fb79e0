"""Check of a flight against the guarantee of its gains.

Every output uses this check (reports, recordings and campaigns), so that all state the same bound
and the same verdict about the same flight. The loop is that of the law that flies, whatever model
the gains were tuned on: the mismatch is measured against that law. An aircraft has no such check:
its mismatch makes the bound wider than anything it could fly, and its tube says more.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.guarantee.bounds import Bounds
from flighttune.guarantee.mismatch import LEAST_SAMPLES, Mismatch, flies_the_law, mismatch, trim_of
from flighttune.guarantee.ultimate_set import (
    ROUNDING,
    SETTLED_FROM,
    Outcome,
    UltimateSet,
    certified_loop,
    error_states,
    largest_command,
    outcomes,
    quadratic_form,
)
from flighttune.simulate.run import Run
from flighttune.theory.attractor import Ellipsoid
from flighttune.theory.indicators import Indicators

NEEDED = ("chi", "gamma", "chi_ref", "gamma_ref", "chi_err", "gamma_err", "phi_cmd", "n_z_cmd")
LIMITED = ("phi_limited", "n_z_limited")


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
