"""The discrete multivariable PI controller: one for every plant."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.errors import InputError, ShapeError
from flighttune.units import wrap_angle

AntiWindup: TypeAlias = Literal["none", "conditional", "back_calculation"]

FREE, MAGNITUDE_LIMITED, RATE_LIMITED = 0, 1, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class MimoPIState:
    """What the controller holds after a step, one entry a channel.

    Attributes
    ----------
    error : tuple of float, length p
        Reference minus actual, wrapped where the channel is an angle of a full turn.
    u : tuple of float, length m
        Command after all limits.
    unlimited : tuple of float, length m
        Command before them.
    integral : tuple of float, length m, input unit
        Part of the command that comes from the integrator.
    limited : tuple of int, length m
        0 free, 1 held by a magnitude limit, 2 held by a rate limit.
    """

    error: tuple[float, ...]
    u: tuple[float, ...]
    unlimited: tuple[float, ...]
    integral: tuple[float, ...]
    limited: tuple[int, ...]


class MimoPI:
    """``u = limit(u_ff + K_P e + K_I integral of e)``, sampled every `dt` seconds.

    The integrator is kept per command, in the unit of the command, so that anti-windup acts on the
    channel whose limit is met and a change of gain causes no jump. It is summed by the trapezoidal
    rule, starts at zero, and takes nothing from before the first sample.

    Parameters
    ----------
    gains : PIGains
        m commands, p errors.
    limits : Limits, optional
        Of m commands; none by default. Where a magnitude and a rate limit disagree (a start outside
        the range) the rate limit rules until the command is inside.
    dt : float, s
        Sample time.
    anti_windup : {"conditional", "back_calculation", "none"}
        What the integrator does while the command after all limits differs from the one before:
        take only as much as the limits let through, be led back with the tracking time, nothing.
    tracking_time : float, s, optional
        Of back-calculation; by default the integral time ``norm(K_P) / norm(K_I)``, never below
        `dt`.
    wrapped : sequence of str, optional
        Errors that are angles of a full turn; by default ``("chi",)`` where there is one.
    schedule_speed : float, m/s, optional
        Airspeed for which the gains were made; gains are then scaled by ``V_a / schedule_speed``,
        which keeps ``B K`` of the chi/gamma law constant over airspeed.

    Raises
    ------
    InputError
        If a value cannot be used.
    ShapeError
        If `limits` is not made for m commands.
    """

    def __init__(
        self,
        gains: PIGains,
        limits: Limits | None = None,
        *,
        dt: float,
        anti_windup: AntiWindup = "conditional",
        tracking_time: float | None = None,
        wrapped: Sequence[str] = ("chi",),
        schedule_speed: float | None = None,
    ) -> None:
        m = len(gains.inputs)
        limits = Limits.none(m) if limits is None else limits
        if limits.lower.shape != (m,):
            raise ShapeError(f"`limits` must be of {m} commands, got {limits.lower.shape[0]}.")
        for name, value in (
            ("dt", dt),
            ("tracking_time", tracking_time),
            ("schedule_speed", schedule_speed),
        ):
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise InputError(f"`{name}` must be positive, got {value}.")
        if anti_windup not in ("none", "conditional", "back_calculation"):
            raise InputError(
                f"`anti_windup` must be none, conditional or back_calculation, got {anti_windup!r}."
            )
        self.gains, self.limits, self.dt, self.anti_windup = gains, limits, dt, anti_windup
        self.wrapped = tuple(name in wrapped for name in gains.errors)
        self._law = (
            self._rows(),
            tuple(range(len(gains.errors))),
            self.wrapped,
            anti_windup == "conditional",
            self._tracking_gain(tracking_time),
            0.0 if schedule_speed is None else 1.0 / schedule_speed,
        )
        self.start(np.zeros(m).tolist())

    def _rows(self) -> tuple[tuple[Any, ...], ...]:
        limits, dt = self.limits, self.dt
        return tuple(
            zip(
                range(len(self.gains.inputs)),
                self.gains.K_P.tolist(),
                (self.gains.K_I * (0.5 * dt)).tolist(),
                limits.lower.tolist(),
                limits.upper.tolist(),
                (limits.rate_lower * dt).tolist(),
                (limits.rate_upper * dt).tolist(),
                strict=True,
            )
        )

    def _tracking_gain(self, tracking_time: float | None) -> float:
        if self.anti_windup != "back_calculation":
            return 0.0
        if tracking_time is None:
            tracking_time = integral_time(self.gains.K_P, self.gains.K_I)
        return self.dt / max(tracking_time, self.dt)

    def start(self, u: Sequence[float]) -> None:
        """Empty the integrator and take `u` (length m) as the command in force before t = 0."""
        m, p = self.gains.K_P.shape
        if len(u) != m or not all(map(math.isfinite, u)):
            raise InputError(f"`u` must be {m} finite numbers, got {list(u)}.")
        self.u = [float(value) for value in u]
        self.unlimited = list(self.u)
        self.integral = [0.0] * m
        self.limited = [FREE] * m
        self.error = [0.0] * p
        memory = (self.error, [0.0] * p, self.u, self.unlimited, self.integral, self.limited)
        self._memory = (*memory, [False])

    @property
    def state(self) -> MimoPIState:
        """What the controller holds now."""
        return MimoPIState(
            error=tuple(self.error),
            u=tuple(self.u),
            unlimited=tuple(self.unlimited),
            integral=tuple(self.integral),
            limited=tuple(self.limited),
        )

    def step(
        self, ref: Sequence[float], y: Sequence[float], u_ff: Sequence[float], V_a: float = 0.0
    ) -> list[float]:
        """Return the command for the coming sample.

        Parameters
        ----------
        ref, y : sequence of float, length p
            Reference and actual value of each controlled quantity.
        u_ff : sequence of float, length m, input unit
            Feed-forward.
        V_a : float, m/s
            Airspeed; used where the gains are scheduled.

        Returns
        -------
        list of float, length m
            Command after all limits; the controller's own list, overwritten by the next step.
        """
        return pi_step(self._law, self._memory, ref, y, u_ff, V_a)


def integral_time(K_P: FloatArray, K_I: FloatArray) -> float:
    """``norm(K_P) / norm(K_I)``, s; infinite without integral gain.

    Parameters
    ----------
    K_P, K_I : ndarray, shape (m, p), input unit per error unit, and that per second
        Proportional and integral gain.
    """
    integral = float(np.linalg.norm(K_I))
    return float(np.linalg.norm(K_P)) / integral if integral else math.inf


def pi_step(
    law: tuple[Any, ...],
    memory: tuple[Any, ...],
    ref: Sequence[float],
    y: Sequence[float],
    u_ff: Sequence[float],
    V_a: float,
) -> Any:
    """One sample of the controller: `MimoPI.step` on plain containers.

    Written so that it also compiles: the batched runs fly this very function.

    Parameters
    ----------
    law : tuple
        Rows ``(i, K_P[i], K_I[i] dt / 2, lower, upper, rate_lower dt, rate_upper dt)``, one a
        command; indices of the errors; which of them to wrap; whether anti-windup is conditional;
        ``dt`` over the tracking time (0: no back-calculation); 1 over the speed of the schedule (0:
        no schedule).
    memory : tuple
        Error, its sum with the one before, command, command before the limits, integral part, kind
        of limit, and one flag (a sample was taken): containers that are written to.
    ref, y, u_ff : sequence of float, lengths p, p and m
        As in `MimoPI.step`.
    V_a : float, m/s
        As in `MimoPI.step`.

    Returns
    -------
    container of float, length m
        Command after all limits: the one of `memory`.
    """
    rows, columns, wrapped, conditional, lead_back, per_speed = law
    error, summed, u, unlimited, integral, limited, started = memory
    for j in columns:
        e = ref[j] - y[j]
        if wrapped[j]:
            e = wrap_angle(e)
        summed[j] = error[j] + e
        error[j] = e
    if not started[0]:
        started[0] = True
        for j in columns:
            summed[j] = 0.0
    gain = V_a * per_speed if per_speed else 1.0
    for i, k_p, k_i, lower, upper, step_down, step_up in rows:
        proportional = increment = 0.0
        for j in columns:
            proportional += k_p[j] * error[j]
            increment += k_i[j] * summed[j]
        increment *= gain
        held = u_ff[i] + gain * proportional + integral[i]
        wanted = held + increment
        low, high = u[i] + step_down, u[i] + step_up
        rate_low, rate_high = low > lower, high < upper
        if not rate_low:
            low = lower if lower < high else high
        if not rate_high:
            high = upper if upper > low else low
        allowed = low if wanted < low else high if wanted > high else wanted
        excess = wanted - allowed
        if excess:
            if conditional and increment * excess > 0.0:
                spare = allowed - held
                increment = spare if increment * spare > 0.0 else 0.0
                wanted = held + increment
            increment -= lead_back * excess
            by_rate = rate_high if excess > 0.0 else rate_low
            limited[i] = RATE_LIMITED if by_rate else MAGNITUDE_LIMITED
        else:
            limited[i] = FREE
        integral[i] += increment
        unlimited[i] = wanted
        u[i] = allowed
    return u
