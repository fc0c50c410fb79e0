"""Lags and delays between command and response: appended to a model, or sampled exactly.

A continuous model has a Pade section for a delay and for the half sample of a held command. In the
map of a sampled loop both are exact. Over one sample the plant is linear and each command changes
at most once, so that the next state is a matrix exponential.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_not_negative, check_positive, read_only_vector
from flighttune.base.errors import InputError, ShapeError
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel


def with_input_lag(model: LinearModel, bandwidths: npt.ArrayLike) -> LinearModel:
    """The model behind a first-order lag of each input; `bandwidths` (rad/s): one number or m."""
    each = _one_per_input("bandwidths", bandwidths, len(model.inputs)).tolist()
    return with_inner_loop(model, [InnerLag(order=1, natural_frequency=w) for w in each])


def with_input_delay(model: LinearModel, delay: npt.ArrayLike) -> LinearModel:
    """The model behind a Pade section ``(1 - s h/2) / (1 + s h/2)`` of each input, `delay` h in s.

    A sampled controller with zero-order hold delays its command by half its sample time on average;
    add its computing time. The delay follows the command: apply this to a model that already has
    its lag. The state of a section is its command behind a lag of h/2, in the unit of the input.
    """
    each = _one_per_input("delay", delay, len(model.inputs))
    late = [(np.array([[-2.0 / h]]), np.array([2.0 / h]), [2.0], -1.0) for h in each]
    return _behind(model, late, [[f"{name}_delay_1"] for name in model.inputs])


# State space A (k, k), B (k,), C (k,), D of the filter between a command and an input.
Filter: TypeAlias = tuple[FloatArray, FloatArray, Sequence[float], float]


def _behind(
    model: LinearModel, filters: Sequence[Filter], names: Sequence[Sequence[str]]
) -> LinearModel:
    """The model with a filter before each input; `names`: names of the filters' states."""
    from scipy.linalg import block_diag

    A, B, C, D = zip(*filters, strict=True)
    inside = block_diag(*A)
    passed, k = model.B @ block_diag(*C), len(inside)
    n, _, p = model.shape
    return replace(
        model,
        A=np.block([[model.A, passed], [np.zeros((k, n)), inside]]),
        B=np.vstack([model.B * D, block_diag(*(column[:, None] for column in B))]),
        C=np.hstack([model.C, np.zeros((p, k))]),
        states=(*model.states, *chain(*names)),
    )


def _one_per_input(name: str, value: npt.ArrayLike, m: int) -> FloatArray:
    try:
        values = read_only_vector(name, np.broadcast_to(value, (m,)))
    except ValueError as error:
        raise ShapeError(f"`{name}` must have shape ({m},), got {np.shape(value)}.") from error
    if not (values > 0.0).all():
        raise InputError(f"`{name}` must be positive, got {values.tolist()}.")
    return values


# A smaller delay, s, is neglected: a section of 2/delay would only harm the arithmetic.
NO_DELAY = 1e-5

Order: TypeAlias = Literal[1, 2, 3]


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class InnerLag:
    r"""Lag from command to response, static gain one.

    ``exp(-s delay)`` times ``w / (s + w)`` (order 1), ``w^2 / (s^2 + 2 z w s + w^2)`` (order 2), or
    the latter and ``1 / (1 + s lag)`` (order 3).

    Attributes
    ----------
    order : 1, 2 or 3
    natural_frequency : float, rad/s
        w above, positive: the inverse time constant of order 1.
    damping : float, 1
        z above, positive; without meaning for order 1.
    lag : float, s
        Time constant of the real pole of order 3, positive; without meaning below.
    delay : float, s
        Not negative.

    Examples
    --------
    >>> ft.loop.InnerLag(order=2, natural_frequency=4.0, damping=0.7).delay
    0.0
    """

    order: Order
    natural_frequency: float
    damping: float = 1.0
    lag: float = 1.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        if self.order not in (1, 2, 3):
            raise InputError(f"`order` must be 1, 2 or 3, got {self.order}.")
        check_positive(natural_frequency=self.natural_frequency, damping=self.damping, lag=self.lag)
        check_not_negative("s", delay=self.delay)

    def response(self, omega: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Frequency response at `omega` (rad/s), of the shape of `omega`."""
        s = 1j * np.asarray(omega, dtype=float)
        w, behind = self.natural_frequency, np.exp(-s * self.delay)
        if self.order == 1:
            return behind * (w / (s + w))
        lagged = w * w / (s * s + 2.0 * self.damping * w * s + w * w)
        return behind * (lagged / (1.0 + s * self.lag) if self.order == 3 else lagged)

    @property
    def whole(self) -> float:
        """Final time lag of the response to a ramp, s: the sum of all lags and the delay."""
        lag = 1.0 / self.natural_frequency
        if self.order > 1:
            lag *= 2.0 * self.damping
        return self.delay + lag + (self.lag if self.order == 3 else 0.0)

    def delayed(self, seconds: float) -> "InnerLag":
        """The same lag with its delay increased by `seconds`."""
        return replace(self, delay=self.delay + seconds)

    @property
    def bandwidth(self) -> float:
        """Frequency (rad/s) from which on the magnitude stays below 1/sqrt(2)."""
        # One over the squared magnitude, as a polynomial in (omega / natural frequency)^2, is 2.
        w, less = self.natural_frequency, np.array([1.0, 1.0])
        if self.order > 1:
            less = np.array([1.0, 4.0 * self.damping**2 - 2.0, 1.0])
        if self.order == 3:
            less = np.polymul([(w * self.lag) ** 2, 1.0], less)
        less[-1] -= 2.0
        roots = np.roots(less)
        return w * math.sqrt(roots.real[roots.imag == 0.0].max())

    @property
    def undelayed(self) -> tuple[FloatArray, FloatArray]:
        """A and B, shapes (order, order) and (order,), of the lag alone.

        Every state has the unit of the channel; the first one is the response.
        """
        w = self.natural_frequency
        if self.order == 1:
            return np.array([[-w]]), np.array([w])
        A = np.array([[0.0, w], [-w, -2.0 * self.damping * w]])
        B = np.array([0.0, w])
        if self.order == 2:
            return A, B
        rate = 1.0 / self.lag
        return np.block([[A, B[:, None]], [np.zeros((1, 2)), -rate]]), np.array([0.0, 0.0, rate])

    @property
    def state_space(self) -> tuple[FloatArray, FloatArray]:
        """A and B with the delay, from `NO_DELAY` on, as a first-order Pade section behind."""
        A, B = self.undelayed
        if self.delay < NO_DELAY:
            return A, B
        rate, n = 2.0 / self.delay, self.order
        return (np.block([[A, 2.0 * B[:, None]], [np.zeros((1, n)), -rate]]), np.append(-B, rate))


def with_inner_loop(model: LinearModel, lags: Sequence[InnerLag]) -> LinearModel:
    """The model behind the inner loop of each input: its states, then the states of each lag."""
    if len(lags) != len(model.inputs):
        raise ShapeError(f"`lags` must be {len(model.inputs)}, one an input, got {len(lags)}.")
    filters, names = [], []
    for name, lag in zip(model.inputs, lags, strict=True):
        A, B = lag.state_space
        filters.append((A, B, np.eye(len(A))[0], 0.0))
        states = (name, *(f"{name}_lag_{i}" for i in range(1, lag.order)), f"{name}_delay")
        names.append(states[: len(A)])
    return _behind(model, filters, names)


def inner_loop_scaling(model: LinearModel, lags: Sequence[InnerLag]) -> FloatArray:
    """Units of s = (x', e) of `with_inner_loop` in which a lag counts by its effect on x'."""
    n, _, p = model.shape
    # The unit of a lag's state of input i is ``1 / norm(B[:, i])``, with B without the inner loop.
    # The roll rate of the chi/gamma law then counts by the angular acceleration that it causes.
    effect = np.linalg.norm(model.B, axis=0)
    if not (effect > 0.0).all():
        raise InputError(f"`model` must have inputs that act on it, got B = {model.B.tolist()}.")
    sizes = [len(lag.state_space[0]) for lag in lags]
    return np.concatenate([np.ones(n), np.repeat(1.0 / effect, sizes), np.ones(p)])


# Maximum states of a sampled loop: the exact check of its rate then takes 3 s.
MAX_SAMPLED = 40


def sampled_loop(
    model: LinearModel,
    lags: Sequence[InnerLag],
    gains: PIGains,
    *,
    dt: float,
    trapezoidal: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """The map of the loop over one sample, while no limit acts, and units of its state.

    `model` is the model of the law alone (n states, m inputs, p errors). `lags` are the inner loops
    of the inputs without the delay of the hold, which is exact here; no lags if the inputs are the
    commands. `trapezoidal`: the integral adds the mean of two errors, as in `MimoPI`; else each
    error after the command of its sample, as in `ExactLaw`.

    The map, shape (N, N), acts on the state at a sample before its command: states of the model and
    of the lags, past commands of each input from the latest back, integrals in the unit of the
    inputs, and the errors of the sample before. In the units, shape (N,), a command and a lag's
    state count by the rate that they cause, as in `inner_loop_scaling`.
    """
    model.check_channels(gains)
    check_positive(dt=dt)
    n, m, p = model.shape
    plant = with_inner_loop(model, [replace(lag, delay=0.0) for lag in lags]) if lags else model
    delays = [lag.delay for lag in lags] or [0.0] * m
    k, late = len(plant.A), sum(delays) / dt
    others = k + 2 * m + p
    if others + late > MAX_SAMPLED:
        raise InputError(
            f"`lags` must be late by at most {MAX_SAMPLED - others} samples in all, for the loop "
            f"to have {MAX_SAMPLED} states, got {late:.3g}."
        )
    whole = [math.floor(delay / dt) for delay in delays]
    kept = [count + 1 for count in whole]
    first_kept = k + np.cumsum([0, *kept])
    integral, before = int(first_kept[-1]), int(first_kept[-1]) + m
    size = before + p

    # Rows that map the state to the errors, the new integrals and the commands.
    state, error = np.eye(size), np.zeros((p, size))
    error[:, :k] = plant.C
    old_integral, old_error = state[integral:before], state[before:]
    summed, share = (error + old_error, dt / 2.0) if trapezoidal else (error, dt)
    new_integral = old_integral + gains.K_I @ summed * share
    command = gains.K_P @ error + (new_integral if trapezoidal else old_integral)

    # The inner feedback measures a lag's first state; without lags there is nothing to feed back.
    orders = [lag.order for lag in lags] or [0] * m
    starts = n + np.cumsum([0, *orders])
    for i, fed in enumerate(gains.feedback if lags else ()):
        command[i] += fed * (command[i] - state[starts[i]])

    M = np.zeros((size, size))
    M[:k, :k] = _held(plant.A, np.zeros((k, 0)), dt)[0]
    for i in range(m):
        # The command from `whole` samples ago acts after the rest of the delay.
        late = delays[i] - whole[i] * dt
        fresh_A, fresh = _held(plant.A, plant.B[:, [i]], dt - late)
        _, stale = _held(plant.A, plant.B[:, [i]], late)
        under_way = state[first_kept[i] : first_kept[i + 1]]
        acting = [command[[i]], *under_way[:, None, :]]
        M[:k] += fresh @ acting[whole[i]] + fresh_A @ stale @ acting[whole[i] + 1]
        M[first_kept[i]] = command[i]
        M[first_kept[i] + 1 : first_kept[i + 1]] = under_way[:-1]
    M[integral:before], M[before:] = new_integral, error
    per_rate = 1.0 / np.linalg.norm(model.B, axis=0)
    late = np.repeat(per_rate, orders), np.repeat(per_rate, kept)
    return M, np.concatenate([np.ones(n), *late, per_rate, np.ones(p)])


def _held(A: FloatArray, B: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
    """State and input matrix over `time` with a held input, of ``x' = A x + B u``."""
    from scipy.linalg import expm

    n, m = B.shape
    both = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * time)
    return both[:n, :n], both[:n, n:]
