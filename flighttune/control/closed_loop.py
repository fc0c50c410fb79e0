"""The velocity form of a PI loop: A_K of a linear model and its gains."""

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel
from flighttune.errors import InputError, ShapeError


def closed_loop(model: LinearModel, gains: PIGains) -> FloatArray:
    """A_K of the loop ``s' = A_K s + d_s`` with ``s = (x', e)``.

    Parameters
    ----------
    model : LinearModel
        n states, m inputs, p errors.
    gains : PIGains
        Gains whose channels are those of `model`.

    Returns
    -------
    ndarray, shape (n + p, n + p)
        ``[[A + B K_P C, B K_I], [C, 0]]``; the paper's A_K(0) where C = I.

    Raises
    ------
    InputError
        If the channels of `gains` are not those of `model`.

    Notes
    -----
    Theorem 2 of arXiv 2411.13140, with an output matrix C.
    """
    if (gains.inputs, gains.errors) != (model.inputs, model.errors):
        raise InputError(
            f"`gains` must act from {model.errors} on {model.inputs}, "
            f"got {gains.errors} on {gains.inputs}."
        )
    return closed_loops(model, gains.K)


def closed_loops(model: LinearModel, K: npt.ArrayLike) -> FloatArray:
    """A_K of many stacked gains (K_P, K_I): shape (..., m, 2 p) to (..., n + p, n + p).

    Raises
    ------
    ShapeError
        If the last two axes of `K` are not (m, 2 p).
    """
    n, m, p = model.shape
    K = np.asarray(K, dtype=float)
    if K.shape[-2:] != (m, 2 * p):
        raise ShapeError(f"`K` must have shape (..., {m}, {2 * p}), got {K.shape}.")
    A_K = np.zeros((*K.shape[:-2], n + p, n + p))
    A_K[..., :n, :n] = model.A + model.B @ K[..., :p] @ model.C
    A_K[..., :n, n:] = model.B @ K[..., p:]
    A_K[..., n:, :n] = model.C
    return A_K


def disturbance_entry(model: LinearModel) -> FloatArray:
    """E of ``d_s = E d'``: where the derivative of a state disturbance enters s = (x', e).

    Returns
    -------
    ndarray, shape (n + p, n)
        ``[I; 0]``: the disturbance reaches the velocity form only through its derivative.
    """
    n, _, p = model.shape
    return np.vstack([np.eye(n), np.zeros((p, n))])
