"""The continuous loop as a system that switches: smooth integration from one switch to the next."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from scipy.integrate import DOP853, DenseOutput

from flighttune.control.gains import PIGains
from flighttune.plants.base import FlightCondition
from flighttune.plants.kinematic import LOST
from flighttune.simulate.disturbance import Sinusoid
from flighttune.simulate.limited_command import FOLLOW, HOLD, LimitedCommand, Mode

TOLERANCE = 1e-12
LONGEST_STEP = 0.05
LOOKS = 8
MOST_SWITCHES = 20_000

Pair = tuple[float, float]
Vector = list[float]


class Signals(NamedTuple):
    """All of the loop at one instant; ``a = K_P e'`` and ``b = K_I e`` are the rates of v."""

    x: Pair
    e: Pair
    e_dot: Pair
    u: Pair
    v: Pair
    z: Pair
    a: Pair
    b: Pair


class SwitchedLoop:
    """State y = (chi, gamma, z_phi, z_n_z, u_phi, u_n_z) and the modes of the two commands.

    Parameters
    ----------
    gains : PIGains
        Of two commands and two errors.
    commands : tuple of LimitedCommand, length 2
        Limits and anti-windup of roll and load factor.
    condition : FlightCondition
        Start.
    ref : tuple of float, rad
        Reference of course and flight-path angle.
    disturbance : Sinusoid or None
        Of the two rates.
    stop_at_90_deg : bool
        Whether the flight ends where the roll command reaches 90 deg.
    g : float, m/s^2
        Acceleration of gravity.

    Attributes
    ----------
    switches : list of float, s
        When a mode changed.
    reason : str
        Why the flight ended before its time; empty while it did not.

    Notes
    -----
    An entry of y whose value follows from the others (the command in mode FOLLOW) rests.
    """

    def __init__(
        self,
        gains: PIGains,
        commands: tuple[LimitedCommand, ...],
        *,
        condition: FlightCondition,
        ref: Pair,
        disturbance: Sinusoid | None,
        stop_at_90_deg: bool,
        g: float,
    ) -> None:
        self._K_P, self._K_I = gains.K_P.tolist(), gains.K_I.tolist()
        self._commands, self._ref, self._disturbance = commands, ref, disturbance
        self._g_over_v = g / condition.V_a
        self._stop_at_90_deg = stop_at_90_deg
        self.switches: list[float] = []
        self.reason = ""
        self._modes = [Mode(HOLD), Mode(HOLD)]
        self._y = [condition.chi, condition.gamma, 0.0, 0.0, condition.phi, condition.n_z_start]
        wanted = self._at(0.0, self._y).v
        equal = [False, False]
        for i, command in enumerate(commands):
            self._y[4 + i], equal[i] = command.start(self._y[4 + i], wanted[i])
        seen = self._at(0.0, self._y)
        self._modes = [self._mode(i, seen, equal[i]) for i in (0, 1)]
        self._end_if_lost(0.0)

    def fly(self, times: list[float]) -> Iterator[tuple[float, ...]]:
        """Yield x, e, e', u, v and z, a row a time of `times`, until the flight ends."""
        t, due = 0.0, 0
        if times[0] == 0.0:
            yield self._row(0.0, self._y)
            due = 1
        while t < times[-1] and not self.reason:
            solver = DOP853(
                self._rates, t, self._y, times[-1], LONGEST_STEP, rtol=TOLERANCE, atol=TOLERANCE
            )
            switched = False
            while solver.status == "running" and not switched:
                solver.step()
                if solver.status == "failed":
                    self.reason = f"the law has no bounded rate at t = {solver.t:.2f} s."
                    return
                dense = solver.dense_output()
                switch = self._first_switch(dense, t, solver.t)
                switched = switch is not None
                t = solver.t if switch is None else switch
                while due < len(times) and times[due] <= t:
                    yield self._row(times[due], dense(times[due]).tolist())
                    due += 1
                self._y = dense(t).tolist() if switched else solver.y.tolist()
            self._end_if_lost(t)
            if switched and not self.reason:
                self._switch(t)

    def _at(self, t: float, y: Vector) -> Signals:
        chi, gamma, z = y[0], y[1], (y[2], y[3])
        e = self._ref[0] - chi, self._ref[1] - gamma
        K_P, K_I = self._K_P, self._K_I
        v = (
            K_P[0][0] * e[0] + K_P[0][1] * e[1] + z[0],
            K_P[1][0] * e[0] + K_P[1][1] * e[1] + z[1],
        )
        u = (
            v[0] if self._modes[0].motion == FOLLOW else y[4],
            v[1] if self._modes[1].motion == FOLLOW else y[5],
        )
        d_chi, d_gamma = self._disturbance(t) if self._disturbance else (0.0, 0.0)
        g_over_v = self._g_over_v
        e_dot = (
            -g_over_v * math.tan(u[0]) - d_chi,
            -g_over_v * (u[1] * math.cos(u[0]) - math.cos(gamma)) - d_gamma,
        )
        a = (
            K_P[0][0] * e_dot[0] + K_P[0][1] * e_dot[1],
            K_P[1][0] * e_dot[0] + K_P[1][1] * e_dot[1],
        )
        b = K_I[0][0] * e[0] + K_I[0][1] * e[1], K_I[1][0] * e[0] + K_I[1][1] * e[1]
        return Signals((chi, gamma), e, e_dot, u, v, z, a, b)

    def _row(self, t: float, y: Vector) -> tuple[float, ...]:
        s = self._at(t, y)
        return (*s.x, *s.e, *s.e_dot, *s.u, *s.v, *s.z)

    def _rates(self, t: float, y: Vector) -> Vector:
        s = self._at(t, y)
        (u_dot, z_dot), (w_dot, q_dot) = (
            self._commands[i].rates(self._modes[i], s.v[i] - s.u[i], s.a[i], s.b[i]) for i in (0, 1)
        )
        return [-s.e_dot[0], -s.e_dot[1], z_dot, q_dot, u_dot, w_dot]

    def _margins(self, t: float, y: Vector) -> tuple[float, ...]:
        s = self._at(t, y)
        lost = LOST - max(abs(y[0]), abs(y[1]))
        rolled = math.pi / 2 - abs(s.u[0]) if self._stop_at_90_deg else math.inf
        return (
            *self._commands[0].margins(self._modes[0], s.u[0], s.v[0], s.a[0], s.b[0]),
            *self._commands[1].margins(self._modes[1], s.u[1], s.v[1], s.a[1], s.b[1]),
            rolled,
            lost,
        )

    def _over(self, t: float, y: Vector) -> bool:
        return min(self._margins(t, y)) < -TOLERANCE

    def _first_switch(self, dense: DenseOutput, t_0: float, t_1: float) -> float | None:
        """First time in [t_0, t_1] at which a margin is used up, to the next float but a few."""
        before = t_0
        for k in range(LOOKS + 1):
            after = t_0 + (t_1 - t_0) * k / LOOKS
            if self._over(after, dense(after).tolist()):
                break
            before = after
        else:
            return None
        while after - before > 4.0 * math.ulp(t_1):
            middle = 0.5 * (before + after)
            if self._over(middle, dense(middle).tolist()):
                after = middle
            else:
                before = middle
        return after

    def _switch(self, t: float) -> None:
        """Give every command whose margin is used up its next mode."""
        self.switches.append(t)
        if len(self.switches) > MOST_SWITCHES:
            self.reason = f"more than {MOST_SWITCHES} switches until t = {t:.4f} s."
            return
        margins = self._margins(t, self._y)
        for i, command in enumerate(self._commands):
            mine = margins[4 * i : 4 * i + 4]
            if min(mine) >= -TOLERANCE:
                continue
            mode, s = self._modes[i], self._at(t, self._y)
            follows = mode.motion == FOLLOW
            if follows:
                self._y[4 + i] = command.clip(s.v[i])
            elif mine[2] < -TOLERANCE:
                self._y[4 + i] = mode.bound
            equal = follows or mode.side == 0 or mine[0] < -TOLERANCE
            if equal:
                self._y[2 + i] += self._y[4 + i] - s.v[i]
            self._modes[i] = Mode(HOLD)
            self._modes[i] = self._mode(i, self._at(t, self._y), equal, mode.side)

    def _mode(self, i: int, s: Signals, equal: bool, side: int = 0) -> Mode:
        if equal:
            return self._commands[i].together(s.u[i], s.a[i], s.b[i])
        return self._commands[i].apart(
            s.u[i], s.v[i], s.b[i], side or (1 if s.v[i] > s.u[i] else -1)
        )

    def _end_if_lost(self, t: float) -> None:
        s = self._at(t, self._y)
        if self._stop_at_90_deg and abs(s.u[0]) >= math.pi / 2:
            self.reason = f"roll command {math.degrees(s.u[0]):.4g} deg at t = {t:.2f} s."
        elif not max(abs(s.x[0]), abs(s.x[1])) < LOST:
            self.reason = f"chi {s.x[0]:.4g} rad, gamma {s.x[1]:.4g} rad at t = {t:.2f} s."
