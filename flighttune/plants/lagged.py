"""A plant behind the lags of an inner loop."""

import math

from flighttune.control.controller import FlightCondition
from flighttune.control.inner_loop import InnerLag
from flighttune.plants.base import Plant, Stop, WrappedPlant
from flighttune.plants.lagged_channel import LaggedChannel

PIECE = 0.002
"""Longest time for which the plant is given one roll and load factor, s."""


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
    """

    def __init__(self, plant: Plant, lags: tuple[InnerLag, InnerLag]) -> None:
        super().__init__(plant, ())
        self._lags = lags

    def start(self, condition: FlightCondition) -> None:
        """Start the plant; roll and load factor of `condition` are in force behind the lags."""
        super().start(condition)
        self._t = 0.0
        begin = (condition.phi, condition.n_z_start)
        self._channels = tuple(map(LaggedChannel, self._lags, begin))

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians."""
        return self._observe()

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float) -> Stop | None:
        """Fly `duration` seconds with the command held; return why the flight ended, if it did."""
        for channel, command in zip(self._channels, (phi_cmd, n_z_cmd), strict=True):
            channel.order(self._t, command)
            channel.move_to(self._t)
        end = self._t + duration
        switches = {t for channel in self._channels for t in channel.switches(end)}
        for until in [*sorted(switches), end]:
            pieces = max(1, math.ceil((until - self._t) / PIECE - 1e-9))
            step = (until - self._t) / pieces
            for i in range(pieces):
                roll, load = (channel.at(self._t + (i + 0.5) * step) for channel in self._channels)
                stop = super().advance(roll, load, step)
                if stop is not None:
                    return stop
            self._t = until
            for channel in self._channels:
                channel.move_to(until)
        return None
