"""Lags of an inner loop in flight, solved in closed form: a channel, and a plant behind two."""

import math
from collections import deque
from functools import lru_cache, partial
from operator import mul

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.control.controller import FlightCondition
from flighttune.control.inner_loop import InnerLag
from flighttune.vehicles.plants.base import Plant, Stop, WrappedPlant

# Longest time for which a plant behind lags is given one roll and load factor, s.
PIECE = 0.002

# Decimals of a second to which the transitions of a channel are distinguished.
RESOLUTION = 12

# Transitions remembered by a channel.
MAX_TRANSITIONS = 4096


@lru_cache(maxsize=256)  # flights of one aircraft ask for the same few again and again
def transition(lag: InnerLag, t: float) -> FloatArray:
    """``exp(A t)``, shape (order, order), of a lag without its delay; `t` in s."""
    from scipy.linalg import expm

    matrix = np.asarray(expm(lag.undelayed[0] * t))
    matrix.flags.writeable = False
    return matrix


def rest(lag: InnerLag) -> FloatArray:
    """State of a lag at rest under the command 1, shape (order,)."""
    A, B = lag.undelayed
    return np.asarray(-np.linalg.solve(A, B), dtype=float)


class LaggedChannel:
    """One channel: its state between commands; it flies and is commanded `value` before t = 0."""

    def __init__(self, lag: InnerLag, value: float) -> None:
        self._lag, self._rest = lag, rest(lag).tolist()
        self._command, self._since = value, 0.0
        # Plain numbers: of three states NumPy's product takes five times as long.
        self._distance = [0.0] * lag.order
        self._pending: deque[tuple[float, float]] = deque()
        self._transitions = lru_cache(MAX_TRANSITIONS)(lambda t: transition(lag, t).tolist())
        self._responses = lru_cache(MAX_TRANSITIONS)(partial(_responses, lag))

    def order(self, t: float, command: float) -> None:
        """Give a command at time `t` (s), and move there; it takes effect after the delay."""
        self._pending.append((t + self._lag.delay, command))
        self.move_to(t)

    def switches(self, end: float) -> list[float]:
        """Times before `end` (s) at which a command takes effect."""
        return [t for t, _ in self._pending if t < end]

    def move_to(self, t: float) -> None:
        """Advance to time `t` (s), no later than the next switch, and take up what is due."""
        self._distance = [sum(map(mul, row, self._distance)) for row in self._transition(t)]
        self._since = t
        while self._pending and self._pending[0][0] <= t:
            before = self._command
            _, self._command = self._pending.popleft()
            states = zip(self._distance, self._rest, strict=True)
            self._distance = [x + at_rest * (before - self._command) for x, at_rest in states]

    def at(self, t: float) -> float:
        """Flown value at time `t` (s), from the last move to the next switch."""
        return self._command + sum(map(mul, self._transition(t)[0], self._distance))

    def over(self, step: float, count: int) -> list[float]:
        """Flown values after 0 to `count` steps (s) from the last move, before the next switch."""
        responses = self._responses(round(step, RESOLUTION), count)
        return (self._command + responses @ self._distance).tolist()

    def _transition(self, t: float) -> list[list[float]]:
        return self._transitions(round(t - self._since, RESOLUTION))


def _responses(lag: InnerLag, step: float, count: int) -> FloatArray:
    """Part of the distance from rest in the response after 0 to `count` steps (s)."""
    times = (round(i * step, RESOLUTION) for i in range(count + 1))
    return np.array([transition(lag, t)[0] for t in times])


@checked_class
class LaggedPlant(WrappedPlant):
    """A plant whose roll and load-factor commands arrive behind lags.

    Parameters
    ----------
    plant : Plant
        A plant that was not flown before, for which any duration can be flown.
    lags : tuple of InnerLag, length 2
        Lags of roll and of load factor.

    Notes
    -----
    The lags are solved in closed form; the plant is given their output at the middle of pieces of
    at most `PIECE`, an error of second order in it.

    Examples
    --------
    >>> lag = ft.loop.InnerLag(order=1, natural_frequency=5.0)
    >>> plant = ft.loop.LaggedPlant(ft.loop.PointMassPlant(), (lag, lag))
    >>> plant.start(ft.loop.FlightCondition(V_a=25.0))
    >>> plant.advance(0.5, 1.0, 0.2)
    >>> round(dict(zip(plant.signals, plant.observe()))["phi"], 4)
    0.3151
    """

    def __init__(self, plant: Plant, lags: tuple[InnerLag, InnerLag]) -> None:
        super().__init__(plant, ())
        self._lags = lags

    def start(self, condition: FlightCondition) -> None:
        """Start the plant; roll and load factor of `condition` are in force behind the lags."""
        super().start(condition)
        self._t = 0.0
        self._channels = tuple(map(LaggedChannel, self._lags, condition.commands(2)))

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians."""
        return self._observe()

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float, *n_x: float) -> Stop | None:
        """Fly `duration` seconds with the command held; return why the flight ended, if it did."""
        for channel, command in zip(self._channels, (phi_cmd, n_z_cmd), strict=True):
            channel.order(self._t, command)
        end = self._t + duration
        switches = {t for channel in self._channels for t in channel.switches(end)}
        for until in [*sorted(switches), end]:
            pieces = max(1, math.ceil((until - self._t) / PIECE - 1e-9))
            step = (until - self._t) / pieces
            for i in range(pieces):
                roll, load = (channel.at(self._t + (i + 0.5) * step) for channel in self._channels)
                if (stop := super().advance(roll, load, step, *n_x)) is not None:
                    return stop
            self._t = until
            for channel in self._channels:
                channel.move_to(until)
        return None
