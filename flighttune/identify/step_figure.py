"""Figure of an aircraft's inner loop: step responses at its airspeeds, and a roll into a bank."""

import math
from collections.abc import Sequence

import numpy as np

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.identify.steps import StepCheck, StepResponse, fly_step
from flighttune.present.chart import DASHED, Chart, Sheet
from flighttune.present.palette import HUES, INK
from flighttune.units import DEG

COLOURS = tuple(strong for (strong, _), _ in HUES)
BANK = 45.0 * DEG
FILE_NAME = "step_responses.svg"


def step_figure(config: AircraftConfig, checks: Sequence[StepCheck]) -> Sheet:
    """Return the figure of the step responses that `check_steps` flew."""
    roll = Chart(title="Roll, step of 30°", y="φ [deg]")
    load = Chart(title="Load factor, steps of 0.5", y="n_z [1]")
    lateral = Chart(title="Lateral load factor in the roll step", y="n_y [1]")
    bank = Chart(title="Load factor on the way into a level 45° bank", y="n_z [1]")
    steps = [check.step for check in checks]
    speeds = sorted({step.V_a for step in steps})
    for V_a, colour in zip(speeds, COLOURS, strict=False):
        name = f"{V_a:g} m/s"
        for step in (s for s in steps if s.V_a == V_a):
            signals = step.signals
            if step.channel == "phi":
                roll.line(signals["t"], signals["phi"] / DEG, colour, name=name)
                lateral.line(signals["t"], signals["n_y"], colour, name=name)
            else:
                upwards = name if step.size > 0.0 else ""
                load.line(signals["t"], signals["n_z"], colour, name=upwards)
        banked = fly_step(config, "phi", BANK, V_a=V_a, h=_height(config), duration=6.0).signals
        bank.line(banked["t"], banked["n_z"], colour, name=name)
    _draw_commands(roll, load, steps, config)
    bank.level(1.0 / math.cos(BANK), INK, dash=DASHED)
    bank.legend.append(("1/cos 45°", INK, DASHED))
    return Sheet(charts=[roll, load, lateral, bank], title=config.title)


def _height(config: AircraftConfig) -> float:
    return config.design.h if config.design else 1000.0


def _draw_commands(
    roll: Chart, load: Chart, steps: Sequence[StepResponse], config: AircraftConfig
) -> None:
    """Draw the commands behind the rate limits of the inner loop."""
    rates = {"phi": config.limits.phi_rate, "n_z": config.limits.n_z_rate}
    first = steps[0].V_a if steps else 0.0
    for step in (s for s in steps if s.V_a == first):
        t, rate = step.signals["t"], rates[step.channel]
        ramp = np.sign(step.size) * np.minimum(abs(step.size), rate * t)
        if step.channel == "phi":
            name = f"command, {rate / DEG:g}°/s"
            roll.line(t, ramp / DEG, INK, dash=DASHED, width=1.0, name=name)
        else:
            name = f"command, {rate:g} per s" if step.size > 0.0 else ""
            load.line(t, 1.0 + ramp, INK, dash=DASHED, width=1.0, name=name)
