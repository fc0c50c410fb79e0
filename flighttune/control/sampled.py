"""The loop as it is flown: a sampled controller on a continuous model, without approximation."""

import math

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel
from flighttune.errors import InputError, ShapeError


def sampled_loop(model: LinearModel, gains: PIGains, dt: float) -> FloatArray:
    """One sample of the loop: ``(x, w)`` at the next sample from that at this one.

    Parameters
    ----------
    model : LinearModel
        n states, m inputs, p errors.
    gains : PIGains
        Gains whose channels are those of `model`.
    dt : float, s
        Sample time.

    Returns
    -------
    ndarray, shape (n + m, n + m)
        ``u = (K_P + K_I dt/2) e + w`` is held for a sample, and ``w`` grows by ``K_I dt e``: the
        trapezoidal integral of `flighttune.control.mimo_pi.MimoPI` without limits.

    Raises
    ------
    InputError
        If the channels of `gains` are not those of `model`, or `dt` is not positive.

    Notes
    -----
    The model under a held input by the matrix exponential: K. J. Astrom and B. Wittenmark,
    *Computer-Controlled Systems*, 3rd ed., Prentice Hall 1997, section 2.3.
    """
    if (gains.inputs, gains.errors) != (model.inputs, model.errors):
        raise InputError(
            f"`gains` must act from {model.errors} on {model.inputs}, "
            f"got {gains.errors} on {gains.inputs}."
        )
    if not (math.isfinite(dt) and dt > 0.0):
        raise InputError(f"`dt` must be positive, got {dt} s.")
    n, m, _ = model.shape
    held = expm(np.block([[model.A, model.B], [np.zeros((m, n + m))]]) * dt)
    A, B = held[:n, :n], held[:n, n:]
    direct = (gains.K_P + 0.5 * dt * gains.K_I) @ model.C
    return np.block([[A + B @ direct, B], [dt * gains.K_I @ model.C, np.eye(m)]])


def sampled_eigenvalues(
    model: LinearModel, gains: PIGains, dt: float
) -> npt.NDArray[np.complex128]:
    """Eigenvalues (1/s) of a continuous loop that decays and turns like the sampled one.

    Parameters
    ----------
    model, gains, dt
        As `sampled_loop`.

    Returns
    -------
    ndarray of complex, shape (n + m,)
        ``log(z) / dt`` of the eigenvalues z, rightmost first; stable where all lie on the left.

    Raises
    ------
    InputError
        As `sampled_loop`.
    """
    z = np.asarray(np.linalg.eigvals(sampled_loop(model, gains, dt)), dtype=complex)
    with np.errstate(divide="ignore"):
        s = np.asarray(np.log(z) / dt, dtype=complex)
    return s[np.argsort(-np.real(s), kind="stable")]


def sampled_response(
    model: LinearModel, gains: PIGains, dt: float, *, e_0: npt.ArrayLike, samples: int
) -> FloatArray:
    """Errors at the samples after a step of the references.

    Parameters
    ----------
    model, gains, dt
        As `sampled_loop`; the first p states of `model` are the errors.
    e_0 : array_like, shape (p,)
        Errors at the first sample; everything else is at rest.
    samples : int
        Samples wanted.

    Returns
    -------
    ndarray, shape (samples, p)

    Raises
    ------
    InputError
        As `sampled_loop`.
    ShapeError
        If `e_0` is not one number an error.
    """
    n, _, p = model.shape
    step = sampled_loop(model, gains, dt)
    e = np.asarray(e_0, dtype=float)
    if e.shape != (p,):
        raise ShapeError(f"`e_0` must have shape ({p},), got {e.shape}.")
    state = np.zeros(len(step))
    state[:p] = e
    state[n:] = -0.5 * dt * gains.K_I @ e
    errors = np.empty((samples, p))
    for k in range(samples):
        errors[k] = model.C @ state[:n]
        state = step @ state
    return errors
