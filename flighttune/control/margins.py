"""How far a loop is from instability: gain, phase, delay and lag, one channel and all at once."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import root_scalar

from flighttune.arrays import FloatArray
from flighttune.control.closed_loop import closed_loop
from flighttune.control.gains import PIGains
from flighttune.control.lag import with_input_lag
from flighttune.control.linear_model import LinearModel

GRID_PER_DECADE = 60
NO_GAIN = 1e-9
"""A destabilising factor this small is the rounding of none at all."""
LONGEST_LAG = 1e3
SHORTEST_LAG = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelMargins:
    """Margins of one input, the other loops closed.

    Attributes
    ----------
    channel : str
        The input at which the loop is cut.
    gain_increase, gain_decrease : float, 1
        Factors on the loop gain at which it becomes unstable: above 1 (inf if none) and below 1
        (0 if none).
    phase_margin : float, rad
        Smallest additional phase lag that destabilises; inf if the gain never crosses 1.
    delay_margin : float, s
        Smallest additional delay that destabilises; inf if there is none.
    """

    channel: str
    gain_increase: float
    gain_decrease: float
    phase_margin: float
    delay_margin: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopMargins:
    """Margins of a whole loop at its inputs.

    Attributes
    ----------
    channels : tuple of ChannelMargins
        One input at a time.
    disk_margin : float, 1
        Size of the largest disk of gain and phase changes, each input its own and all at once,
        that the loop survives: 2 would be perfect, 0 is the verge of instability.
    disk_gain : float, 1
        Every input's gain may change at once by any factor from 1/`disk_gain` to `disk_gain`.
    disk_phase : float, rad
        Every input's phase may change at once by up to this.
    delay_margin : float, s
        Smallest delay common to all inputs that destabilises.
    lag_margin : float, s
        Smallest time constant of a first-order lag common to all inputs that destabilises.
    """

    channels: tuple[ChannelMargins, ...]
    disk_margin: float
    disk_gain: float
    disk_phase: float
    delay_margin: float
    lag_margin: float


def loop_margins(model: LinearModel, gains: PIGains) -> LoopMargins | None:
    """Margins of the loop that `gains` close on `model`, or None if it is not stable.

    Parameters
    ----------
    model : LinearModel
    gains : PIGains
        With the channels of `model`.

    Returns
    -------
    LoopMargins or None

    Raises
    ------
    InputError
        If the channels of `gains` are not those of `model`.

    Notes
    -----
    Channel margins and the multi-loop disk margin (balanced, by the structured singular value of
    ``(S - T)/2``) are python-control's; see Seiler, Packard and Gahinet, *An introduction to disk
    margins*, IEEE Control Systems 40(5), 2020.
    """
    A_K = closed_loop(model, gains)
    if not np.linalg.eigvals(A_K).real.max() < 0.0:
        return None
    import control

    omega = _frequencies(A_K)
    loop = control.ss(*_opened(model, gains, tuple(range(len(model.inputs)))))
    disk, gain_dB, phase_deg = control.disk_margins(loop, omega)
    return LoopMargins(
        channels=tuple(_channel(model, gains, i, control) for i in range(len(model.inputs))),
        disk_margin=float(disk),
        disk_gain=float(10.0 ** (gain_dB / 20.0)),
        disk_phase=math.radians(float(phase_deg)),
        delay_margin=delay_margin(model, gains),
        lag_margin=lag_margin(model, gains),
    )


def lag_margin(model: LinearModel, gains: PIGains) -> float:
    """Smallest time constant, s, of a first-order lag common to all inputs that destabilises.

    Returns
    -------
    float
        0 if the loop is unstable without a lag, inf if no lag up to `LONGEST_LAG` destabilises.

    Raises
    ------
    InputError
        If the channels of `gains` are not those of `model`.
    """
    if not np.linalg.eigvals(closed_loop(model, gains)).real.max() < 0.0:
        return 0.0

    def abscissa(log_lag: float) -> float:
        lagged = with_input_lag(model, math.exp(-log_lag))
        return float(np.linalg.eigvals(closed_loop(lagged, gains)).real.max())

    decades = math.log10(LONGEST_LAG / SHORTEST_LAG)
    log_lags = np.linspace(
        math.log(SHORTEST_LAG), math.log(LONGEST_LAG), int(decades * GRID_PER_DECADE)
    )
    for shorter, longer in pairwise(log_lags):
        if abscissa(longer) >= 0.0:
            return math.exp(_root(abscissa, shorter, longer))
    return math.inf


def delay_margin(model: LinearModel, gains: PIGains) -> float:
    """Smallest delay, s, common to all inputs that destabilises a stable loop.

    Returns
    -------
    float
        0 if the loop is unstable without a delay, inf if no delay destabilises it.

    Raises
    ------
    InputError
        If the channels of `gains` are not those of `model`.

    Notes
    -----
    ``L(jw) exp(-jwh)`` has the eigenvalue -1 where an eigenvalue of L(jw) has the modulus 1; its
    phase says at which delay h.
    """
    A_K = closed_loop(model, gains)
    if not np.linalg.eigvals(A_K).real.max() < 0.0:
        return 0.0
    A, B, C, _ = _opened(model, gains, tuple(range(len(model.inputs))))

    def eigenvalues(omega: float) -> npt.NDArray[np.complex128]:
        loop = C @ np.linalg.solve(1j * omega * np.eye(len(A)) - A, B)
        values = np.asarray(np.linalg.eigvals(loop), dtype=complex)
        return values[np.argsort(np.abs(values))]

    omega = _frequencies(A_K).tolist()
    excess = np.abs([eigenvalues(w) for w in omega]) - 1.0
    delays = [math.inf]
    for step, k in np.argwhere(excess[:-1] * excess[1:] <= 0.0):
        crossing = _root(
            lambda w, k=k: float(np.abs(eigenvalues(w)[k])) - 1.0, omega[step], omega[step + 1]
        )
        phase = np.angle(eigenvalues(crossing)[k])
        delays.append(float((phase + math.pi) % (2.0 * math.pi)) / crossing)
    return float(min(delays))


def _opened(
    model: LinearModel, gains: PIGains, cut: tuple[int, ...]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """State space from the cut inputs to minus what the controller would send them."""
    n, m, p = model.shape
    closed = [i for i in range(m) if i not in cut]
    K_P, K_I = gains.K_P @ model.C, gains.K_I
    A = np.zeros((n + p, n + p))
    A[:n, :n] = model.A + model.B[:, closed] @ K_P[closed]
    A[:n, n:] = model.B[:, closed] @ K_I[closed]
    A[n:, :n] = model.C
    B = np.vstack([model.B[:, cut], np.zeros((p, len(cut)))])
    C = -np.hstack([K_P[list(cut)], K_I[list(cut)]])
    return A, B, C, np.zeros((len(cut), len(cut)))


def _channel(model: LinearModel, gains: PIGains, i: int, control: Any) -> ChannelMargins:
    loop = control.ss(*_opened(model, gains, (i,)))
    gain, phase, _, _, crossover, _ = control.stability_margins(loop, returnall=True)
    lag = np.deg2rad(np.mod(phase, 360.0))
    with np.errstate(divide="ignore"):
        delays = lag / crossover
    return ChannelMargins(
        channel=model.inputs[i],
        gain_increase=float(min(gain[gain > 1.0], default=math.inf)),
        gain_decrease=float(max(gain[(gain > NO_GAIN) & (gain < 1.0)], default=0.0)),
        phase_margin=float(min(lag, default=math.inf)),
        delay_margin=float(min(delays, default=math.inf)),
    )


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(root_scalar(function, bracket=(low, high), xtol=1e-12).root)


def _frequencies(A_K: FloatArray) -> FloatArray:
    """A grid two decades wider than the closed loop's eigenvalues, rad/s."""
    size = np.abs(np.linalg.eigvals(A_K))
    low, high = np.log10(size.min()) - 2.0, np.log10(size.max()) + 2.0
    return np.logspace(low, high, int((high - low) * GRID_PER_DECADE))
