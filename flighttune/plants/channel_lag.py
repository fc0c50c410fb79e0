"""The inner loop of one channel as a lag with delay: from command to what is flown."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

from flighttune.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelLag:
    r"""A lag of first or second order behind a delay, of gain one.

    With w the bandwidth and z the damping: ``exp(-s delay) w / (s + w)``, or
    ``exp(-s delay) w^2 / (s^2 + 2 z w s + w^2)``.

    Attributes
    ----------
    bandwidth : float, rad/s
        Inverse time constant (order 1) or undamped natural frequency (order 2), positive.
    delay : float, s
        Not negative.
    order : 1 or 2
    damping : float, 1
        Damping ratio of order 2, positive; without meaning for order 1.
    """

    bandwidth: float
    delay: float = 0.0
    order: Literal[1, 2] = 1
    damping: float = 1.0

    def __post_init__(self) -> None:
        for name in ("bandwidth", "damping"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"`{name}` must be positive, got {value}.")
        if not (math.isfinite(self.delay) and self.delay >= 0.0):
            raise InputError(f"`delay` must not be negative, got {self.delay} s.")
        if self.order not in (1, 2):
            raise InputError(f"`order` must be 1 or 2, got {self.order}.")

    def free_response(self, z: float, z_dot: float, t: float) -> tuple[float, float]:
        """How far from its command the channel is after `t` seconds, and how fast it moves.

        Parameters
        ----------
        z, z_dot : float, unit of the channel, and per second
            Distance (flown minus commanded) and rate at the start; the rate counts for order 2.
        t : float, s

        Returns
        -------
        z, z_dot : float
            Exact, for a command that is held.
        """
        w = self.bandwidth
        if self.order == 1:
            z *= math.exp(-w * t)
            return z, -w * z
        decay = self.damping * w
        squared = w * w - decay * decay
        if squared > 0.0:
            root = math.sqrt(squared)
            c, s = math.cos(root * t), math.sin(root * t) / root
        elif squared < 0.0:
            root = math.sqrt(-squared)
            c, s = math.cosh(root * t), math.sinh(root * t) / root
        else:
            c, s = 1.0, t
        fade = math.exp(-decay * t)
        return (
            fade * (z * c + (z_dot + decay * z) * s),
            fade * (z_dot * c - (decay * z_dot + w * w * z) * s),
        )


class LaggedChannel:
    """One channel in flight: commands go in, the flown value comes out, exactly.

    Parameters
    ----------
    lag : ChannelLag
    value : float, unit of the channel
        Flown and commanded before t = 0.
    """

    def __init__(self, lag: ChannelLag, value: float) -> None:
        self._lag = lag
        self._command = value
        self._since, self._z, self._z_dot = 0.0, 0.0, 0.0
        self._pending: deque[tuple[float, float]] = deque()

    def order(self, t: float, command: float) -> None:
        """Give a command at time `t` (s); it takes effect after the delay."""
        self._pending.append((t + self._lag.delay, command))

    def switches(self, end: float) -> list[float]:
        """Times before `end` (s) at which a command takes effect."""
        return [t for t, _ in self._pending if t < end]

    def move_to(self, t: float) -> None:
        """Advance to time `t` (s), no later than the next switch, and take up what is due."""
        self._z, self._z_dot = self._lag.free_response(self._z, self._z_dot, t - self._since)
        self._since = t
        while self._pending and self._pending[0][0] <= t:
            flown = self._command + self._z
            _, self._command = self._pending.popleft()
            self._z = flown - self._command

    def at(self, t: float) -> float:
        """Flown value at time `t` (s), from the last move to the next switch."""
        z, _ = self._lag.free_response(self._z, self._z_dot, t - self._since)
        return self._command + z
