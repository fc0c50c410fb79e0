"""A flight beside what its certificate guarantees: the norm of s, the exponential, the ball."""

import math
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.certificates import Certificate
from flighttune.simulate.run import Run

CHANNELS = ("chi", "gamma")
UNSEEN = 2e-3
"""Norm of s (0.1 deg in an error) below which nothing counts as broken."""


REFERENCE_MOVED = 1e-9
"""A change of slope of the reference beyond this (rad a sample) starts the claim anew."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoundFlown:
    """The norm of ``s = (e', e)`` over a flight, and what is guaranteed of it.

    Attributes
    ----------
    t : ndarray, shape (n,), s
    norm : ndarray, shape (n,), rad/s and rad
        Euclidean norm of the error rates and errors.
    guaranteed : ndarray, shape (n,)
        Largest norm that the certified linear loop can have; nan while a limit holds a command or
        the reference changes its slope, of which the certificate knows nothing. It begins anew
        after each.
    t_free : float or None, s
        When there first was a guarantee; None where there never was.
    t_broken : float or None, s
        When the norm was first above what is guaranteed.
    """

    t: FloatArray
    norm: FloatArray
    guaranteed: FloatArray
    t_free: float | None
    t_broken: float | None


def bound_flown(run: Run, certificate: Certificate) -> BoundFlown:
    r"""Hold a flight against the exponential that a certificate guarantees.

    Parameters
    ----------
    run : Run
        Of at least three samples.
    certificate : Certificate
        Of the chi/gamma loop, with four states.

    Notes
    -----
    With ``V = s' Q s`` and the certified rate R, ``V(t) <= V(t_1) exp(-R (t - t_1))`` gives
    ``||s(t)|| <= sqrt(V(t_1) / lambda_min(Q)) exp(-R (t - t_1) / 2)``. Under a disturbance the loop
    may stay as far out as the certified radius, which is then the floor of the bound. The error
    rates are central differences of the recorded errors.
    """
    t = run.signals.index.to_numpy(dtype=float)
    errors = np.column_stack([np.unwrap(run.signals[f"{name}_err"]) for name in CHANNELS])
    s = np.hstack([np.gradient(errors, t, axis=0), errors])
    norm = np.linalg.norm(s, axis=1)
    Q, rate, radius = certificate.Q, certificate.claim.rate, certificate.claim.radius
    least = float(np.linalg.eigvalsh(Q)[0])
    guaranteed = np.full(len(t), math.nan)
    for first, end in stretches(_free(run)):
        start = math.sqrt(float(s[first] @ Q @ s[first]) / least)
        guaranteed[first:end] = start * np.exp(-0.5 * rate * (t[first:end] - t[first]))
    if radius is not None:
        guaranteed = np.maximum(guaranteed, radius)
    known = np.flatnonzero(np.isfinite(guaranteed))
    over = np.flatnonzero((norm > guaranteed) & (norm > UNSEEN))
    return BoundFlown(
        t=t,
        norm=norm,
        guaranteed=guaranteed,
        t_free=float(t[known[0]]) if len(known) else None,
        t_broken=float(t[over[0]]) if len(over) else None,
    )


def stretches(flag: np.ndarray) -> list[tuple[int, int]]:
    """First and one past the last place of every stretch in which `flag` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flag, [False]]).astype(int)))
    return [(int(first), int(end)) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def _free(run: Run) -> np.ndarray:
    """Where neither a limit nor a bend of the reference is within a sample."""
    signals = run.signals
    taken = np.any([signals[f"{name}_limited"] != 0.0 for name in ("phi", "n_z")], axis=0)
    for name in CHANNELS:
        bend = np.abs(np.diff(np.unwrap(signals[f"{name}_ref"]), n=2))
        taken[1:-1] |= bend > REFERENCE_MOVED
    near = taken.copy()
    near[1:] |= taken[:-1]
    near[:-1] |= taken[1:]
    return ~near
