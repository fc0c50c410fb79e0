"""Step responses of roll and load factor, flown on an aircraft, against its design goals.

Their figure also shows a roll into a bank at each airspeed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.arrays import FloatArray
from flighttune.identification.file import Channel
from flighttune.plants.jsbsim.plant import JSBSimPlant
from flighttune.plants.jsbsim.trim import level
from flighttune.present.answer import Column, Table, pick
from flighttune.present.chart import DASHED, Chart, Sheet
from flighttune.present.names import columns
from flighttune.present.palette import HUES, INK
from flighttune.units import DEG

ROLL_STEP = 30.0 * DEG
LOAD_STEP = 0.5

# A step lasts this long, s, or this many times the longest time to 90 %, whichever is longer.
ROLL_TIME, LOAD_TIME = 4.0, 1.6
OVER_T90 = 1.4

DT = 0.005

COLOURS = tuple(strong for (strong, _), _ in HUES)
BANK = 45.0 * DEG
FIGURE = "step_responses.svg"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepResponse:
    """Response to one step of a command from steady level flight, and what it is allowed."""

    channel: Channel  # the commanded channel
    V_a: float  # m/s: airspeed at the start
    size: float  # rad or 1: step of the command
    signals: Mapping[str, FloatArray]  # signals of the plant over time, and ``t`` (s)
    ended: str  # why the flight ended early; empty if it did not
    # s and 1: longest time to 90 % and largest overshoot that ``[design]`` asks for
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
        """Whether the step is as fast and as well damped as asked."""
        fast = self.t90 <= self.t90_allowed
        return fast and self.overshoot <= self.overshoot_allowed and not self.ended

    @property
    def name(self) -> str:
        """Channel, size and airspeed."""
        size = f"{self.size / DEG:+g} deg" if self.channel == "phi" else f"{self.size:+g}"
        return f"{self.channel} {size} at {self.V_a:g} m/s"


def fly_step(
    config: AircraftConfig,
    channel: Channel,
    size: float,
    *,
    V_a: float,
    h: float = 1000.0,
    duration: float = 4.0,
) -> StepResponse:
    """Fly a step of roll (rad) at a held climb angle, or of load factor, from steady flight."""
    plant = JSBSimPlant(config)
    plant.start(level(config, V_a, h))
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


def check_steps(config: AircraftConfig) -> tuple[StepResponse, ...]:
    """Fly the steps of an aircraft's ``[design]`` at its airspeeds; none without such a table."""
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
            duration = max(shortest, OVER_T90 * t90)
            step = fly_step(config, channel, size, V_a=V_a, h=design.h, duration=duration)
            steps.append(replace(step, t90_allowed=t90, overshoot_allowed=overshoot))
    return tuple(steps)


STEP_COLUMNS = [
    *columns("name t90_s t90_allowed_s"),
    Column("overshoot", "overshoot", "%", factor=100.0),
    Column("overshoot_allowed", "allowed", "%", factor=100.0),
    *columns("met"),
]


def steps_table(steps: Sequence[StepResponse]) -> Table:
    """Steps flown against what was asked for."""
    records = [
        {
            **pick(step, "name channel overshoot overshoot_allowed met"),
            "V_a_mps": step.V_a,
            "step": step.size,
            "t90_s": step.t90,
            "t90_allowed_s": step.t90_allowed,
        }
        for step in steps
    ]
    return Table(title="step responses", name="steps", columns=STEP_COLUMNS, records=records)


def step_figure(config: AircraftConfig, steps: Sequence[StepResponse]) -> Sheet:
    """Return the figure of the step responses that `check_steps` flew."""
    roll = Chart(title="Roll, step of 30°", y="φ [deg]")
    load = Chart(title="Load factor, steps of 0.5", y="n_z [1]")
    lateral = Chart(title="Lateral load factor in the roll step", y="n_y [1]")
    bank = Chart(title="Load factor on the way into a level 45° bank", y="n_z [1]")
    height = config.design.h if config.design else 1000.0
    speeds = sorted({step.V_a for step in steps})
    rates = {"phi": config.limits.phi_rate, "n_z": config.limits.n_z_rate}
    for V_a, colour in zip(speeds, COLOURS, strict=False):
        name = f"{V_a:g} m/s"
        for step in (step for step in steps if step.V_a == V_a):
            signals, rate = step.signals, rates[step.channel]
            # The command behind the rate limit of the inner loop, the same at every airspeed.
            ramp = np.sign(step.size) * np.minimum(abs(step.size), rate * signals["t"])
            if step.channel == "phi":
                chart, unit, start, label = roll, DEG, 0.0, f"command, {rate / DEG:g}°/s"
                lateral.line(signals["t"], signals["n_y"], colour, name=name)
            else:
                chart, unit, start, label = load, 1.0, 1.0, f"command, {rate:g} per s"
            named = step.size > 0.0  # the step down has the same colour
            response = signals[step.channel] / unit
            chart.line(signals["t"], response, colour, name=name if named else "")
            if step.V_a == steps[0].V_a:
                command = (start + ramp) / unit
                label = label if named else ""
                chart.line(signals["t"], command, INK, dash=DASHED, width=1.0, name=label)
        banked = fly_step(config, "phi", BANK, V_a=V_a, h=height, duration=6.0).signals
        bank.line(banked["t"], banked["n_z"], colour, name=name)
    bank.level(1.0 / math.cos(BANK), INK, dash=DASHED)
    bank.legend.append(("1/cos 45°", INK, DASHED))
    return Sheet(charts=[roll, load, lateral, bank], title=config.title)
