"""The loop as it is flown: sampled PI, held commands, lags and delays of roll and load factor.

The continuous models of this project take a delay, and the half sample that a held command is late,
as a Pade section. Here both are exact: over one sample the plant is linear with commands that
change at most once, so that its state at the next sample is a matrix exponential.
"""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.arrays import FloatArray, check_positive
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.linear_model import LinearModel
from flighttune.errors import InputError, ShapeError

# States of a sampled loop: the exact check of its rate takes 3 s at as many.
MAX_SAMPLED = 40


def sampled_loop(
    model: LinearModel,
    lags: Sequence[InnerLag],
    gains: PIGains,
    *,
    dt: float,
    trapezoidal: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """The map of the loop over one sample, while no limit holds, and units of its state.

    `model` is that of the law alone (n states, m inputs, p errors), `lags` the inner loop of each
    input without the delay of the hold, which is exact here; none where the inputs are the
    commands. `trapezoidal`: the integral takes the mean of two errors, as `MimoPI` does; else each
    error after the command of its sample, as `ExactLaw` does.

    Returns
    -------
    loop : ndarray, shape (N, N)
        N = n + lag states + commands under way + m + p. Acts on the state at a sample before its
        command: states of the model, of the lags in turn, commands of each input from the last one
        back, integrals in the unit of the inputs, and the errors of the sample before.
    units : ndarray, shape (N,)
        In these a command and a lag's state count by the rate that they cause, as in
        `inner_loop_scaling`.

    Raises
    ------
    ShapeError, InputError
        If models, lags and gains do not fit, or N is above `MAX_SAMPLED`.
    """
    model.check_channels(gains)
    check_positive(dt=dt)
    n, m, p = model.shape
    if lags and len(lags) != m:
        raise ShapeError(f"`lags` must be {m}, one an input, got {len(lags)}.")
    A, B = _plant(model, lags)
    delays = [lag.delay for lag in lags] or [0.0] * m
    late, others = sum(delays) / dt, len(A) + 2 * m + p
    if others + late > MAX_SAMPLED:
        raise InputError(
            f"`lags` must be late by at most {MAX_SAMPLED - others} samples in all, for the loop "
            f"to have {MAX_SAMPLED} states, got {late:.3g}."
        )
    whole = [math.floor(delay / dt) for delay in delays]
    k, kept = len(A), [count + 1 for count in whole]
    first_kept = k + np.cumsum([0, *kept])
    integral, before = int(first_kept[-1]), int(first_kept[-1]) + m
    size = before + p
    C = np.hstack([model.C, np.zeros((p, k - n))])

    # Rows that give the errors, the new integrals and the commands from the state.
    error, old_error, old_integral = np.zeros((p, size)), np.zeros((p, size)), np.zeros((m, size))
    error[:, :k] = C
    old_error[:, before:] = np.eye(p)
    old_integral[:, integral:before] = np.eye(m)
    if trapezoidal:
        new_integral = old_integral + gains.K_I @ (error + old_error) * (dt / 2.0)
        command = gains.K_P @ error + new_integral
    else:
        new_integral = old_integral + gains.K_I @ error * dt
        command = gains.K_P @ error + old_integral

    # What the inner feedback measures: a lag's first state or, without lags, the last command.
    starts = n + np.cumsum([0, *(lag.order for lag in lags)])[:-1] if lags else first_kept[:-1]
    for i, fed in enumerate(gains.feedback):
        command[i] += fed * (command[i] - np.eye(size)[starts[i]])

    M = np.zeros((size, size))
    M[:k, :k] = _held(A, np.zeros((k, 0)), dt)[0]
    for i in range(m):
        # The command of `whole` samples ago takes over after the rest of the delay.
        late = delays[i] - whole[i] * dt
        fresh_A, fresh = _held(A, B[:, [i]], dt - late)
        _, stale = _held(A, B[:, [i]], late)
        under_way = np.eye(size)[first_kept[i] : first_kept[i + 1]]
        acting = [command[[i]], *under_way[:, None, :]]
        M[:k] += fresh @ acting[whole[i]] + fresh_A @ stale @ acting[whole[i] + 1]
        M[first_kept[i]] = command[i]
        M[first_kept[i] + 1 : first_kept[i + 1]] = under_way[:-1]
    M[integral:before], M[before:] = new_integral, error
    per_rate = 1.0 / np.linalg.norm(model.B, axis=0)
    orders = [lag.order for lag in lags] or [0] * m
    late = np.repeat(per_rate, orders), np.repeat(per_rate, kept)
    return M, np.concatenate([np.ones(n), *late, per_rate, np.ones(p)])


def _plant(model: LinearModel, lags: Sequence[InnerLag]) -> tuple[FloatArray, FloatArray]:
    """A and B of the model behind lags whose delays are left out; every lag's first state acts."""
    from scipy.linalg import block_diag

    if not lags:
        return model.A, model.B
    inside, entries = zip(*(lag.undelayed for lag in lags), strict=True)
    response = block_diag(*(np.eye(len(A))[:1] for A in inside))
    n, k = model.shape[0], sum(map(len, inside))
    A = np.block([[model.A, model.B @ response], [np.zeros((k, n)), block_diag(*inside)]])
    B = np.vstack([np.zeros((n, len(lags))), block_diag(*(column[:, None] for column in entries))])
    return A, B


def _held(A: FloatArray, B: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
    """State and input matrix over `time` with a held input, of ``x' = A x + B u``."""
    from scipy.linalg import expm

    n, m = B.shape
    both = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * time)
    return both[:n, :n], both[:n, n:]
