"""Figure of an aircraft's inner loop: step responses at its airspeeds, and a roll into a bank."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.identify.steps import StepCheck, StepResponse, fly_step
from flighttune.present.palette import HUES
from flighttune.units import DEG
from flighttune.whole_file import whole_file

COLOURS = tuple(strong for (strong, _), _ in HUES)
BANK = 45.0 * DEG
FILE_NAME = "step_responses.png"


def step_figure(config: AircraftConfig, checks: Sequence[StepCheck]) -> Figure:
    """Return the figure of the step responses.

    Parameters
    ----------
    config : AircraftConfig
        The aircraft, with a ``[design]`` table.
    checks : sequence of StepCheck
        From `check_steps`.

    Raises
    ------
    TrimError
        If there is no steady level flight at one of the airspeeds.
    """
    drawing = Figure(figsize=(9.0, 5.2), layout="constrained")
    ((roll, load), (lateral, bank)) = drawing.subplots(2, 2)
    steps = [check.step for check in checks]
    speeds = sorted({step.V_a for step in steps})
    for V_a, colour in zip(speeds, COLOURS, strict=False):
        style = {"color": colour, "lw": 1.4}
        for step in (s for s in steps if s.V_a == V_a):
            signals = step.signals
            if step.channel == "phi":
                roll.plot(signals["t"], signals["phi"] / DEG, label=f"{V_a:g} m/s", **style)
                lateral.plot(signals["t"], signals["n_y"], **style)
            else:
                label = f"{V_a:g} m/s" if step.size > 0.0 else None
                load.plot(signals["t"], signals["n_z"], label=label, **style)
        banked = fly_step(config, "phi", BANK, V_a=V_a, h=_height(config), duration=6.0).signals
        bank.plot(banked["t"], banked["n_z"], label=f"{V_a:g} m/s", **style)
    _draw_commands(roll, load, steps, config)
    bank.axhline(1.0 / math.cos(BANK), color="k", ls="--", lw=0.8, label="1/cos 45 deg")
    _dress(roll, "Roll, step of 30 deg", "phi in deg")
    _dress(load, "Load factor, steps of 0.5", "n_z")
    _dress(lateral, "Lateral load factor in the roll step", "n_y")
    _dress(bank, "Load factor on the way into a level 45 deg bank", "n_z")
    for axes, where in ((roll, "lower right"), (load, "center right"), (bank, "lower right")):
        axes.legend(fontsize=8, frameon=False, loc=where)
    return drawing


def draw_steps(config: AircraftConfig, checks: Sequence[StepCheck], folder: Path) -> Path:
    """Write the figure into `folder`, whole or not at all, and return the file.

    Raises
    ------
    OutputError
        If the file cannot be written.
    TrimError
        If there is no steady level flight at one of the airspeeds.
    """
    file = folder / FILE_NAME
    drawing = step_figure(config, checks)
    with whole_file(file) as part:
        drawing.savefig(part, format="png", dpi=80)
    return file


def _height(config: AircraftConfig) -> float:
    return config.design.h if config.design else 1000.0


def _draw_commands(
    roll: Axes, load: Axes, steps: Sequence[StepResponse], config: AircraftConfig
) -> None:
    """Draw the commands behind the rate limits of the inner loop."""
    rates = {"phi": config.limits.phi_rate, "n_z": config.limits.n_z_rate}
    first = steps[0].V_a if steps else 0.0
    for step in (s for s in steps if s.V_a == first):
        t, rate = step.signals["t"], rates[step.channel]
        ramp = np.sign(step.size) * np.minimum(abs(step.size), rate * t)
        if step.channel == "phi":
            label = f"command, {rate / DEG:g} deg/s"
            roll.plot(t, ramp / DEG, "k--", lw=0.8, label=label)
        else:
            label = f"command, {rate:g} per s" if step.size > 0.0 else None
            load.plot(t, 1.0 + ramp, "k--", lw=0.8, label=label)


def _dress(axes: Axes, title: str, unit: str) -> None:
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_ylabel(unit)
    axes.set_xlabel("t in s")
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
