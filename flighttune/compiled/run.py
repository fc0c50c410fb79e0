# SPDX-License-Identifier: LGPL-2.1-or-later
"""One step of a flight: its parts in the order of FGFDMExec::Run."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element

from flighttune.compiled.aerodynamics import aerodynamics
from flighttune.compiled.air_data import air_data, body_arm
from flighttune.compiled.atmosphere import atmosphere
from flighttune.compiled.components import run_channels
from flighttune.compiled.engine_files import EngineFile
from flighttune.compiled.engines import propulsion
from flighttune.compiled.properties import POSITION, Properties, named
from flighttune.compiled.rigid_body import (
    INERTIA,
    INVERSE_INERTIA,
    Planet,
    accelerate,
    gravity,
    hold,
    integrate,
    propagate,
)
from flighttune.compiled.turbulence import total_wind
from flighttune.compiled.vectors import Matrix, Vector, add


@dataclass(frozen=True, eq=False)  # a key of caches
class Model:
    """An aircraft as one step flies it."""

    root: Element  # the main file with all its parts in it
    engines: tuple[EngineFile, ...]
    planet: Planet
    dt: float
    turbulence: Literal["", "milspec", "tustin"] = ""
    gust: bool = False


def run(now: Properties, model: Model) -> None:
    """One step."""
    _run(now, model, integrate)


def run_still(now: Properties, model: Model) -> None:
    """One step in which the motion is held."""
    _run(now, model, hold)


def _run(now: Properties, model: Model, move: Callable[[Properties], None]) -> None:
    now["simulation/sim-time-sec"] = now["simulation/sim-time-sec"] + now.elapsed
    move(now)
    evaluate(now, model)


def evaluate(now: Properties, model: Model) -> None:
    """All models in the state of motion that there is; no time passes for the motion."""
    propagate(now, model.planet)
    now.gravity = gravity(now.vector(POSITION), now["_radius"], model.planet)
    atmosphere(now)
    total_wind(now, model.turbulence, gust=model.gust)
    _levers(now, model)
    run_channels(now, model.root)
    now.cg = now.vector(named("inertia/cg-{}-in"))
    now.reference_point = body_arm(now.vector(named("metrics/aero-rp-{}-in")), now.cg)
    air_data(now)
    propulsion(now, model.engines)
    _show(now, "prop")
    aerodynamics(now, model.root)
    _show(now, "aero")
    now.forces["total"] = add(now.forces["aero"], now.forces["prop"])
    now.moments["total"] = add(now.moments["aero"], now.moments["prop"])
    _show(now, "total")
    accelerate(now, _matrix(now.vector(INERTIA)), _matrix(now.vector(INVERSE_INERTIA)))


def _levers(now: Properties, model: Model) -> None:
    """Commands of engines are positions unless a channel writes those."""
    for engine in model.engines:
        for lever in ("throttle", "mixture", "advance", "feather"):
            position = engine.numbered(f"fcs/{lever}-pos-norm")
            now[position] = now[engine.numbered(f"fcs/{lever}-cmd-norm")]


def _show(now: Properties, kind: str) -> None:
    now.put(named(f"forces/fb{{}}-{kind}-lbs"), now.forces[kind])
    now.put(named(f"moments/{{}}-{kind}-lbsft", "lmn"), now.moments[kind])


def _matrix(entries: Vector) -> Matrix:
    return [entries[0:3], entries[3:6], entries[6:9]]
