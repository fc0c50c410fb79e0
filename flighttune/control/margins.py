"""Stability margins of a loop: gain, phase, delay and lag, for one channel or all together."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import with_input_lag
from flighttune.control.linear_model import LinearModel, closed_loop, inner_feedback, velocity_form

GRID_PER_DECADE = 60
RTOL = 1e-15  # tolerance of a root between two points of the grid
LONGEST_LAG = 1e3
SHORTEST_LAG = 1e-4

# A smaller destabilising factor is rounding: there is none.
NO_GAIN = 1e-9

# Offset from a pole, relative to the largest entry of A, for the response at the pole.
BESIDE = 1e-12

# A zero within this relative distance counts as on the imaginary axis. Rounding moves a double zero
# by 1e-8; the frequency response later rejects a zero that was admitted by mistake.
ON_AXIS = 1e-5

# Crossings are sought within this factor of the closed loop's slowest and fastest eigenvalues,
# because a pencil returns a zero at infinity as a very large zero.
BAND = 1e6

# Relative accuracy: at no frequency is the disk margin smaller than the result by more.
DISK_ACCURACY = 1e-10

# Iterations that balance three or more inputs; the first iteration balances two.
SWEEPS = 10


TOGETHER = "all at once"  # name of the margins of all inputs together

# A, B, C of a strictly proper loop L(s), from inputs to minus the controller's commands.
Loop: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]

Interval: TypeAlias = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Margins of one input with the other loops closed, or of all inputs at once.

    For all inputs together (`TOGETHER`) each input changes by its own amount, up to these margins;
    delay and lag are common to all.
    """

    loop: str  # the input at which the loop is cut, or `TOGETHER`
    # Factors on the loop gain at which it becomes unstable: below 1 (0 if none) and above 1 (inf)
    gain_decrease: float
    gain_increase: float
    phase_margin: float  # rad: smallest additional lag that destabilises; inf if no gain is 1
    delay_margin: float  # s: smallest additional delay that destabilises; inf if no delay does
    # For all inputs only: smallest time constant (s) of a destabilising lag, and the disk margin: 2
    # at best, 0 at the stability limit
    lag_margin: float | None = None
    disk_margin: float | None = None


def loop_margins(model: LinearModel, gains: PIGains) -> tuple[Margins, ...]:
    """Margins of `gains` on `model`, for each input and for all together; none if unstable."""
    if not _is_stable(closed_loop(model, gains)):
        return ()
    # The disk margin is balanced: the structured singular value of ``(S - T)/2``. P. Seiler, A.
    # Packard and P. Gahinet, *An introduction to disk margins*, IEEE Control Systems 40(5), 2020.
    disk = _disk_margin(_opened(model, gains))
    # the disk meets the real axis at 1/gain and gain, and the unit circle at +-phase
    gain = (2.0 + disk) / (2.0 - disk) if disk < 2.0 else math.inf
    return *channel_margins(model, gains), Margins(
        loop=TOGETHER,
        gain_decrease=1.0 / gain,
        gain_increase=gain,
        phase_margin=2.0 * math.atan(disk / 2.0),
        delay_margin=delay_margin(model, gains),
        lag_margin=lag_margin(model, gains),
        disk_margin=disk,
    )


def channel_margins(model: LinearModel, gains: PIGains) -> tuple[Margins, ...]:
    """The single-input margins of `loop_margins`, in a quarter of its time."""
    if not _is_stable(closed_loop(model, gains)):
        return ()
    return cut_margins(_opened(model, gains), model.inputs)


def cut_margins(loop: Loop, inputs: Sequence[str]) -> tuple[Margins, ...]:
    """The single-input margins of any loop, cut at each of its `inputs` in turn."""
    A, B, C = loop
    if not _is_stable(A - B @ C):
        return ()
    return tuple(_channel_margins(loop, i, name) for i, name in enumerate(inputs))


def channel_responses(
    model: LinearModel, gains: PIGains, omega: FloatArray
) -> npt.NDArray[np.complex128]:
    """Responses, (k, m), at `omega`, rad/s, cut at each input with the others closed."""
    A, B, C = _opened(model, gains)
    # A loop is at its stability limit if its response is -1.
    cut = (_cut_at(i, A, B, C) for i in range(B.shape[1]))
    return np.stack([_response(loop, omega)[:, 0, 0] for loop in cut], axis=1)


def lag_margin(model: LinearModel, gains: PIGains) -> float:
    """Smallest time constant, s, of a first-order lag common to all inputs that destabilises."""
    from scipy.optimize import brentq

    if not _is_stable(closed_loop(model, gains)):
        return 0.0

    # The loop is affine in the bandwidth of the lags.
    at_one, at_two = (closed_loop(with_input_lag(model, rate), gains) for rate in (1.0, 2.0))

    def abscissa(log_lag: float | FloatArray) -> FloatArray:
        bandwidth = np.exp(-np.asarray(log_lag))[..., None, None]
        lagged = (2.0 * at_one - at_two) + bandwidth * (at_two - at_one)
        return np.asarray(np.linalg.eigvals(lagged).real.max(axis=-1), dtype=float)

    ends = math.log(SHORTEST_LAG), math.log(LONGEST_LAG)
    log_lags = np.linspace(*ends, int(math.log10(LONGEST_LAG / SHORTEST_LAG) * GRID_PER_DECADE))
    unstable = np.flatnonzero(abscissa(log_lags) >= 0.0)
    if not len(unstable):
        return math.inf
    if unstable[0] == 0:
        return SHORTEST_LAG
    ends = log_lags[unstable[0] - 1], log_lags[unstable[0]]
    return math.exp(brentq(lambda log_lag: float(abscissa(log_lag)), *ends, rtol=RTOL))


def delay_margin(model: LinearModel, gains: PIGains) -> float:
    """Smallest delay, s, common to all inputs that destabilises a loop; 0 if it is unstable."""
    from scipy.optimize import brentq

    A_K = closed_loop(model, gains)
    if not _is_stable(A_K):
        return 0.0
    loop = _opened(model, gains)

    def eigenvalues(omega: float | FloatArray) -> npt.NDArray[np.complex128]:
        values = np.asarray(np.linalg.eigvals(_response(loop, omega)), dtype=complex)
        return np.take_along_axis(values, np.argsort(np.abs(values), axis=-1), axis=-1)

    decades = np.log10(np.abs(np.linalg.eigvals(A_K)))
    low, high = decades.min() - 2.0, decades.max() + 2.0
    omega = np.logspace(low, high, int((high - low) * GRID_PER_DECADE))
    # ``L(jw) exp(-jwh)`` has the eigenvalue -1 if an eigenvalue of L(jw) has the modulus 1; its
    # phase gives the delay h.
    excess = np.abs(eigenvalues(omega)) - 1.0
    delays = [math.inf]
    for step, k in np.argwhere(excess[:-1] * excess[1:] <= 0.0):
        ends = omega[step], omega[step + 1]
        crossing = brentq(lambda w, k=k: float(np.abs(eigenvalues(w)[k])) - 1.0, *ends, rtol=RTOL)
        delays.append(float(_phase_lag(eigenvalues(crossing)[k])) / crossing)
    return min(delays)


def _is_stable(A_K: FloatArray) -> bool:
    return bool(np.linalg.eigvals(A_K).real.max() < 0.0)


def _opened(model: LinearModel, gains: PIGains) -> Loop:
    # The loop is cut behind the inner feedback, at the final commands.
    k, k_M = inner_feedback(model, gains.feedback)
    rows = np.hstack([gains.K_P @ model.C, gains.K_I]) * (1.0 + k)[:, None]
    rows[:, : len(model.states)] -= k_M
    return *velocity_form(model), -rows


def _response(loop: Loop, omega: float | FloatArray) -> npt.NDArray[np.complex128]:
    """``C (jw - A)^-1 B`` at frequencies of shape (...), rad/s: shape (..., m, m)."""
    A, B, C = loop
    s = 1j * np.asarray(omega)[..., None, None]
    try:
        return C @ np.linalg.solve(s * np.eye(len(A)) - A, B)
    except np.linalg.LinAlgError:  # a pole on the axis: the response next to it serves as well
        s = s + BESIDE * np.abs(A).max()
        return C @ np.linalg.solve(s * np.eye(len(A)) - A, B)


def _phase_lag(value: Any) -> Any:
    """Additional phase lag, rad, that turns a value on the unit circle into -1."""
    return (np.angle(value) + math.pi) % (2.0 * math.pi)


def _cut_at(i: int, A: FloatArray, B: FloatArray, C: FloatArray) -> Loop:
    """The loop at one input, with the others closed."""
    kept_inputs = [j for j in range(B.shape[1]) if j != i]
    return A - B[:, kept_inputs] @ C[kept_inputs], B[:, [i]], C[[i]]


def _channel_margins(loop: Loop, i: int, name: str) -> Margins:
    from scipy.linalg import block_diag

    A, B, C = _cut_at(i, *loop)

    # phase crossovers, where L is real, are among the zeros of L(s) - L(-s)
    doubled = block_diag(A, -A), np.vstack([B, B]), np.hstack([C, C])
    values = _response((A, B, C), _zeros_on_axis(*doubled, np.zeros((1, 1))))[:, 0, 0]
    real = np.abs(values.imag) < ON_AXIS * np.abs(values)
    gain = 1.0 / np.abs(values[real & (values.real < 0.0)])

    crossover = _level_crossings(1.0, (A, B, C), 0.0)
    values = _response((A, B, C), crossover)[:, 0, 0]
    on_circle = np.abs(np.abs(values) - 1.0) < ON_AXIS
    lag, crossover = _phase_lag(values[on_circle]), crossover[on_circle]
    return Margins(
        loop=name,
        gain_decrease=float(max(gain[(gain > NO_GAIN) & (gain < 1.0)], default=0.0)),
        gain_increase=float(min(gain[gain > 1.0], default=math.inf)),
        phase_margin=float(min(lag, default=math.inf)),
        delay_margin=float(min(lag / crossover, default=math.inf)),
    )


def _disk_margin(loop: Loop) -> float:
    """``1 / mu`` with the largest structured singular value mu of ``M = (S - T)/2``."""
    A, B, C = loop
    closed = (A - B @ C, B, -C)  # M = I/2 + this one's response
    speeds = np.abs(np.linalg.eigvals(closed[0]))
    peak = 0.5  # M at infinity
    candidates = [(float(speeds.min()) / BAND, float(speeds.max()) * BAND)]
    # At one frequency mu is the smallest norm of ``D M D^-1`` over diagonal D. This is exact for
    # one and two inputs; for more the margin is a lower bound. With this D at all frequencies, the
    # zeros of a pencil show where the norm exceeds a level (N. A. Bruinsma and M. Steinbuch,
    # Systems & Control Letters 14, 1990); elsewhere mu is below the level too. Frequencies are
    # excluded in this way until none remain (C. Lawrence, A. Tits and P. Van Dooren, Automatica 36,
    # 2000), so that no peak is missed between the points of a grid.
    while candidates:
        low, high = max(candidates, key=lambda ends: ends[1] / ends[0])
        M = 0.5 * np.eye(B.shape[1]) + _response(closed, math.sqrt(low * high))
        d = _balancing(M)
        peak = max(peak, float(np.linalg.norm(M * (d[:, None] / d), 2)))
        balanced = (closed[0], B / d, -C * d[:, None])
        candidates = _above((1.0 + DISK_ACCURACY) * peak, balanced, candidates)
    return 1.0 / peak


def _balancing(M: npt.NDArray[np.complex128]) -> FloatArray:
    """Diagonal of the D with the smallest Frobenius norm of ``D M D^-1``."""
    size = np.abs(M) + 1e-15 * np.linalg.norm(M)  # stays finite for decoupled inputs
    # With two inputs this D also has the smallest 2-norm: the determinant does not depend on D, so
    # that the larger singular value falls with the sum of the squares.
    d = np.ones(len(M))
    for _ in range(SWEEPS):
        for i in range(len(M)):
            others = np.arange(len(M)) != i
            row, column = size[i, others] / d[others], size[others, i] * d[others]
            if others.any():
                d[i] = math.sqrt(np.linalg.norm(column) / np.linalg.norm(row))
    return d


def _above(level: float, loop: Loop, intervals: list[Interval]) -> list[Interval]:
    """The parts of `intervals` where the norm of ``I/2 + C (jw - A)^-1 B`` exceeds `level`."""
    crossings = _level_crossings(level, loop, 0.5)
    parts: list[Interval] = []
    for low, high in intervals:
        parts += pairwise([low, *crossings[(low < crossings) & (crossings < high)].tolist(), high])
    middle = np.sqrt([low * high for low, high in parts])
    norms = np.linalg.norm(0.5 * np.eye(loop[1].shape[1]) + _response(loop, middle), 2, axis=(1, 2))
    return [part for part, norm in zip(parts, norms, strict=True) if norm > level]


def _level_crossings(level: float, loop: Loop, direct: float) -> FloatArray:
    """Frequencies where a singular value of ``G = direct I + C (s - A)^-1 B`` equals `level`."""
    from scipy.linalg import block_diag

    A, B, C = loop
    zero = np.zeros_like(B)
    # There ``[[level I, G(s)], [G(-s)', level I]]`` is singular. Unlike the Hamiltonian matrix, its
    # pencil needs no inverse of ``level^2 - direct^2``, which vanishes if the peak is at infinity.
    return _zeros_on_axis(
        block_diag(A, -A.T),
        np.block([[zero, B], [C.T, zero]]),
        block_diag(C, -B.T),
        np.asarray(np.kron([[level, direct], [direct, level]], np.eye(B.shape[1])), dtype=float),
    )


def _zeros_on_axis(A: Any, B: FloatArray, C: Any, D: FloatArray) -> FloatArray:
    """Positive frequencies of the zeros of ``D + C (s - A)^-1 B`` on the imaginary axis, rising."""
    from scipy.linalg import eigvals

    unit = float(np.linalg.norm(A, 2))  # unit of time, which makes the pencil of order one
    pencil = np.block([[A / unit, B], [C / unit, D]])
    zeros = eigvals(pencil, np.diag(np.repeat([1.0, 0.0], [len(A), len(D)])))
    zeros = zeros[np.isfinite(zeros)]  # a pencil that is singular everywhere gives NaN: no crossing
    real, imag, size = np.real(zeros), np.imag(zeros), np.abs(zeros)
    on_axis = (size < BAND) & (imag > 0.0) & (np.abs(real) <= ON_AXIS * size)
    return np.sort(unit * imag[on_axis])
