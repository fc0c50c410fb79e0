"""The paper's continuous loop under limits, by `scipy.integrate.solve_ivp` between switches."""

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.paper import parameters as printed
from flighttune.plants.point_mass import LOST
from flighttune.simulate.disturbance import Sinusoid

# Relative and absolute tolerance of an integration step; how far past a switch it is detected.
TOLERANCE = 1e-12

# Longest step where a switch could be missed, s: events are looked for at the ends of steps.
MAX_STEP_S = 0.01

REFERENCE = np.array([printed.CHI_C, printed.GAMMA_C])


class Moving(NamedTuple):
    """A command that does not follow the controller."""

    speed: float  # its rate: a rate limit, or 0 at the end of its range
    side: int  # sign of unlimited command minus command; 0 where anti-windup keeps the two together
    bound: float  # end of the range that it meets next


class Signals(NamedTuple):
    """The loop at one instant, shape (2,), or over time, (2, k); `a` and `b` make ``v' = a + z'``.

    `v` is the command before the limits, `u` the one after; `a` is ``K_P e'`` and `b` is ``K_I e``.
    """

    e: FloatArray
    e_dot: FloatArray
    u: FloatArray
    v: FloatArray
    a: FloatArray
    b: FloatArray


class ContinuousLoop:
    """State y = (chi, gamma, z_phi, z_n_z, u_phi, u_n_z), z the integral parts of the commands.

    Parameters
    ----------
    gains : PIGains
    limits : Limits
    conditional : bool
        Stop the integrator of a command while a limit holds it and it would drive it further on;
        with rate limits only.
    disturbance : Sinusoid or None

    Notes
    -----
    With ``v = K_P e + z``: without rate limits ``u = clip(v)`` and ``z' = K_I e``. That law is
    continuous, and the error control of the integration finds its corners by itself.

    With rate limits u is v as long as range and rates permit (`Moving` is None), else a state of
    its own that moves at a rate limit towards ``clip(v)``. Conditional anti-windup has z' = 0 where
    ``(v - u) K_I e > 0``, which jumps at v = u: where both sides drive v to u, the two stay
    together and z' = u' - a (the solution in the sense of Filippov).

    These are the limits of the discrete rules of `MimoPI` as its sample time goes to zero.
    ``tan(phi)`` is taken as printed, whatever the roll, and the course error is not wrapped.
    """

    def __init__(
        self, gains: PIGains, limits: Limits, *, conditional: bool, disturbance: Sinusoid | None
    ) -> None:
        self._gains, self._limits, self._disturbance = gains, limits, disturbance
        self._conditional = conditional
        self._moving: list[Moving | None] = [None, None]
        self.y = np.array([printed.CHI_0, printed.GAMMA_0, 0.0, 0.0, printed.PHI_0, printed.N_Z_0])
        self.rate_limited = bool(np.isfinite(limits.rate_upper).all())
        if self.rate_limited:
            v = self.signals(0.0, self.y).v
            for i in (0, 1):
                self._start_moving(i, 0.0, 1 if v[i] > self.y[4 + i] else -1)

    def signals(self, t: float | FloatArray, y: FloatArray) -> Signals:
        """Signals at time `t` and state `y`, shape (6,), or over times, (6, k)."""
        K_P, K_I, chi, gamma = self._gains.K_P, self._gains.K_I, y[0], y[1]
        e = np.array([REFERENCE[0] - chi, REFERENCE[1] - gamma])
        v = K_P @ e + y[2:4]
        u = np.clip(v.T, self._limits.lower, self._limits.upper).T
        for i in (0, 1):
            if self._moving[i] is not None:
                u[i] = y[4 + i]
        g_over_v = printed.G / printed.V_A
        e_dot = -g_over_v * np.array([np.tan(u[0]), u[1] * np.cos(u[0]) - np.cos(gamma)])
        if self._disturbance is not None:
            wave = self._disturbance
            e_dot[0] -= wave.chi_amplitude * np.sin(wave.chi_omega * t)
            e_dot[1] -= wave.gamma_amplitude * np.cos(wave.gamma_omega * t)
        return Signals(e, e_dot, u, v, K_P @ e_dot, K_I @ e)

    def rates(self, t: float, y: FloatArray) -> FloatArray:
        """Rates of the state."""
        s = self.signals(t, y)
        z_dot, u_dot = s.b.copy(), np.zeros(2)
        for i, moving in enumerate(self._moving):
            if moving is None:
                continue
            u_dot[i] = moving.speed
            if moving.side == 0:
                z_dot[i] = moving.speed - s.a[i]
            elif self._conditional and moving.side * s.b[i] > 0.0:
                z_dot[i] = 0.0
        return np.concatenate([-s.e_dot, z_dot, u_dot])

    def margins(self, i: int, t: float, y: FloatArray) -> tuple[float, float]:
        """Margins of command `i` before it switches: to its range, and to any other limit."""
        s, limits, moving = self.signals(t, y), self._limits, self._moving[i]
        u, v, a, b = s.u[i], s.v[i], s.a[i], s.b[i]
        if moving is None:
            v_dot = a + b
            return (
                min(limits.upper[i] - v, v - limits.lower[i]),
                min(limits.rate_upper[i] - v_dot, v_dot - limits.rate_lower[i]),
            )
        to_bound = (moving.bound - u) * np.sign(moving.speed) if moving.speed else math.inf
        if moving.side:
            return to_bound, moving.side * (v - u)
        z_dot = moving.speed - a
        return to_bound, min(z_dot - min(b, 0.0), max(b, 0.0) - z_dot)

    def switch(self, t: float, y: FloatArray) -> None:
        """Go on from `y` at time `t`, every command with nothing left in its next mode."""
        self.y = y
        for i in (0, 1):
            in_range, other = self.margins(i, t, y)
            if min(in_range, other) > 0.0:
                continue
            moving, v = self._moving[i], self.signals(t, y).v[i]
            if moving is None:
                y[4 + i] = min(max(v, self._limits.lower[i]), self._limits.upper[i])
            elif in_range <= 0.0:
                y[4 + i] = moving.bound
            apart = moving is not None and moving.side != 0 and other > 0.0
            if not apart:
                y[2 + i] += y[4 + i] - v
            self._start_moving(i, t, moving.side if apart and moving is not None else 0)

    def _start_moving(self, i: int, t: float, side: int) -> None:
        """The mode of command `i`, which v is on the given `side` of; 0 where it equals v."""
        self._moving[i] = Moving(0.0, 0, math.inf)
        s, limits = self.signals(t, self.y), self._limits
        u, v, a, b = s.u[i], s.v[i], s.a[i], s.b[i]
        lower, upper = limits.lower[i], limits.upper[i]
        # Outside its range a command comes back at the rate limit; at an end it does not go on.
        fastest = limits.rate_lower[i] if u > upper else limits.rate_upper[i] if u != upper else 0.0
        slowest = limits.rate_upper[i] if u < lower else limits.rate_lower[i] if u != lower else 0.0
        if side:
            target = min(max(v, lower), upper)
            speed = (
                0.0 if u == target else limits.rate_upper[i] if u < target else limits.rate_lower[i]
            )
        elif slowest <= a + b <= fastest and slowest < fastest:
            self._moving[i] = None
            return
        else:
            side = 1 if a + b > fastest else -1
            speed = fastest if side > 0 else slowest
            if self._conditional and side * b > 0.0 > side * (a - speed):
                side = 0
        bound = (lower if u < lower else upper) if speed > 0.0 else upper if u > upper else lower
        self._moving[i] = Moving(speed, side, bound)


def integrate(loop: ContinuousLoop, times: FloatArray) -> tuple[FloatArray, str]:
    """Fly a loop that was not flown before, and report at `times`, which rise from 0.

    The rows, shape (k or fewer, 6, 2), hold state (chi, gamma), error, its rate, command after the
    limits, before them, and integral part. The reason says why the flight ended before its time; it
    is empty where it did not.
    """

    def lost(_: float, y: FloatArray) -> float:
        return LOST - np.max(np.abs(y[:2]))

    events = [lost]
    if loop.rate_limited:
        # The tolerance keeps the margin that is used up at a switch from ending the next piece too.
        events += [lambda t, y, i=i: min(loop.margins(i, t, y)) + TOLERANCE for i in (0, 1)]
    for event in events:
        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    parts, t, reason = [], -1.0, ""
    while not reason and t < times[-1]:
        piece = solve_ivp(
            loop.rates,
            (max(t, 0.0), times[-1]),
            loop.y,
            method="DOP853",
            t_eval=times[times > t],
            events=events,
            rtol=TOLERANCE,
            atol=TOLERANCE,
            max_step=MAX_STEP_S if loop.rate_limited else math.inf,
        )
        s, y = loop.signals(piece.t, piece.y), piece.y
        parts.append(np.array([y[:2], s.e, s.e_dot, s.u, s.v, y[2:4]]).transpose(2, 0, 1))
        ends = [
            (at[0], y_at[0])
            for at, y_at in zip(piece.t_events, piece.y_events, strict=True)
            if len(at)
        ]
        if piece.status == 0:
            break
        if piece.status < 0:
            reason = f"the law has no bounded rate at t = {piece.t[-1]:.2f} s."
        elif len(piece.t_events[0]):
            chi, gamma = ends[0][1][:2]
            reason = f"chi {chi:.4g} rad, gamma {gamma:.4g} rad at t = {ends[0][0]:.2f} s."
        else:
            t, y = min(ends, key=lambda end: end[0])
            loop.switch(t, y)
    return np.concatenate(parts), reason
