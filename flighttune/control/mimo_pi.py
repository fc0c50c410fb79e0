"""The discrete multivariable PI controller, the same for every plant."""

import math
from collections.abc import Mapping, MutableSequence, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_positive
from flighttune.base.errors import InputError, ShapeError
from flighttune.base.units import G_PAPER, wrap_angle
from flighttune.control.controller import FlightCondition, Measured, ReferenceSample, SelfLimiting
from flighttune.control.gains import ERRORS, ERRORS_WITH_AIRSPEED, PIGains
from flighttune.control.limits import FREE, AntiWindup, Limits, limit_command
from flighttune.control.wind import WindEstimate, climb_through_air

Vector: TypeAlias = MutableSequence[Any] | npt.NDArray[Any]

# No feed-forward.
LEVEL = (0.0, 0.0, 0.0)

INTEGRAL_SIGNALS: Mapping[str, str] = MappingProxyType({"phi_integral": "rad", "n_z_integral": "1"})
WITH_AIRSPEED_INTEGRAL = MappingProxyType({**INTEGRAL_SIGNALS, "n_x_integral": "1"})

# The command of n_x may exceed the range of the engines by this load factor: with less the engines
# would leave their stop, and with more the integral would wind up.
BEYOND_STOP = 0.05


class ChannelLaw(NamedTuple):
    """Settings of the law for one command, with p errors."""

    K_P: Sequence[float]  # its row of K_P, length p
    # Its row of ``K_I dt/2``: the trapezoidal rule adds two errors. The exact law adds single
    # errors and has ``K_I dt`` here.
    K_I_half: Sequence[float]
    lower: float
    upper: float
    # Largest steps in a sample: the rate limits times the sample time
    step_down: float
    step_up: float


class PILaw(NamedTuple):
    """Settings that do not change from sample to sample."""

    channels: tuple[ChannelLaw, ...]  # length m
    wrapped: tuple[bool, ...]  # length 2: whether an error is an angle that wraps
    conditional: bool  # anti-windup
    tracking_gain: float  # sample time over tracking time; 0 without back-calculation
    per_speed: float  # s/m: one over the speed of the schedule; 0 without a schedule


class PIState(NamedTuple):
    """State of the controller between samples: lists, or arrays in compiled code."""

    # Length p: reference minus actual, wrapped for angles of a full turn; the error of the airspeed
    # is divided by its reference
    error: Vector
    # Length m: commands after and before all limits
    u: Vector
    u_unsat: Vector
    integral: Vector  # length m, input unit: part of the command that comes from the integrator
    limited: Vector  # length m: 0 free, 1 at a magnitude limit, 2 at a rate limit
    started: Vector  # length 1: whether the first sample is over
    # Length m: limited commands before the inner feedback of the exact law; other laws do not use
    # it
    expected: Vector


def empty_state(u: Sequence[float]) -> PIState:
    """A state with empty integrators and the commands `u` in force before t = 0."""
    before, m = [float(value) for value in u], len(u)
    return PIState(
        error=[0.0] * m,
        u=before,
        u_unsat=[*before],
        integral=[0.0] * m,
        limited=[FREE] * m,
        started=[False],
        expected=[*before],
    )


def channel_laws(
    gains: PIGains, K_I_step: FloatArray, limits: Limits | None, dt: float
) -> tuple[ChannelLaw, ...]:
    """The settings of each command; `K_I_step` is K_I times the integration time per error."""
    m = len(gains.inputs)
    limits = Limits.none(m) if limits is None else limits
    if limits.lower.shape != (m,):
        raise ShapeError(f"`limits` must be of {m} commands, got {limits.lower.shape[0]}.")
    steps = limits.rate_lower * dt, limits.rate_upper * dt
    rows = gains.K_P, K_I_step, limits.lower, limits.upper, *steps
    return tuple(map(ChannelLaw, *(row.tolist() for row in rows)))


class StatefulPI(SelfLimiting):
    """A law whose memory is a `PIState`: its commands, their limits and its integrators."""

    def __init__(self, gains: PIGains, dt: float, u: Sequence[float] = ()) -> None:
        self.gains, self.dt = gains, dt
        self.state = empty_state(u or [0.0] * len(gains.inputs))
        self._wind = WindEstimate(dt)

    @property
    def limiter(self) -> PIState:
        """Commands before the limits, and which limit holds: the law applies its own."""
        return self.state

    def start(self, condition: FlightCondition) -> None:
        """Clear the integrators; the commands of steady flight at `condition` are in force."""
        self.state = empty_state(condition.commands(len(self.gains.inputs)))
        self._wind = WindEstimate(self.dt)

    def tracking_gain(self, anti_windup: str, tracking_time: float | None) -> float:
        """Sample time over tracking time; 0 without back-calculation."""
        if anti_windup not in get_args(AntiWindup):
            names = ", ".join(get_args(AntiWindup))
            raise InputError(f"`anti_windup` must be one of {names}, got {anti_windup!r}.")
        if anti_windup != "back_calculation":
            return 0.0
        if tracking_time is None:
            # The default is the integral time, which is infinite without integral gain.
            size, integral = (float(np.linalg.norm(K)) for K in (self.gains.K_P, self.gains.K_I))
            tracking_time = size / integral if integral else math.inf
        return self.dt / max(tracking_time, self.dt)

    def airspeed_channel(
        self, channel: ChannelLaw, measured: Measured, reference: ReferenceSample
    ) -> tuple[float, ChannelLaw]:
        """Relative error of the airspeed, and its channel with the limits of the engines."""
        # The loop refuses such a flight before it starts.
        if measured.n_x is None or reference.V is None:
            raise InputError(
                "`gains` must be of two errors without a reference of the airspeed and a measured "
                "n_x, got three."
            )
        (_, least, most), V_ref = measured.n_x, reference.V
        within = channel._replace(
            lower=max(channel.lower, least - BEYOND_STOP),
            upper=min(channel.upper, most + BEYOND_STOP),
        )
        return (V_ref - measured.V_a) / V_ref, within

    def climb(self, measured: Measured, gamma: float) -> float:
        """Sine of the path angle through the air for `gamma` over ground (rad)."""
        if (wind := self._wind(measured.wind)) is None:
            return math.sin(gamma)
        return climb_through_air(measured.chi, gamma, measured.V_a, wind)


@checked_class
class MimoPI(StatefulPI):
    """``u = limit(u_ff + K_P e + K_I integral of e)``, sampled every `dt` seconds.

    Each command has an integrator in its own unit, so that anti-windup acts on the limited channel
    and a change of gain causes no jump. The trapezoidal sum starts at zero with the first sample.

    Parameters
    ----------
    gains : PIGains
        From (chi, gamma) to (phi, n_z), or from (chi, gamma, V) to (phi, n_z, n_x).
    limits : Limits, optional
        Limits of m commands, applied as by `CommandLimiter`; none by default.
    dt : float, s
        Sample time.
    anti_windup : {"conditional", "back_calculation", "none"}
        Action of the integrator while limits change the command: add only as much as the limits let
        through, return with the tracking time, or continue.
    tracking_time : float, s, optional
        Time constant of back-calculation; by default ``norm(K_P) / norm(K_I)``, never below
        `dt`.
    wrapped : sequence of str, optional
        Errors that are angles of a full turn; by default ``("chi",)`` if there is one.
    schedule_speed : float, m/s, optional
        Design airspeed of the gains, which are then scaled by ``V_a / schedule_speed``,
        which keeps ``B K`` of the chi/gamma law constant over airspeed.
    feed_forward : bool
        Add ``cos(gamma_ref)/cos(phi)`` to the load-factor command: the load factor of steady flight
        on the reference at the actual bank. It does not depend on the error, so the linear loop
        about wings-level flight does not change. If the reference was made of commands, these are
        added instead. To n_x it adds the sine of the reference's path angle through the air, and
        the rate of the airspeed's reference divided by g.
    g : float, m/s^2
        Acceleration of gravity, used only by the feed-forward of n_x.

    Attributes
    ----------
    law : PILaw
        Settings that do not change from sample to sample.
    state : PIState
        State of the controller; every step writes to it.
    signals : mapping of str to str
        Recorded: ``phi_integral`` and ``n_z_integral``, the parts of the commands that come from
        the integrator.

    Raises
    ------
    InputError
        If a value cannot be used.
    ShapeError
        If `limits` is not made for m commands.

    Examples
    --------
    >>> law = ft.loop.MimoPI(ft.PAPER_GAINS, dt=0.02)
    >>> law.start(ft.loop.FlightCondition(V_a=25.0))
    >>> still = ft.loop.Measured(0.0, 0.0, 25.0, 0.0, 1.0, 1000.0, (0.0, 0.0, 0.0), None)
    >>> phi, n_z, *_ = law.step(still, ft.loop.ReferenceSample(chi=0.1, gamma=0.0), 0.0)
    >>> round(phi, 5)
    0.16968
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
        feed_forward: bool = False,
        g: float = G_PAPER,
    ) -> None:
        if gains.errors not in (ERRORS, ERRORS_WITH_AIRSPEED):
            raise ShapeError(f"`gains` must be of 2 or 3 errors, got {len(gains.errors)}.")
        check_positive(dt=dt, tracking_time=tracking_time, schedule_speed=schedule_speed)
        super().__init__(gains, dt)
        self.feed_forward, self._g = feed_forward, g
        self.signals = WITH_AIRSPEED_INTEGRAL if gains.airspeed else INTEGRAL_SIGNALS
        self._gamma_ref, self._lift = math.nan, 0.0
        self.wrapped = tuple(name in wrapped for name in gains.errors)
        self.law = PILaw(
            channels=channel_laws(gains, gains.K_I * (0.5 * dt), limits, dt),
            wrapped=self.wrapped,
            conditional=anti_windup == "conditional",
            tracking_gain=self.tracking_gain(anti_windup, tracking_time),
            per_speed=0.0 if schedule_speed is None else 1.0 / schedule_speed,
        )

    def step(self, measured: Measured, reference: ReferenceSample, _t: float, /) -> Sequence[float]:
        """Return roll and load-factor command after all limits, and the values of `signals`."""
        u_ff = reference[4] if self.feed_forward else LEVEL
        if u_ff is None:
            if reference[1] != self._gamma_ref:
                # NumPy's cosine, as in earlier versions: the cosine of `math` may differ in the
                # last bit.
                self._gamma_ref, self._lift = reference[1], float(np.cos(reference[1]))
            u_ff = 0.0, self._lift / math.cos(measured[3])
        state, law, e_V = self.state, self.law, 0.0
        if len(law.channels) > 2:
            e_V, channel = self.airspeed_channel(law.channels[2], measured, reference)
            along = self.climb(measured, reference.gamma) + reference.V_dot / self._g
            u_ff = *u_ff[:2], along if self.feed_forward else 0.0
            law = law._replace(channels=(*law.channels[:2], channel))
        # Both begin with course and path angle; slices of them would cost as much as an error.
        pi_step(law, state, reference, measured, u_ff, measured[2], e_V)
        return (*state.u, *state.integral)


def pi_step(
    law: PILaw,
    state: PIState,
    ref: Sequence[Any],
    y: Sequence[Any],
    u_ff: Sequence[float],
    V_a: float,
    e_V: float = 0.0,
) -> None:
    """One sample of the controller `MimoPI`; Numba compiles this too.

    `ref` and `y` begin with course and flight-path angle; `u_ff` (length m, input unit) is the
    feed-forward, and scheduled gains use `V_a` (m/s). `e_V` (1) is the third error, if any. Writes
    to `state`, whose `u` is the command after all limits.
    """
    channels, wrapped, conditional, tracking_gain, per_speed = law
    # All names are bound first: when Numba inlines this, it would lose writes through attributes.
    error, u, unsaturated, integral, limited, started, _ = state
    # Written out for two errors: in CPython a loop over them costs a sixth of the whole step.
    e_0, e_1 = ref[0] - y[0], ref[1] - y[1]
    if wrapped[0]:
        e_0 = wrap_angle(e_0)
    if wrapped[1]:
        e_1 = wrap_angle(e_1)
    both_0, both_1, both_V = error[0] + e_0, error[1] + e_1, error[-1] + e_V
    if not started[0]:
        # The first sample adds nothing, since no time has passed.
        started[0] = True
        both_0 = both_1 = both_V = 0.0
    error[0], error[1] = e_0, e_1
    third = len(error) > 2
    if third:
        error[-1] = e_V
    # The input matrix of the chi/gamma law is proportional to 1/V_a, so gains proportional to V_a
    # keep B K.
    gain = V_a * per_speed if per_speed else 1.0
    for i, (K_P, K_I_half, lower, upper, step_down, step_up) in enumerate(channels):
        proportional = K_P[0] * e_0 + K_P[1] * e_1
        increment = K_I_half[0] * both_0 + K_I_half[1] * both_1
        if third:
            proportional += K_P[-1] * e_V
            increment += K_I_half[-1] * both_V
        # The integral contains the scheduled gain, so that a change of gain moves no command.
        increment *= gain
        u_before = u_ff[i] + gain * proportional + integral[i]  # without this increment
        u_unsat = u_before + increment

        u_sat, kind = u_unsat, FREE
        # Tested before the call, which costs as much as the rest of a channel.
        if not (u[i] + step_down <= u_unsat <= u[i] + step_up and lower <= u_unsat <= upper):
            u_sat, kind = limit_command(u_unsat, u[i], lower, upper, step_down, step_up)
        excess = u_unsat - u_sat
        if excess != 0.0:
            if conditional and increment * excess > 0.0:
                # The increment drives the command further beyond the limit. Only the part that
                # reaches the limit is added: nothing if the command is at or beyond the limit
                # without it. Freezing the integrator instead would lock the loop if an increment is
                # larger than the rate limit allows in a sample: design/anti_windup.md.
                spare = u_sat - u_before
                increment = spare if increment * spare > 0.0 else 0.0
                u_unsat = u_before + increment
            # Minus, because an excess above the limit moves the integral down, towards the command.
            increment -= tracking_gain * excess
        integral[i] += increment
        u[i], unsaturated[i], limited[i] = u_sat, u_unsat, kind
