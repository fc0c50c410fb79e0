"""The exact law: rates by PI and reference, commands by inversion of the point mass."""

import math
from collections.abc import Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import check_positive
from flighttune.base.errors import InputError
from flighttune.base.units import G_PAPER, wrap_angle
from flighttune.control.controller import Measured, ReferenceSample
from flighttune.control.gains import RATES, PIGains
from flighttune.control.limits import FREE, RATE_LIMITED, AntiWindup, Limits, limit_command
from flighttune.control.linear_model import LinearModel, law_model
from flighttune.control.mimo_pi import ChannelLaw, PIState, StatefulPI, channel_laws
from flighttune.control.wind import speed_in_wind

Priority: TypeAlias = Literal["gamma", "chi"]

RATE_SIGNALS = MappingProxyType({"chi_dot_integral": "rad/s", "gamma_dot_integral": "rad/s"})
WITH_AIRSPEED_SIGNALS = MappingProxyType({**RATE_SIGNALS, "V_dot_integral": "1/s"})

# Minimum vertical lift for which the roll command is computed, in weights.
LIFT_FLOOR = 0.1

# A gain below this share of the largest gain counts as rounding.
ROUNDING = 1e-9

# Smallest maximum of the load factor for which roll is computed, in weights.
LEAST_LIFT = 1e-9

# Share of the load factor's rate limit with which the path angle brakes.
BRAKING = 0.5


# Numbers of a `RateLaw` in compiled order; a `PILaw` has fewer.
LAW_NUMBERS = 26


class RateLaw(NamedTuple):
    """Settings that do not change from sample to sample."""

    # Gains of the course rate with the limits of roll, and gains of the path-angle rate with the
    # limits of the load factor
    channels: tuple[ChannelLaw, ...]
    wrapped: bool  # whether the course error is taken the short way round
    conditional: bool  # anti-windup
    tracking_gain: float  # sample time over tracking time; 0 without back-calculation
    per_g: float  # s^2/m: one over the acceleration of gravity
    lift_floor: float  # weights
    brake: float  # 1/s: twice the share of the load factor's rate limit that brakes the path angle
    course_first: bool  # whether the course has priority
    feedback: tuple[float, float]  # feedback gains on the errors of roll and load factor
    turn_brake: float  # 1/s: as `brake`, for roll and course; inf if turns are not braked


@checked_class
class ExactLaw(StatefulPI):
    r"""Course and path angle by exact inversion of the point mass.

    The desired rates are the rates of the reference plus a PI of the errors,
    ``nu = ref' + K_P e + K_I integral of e``. With the horizontal and vertical lift that they need,
    in weights, ``a = V_a cos(gamma) nu_chi / g`` and ``b = V_a nu_gamma / g + cos(gamma)``, the
    commands are ``phi = atan2(a, max(b, lift_floor))`` and, from the roll command after its limits
    in the same sample, ``n_z = b / cos(phi)``. Valid for cos(gamma) > 0. With the `feedback` k of
    the gains, the tracking error of both commands after their limits is added, ``u + k (u -
    measured)``, and limited again.

    Parameters
    ----------
    gains : PIGains
        From the errors (chi, gamma) to the rates `RATES`: K_P in 1/s, K_I in 1/s^2. With the
        airspeed as third channel, nu_V is its rate divided by its reference, and the law commands
        ``n_x = sin(gamma) + V_ref nu_V / g`` with gamma through the air.
    limits : Limits, optional
        Limits of (phi, n_z) or (phi, n_z, n_x), applied as by `CommandLimiter`; none by default.
    dt : float, s
        Sample time.
    anti_windup : {"conditional", "back_calculation", "none"}
        Action of an integrator while a limit holds the command of its channel (roll for the course,
        load factor for the path angle), and of the course integrator while b is below the floor:
        hold, return towards the achieved rate with the tracking time, or continue.
    tracking_time : float, s, optional
        Time constant of back-calculation; by default ``norm(K_P) / norm(K_I)``, never below `dt`.
    priority : {"gamma", "chi"}
        Part of the lift that is kept if the largest load factor is too small for both channels: the
        vertical lift (the roll command is reduced to ``acos(b / n_z_max)``), or the horizontal lift
        (roll is raised to ``asin(a / n_z_max)``).
    lift_floor : float
        In weights. If less vertical lift is needed, in a push-over, the roll command is computed
        with the floor. It then stays on the side of the turn and does not jump when b passes zero.
        The load factor stays ``b / cos(phi)``, negative for negative b, within its limits; without
        lift there is no turn, and the course waits.
    braking : float or None
        The proportional part of the path-angle rate is at most
        ``sqrt(2 braking (g / V_a) r |e|)``, with r the rate limit of the load factor and e the
        error of the proportional part: a larger rate could not be reduced before the error is zero.
        None: no bound. While the bound acts, the load factor counts as rate-limited.
    brakes_turns : bool, optional
        Whether the same bound acts on the course, with the rate limit of roll; by default if roll
        is fed back.
    wrapped : bool
        Take the course error the short way round.
    g : float, m/s^2
        Acceleration of gravity.

    Attributes
    ----------
    law : RateLaw
        Settings that do not change from sample to sample.
    state : PIState
        Errors, commands after and before the limits, and integrals in rad/s.
    signals : mapping of str to str
        Recorded: ``chi_dot_integral`` and ``gamma_dot_integral``, the parts of the desired rates
        that come from the integrators at the next sample.

    Raises
    ------
    InputError
        If a value cannot be used, or `gains` does not act on rates (`rate_gains` maps others).
    ShapeError
        If `limits` is not made for two commands.

    Notes
    -----
    Derived in docs/exact_law.md. Integrals add each error after the command of its sample, so that
    a limit does not depend on the increment that it stops. This avoids a lock, see
    design/anti_windup.md.

    Examples
    --------
    >>> law = ft.loop.ExactLaw(ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0), dt=0.02)
    >>> law.start(ft.loop.FlightCondition(V_a=25.0))
    >>> still = ft.loop.Measured(0.0, 0.0, 25.0, 0.0, 1.0, 1000.0, (0.0, 0.0, 0.0), None)
    >>> phi, n_z, *_ = law.step(still, ft.loop.ReferenceSample(chi=0.1, gamma=0.0), 0.0)
    >>> round(phi, 5)
    0.17841
    """

    def __init__(
        self,
        gains: PIGains,
        limits: Limits | None = None,
        *,
        dt: float,
        anti_windup: AntiWindup = "conditional",
        tracking_time: float | None = None,
        priority: Priority = "gamma",
        lift_floor: float = LIFT_FLOOR,
        braking: float | None = BRAKING,
        brakes_turns: bool | None = None,
        wrapped: bool = True,
        g: float = G_PAPER,
    ) -> None:
        check_positive(
            dt=dt, tracking_time=tracking_time, lift_floor=lift_floor, braking=braking, g=g
        )
        if priority not in get_args(Priority):
            raise InputError(f"`priority` must be gamma or chi, got {priority!r}.")
        rate_model(airspeed=gains.airspeed).check_channels(gains)
        super().__init__(gains, dt, (0.0, 1.0, 0.0)[: len(gains.inputs)])
        self.signals = WITH_AIRSPEED_SIGNALS if gains.airspeed else RATE_SIGNALS
        limits = Limits.none(len(gains.inputs)) if limits is None else limits
        channels = channel_laws(gains, gains.K_I * dt, limits, dt)
        rates = np.minimum(limits.rate_upper, -limits.rate_lower).tolist()
        self._third = channels[2] if gains.airspeed else None
        integrated = np.abs(gains.K_I[:2, 2:])
        if integrated.size and integrated.max() > ROUNDING * np.abs(gains.K_I).max():
            raise InputError(
                "`K_I` of the exact law must not turn or lift by the airspeed's error, got "
                f"{gains.K_I[:2, 2].tolist()}."
            )
        if brakes_turns is None:
            brakes_turns = bool(gains.feedback[0])
        brake, turn_brake = (2.0 * (braking or math.inf) * rates[i] for i in (1, 0))
        self.law = RateLaw(
            channels=channels[:2],
            wrapped=wrapped,
            conditional=anti_windup == "conditional",
            tracking_gain=self.tracking_gain(anti_windup, tracking_time),
            per_g=1.0 / g,
            lift_floor=lift_floor,
            brake=brake,
            course_first=priority == "chi",
            feedback=gains.feedback,
            turn_brake=turn_brake if brakes_turns else math.inf,
        )

    def linear(self) -> tuple[LinearModel, PIGains]:
        """Model and gains of its error dynamics, the same at every flight condition."""
        return rate_model(airspeed=self.gains.airspeed), self.gains

    def step(self, measured: Measured, reference: ReferenceSample, _t: float, /) -> Sequence[float]:
        """Return roll and load-factor command after all limits, and the values of `signals`."""
        state, law, ref, channel = self.state, self.law, reference[:4], self._third
        if channel is not None:
            state.error[2], channel = self.airspeed_channel(channel, measured, reference)
            turn, climb = (row.K_P[2] * state.error[2] for row in law.channels)
            ref = *ref[:2], ref[2] + turn, ref[3] + climb
        seen = measured.chi, measured.gamma, measured.phi, measured.n_z
        exact_step(law, state, ref, seen, turning_speed(measured))
        if channel is not None:
            self._hold_airspeed(channel, self.climb(measured, measured.gamma), reference)
        return (*state.u, *state.integral)

    def _hold_airspeed(self, channel: ChannelLaw, climb: float, reference: ReferenceSample) -> None:
        """Command n_x for a `climb`; its integral is held at a limit, like the others."""
        state, law, (K_P, K_I, *limits) = self.state, self.law, channel
        V_ref = reference.V
        assert V_ref is not None  # `airspeed_channel` has refused a reference without an airspeed
        rate = reference.V_dot / V_ref + state.integral[2]
        rate += sum(gain * error for gain, error in zip(K_P, state.error, strict=True))
        wanted = climb + V_ref * law.per_g * rate
        n_x, limited = limit_command(wanted, state.u[2], *limits)
        state.u[2], state.u_unsat[2], state.limited[2] = n_x, wanted, limited
        more = sum(gain * error for gain, error in zip(K_I, state.error, strict=True))
        if limited != FREE:
            more = 0.0 if law.conditional else more
            more -= law.tracking_gain * (wanted - n_x) / (V_ref * law.per_g)
        state.integral[2] += more


def turning_speed(measured: Measured, estimate: tuple[float, ...] | None = None) -> float:
    """Speed that converts lift to rates, m/s, in the measured wind or its `estimate` (NED, m/s)."""
    chi, gamma, V_a, *_ = measured
    wind = measured.wind if estimate is None else estimate
    return V_a if wind is None else speed_in_wind(chi, gamma, V_a, wind)


def rate_model(*, airspeed: bool = False) -> LinearModel:
    """Error dynamics of the exact law while no limit acts: ``e' = -nu`` in every flight."""
    n = 3 if airspeed else 2
    return law_model(np.zeros((n, n)), -np.eye(n), RATES)


def roll_of_lift(a: float, b: float, floor: float, n_z_high: float, course_first: bool) -> float:
    """Roll for a horizontal lift a and a vertical lift b, as far as the lift suffices."""
    if b < floor:
        return math.atan2(a, floor)
    most = max(n_z_high, LEAST_LIFT)  # a limit may leave no lift
    if not a * a + b * b > most * most:
        return math.atan2(a, b)
    # The largest load factor is too small for both.
    if course_first:
        return math.copysign(math.asin(min(1.0, abs(a) / most)), a)
    return math.copysign(math.acos(min(1.0, b / most)), a)


def braked_rate(rate: float, speed: float, K_P: float, brake: float) -> float:
    """A desired rate of course or path angle, bounded so that its command can reduce it in time."""
    return math.copysign(math.sqrt(brake * abs(rate) / (speed * K_P)), rate)


def with_feedback(
    limited: int,
    k: float,
    expected: float,
    measured: float,
    before: float,
    lower: float,
    upper: float,
    step_down: float,
    step_up: float,
) -> tuple[float, float, int]:
    """The expected command plus feedback of its error, after limits, and which limit holds."""
    # `limited` says which limit acts on the expected command. The arguments from `before` on belong
    # to `limit_command`. Numba compiles this function too.
    wanted = expected + k * (expected - measured)
    u, kind = limit_command(wanted, before, lower, upper, step_down, step_up)
    # The second value is the expected command that leads to the limited command.
    return u, (u + k * measured) / (1.0 + k), limited or kind


def exact_step(
    law: RateLaw, state: PIState, ref: Sequence[float], y: Sequence[float], V_a: float
) -> None:
    """One sample of `ExactLaw`, which writes to `state`, written so that Numba compiles it too.

    `ref`: course, flight-path angle (rad) and their rates; `y`: measured angles, roll and load
    factor; `V_a` (m/s).
    """
    channels, wrapped, conditional, tracking_gain, per_g, lift_floor = law[:6]
    brake, course_first, (k_phi, k_n_z), turn_brake = law[6:]
    (
        (K_chi, I_chi, phi_low, phi_high, phi_down, phi_up),
        (K_gamma, I_gamma, n_z_low, n_z_high, n_z_down, n_z_up),
    ) = channels
    # All names are bound first: when Numba inlines this, it would lose writes through attributes.
    error, u, u_unsat, integral, limited, _, expected = state
    e_chi, e_gamma = ref[0] - y[0], ref[1] - y[1]
    if wrapped:
        e_chi = wrap_angle(e_chi)
    error[0], error[1] = e_chi, e_gamma
    level, speed = math.cos(y[1]), V_a * per_g
    # Not by `turn`, which rounds the sum differently: flights keep the bits of earlier versions.
    nu_chi = ref[2] + K_chi[0] * e_chi + K_chi[1] * e_gamma + integral[0]
    turn = K_chi[0] * e_chi + K_chi[1] * e_gamma
    climb = K_gamma[0] * e_chi + K_gamma[1] * e_gamma
    # Roll and load factor can end a turn and a climb only at their own rate limits.
    turn_braked = abs(turn) * speed * level * K_chi[0] > turn_brake
    if turn_braked:
        nu_chi = ref[2] + integral[0] + braked_rate(turn, speed * level, K_chi[0], turn_brake)
    braked = abs(climb) * speed * K_gamma[1] > brake
    if braked:
        climb = braked_rate(climb, speed, K_gamma[1], brake)
    nu_gamma = ref[3] + climb + integral[1]

    # Horizontal and vertical lift for these rates, in weights.
    a, b = speed * level * nu_chi, speed * nu_gamma + level
    floored = b < lift_floor
    roll = roll_of_lift(a, b, lift_floor, n_z_high, course_first)
    phi, phi_limited = limit_command(roll, expected[0], phi_low, phi_high, phi_down, phi_up)
    load = b / math.cos(phi)
    n_z, n_z_limited = limit_command(load, expected[1], n_z_low, n_z_high, n_z_down, n_z_up)
    expected[0], expected[1] = phi, n_z
    before, u[0], u[1] = (u[0], u[1]), phi, n_z
    # From here on, for anti-windup, phi and n_z are the inputs that lead to the limited commands.
    if k_phi:
        roll += k_phi * (phi - y[2])
        u[0], phi, phi_limited = with_feedback(
            phi_limited, k_phi, phi, y[2], before[0], phi_low, phi_high, phi_down, phi_up
        )
    if k_n_z:
        load += k_n_z * (n_z - y[3])
        u[1], n_z, n_z_limited = with_feedback(
            n_z_limited, k_n_z, n_z, y[3], before[1], n_z_low, n_z_high, n_z_down, n_z_up
        )
    phi_limited = phi_limited or (RATE_LIMITED if turn_braked else FREE)
    n_z_limited = n_z_limited or (RATE_LIMITED if braked else FREE)
    u_unsat[0], u_unsat[1], limited[0], limited[1] = roll, load, phi_limited, n_z_limited

    # Whether the commands achieve the desired rates; without an active limit they do, but for
    # rounding.
    held_chi, held_gamma = phi_limited != FREE or floored, n_z_limited != FREE
    more_chi = I_chi[0] * e_chi + I_chi[1] * e_gamma
    more_gamma = I_gamma[0] * e_chi + I_gamma[1] * e_gamma
    if conditional:
        more_chi, more_gamma = 0.0 if held_chi else more_chi, 0.0 if held_gamma else more_gamma
    elif tracking_gain:
        if held_chi or held_gamma:
            more_chi -= tracking_gain * (a - n_z * math.sin(phi)) / (speed * level)
        if held_gamma:
            more_gamma -= tracking_gain * (b - n_z * math.cos(phi)) / speed
    integral[0] += more_chi
    integral[1] += more_gamma
