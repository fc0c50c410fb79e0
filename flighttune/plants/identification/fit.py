"""Lags fitted to a flown frequency response; the data choose their order."""

import math
from dataclasses import dataclass
from itertools import product
from typing import get_args

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm
from scipy.optimize import least_squares

from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import NO_DELAY, InnerLag, Order
from flighttune.errors import InputError
from flighttune.plants.identification.excitation import DT, PERIOD
from flighttune.plants.identification.experiment import Response

SAMPLES = round(PERIOD / DT)

START_DELAYS = 0.0, 0.1
START_SHAPES = (1.0, 0.7, 0.3), (2.0, 0.5, 1.0)
"""From where the search begins: delays in s; frequency over the corner, damping, lag times it."""

FINEST = 1e-3
"""Distance between responses below which an order does not earn a further parameter."""

LOWER = math.log(0.05), 0.0, math.log(0.2), math.log(1e-3)
UPPER = math.log(200.0), 1.0, math.log(5.0), math.log(10.0)
"""Of log frequency (rad/s), delay (s), log damping and log lag (s)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrequencyResponse:
    """Flown over commanded at the lines of one channel.

    Attributes
    ----------
    omega : ndarray, shape (lines,), rad/s
    own : ndarray of complex, shape (lines,), 1
        From the command of the channel to what it flies.
    other : ndarray of complex, shape (lines,), unit of the other channel over that of this one
        From the command of the channel to what the other one flies, beyond the answer of the other
        one to its own command.
    """

    omega: FloatArray
    own: npt.NDArray[np.complex128]
    other: npt.NDArray[np.complex128]


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A lag fitted at one order.

    Attributes
    ----------
    lag : InnerLag
    residual : float, 1
        Root mean square distance from the flown response over the lines.
    bic : float, 1
        Bayesian information criterion; the lowest wins.
    """

    lag: InnerLag
    residual: float
    bic: float


def frequency_responses(response: Response) -> tuple[FrequencyResponse, FrequencyResponse]:
    """Responses of roll and load factor from the last period of a multisine flight.

    Parameters
    ----------
    response : Response
        Of at least two periods, so that the last one is in the steady state.

    Returns
    -------
    tuple of two FrequencyResponse
        Freed of the sample-and-hold of the commands.

    Raises
    ------
    InputError
        If the flight was shorter or not periodic.
    """
    lines = response.excitation.lines
    if len(response.flown) < 2 * SAMPLES or not all(len(line) for line in lines):
        raise InputError(
            f"`response` must be of two periods of {PERIOD:g} s of multisines, "
            f"got {len(response.flown) * DT:g} s."
        )
    commanded = np.fft.rfft(response.commanded[-SAMPLES:], axis=0)
    flown = np.fft.rfft(response.flown[-SAMPLES:], axis=0)
    omegas = [line.astype(np.float64) * (2.0 * math.pi / PERIOD) for line in lines]
    own = [flown[lines[i], i] / commanded[lines[i], i] for i in range(2)]
    found = []
    for i, j in ((0, 1), (1, 0)):
        expected = _interpolated(omegas[i], omegas[j], own[j]) * commanded[lines[i], j]
        other = (flown[lines[i], j] - expected) / commanded[lines[i], i]
        hold = np.sinc(omegas[i] * DT / (2.0 * math.pi)) * np.exp(-0.5j * omegas[i] * DT)
        found.append(FrequencyResponse(omega=omegas[i], own=own[i] / hold, other=other / hold))
    return found[0], found[1]


def candidates(response: FrequencyResponse) -> tuple[Candidate, ...]:
    """The best lag of each order, the lowest information criterion first.

    Parameters
    ----------
    response : FrequencyResponse

    Returns
    -------
    tuple of Candidate
        One an order.

    Notes
    -----
    Least squares of the complex error, which is ``N log(rss / N) + k log N`` (G. Schwarz, *Annals
    of Statistics* 6, 1978) for ``N = 2 lines`` numbers and k parameters: lines, not samples of
    time, are what the flight gave independently of each other.
    """
    fitted = [_fitted(response, order) for order in get_args(Order)]
    return tuple(sorted(fitted, key=lambda one: one.bic))


def predicted(lag: InnerLag, commanded: FloatArray, dt: float) -> FloatArray:
    """What a lag flies under sampled and held commands, from rest.

    Parameters
    ----------
    lag : InnerLag
    commanded : ndarray, shape (samples,)
        Held from each sample to the next.
    dt : float, s
        Sample time.

    Returns
    -------
    ndarray, shape (samples,)
        At the instants of the samples; a delay between two samples shares a command among them.
    """
    A, B = lag.undelayed
    n = len(B)
    held = expm(np.block([[A, B[:, None]], [np.zeros((1, n + 1))]]) * dt)
    whole, part = divmod(lag.delay / dt, 1.0)
    first = commanded[0]
    late = np.concatenate([np.full(int(whole) + 1, first), commanded])[: len(commanded) + 1]
    acting = (1.0 - part) * late[1:] + part * late[:-1]
    x = np.concatenate([np.linalg.solve(A, -B * first)])
    flown = np.empty(len(commanded))
    for k, command in enumerate(acting.tolist()):
        flown[k] = x[0]
        x = held[:n, :n] @ x + held[:n, n] * command
    return flown


def variance_explained(flown: FloatArray, model: FloatArray) -> float:
    """Share of the variance of `flown` (samples,) that `model` accounts for, in percent."""
    total = float(np.var(flown))
    return 100.0 * (1.0 - float(np.var(flown - model)) / total) if total > 0.0 else -math.inf


def _fitted(response: FrequencyResponse, order: Order) -> Candidate:
    size = order + 1
    lower, upper = np.array(LOWER[:size]), np.array(UPPER[:size])
    count = 2 * len(response.omega)

    def error(p: FloatArray) -> FloatArray:
        gap = _lag(p, order).response(response.omega) - response.own
        return np.concatenate([gap.real, gap.imag])

    corner = _corner(response)
    starts = {
        (math.log(corner * faster), delay, math.log(damping), math.log(part / corner))[:size]
        for delay, (faster, damping, part) in product(START_DELAYS, START_SHAPES)
    }
    runs = [
        least_squares(
            error,
            np.clip(start, lower + 1e-3, upper - 1e-3),
            bounds=(lower, upper),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
        )
        for start in sorted(starts)
    ]
    best = min(runs, key=lambda run: run.cost)
    mean_square = 2.0 * float(best.cost) / count
    return Candidate(
        lag=_lag(best.x, order),
        residual=math.sqrt(2.0 * mean_square),
        bic=count * math.log(max(mean_square, FINEST**2)) + size * math.log(count),
    )


def _lag(p: FloatArray, order: Order) -> InnerLag:
    return InnerLag(
        order=order,
        natural_frequency=math.exp(p[0]),
        delay=float(p[1]) if p[1] >= NO_DELAY else 0.0,
        damping=math.exp(p[2]) if order > 1 else 1.0,
        lag=math.exp(p[3]) if order > 2 else 1.0,
    )


def _corner(response: FrequencyResponse) -> float:
    """Where the flown magnitude falls below 1/sqrt(2), or the end of the band."""
    low = np.flatnonzero(np.abs(response.own) < math.sqrt(0.5))
    return float(response.omega[low[0]] if len(low) else response.omega[-1])


def _interpolated(
    at: FloatArray, omega: FloatArray, values: npt.NDArray[np.complex128]
) -> npt.NDArray[np.complex128]:
    magnitude = np.interp(at, omega, np.abs(values))
    phase = np.interp(at, omega, np.unwrap(np.angle(values)))
    return np.asarray(magnitude * np.exp(1j * phase), dtype=complex)
