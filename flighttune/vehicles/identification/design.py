"""Design of the inner loop: derivatives of the airframe, gains, step responses, file.

Steps of roll and load factor are flown against the design goals; their figure also shows a roll
into a bank at each airspeed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from flighttune.base.answering import Drawn
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, PlantError
from flighttune.base.files.whole import together
from flighttune.base.units import DEG, G_0
from flighttune.vehicles.aircraft.aircraft import (
    AircraftConfig,
    InnerLoopGains,
    load_aircraft,
    save_gains,
)
from flighttune.vehicles.aircraft.aircraft import Design as DesignTable
from flighttune.vehicles.identification.file import Channel
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim.bench import AirframeState, Bench, slopes
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.model_files import model_hash
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.jsbsim.properties import GYROSCOPIC
from flighttune.vehicles.plants.jsbsim.trim import level, trim

# A smaller gain counts as rounding and is written as 0.
NO_GAIN = 1e-9

# Significant digits of the gains in the file, which are also flown.
DIGITS = 4

_MEASURED = ("p_dot", "q_dot", "r_dot", "u_dot", "n_z", "n_y")

# Signs of slopes that this inner loop requires.
SIGNS = (
    *((1, "p_dot", "aileron"), (1, "u_dot", "throttle"), (1, "n_z", "alpha")),
    *((-1, "q_dot", "elevator"), (-1, "r_dot", "rudder"), (-1, "n_y", "beta")),
)

# Half-widths of the central differences: rad/s, rad and 1.
_HALF_WIDTHS = dict.fromkeys(
    ("p", "q", "r", "alpha", "beta", "aileron", "elevator", "rudder"), 1e-3
) | {"throttle": 0.05}

# Bandwidth of the surface actuators, rad/s.
ACTUATOR = 25.0

# Default natural frequency of the roll error, relative to the bandwidth of the roll model.
ROLL_STIFFNESS = 2.3

WELL_DAMPED = 0.9
DUTCH_ROLL_DAMPING = 0.7

# Bandwidth at which the rudder takes the lateral load factor to zero, rad/s.
SIDE_FORCE = 1.0

# Yaw acceleration by sideslip that the rudder compensates, 1/s^2.
MIN_WEATHERCOCK = 1.0

# Delay of the lateral load factor, s: two samples and half a hold.
ACCELEROMETER = 0.015

YAW_MARGIN = 1.3  # factor on the gains at which the yaw loop must be stable
MIN_YAW_SHARE = 0.02

# Largest gain from pitch rate to pitch acceleration, relative to the actuator's bandwidth.
MAX_DAMPER = 0.6

# Ratio of the load-factor model's bandwidth to the desired bandwidth, at most 20 rad/s.
MODEL_LEAD = 2.0

# The gains compensate the coupling of pitch and yaw by a propeller above this frequency, relative
# to the bandwidth of load factor; below it the loops reject the coupling.
STRONG = 1.5

YAW_GAINS = ("yaw/k_ff", "yaw/k_r", "yaw/k_p", "yaw/k_i")

_SPAN, _STEP = 2.0, 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Airframe:
    """Derivatives of accelerations and load factors about wings-level flight, SI and rad."""

    trimmed: AirframeState  # the flight condition of the derivatives
    # ``slopes[what][by]``: of ``p_dot``, ``q_dot``, ``r_dot`` (rad/s^2), ``u_dot`` (m/s^2),
    # ``n_z``, ``n_y`` (1), by ``p``, ``q``, ``r`` (rad/s), ``alpha``, ``beta``, ``aileron``,
    # ``elevator``, ``rudder`` (rad; only where there is one) and ``throttle`` (1)
    slopes: dict[str, dict[str, float]]

    def of(self, output: str, by: str) -> float:
        """Return the derivative of `output` by `by`."""
        return self.slopes[output][by]

    @classmethod
    def about(cls, fdm: Fdm, condition: FlightCondition) -> "Airframe":
        """The derivatives of `fdm` about wings-level flight at `condition`."""
        trimmed, bench = trim(fdm, condition), Bench(fdm, condition.h)

        def measure(state: AirframeState) -> FloatArray:
            measured = bench.accelerations(state)
            return np.array([measured[name] for name in _MEASURED])

        half_widths = dict(_HALF_WIDTHS)
        if fdm.config.surfaces.rudder is None:
            del half_widths["rudder"]
        by = slopes(measure, trimmed, half_widths)
        named = {
            output: {name: float(column[i]) for name, column in by.items()}
            for i, output in enumerate(_MEASURED)
        }
        if not fdm.config.engines.count:  # with any power, no throttle would be needed
            named["u_dot"]["throttle"] = math.inf
        return cls(trimmed=trimmed, slopes=named)


ROLL_STEP = 30.0 * DEG
LOAD_STEP = 0.5

# Duration of a step: this time, s, or this multiple of the longest time to 90 %, if longer.
ROLL_TIME, LOAD_TIME = 4.0, 1.6
OVER_T90 = 1.4

STEP_DT = 0.005  # s: sample time of the flown steps

BANK = 45.0 * DEG


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepResponse:
    """Response to one step of a command from steady level flight, with its requirements."""

    channel: Channel  # the commanded channel
    V_a: float  # m/s: airspeed at the start
    size: float  # rad or 1: step of the command
    signals: Mapping[str, FloatArray]  # signals of the plant over time, and ``t`` (s)
    ended: str  # reason of an early end; else empty
    # s and 1: longest time to 90 % and largest overshoot by ``[design]``
    t90_allowed: float = math.inf
    overshoot_allowed: float = math.inf

    @property
    def progress(self) -> FloatArray:
        """Response as a share of the step, 0 at the start and 1 when reached."""
        y = self.signals[self.channel]
        return (y - y[0]) / self.size

    @property
    def t90(self) -> float:
        """Time to 90 % of the step, s; infinite if it was not reached."""
        reached = np.flatnonzero(self.progress >= 0.9)
        return float(self.signals["t"][reached[0]]) if len(reached) else math.inf

    @property
    def overshoot(self) -> float:
        """Overshoot as a share of the step."""
        return max(0.0, float(np.max(self.progress)) - 1.0)

    @property
    def met(self) -> bool:
        """Whether the step meets its requirements on speed and damping."""
        fast = self.t90 <= self.t90_allowed
        return fast and self.overshoot <= self.overshoot_allowed and not self.ended

    @property
    def name(self) -> str:
        """Channel, size and airspeed."""
        size = f"{self.size / DEG:+g} deg" if self.channel == "phi" else f"{self.size:+g}"
        return f"{self.channel} {size} at {self.V_a:g} m/s"


def fly_step(
    config: AircraftConfig, channel: Channel, size: float, V_a: float, h: float, duration: float
) -> StepResponse:
    """Fly a step of roll (rad) at a held climb angle, or of load factor, from steady flight."""
    plant = JSBSimPlant(config)
    plant.start(level(config, V_a, h))
    rows, stop = [plant.observe()], None
    gamma, phi = plant.signals.index("gamma"), plant.signals.index("phi")
    phi_cmd, n_z_step = (size, 0.0) if channel == "phi" else (0.0, size)
    for _ in range(round(duration / STEP_DT)):
        now = rows[-1]
        steady = math.cos(now[gamma]) / math.cos(now[phi]) if phi_cmd else 1.0
        stop = plant.advance(phi_cmd, steady + n_z_step, STEP_DT)
        rows.append(plant.observe())
        if stop is not None:
            break
    signals = dict(zip(plant.signals, np.array(rows).T, strict=True))
    signals["t"] = STEP_DT * np.arange(len(rows))
    ended = stop.reason if stop else ""
    return StepResponse(channel=channel, V_a=V_a, size=size, signals=signals, ended=ended)


def check_steps(config: AircraftConfig) -> tuple[StepResponse, ...]:
    """Fly the steps of an aircraft's ``[design]`` at its airspeeds; empty without the table."""
    if (design := config.design) is None:
        return ()
    goals: tuple[tuple[Channel, float, float, float, float], ...] = (
        ("phi", ROLL_STEP, ROLL_TIME, design.roll_t90, design.roll_overshoot),
        ("n_z", LOAD_STEP, LOAD_TIME, design.n_z_t90, design.n_z_overshoot),
        ("n_z", -LOAD_STEP, LOAD_TIME, design.n_z_t90, design.n_z_overshoot),
    )
    steps = []
    for V_a in design.V_a_shown:
        for channel, size, shortest, t90, overshoot in goals:
            step = fly_step(config, channel, size, V_a, design.h, max(shortest, OVER_T90 * t90))
            steps.append(replace(step, t90_allowed=t90, overshoot_allowed=overshoot))
    return tuple(steps)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignedAircraft(Drawn):
    """An aircraft with its designed inner loop."""

    config: AircraftConfig  # with its new gains
    steps: tuple[StepResponse, ...]  # steps flown with them
    before: Mapping[str, float]  # earlier gains of the aircraft, by name, or empty

    @property
    def gains(self) -> InnerLoopGains:
        """The designed gains."""
        assert self.config.gains is not None  # a design always has gains
        return self.config.gains

    @property
    def missed(self) -> str:
        """The first step that misses its requirement, in words; empty if all meet it."""
        for step in self.steps:
            if not step.met:
                ended = f": {step.ended}" if step.ended else ""
                return (
                    f"{step.name}: t90 must be at most {step.t90_allowed:g} s and the overshoot "
                    f"{100.0 * step.overshoot_allowed:g} %, got {step.t90:.2f} s and "
                    f"{100.0 * step.overshoot:.1f} %{ended}; nothing is written"
                )
        return ""

    def save(self, folder: str | Path) -> dict[str, Path]:
        """Write gains and a figure of the steps into a folder; return the files by kind."""
        folder = Path(folder)
        figure = folder / "step_responses.svg"
        with together():
            written = save_gains(self.gains, folder)
            self.sheet().save(figure)
        return {"written": written, "figure": figure}


def design(aircraft: AircraftConfig | str | Path) -> DesignedAircraft:
    """Design the gains of an aircraft's inner loop, and fly its step responses.

    Existing gains have no effect: the same file gives the same design.

    Parameters
    ----------
    aircraft : AircraftConfig, str or Path
        A shipped aircraft or the folder of an aircraft, whose file has a table [design].

    Returns
    -------
    DesignedAircraft
        Nothing is written; its `save` does.

    Raises
    ------
    InputError
        If there is no such aircraft, or it has no table [design].
    PlantError
        If a slope of the airframe has the wrong sign for this inner loop.

    Examples
    --------
    >>> designed = ft.design("aerosonde")
    >>> designed.gains.gains["roll/model-rad_sec"] > 0.0, designed.missed
    (True, '')
    """
    config = aircraft if isinstance(aircraft, AircraftConfig) else load_aircraft(aircraft)
    if (goals := config.design) is None:
        raise InputError(f"{config.file}: `design` must be given: what to make the gains for.")
    trimmed = Airframe.about(Fdm(config), level(config, goals.V_a, goals.h))
    gains = {
        name: float(f"{value:.{DIGITS}g}") if abs(value) > NO_GAIN else 0.0
        for name, value in inner_loop_gains(trimmed, goals).items()
    }
    designed = config.with_gains(
        InnerLoopGains(made_for=model_hash(config), jsbsim=version("jsbsim"), gains=gains)
    )
    before = config.gains.gains if config.gains else {}
    return DesignedAircraft(config=designed, steps=check_steps(designed), before=before)


def inner_loop_gains(airframe: Airframe, design: DesignTable) -> dict[str, float]:
    """Return the gains by name, SI and rad."""
    # Roll: the error of the roll model obeys ``e'' + 2 zeta omega e' + omega^2 e = 0`` with omega =
    # `roll_error` of the design; the integrator is an order slower than the model. Pitch: a
    # least-squares fit of the linear step response, with actuator, to two equal real poles. Yaw:
    # damping of the dutch roll, and the static effect of the rudder on the lateral load factor.
    # Rolling at the rate p without sideslip needs the yaw rate ``r = g/V phi + alpha p``. The
    # feed-forward of the rudder compensates the yaw moments of p, r and the aileron, and gives ``r'
    # = g/V p``. Without a rudder its gains are 0. Speed: a first-order loop on the slope of thrust.
    d = airframe.of
    rudderless = "rudder" not in airframe.slopes["r_dot"]
    for sign, output, by in SIGNS:
        if rudderless and by == "rudder":
            continue
        if not sign * d(output, by) > 0.0:
            raise PlantError(
                f"the slope of {output} by {by} must be {'positive' if sign > 0 else 'negative'} "
                f"for this inner loop, got {d(output, by):g}."
            )
    damping, effect, thrust = -d("p_dot", "p"), d("p_dot", "aileron"), d("u_dot", "throttle")
    omega = design.roll_error or min(ROLL_STIFFNESS * design.roll, 0.5 * ACTUATOR)
    k_p = omega**2 / effect
    return {
        "V_a-design-mps": airframe.trimmed.V_a,
        "roll/model-rad_sec": design.roll,
        "roll/k_ff": damping / effect,
        "roll/k_p": k_p,
        "roll/k_i": 0.1 * design.roll * k_p,
        "roll/k_d": max(0.0, 2.0 * WELL_DAMPED * omega - damping) / effect,
        **_pitch(airframe, design.n_z),
        **(dict.fromkeys(YAW_GAINS, 0.0) if rudderless else _yaw(airframe, damping / effect)),
        **({} if rudderless else _gyroscopic(airframe, design.n_z)),
        "speed/k_gamma": G_0 / thrust,
        "speed/k_p": design.speed / thrust,
        "speed/k_i": 0.25 * design.speed**2 / thrust,
    }


def _pitch(airframe: Airframe, bandwidth: float) -> dict[str, float]:
    from scipy.optimize import least_squares

    effect, lift = -airframe.of("q_dot", "elevator"), airframe.of("n_z", "alpha")
    model = min(MODEL_LEAD * bandwidth, 20.0)
    t = np.arange(0.0, _SPAN, _STEP)
    goal = 1.0 - (1.0 + bandwidth * t) * np.exp(-bandwidth * t)
    scale = np.array([1.0, bandwidth / lift, bandwidth**2 / lift]) * bandwidth / effect

    def error(log_gains: FloatArray) -> FloatArray:
        k_q, k_p, k_i = scale * np.exp(log_gains)
        response = _n_z_step(airframe, model, k_q, k_p, k_i, len(t))
        return np.append(np.clip(response - goal, -10.0, 10.0), 0.02 * log_gains)

    highest = [math.log(MAX_DAMPER * ACTUATOR / bandwidth), 2.0, 2.0]
    fitted = least_squares(error, np.minimum(0.0, np.array(highest) - 0.1), bounds=(-4.0, highest))
    k_q, k_p, k_i = (scale * np.exp(fitted.x)).tolist()
    return {"pitch/model-rad_sec": model, "pitch/k_p": k_p, "pitch/k_i": k_i, "pitch/k_q": k_q}


def _n_z_step(
    airframe: Airframe, model: float, k_q: float, k_p: float, k_i: float, count: int
) -> FloatArray:
    """Load factor of the linear short period after a step of its command, shape (count,)."""
    from scipy.linalg import expm

    d, g_over_V = airframe.of, G_0 / airframe.trimmed.V_a
    n_alpha, n_e = d("n_z", "alpha"), d("n_z", "elevator")
    m_alpha, m_q, m_e = d("q_dot", "alpha"), d("q_dot", "q"), d("q_dot", "elevator")
    # The command is a constant state, so that one matrix exponential steps the loop exactly. The
    # caller clips an unstable response, because the fit needs numbers.
    alpha, q, elevator, n_model, integral, command = range(6)
    A = np.zeros((6, 6))
    n_z = np.zeros(6)
    n_z[[alpha, elevator]] = n_alpha, n_e
    A[alpha] = -g_over_V * n_z
    A[alpha, q] = 1.0
    A[q, [alpha, q, elevator]] = m_alpha, m_q, m_e
    A[n_model, [n_model, command]] = -model, model
    n_z_error = -n_z
    n_z_error[n_model] += 1.0
    A[integral] = n_z_error
    law = -k_p * n_z_error
    law[q] += k_q
    law[n_model] -= k_q * g_over_V
    law[integral] -= k_i
    A[elevator] = ACTUATOR * law
    A[elevator, elevator] -= ACTUATOR
    step = expm(A * _STEP)
    x = np.zeros(6)
    x[command] = 1.0
    response = np.empty(count)
    for k in range(count):
        response[k] = n_z @ x
        x = step @ x
    return np.nan_to_num(response, nan=10.0, posinf=10.0, neginf=-10.0)


def _gyroscopic(airframe: Airframe, bandwidth: float) -> dict[str, float]:
    """Gains of elevator and rudder that compensate the gyroscopic moments of a propeller."""
    d = airframe.of
    if not -d("q_dot", "r") * d("r_dot", "q") > (STRONG * bandwidth) ** 2:
        # The loops with this `bandwidth` (rad/s) do not reject these moments.
        return {}
    gains = -d("q_dot", "r") / d("q_dot", "elevator"), -d("r_dot", "q") / d("r_dot", "rudder")
    return dict(zip(GYROSCOPIC, gains, strict=True))


def _yaw(airframe: Airframe, roll_k_ff: float) -> dict[str, float]:
    d = airframe.of
    effect, weathercock = -d("r_dot", "rudder"), d("r_dot", "beta")
    side = d("n_y", "beta")
    damping = -d("r_dot", "r") - side * G_0 / airframe.trimmed.V_a
    # The lateral load factor gives weathercock stability to an airframe without it.
    lacking = max(0.0, MIN_WEATHERCOCK - weathercock)
    stiffness = weathercock + lacking
    goal = 2.0 * DUTCH_ROLL_DAMPING * math.sqrt(stiffness)
    static = abs(side * effect / stiffness)
    adverse = d("r_dot", "p") + d("r_dot", "aileron") * roll_k_ff
    k_r = max(0.0, goal - damping) / effect
    straight = adverse - G_0 / airframe.trimmed.V_a + airframe.trimmed.alpha * d("r_dot", "r")
    k_p, k_i = 0.75 * SIDE_FORCE / static, SIDE_FORCE / static
    k_p += lacking / abs(side * effect)
    share = 1.0
    while share > MIN_YAW_SHARE and not _yaw_is_stable(airframe, k_r, share * k_p, share * k_i):
        share *= 0.8
    k_ff = straight / effect - airframe.trimmed.alpha * k_r
    return {"yaw/k_ff": k_ff, "yaw/k_r": k_r, "yaw/k_p": share * k_p, "yaw/k_i": share * k_i}


def _yaw_is_stable(airframe: Airframe, k_r: float, k_p: float, k_i: float) -> bool:
    """Whether sideslip and yaw rate are stable with actuator, accelerometer and a margin."""
    d, g_over_V = airframe.of, G_0 / airframe.trimmed.V_a
    beta, r, rudder, n_y, integral = range(5)
    side, direct = d("n_y", "beta"), d("n_y", "rudder")
    A = np.zeros((5, 5))
    A[beta, [beta, r, rudder]] = g_over_V * side, -1.0, g_over_V * direct
    A[r, [beta, r, rudder]] = d("r_dot", "beta"), d("r_dot", "r"), d("r_dot", "rudder")
    A[rudder, [r, rudder, n_y, integral]] = np.array([k_r, -1.0, k_p, 1.0]) * ACTUATOR
    A[n_y, [beta, rudder, n_y]] = np.array([side, direct, -1.0]) / ACCELEROMETER
    A[integral, n_y] = k_i
    more = A.copy()
    more[rudder, [n_y, integral]] *= YAW_MARGIN
    return bool(np.linalg.eigvals([A, more]).real.max() < 0.0)
