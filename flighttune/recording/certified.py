"""What the gains of a run guarantee, held against what the run did."""

import math
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.closed_loop import closed_loop, disturbance_entry
from flighttune.control.linear_model import kinematic_model
from flighttune.errors import InputError
from flighttune.gap.mismatch import mismatch
from flighttune.plants.kinematic import G_PAPER
from flighttune.simulate.run import Run
from flighttune.theory.attractor import invariant_ellipsoid
from flighttune.theory.indicators import indicators

LEAST_SAMPLES = 8
SETTLED_FROM = 0.5
"""Part of the flight from which the mismatch bounds the ultimate set."""

ROUNDING = 1e-6
"""Part by which a guarantee may be exceeded before it counts as broken."""

REFERENCE_MOVED = 1e-9
"""A change of slope of the reference beyond this (rad a sample) starts the claim anew."""

NEEDED = ("chi", "gamma", "chi_ref", "gamma_ref", "chi_err", "gamma_err", "phi_cmd", "n_z_cmd")
HELD = ("phi_limited", "n_z_limited")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Certified:
    """The guarantee of a linear loop beside the flight of its gains.

    Attributes
    ----------
    t : ndarray, shape (n,), s
        Middle of each sample interval.
    size : ndarray, shape (n,)
        ``||s||`` with s = (e', e) in rad/s and rad.
    bound : ndarray, shape (n,)
        What `size` may be at most: the guaranteed exponential plus `radius`. NaN where there is no
        claim: a limit holds a command, or the reference moves.
    rate : float, 1/s
        R_K; the exponential decays at half of it.
    L_d : float, rad/s^2
        Largest norm of the mismatch's derivative in the second half of the flight.
    radius : float
        Of the invariant ellipsoid for `L_d`: the ultimate bound of ``||s||``.
    angles : ndarray, shape (n, 2), rad
        Largest errors of course and path angle that go with `bound`; NaN where it is.
    broken : ndarray of bool, shape (n,)
        Where `size` is above `bound`.
    """

    t: FloatArray
    size: FloatArray
    bound: FloatArray
    rate: float
    L_d: float
    radius: float
    angles: FloatArray
    broken: np.ndarray

    @property
    def t_broken(self) -> float | None:
        """When the guarantee is first broken, s; None where it holds."""
        late = np.flatnonzero(self.broken)
        return float(self.t[late[0]]) if len(late) else None

    @property
    def share_broken(self) -> float:
        """Part of the samples with a claim at which it is broken, 0 to 1."""
        claimed = int(np.isfinite(self.bound).sum())
        return float(self.broken.sum()) / claimed if claimed else 0.0


def certified(run: Run) -> Certified | None:
    """Hold a run against the certificate of its gains on the kinematic law.

    Parameters
    ----------
    run : Run
        A flight whose scenario says ``V_a_mps`` and ``g_mps2`` in its table ``flight``.

    Returns
    -------
    Certified or None
        None where there is nothing to hold against: no gains, an unstable loop, a flight of fewer
        than eight samples, or signals of the loop that are not there.

    Notes
    -----
    The loop is ``s' = A_K s + E d'`` with the model of the chi/gamma law about wings-level flight
    on the first reference. With ``A_K' Q + Q A_K + I = 0`` and d = 0, ``s' Q s`` decays at R_K or
    faster, so that ``||s(t)|| <= sqrt(s_0' Q s_0 / lambda_min(Q)) exp(-R_K (t - t_0) / 2)``; what
    d' adds, from s = 0 on, stays in the invariant ellipsoid of its bound L_d. The sum of both is
    what is drawn. The claim is about the linear loop: it begins anew behind every move of the
    reference and where the last limit lets go, and there is none while a limit holds a command.

    No derivative of a sampled signal is estimated. The mean rate of an angle over a sample interval
    is its increment over the sample time, exactly; that is the rate of the error at the middle of
    the interval to second order in the sample time, and the error there is the one at its start
    plus half the increment. The course is unwrapped first.
    """
    signals, gains = run.signals, run.provenance.gains
    flight = run.provenance.scenario.get("flight") or {}
    if gains is None or len(signals) < LEAST_SAMPLES or "V_a_mps" not in flight:
        return None
    if not set(NEEDED) <= set(signals) or not np.isfinite(signals[list(NEEDED)].to_numpy()).all():
        return None
    V_a, g = float(flight["V_a_mps"]), float(flight.get("g_mps2", G_PAPER))
    try:
        model = kinematic_model(V_a=V_a, gamma=float(signals["gamma_ref"].iloc[0]), g=g)
        A_K = closed_loop(model, gains)
        L_d = _settled_L_d(run, V_a, g)
    except InputError:
        return None
    found = indicators(A_K)
    if found.Q is None:
        return None
    unit = invariant_ellipsoid(A_K, disturbance_entry(model), L_d=1.0)
    t, s, moved = _velocity_form(run)
    claimed = ~moved
    for name in HELD:
        if name in signals:
            claimed &= signals[name].to_numpy()[:-1] == 0.0
    level = _promised(t, np.einsum("ti,ij,tj->t", s, found.Q, s), claimed, found.R_K)
    smallest = float(np.linalg.eigvalsh(found.Q)[0])
    size, bound = np.linalg.norm(s, axis=1), np.sqrt(level / smallest) + unit.radius * L_d
    widths = np.sqrt(np.diag(np.linalg.inv(found.Q))[2:])
    angles = np.sqrt(level)[:, None] * widths + np.sqrt(np.diag(unit.W)[2:]) * L_d
    return Certified(
        t=t,
        size=size,
        bound=bound,
        rate=found.R_K,
        L_d=L_d,
        radius=unit.radius * L_d,
        angles=angles,
        broken=size > bound * (1.0 + ROUNDING) + ROUNDING**2,
    )


def _settled_L_d(run: Run, V_a: float, g: float) -> float:
    found = mismatch(run, V_a=V_a, g=g)
    late = found.t[:-1] >= SETTLED_FROM * run.duration
    return float(np.linalg.norm(found.d_dot[late], axis=1).max(initial=0.0))


def _velocity_form(run: Run) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Middle of each interval, s = (e', e) there, and where the reference changes its slope."""
    signals = run.signals
    t = signals.index.to_numpy(dtype=float)
    dt = np.diff(t)
    x, ref = (
        np.column_stack([np.unwrap(signals[chi].to_numpy()), signals[gamma].to_numpy()])
        for chi, gamma in (("chi", "gamma"), ("chi_ref", "gamma_ref"))
    )
    rates = np.diff(ref - x, axis=0) / dt[:, None]
    errors = signals[["chi_err", "gamma_err"]].to_numpy()
    slopes = np.diff(ref, axis=0)
    moved = np.abs(np.diff(slopes, axis=0, prepend=slopes[:1])).max(axis=1) > REFERENCE_MOVED
    s = np.column_stack([rates, errors[:-1] + 0.5 * dt[:, None] * rates])
    return t[:-1] + 0.5 * dt, s, moved


def _promised(t: FloatArray, level: FloatArray, claimed: np.ndarray, rate: float) -> FloatArray:
    """What ``s' Q s`` may be: exponentials from the start of each stretch with a claim."""
    n = np.arange(len(t))
    begins = claimed & ~np.concatenate([[False], claimed[:-1]])
    start = np.maximum.accumulate(np.where(begins, n, 0))
    return np.where(claimed, level[start] * np.exp(-rate * (t - t[start])), math.nan)
