"""What stands between command and aircraft: inner-loop lag and controller delay."""

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, read_only_vector
from flighttune.control.linear_model import LinearModel
from flighttune.errors import InputError, ShapeError


def with_input_lag(model: LinearModel, bandwidths: npt.ArrayLike) -> LinearModel:
    """The model behind a first-order lag of each input.

    Parameters
    ----------
    model : LinearModel
        n states, m inputs, p errors.
    bandwidths : array_like, shape (m,) or (), rad/s
        Inverse time constants from command to input, positive.

    Returns
    -------
    LinearModel
        States (x, u), n + m of them; its inputs are the commands. The loop closes on the errors
        alone: output feedback.

    Raises
    ------
    ShapeError
        If `bandwidths` is not one number or m of them.
    InputError
        If one is not positive and finite.
    """
    n, m, p = model.shape
    bandwidth = _one_per_input("bandwidths", bandwidths, m)
    return LinearModel(
        A=np.block([[model.A, model.B], [np.zeros((m, n)), -np.diag(bandwidth)]]),
        B=np.vstack([np.zeros((n, m)), np.diag(bandwidth)]),
        C=np.hstack([model.C, np.zeros((p, m))]),
        states=(*model.states, *model.inputs),
        inputs=model.inputs,
        errors=model.errors,
    )


def with_input_delay(model: LinearModel, delay: npt.ArrayLike, *, sections: int = 1) -> LinearModel:
    """The model behind a delay of its inputs, by Pade sections.

    A sampled controller with zero-order hold delays its command by half its sample time on
    average; add the time it computes. The delay stands after the command: apply this to a model
    that has its lag already.

    Parameters
    ----------
    model : LinearModel
        n states, m inputs, p errors.
    delay : array_like, shape (m,) or (), s
        Delay of each input, positive.
    sections : int
        Number of first-order Pade sections ``(1 - s h/2) / (1 + s h/2)`` in a row, ``h = delay /
        sections``; the phase error falls with its square.

    Returns
    -------
    LinearModel
        n + m `sections` states; a section's own state is its command behind a lag of h/2, so that
        it has the unit of the input.

    Raises
    ------
    ShapeError
        If `delay` is not one number or m of them.
    InputError
        If a delay is not positive and finite, or `sections` not at least 1.
    """
    if sections < 1:
        raise InputError(f"`sections` must be at least 1, got {sections}.")
    n, m, p = model.shape
    rate = 2.0 * sections / _one_per_input("delay", delay, m)
    A = np.block([[model.A, 2.0 * model.B], [np.zeros((m, n)), -np.diag(rate)]])
    delayed = LinearModel(
        A=A,
        B=np.vstack([-model.B, np.diag(rate)]),
        C=np.hstack([model.C, np.zeros((p, m))]),
        states=(*model.states, *(f"{name}_delay_{sections}" for name in model.inputs)),
        inputs=model.inputs,
        errors=model.errors,
    )
    if sections == 1:
        return delayed
    rest = np.broadcast_to(delay, (m,)) * (sections - 1) / sections
    return with_input_delay(delayed, rest, sections=sections - 1)


def _one_per_input(name: str, value: npt.ArrayLike, m: int) -> FloatArray:
    try:
        values = read_only_vector(name, np.broadcast_to(value, (m,)))
    except ValueError as error:
        raise ShapeError(f"`{name}` must have shape ({m},), got {np.shape(value)}.") from error
    if not (values > 0.0).all():
        raise InputError(f"`{name}` must be positive, got {values.tolist()}.")
    return values
