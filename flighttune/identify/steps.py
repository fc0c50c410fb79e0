"""Step responses of roll and load factor, flown on an aircraft, against its design goals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.arrays import FloatArray
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.plant import JSBSimPlant
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table
from flighttune.units import DEG

Channel: TypeAlias = Literal["phi", "n_z"]

ROLL_STEP = 30.0 * DEG
LOAD_STEP = 0.5

# A step lasts this long, s, or this many times the longest time to 90 %, whichever is longer.
ROLL_TIME, LOAD_TIME = 4.0, 1.6
OVER_T90 = 1.4

DT = 0.005


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepResponse:
    """Response to one step of a command from steady level flight."""

    channel: Channel  # the commanded channel
    V_a: float  # m/s: airspeed at the start
    size: float  # rad or 1: step of the command
    signals: Mapping[str, FloatArray]  # signals of the plant over time, and ``t`` (s)
    ended: str  # why the flight ended early; empty if it did not

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


def fly_step(
    config: AircraftConfig,
    channel: Channel,
    size: float,
    *,
    V_a: float,
    h: float = 1000.0,
    duration: float = 4.0,
) -> StepResponse:
    """Fly a step of roll, at a load factor that holds the climb angle, or one of load factor.

    `size` is in rad or 1; the flight begins in steady level flight.
    """
    plant = JSBSimPlant(config)
    plant.start(FlightCondition(V_a=V_a, h=h))
    rows, stop = [plant.observe()], None
    gamma, phi = plant.signals.index("gamma"), plant.signals.index("phi")
    phi_cmd, n_z_step = (size, 0.0) if channel == "phi" else (0.0, size)
    for _ in range(round(duration / DT)):
        now = rows[-1]
        steady = math.cos(now[gamma]) / math.cos(now[phi]) if phi_cmd else 1.0
        stop = plant.advance(phi_cmd, steady + n_z_step, DT)
        rows.append(plant.observe())
        if stop is not None:
            break
    signals = dict(zip(plant.signals, np.array(rows).T, strict=True))
    signals["t"] = DT * np.arange(len(rows))
    return StepResponse(
        channel=channel, V_a=V_a, size=size, signals=signals, ended=stop.reason if stop else ""
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class StepCheck:
    """A step response against what the aircraft's ``[design]`` asks for."""

    step: StepResponse
    # s and 1
    t90_allowed: float
    overshoot_allowed: float

    @property
    def met(self) -> bool:
        """Whether the step is as fast and as well damped as asked."""
        step = self.step
        fast = step.t90 <= self.t90_allowed
        return fast and step.overshoot <= self.overshoot_allowed and not step.ended

    @property
    def name(self) -> str:
        """Channel, size and airspeed."""
        step = self.step
        size = f"{step.size / DEG:+g} deg" if step.channel == "phi" else f"{step.size:+g}"
        return f"{step.channel} {size} at {step.V_a:g} m/s"


def check_steps(config: AircraftConfig) -> tuple[StepCheck, ...]:
    """Fly the steps of an aircraft's ``[design]`` at its airspeeds; none without such a table."""
    design = config.design
    if design is None:
        return ()
    roll_time = max(ROLL_TIME, OVER_T90 * design.roll_t90)
    load_time = max(LOAD_TIME, OVER_T90 * design.n_z_t90)
    goals: tuple[tuple[Channel, float, float, float, float], ...] = (
        ("phi", ROLL_STEP, design.roll_t90, design.roll_overshoot, roll_time),
        ("n_z", LOAD_STEP, design.n_z_t90, design.n_z_overshoot, load_time),
        ("n_z", -LOAD_STEP, design.n_z_t90, design.n_z_overshoot, load_time),
    )
    return tuple(
        StepCheck(
            step=fly_step(config, channel, size, V_a=V_a, h=design.h, duration=duration),
            t90_allowed=t90,
            overshoot_allowed=overshoot,
        )
        for V_a in design.V_a_shown
        for channel, size, t90, overshoot, duration in goals
    )


STEP_COLUMNS = [
    *columns("name t90_s t90_allowed_s"),
    Column("overshoot", "overshoot", "%", factor=100.0),
    Column("overshoot_allowed", "allowed", "%", factor=100.0),
    *columns("met"),
]


def steps_table(checks: Sequence[StepCheck]) -> Table:
    """Steps flown against what was asked for."""
    records = [
        {
            "name": check.name,
            "channel": check.step.channel,
            "V_a_mps": check.step.V_a,
            "step": check.step.size,
            "t90_s": check.step.t90,
            "t90_allowed_s": check.t90_allowed,
            "overshoot": check.step.overshoot,
            "overshoot_allowed": check.overshoot_allowed,
            "met": check.met,
        }
        for check in checks
    ]
    return Table(title="step responses", name="steps", columns=STEP_COLUMNS, records=records)
