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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoundFlown:
    """The norm of ``s = (e', e)`` over a flight, and what is guaranteed of it.

    Attributes
    ----------
    t : ndarray, shape (n,), s
    norm : ndarray, shape (n,), rad/s and rad
        Euclidean norm of the error rates and errors.
    guaranteed : ndarray, shape (n,)
        Largest norm that the certified linear loop can have; nan before `t_free`.
    t_free : float, s
        The time from which no limit holds a command: the certificate knows none.
    t_broken : float or None, s
        When the norm was first above what is guaranteed.
    """

    t: FloatArray
    norm: FloatArray
    guaranteed: FloatArray
    t_free: float
    t_broken: float | None


def bound_flown(run: Run, certificate: Certificate) -> BoundFlown:
    r"""Hold a flight against the exponential that a certificate guarantees.

    Parameters
    ----------
    run : Run
        Of at least two samples.
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
    held = np.any([run.signals[f"{name}_limited"] != 0.0 for name in ("phi", "n_z")], axis=0)
    last = np.flatnonzero(held)
    first = min(int(last[-1]) + 2, len(t) - 1) if len(last) else 0
    Q, rate, radius = certificate.Q, certificate.claim.rate, certificate.claim.radius
    start = math.sqrt(float(s[first] @ Q @ s[first]) / float(np.linalg.eigvalsh(Q)[0]))
    guaranteed = start * np.exp(-0.5 * rate * (t - t[first]))
    if radius is not None:
        guaranteed = np.maximum(guaranteed, radius)
    guaranteed[:first] = math.nan
    over = np.flatnonzero((norm > guaranteed) & (norm > UNSEEN))
    return BoundFlown(
        t=t,
        norm=norm,
        guaranteed=guaranteed,
        t_free=float(t[first]),
        t_broken=float(t[over[0]]) if len(over) else None,
    )
