"""The bound of the linear loop, drawn beside flights of the law.

The bound follows from the gains, the linearised law, the start of each stretch and the scenario's
disturbance, without measurements from the flight. It is drawn for flights of the law's model in
still air, without sensor errors. An aircraft has no such bound, because it does not keep the
airspeed, roll and load factor that the law assumes. Its tube bounds its errors.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.control.linear_model import closed_loop, disturbance_entry
from flighttune.control.theory.indicators import Indicators, indicators
from flighttune.control.theory.lyapunov import Ellipsoid, invariant_ellipsoid
from flighttune.flight.loop.disturbance import Sinusoid
from flighttune.flight.loop.run import Run
from flighttune.gaps.residual import CHANNELS, trim_of

# Change of the reference's slope, rad per sample, beyond which it counts as moved.
# A step of the reference is a jump of s that no disturbance explains, so the bound restarts.
REFERENCE_MOVED = 1e-9

# Minimum number of samples, for two values of the derivative of an error rate.
LEAST_SAMPLES = 4

NEEDED = ("chi", "gamma", "chi_ref", "gamma_ref", "chi_err", "gamma_err", "phi_cmd", "n_z_cmd")
LIMITED = ("phi_limited", "n_z_limited")


class LinearBound(NamedTuple):
    """The norm of s = (e', e) in a flight of the law, and its bound from the gains."""

    t: FloatArray  # (n,), s: Middle of each sample interval
    size: FloatArray  # (n,): ``||s||`` there, in rad/s and rad
    # (n,): Upper bound of `size`; NaN while the reference moves or a command is at a limit
    bound: FloatArray
    radius: float  # Largest norm of s in the ultimate set of the stated disturbance


def linear_bound(run: Run) -> LinearBound | None:
    """The bound on a run from its gains, or None."""
    # There is no bound with a plant other than the law's model, wind, sensors, a disturbance that
    # jumps, no gains, feedback of roll or load factor (here a sample late), an unstable loop, fewer
    # than four samples, or missing signals of the loop.
    trim, gains, L_d = trim_of(run), run.provenance.gains, stated_L_d(run)
    signals = run.signals
    if trim is None or gains is None or L_d is None or len(signals) < LEAST_SAMPLES:
        return None
    if gains.feeds_back:
        return None
    if not set(NEEDED) <= set(signals) or not np.isfinite(signals[list(NEEDED)].to_numpy()).all():
        return None
    try:
        model = run.provenance.law.linear_model(trim)
        A_K = closed_loop(model, gains)
    except InputError:  # a vertical first reference, or gains of other channels
        return None
    values = indicators(A_K)
    if values.status != "stable":
        return None
    return bound_of(run, values, invariant_ellipsoid(A_K, disturbance_entry(model), L_d=1.0), L_d)


def stated_L_d(run: Run) -> float | None:
    """L_d of the disturbance in the scenario of a run; None without such a bound."""
    scenario, law = run.provenance.scenario, run.provenance.law
    kind = run.provenance.plant.partition(":")[0]
    others = ("wind", "gust", "turbulence", "sensors", "navigation")
    if kind != law.plant or any(scenario.get(key) for key in others):
        return None
    stated = scenario.get("disturbance") or {}
    if stated.get("as_wind"):
        return None
    bound = Sinusoid.of_table(stated).rate_bound
    return bound if math.isfinite(bound) else None


def bound_of(run: Run, indicators: Indicators, unit: Ellipsoid, L_d: float) -> LinearBound:
    """A run and the bound of its stable loop in velocity form, ``s' = A_K s + E v``.

    `unit` is its invariant ellipsoid for ``|v| <= 1``, `L_d` (rad/s^2) the bound of the norm of v,
    the derivative of the disturbance. By superposition s is the free response from the start of a
    stretch plus the response to the disturbance from rest. With ``A_K' Q + Q A_K + I = 0`` the free
    response obeys ``||s|| <= sqrt(s_0' Q s_0 / lambda_min(Q)) exp(-R_K (t - t_0) / 2)``. With W of
    `invariant_ellipsoid` and its multiplier a, ``V = s' W^-1 s`` of the rest obeys ``V' <= a (L_d^2
    - V)`` from V = 0.
    """
    states, moved = error_states(run)
    limited = (run.signals.filter(items=LIMITED).to_numpy()[:-1] != 0.0).any(axis=1)
    t, Q = run.t[:-1] + 0.5 * np.diff(run.t), indicators.Q
    assert Q is not None  # the loop is stable
    free = ~(moved | limited)
    # The loop is linear only without limits: a stretch begins after every move of the reference and
    # after every limited command, and there is no bound during limits.
    begins = free & ~np.concatenate([[False], free[:-1]])
    start = np.maximum.accumulate(np.where(begins, np.arange(len(t)), 0))
    since = t - t[start]
    level = np.einsum("ni,ij,nj->n", states, Q, states)[start] / np.linalg.eigvalsh(Q)[0]
    added = unit.radius * L_d * np.sqrt(-np.expm1(-unit.multiplier * since))
    bound = np.sqrt(level) * np.exp(-0.5 * indicators.R_K * since) + added
    return LinearBound(
        t=t,
        size=np.linalg.norm(states, axis=1),
        bound=np.where(free, bound, math.nan),
        radius=unit.radius * L_d,
    )


def error_states(run: Run) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """The states s = (e', e), shape (n, 4), rad/s and rad, and whether the reference bends."""
    dt = np.diff(run.t)[:, None]
    angles, references, errors = (
        run.signals[[f"{channel}{end}" for channel in CHANNELS]].to_numpy()
        for end in ("", "_ref", "_err")
    )
    step = np.diff(references, axis=0)
    # States are in the middle of each interval. No derivative of a sampled signal is estimated: an
    # increment divided by the sample time is exactly the mean rate, and the rate in the middle to
    # second order in the sample time. The error in the middle is the error at the start plus half
    # the change.
    slopes = (step - np.diff(angles, axis=0)) / dt
    bends = np.abs(np.diff(step, axis=0, prepend=step[:1])) > REFERENCE_MOVED
    return np.hstack([slopes, errors[:-1] + 0.5 * dt * slopes]), bends.any(axis=1)
