"""Draw the step responses of a shipped aircraft into its folder: python docs/step_responses.py."""

import math
import sys

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flighttune.arrays import FloatArray
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.plant import JSBSimPlant
from flighttune.shipped import aircraft_folder
from flighttune.units import DEG

DT = 0.005
SPEEDS = (20.0, 25.0, 30.0)
COLOURS = ("#1b9e77", "#264653", "#d95f02")


def step(name: str, V_a: float, phi_cmd: float, n_z_step: float, seconds: float) -> FloatArray:
    """Return time, roll (deg), load factor and lateral load factor of a step from level flight."""
    plant = JSBSimPlant(name)
    plant.start(FlightCondition(V_a=V_a))
    column = {signal: index for index, signal in enumerate(plant.signals)}
    rows = []
    for k in range(round(seconds / DT)):
        now = plant.observe()
        gamma, phi = now[column["gamma"]], now[column["phi"]]
        rows.append((k * DT, phi / DEG, now[column["n_z"]], now[column["n_y"]]))
        steady = math.cos(gamma) / math.cos(phi) if phi_cmd else 1.0
        stop = plant.advance(phi_cmd, steady + n_z_step, DT)
        if stop is not None:
            raise SystemExit(f"{name} at {V_a:g} m/s: {stop.reason}")
    return np.array(rows).T


def dress(axes: Axes, title: str, unit: str) -> None:
    """Give `axes` its title, unit, grid and time axis."""
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_ylabel(unit)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("t in s")


def figure(name: str) -> Figure:
    """Return the figure: roll and load-factor steps at three airspeeds, and the limits on them."""
    drawing = Figure(figsize=(9.0, 5.2), layout="constrained")
    ((roll, load), (lateral, bank)) = drawing.subplots(2, 2)
    for V_a, colour in zip(SPEEDS, COLOURS, strict=True):
        style = {"color": colour, "lw": 1.4, "label": f"{V_a:g} m/s"}
        t, phi, n_z, n_y = step(name, V_a, 30.0 * DEG, 0.0, 3.0)
        roll.plot(t, phi, **style)
        lateral.plot(t, n_y, **style)
        t, _, n_z, _ = step(name, V_a, 45.0 * DEG, 0.0, 6.0)
        bank.plot(t, n_z, **style)
        for sign in (0.5, -0.5):
            t, _, n_z, _ = step(name, V_a, 0.0, sign, 1.6)
            load.plot(t, n_z, **style | {"label": style["label"] if sign > 0.0 else None})
    ramp = np.array([0.0, 1.0, 3.0])
    roll.plot(ramp, 30.0 * np.clip(ramp, 0.0, 1.0), "k--", lw=0.8, label="command, 30 deg/s")
    for sign in (0.5, -0.5):
        load.plot([0.0, 0.5, 1.6], [1.0, 1.0 + sign, 1.0 + sign], "k--", lw=0.8)
    load.plot([], [], "k--", lw=0.8, label="command, 1 per s")
    bank.axhline(math.sqrt(2.0), color="k", ls="--", lw=0.8, label="1/cos 45 deg")
    dress(roll, "Roll, step of 30 deg", "phi in deg")
    dress(load, "Load factor, steps of 0.5", "n_z")
    dress(lateral, "Lateral load factor in the roll step", "n_y")
    dress(bank, "Load factor on the way into a level 45 deg bank", "n_z")
    for axes in (roll, load, bank):
        axes.legend(
            fontsize=8, frameon=False, loc="lower right" if axes is not load else "center right"
        )
    return drawing


if __name__ == "__main__":
    mpl.use("Agg")
    aircraft = sys.argv[1] if len(sys.argv) > 1 else "aerosonde"
    figure(aircraft).savefig(aircraft_folder(aircraft) / "step_responses.png", dpi=80)
