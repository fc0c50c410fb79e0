"""One flight of the paper's continuous loop, its measures and initial commands."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from flighttune.base.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.flight.loop.disturbance import Sinusoid
from flighttune.studies.paper import parameters as printed
from flighttune.vehicles.plants.point_mass import LOST

# Time between the samples of a flight, s.
SAMPLE = 0.01

# Errors below this count as near the origin, rad.
NEAR = 0.05

# Relative and absolute tolerance of an integration step; overshoot at which a switch is detected.
TOLERANCE = 1e-12

# Longest step if a switch could be missed, s, because events are tested at the ends of steps.
MAX_STEP_S = 0.01

REFERENCE = np.array([printed.CHI_C, printed.GAMMA_C])


@dataclass(frozen=True, eq=False)
class PaperFlight:
    """One flight of the paper's loop, sampled every `SAMPLE` seconds."""

    t: FloatArray  # (k,), s
    # (k, 2), rad, rad, rad/s: course and flight-path angle; errors (reference minus actual); their
    # rates by the law
    x: FloatArray
    error: FloatArray
    error_rate: FloatArray
    # (k, 2), rad and 1: commands of roll and load factor after the limits, before them, and their
    # integral part
    u: FloatArray
    unlimited: FloatArray
    integral: FloatArray
    reason: str  # reason of a divergence, in a sentence; else empty

    @property
    def status(self) -> Literal["completed", "diverged"]:
        """Whether the flight lasted its whole time."""
        return "diverged" if self.reason else "completed"

    @cached_property
    def channels(self) -> dict[str, FloatArray]:
        """Errors, their rates, and ``s = sqrt(e^2 + e_dot^2)`` over time, each of shape (k,)."""
        (chi, gamma), (chi_dot, gamma_dot) = self.error.T, self.error_rate.T
        errors = {"chi": chi, "gamma": gamma, "chi_dot": chi_dot, "gamma_dot": gamma_dot}
        return {**errors, "s_chi": np.hypot(chi, chi_dot), "s_gamma": np.hypot(gamma, gamma_dot)}

    @cached_property
    def measures(self) -> pd.DataFrame:
        """The paper's measures over the printed 20 s: a row per channel, a column per measure."""
        # Section 5.2 of arXiv 2411.13140, in words: ITAE is the integral of ``t |x|`` by the
        # trapezoidal rule; MO the largest value of x and PT its time (the errors begin below zero
        # and overshoot upwards); MS and ST the mean and standard deviation over the last quarter;
        # mean and std over the whole time; energy the integral of x^2. ``_rad`` is rad/s for rates.
        inside, rows = self.t <= printed.DURATION + 0.5 * SAMPLE, {}
        t = self.t[inside]
        late = t >= 0.75 * t[-1]
        for name, signal in self.channels.items():
            x = signal[inside]
            peak = int(np.argmax(x))
            rows[name] = {
                "ITAE": float(np.trapezoid(t * np.abs(x), t)),
                "MO_rad": max(0.0, float(x[peak])),
                "PT_s": float(t[peak]),
                "MS_rad": float(np.mean(x[late])),
                "ST_rad": float(np.std(x[late])),
                "mean": float(np.mean(x)),
                "std": float(np.std(x)),
                "energy": float(np.trapezoid(x**2, t)),
            }
        return pd.DataFrame.from_dict(rows, orient="index")

    def peak(self, channel: str) -> tuple[float, float]:
        """Maximum overshoot in rad and peak time in s of a channel."""
        row = self.measures.loc[channel]
        return float(row["MO_rad"]), float(row["PT_s"])

    def after(self, channel: str, t: float) -> float:
        """Largest magnitude of a channel from time `t` (s) on."""
        return float(np.max(np.abs(self.channels[channel][self.t >= t])))

    @property
    def command_rates(self) -> FloatArray:
        """Rates of the two commands over time by differences, shape (k - 1, 2)."""
        return np.diff(self.u, axis=0) / SAMPLE

    @property
    def released(self) -> float:
        """Last time with a limited command, s; 0 without any."""
        limited = self.t[np.any(self.u != self.unlimited, axis=1)]
        return float(limited[-1]) if len(limited) else 0.0

    @property
    def converged(self) -> bool:
        """Whether both errors stay below `NEAR` for the last two seconds."""
        late = self.t >= self.t[-1] - 2.0
        return not self.reason and bool(np.max(np.abs(self.error[late])) < NEAR)


def oscillations(x: FloatArray) -> int:
    """Number of times a signal crosses zero."""
    signs = np.sign(x)
    return int(np.count_nonzero(np.diff(signs[signs != 0.0])))


def decay_rate(t: FloatArray, norm: FloatArray) -> float:
    """Decay rate of `norm`, from a straight line through its logarithm."""
    seconds, norms = t[norm > 0.0], norm[norm > 0.0]
    return -float(np.polyfit(seconds, np.log(norms), 1)[0]) if len(norms) > 2 else math.nan


def initial_commands(gains: PIGains) -> pd.DataFrame:
    """Both commands and their rates at the first instant, with ranges and used shares."""
    x_0, limits, nothing = printed.E_0, printed.printed_limits(), np.zeros(2)
    # ``u(t_0) = K (x_0; x_0 dt)`` and ``u'(t_0) = K (0; x_0)`` of section 4.4 with dt = 0.1 s.
    states = np.concatenate([x_0, x_0 * printed.OPTIMISATION_DT]), np.concatenate([nothing, x_0])
    rows = {
        "value": np.column_stack([gains.K @ state for state in states]).ravel(),
        "lower": np.column_stack([limits.lower, limits.rate_lower]).ravel(),
        "upper": np.column_stack([limits.upper, limits.rate_upper]).ravel(),
    }
    table = pd.DataFrame(rows, index=pd.Index(["phi", "phi rate", "n_z", "n_z rate"]))
    limit = np.where(table["value"] > 0.0, table["upper"], table["lower"])
    return table.assign(share=table["value"] / limit)


def largest_share(gains: PIGains) -> float:
    """Largest used share of a limit in `initial_commands`; at most one if all limits hold."""
    return float(initial_commands(gains)["share"].max())


class Moving(NamedTuple):
    """A command that does not follow the controller."""

    speed: float  # its rate: a rate limit, or 0 at the end of its range
    side: int  # sign of unlimited command minus command; 0 if anti-windup keeps the two equal
    bound: float  # next end of the range


class Signals(NamedTuple):
    """The loop at one instant, shape (2,), or over time, (2, k); `a` and `b` make ``v' = a + z'``.

    `v` is the command before and `u` after the limits; `a` is ``K_P e'`` and `b` is ``K_I e``.
    """

    e: FloatArray
    e_dot: FloatArray
    u: FloatArray
    v: FloatArray
    a: FloatArray
    b: FloatArray


class ContinuousLoop:
    """State y = (chi, gamma, z_phi, z_n_z, u_phi, u_n_z), z the integral parts of the commands.

    With ``v = K_P e + z``: without rate limits ``u = clip(v)`` and ``z' = K_I e``. This law is
    continuous, and the integration's error control resolves its corners.

    With rate limits u equals v as long as range and rates permit (`Moving` is None); else u is a
    separate state that moves at a rate limit towards ``clip(v)``. Conditional anti-windup has z' =
    0 if ``(v - u) K_I e > 0``, which jumps at v = u. If both sides drive v to u, the two stay equal
    and z' = u' - a (Filippov's solution).

    These are the limits of the discrete rules of `MimoPI` for a sample time of zero. ``tan(phi)``
    is used as printed, for any roll, and the course error is not wrapped.
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
        # as np.clip, which takes five times as long for two numbers
        u = np.minimum(np.maximum(v.T, self._limits.lower), self._limits.upper).T
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
        """Margins of command `i` to its next switches: to its range, and to other limits."""
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
        """Continue from `y` at time `t`, with every command without margin in its next mode."""
        self.y = y
        for i in (0, 1):
            in_range, to_limit = self.margins(i, t, y)
            if min(in_range, to_limit) > 0.0:
                continue
            moving, v = self._moving[i], self.signals(t, y).v[i]
            if moving is None:
                y[4 + i] = min(max(v, self._limits.lower[i]), self._limits.upper[i])
            elif in_range <= 0.0:
                y[4 + i] = moving.bound
            apart = moving is not None and moving.side != 0 and to_limit > 0.0
            if not apart:
                y[2 + i] += y[4 + i] - v
            self._start_moving(i, t, moving.side if apart and moving is not None else 0)

    def _start_moving(self, i: int, t: float, side: int) -> None:
        """The mode of command `i`, with v on the given `side` of it; 0: equal to v."""
        self._moving[i] = Moving(0.0, 0, math.inf)
        s, limits = self.signals(t, self.y), self._limits
        u, v, a, b = s.u[i], s.v[i], s.a[i], s.b[i]
        lower, upper = limits.lower[i], limits.upper[i]
        # Outside its range a command returns at the rate limit; at an end it stops.
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


def fly(
    gains: PIGains,
    disturbance: Sinusoid | None,
    *,
    limits: Limits | None = None,
    conditional: bool = False,
    duration: float = printed.DURATION,
) -> PaperFlight:
    """Fly the paper's manoeuvre for `duration` seconds.

    By default under the printed ranges without rate limits, as the paper must have done, and
    without conditional anti-windup, which the paper lacks.
    """
    limits = printed.printed_ranges() if limits is None else limits
    loop = ContinuousLoop(gains, limits, conditional=conditional, disturbance=disturbance)
    times = np.arange(round(duration / SAMPLE) + 1, dtype=np.float64) * SAMPLE

    def lost(_: float, y: FloatArray) -> float:
        return LOST - np.max(np.abs(y[:2]))

    events = [lost]
    if loop.rate_limited:
        # With the tolerance, the margin that ended at a switch does not end the next piece at once.
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
        ends = [(t[0], y[0]) for t, y in zip(piece.t_events, piece.y_events, strict=True) if len(t)]
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
    signals = np.concatenate(parts)
    # The signals of a part are in the order of the fields.
    return PaperFlight(times[: len(signals)], *signals.transpose(1, 0, 2), reason=reason)
