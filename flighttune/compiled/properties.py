# SPDX-License-Identifier: LGPL-2.1-or-later
"""Properties in one step: a property that is read before it is written is state or parameter."""

import math
from collections.abc import Mapping, Sequence

from flighttune.compiled.trace import Graph, Number, Truth, Value, fabs, select
from flighttune.compiled.vectors import Matrix, Vector

RADIANS, DEGREES = math.pi / 180.0, 180.0 / math.pi

# Surfaces whose position JSBSim shows in radians, in degrees and as a size, whichever is written.
_SURFACES = (
    *("elevator-pos", "left-aileron-pos", "right-aileron-pos", "rudder-pos"),
    *("flap-pos", "speedbrake-pos", "spoiler-pos"),
)


class Unsupported(Exception):
    """A part of a model that the compiled step does not support: JSBSim flies."""


def named(pattern: str, axes: Sequence[str] = "xyz") -> list[str]:
    """Names of the components of a vector."""
    return [pattern.format(axis) for axis in axes]


ANGULAR_RATES = named("velocities/{}-rad_sec", "pqr")
INERTIAL_RATES = named("velocities/{}i-rad_sec", "pqr")
VELOCITY = named("velocities/{}-fps", "uvw")
POSITION, INERTIAL_VELOCITY = named("position/eci-{}-ft"), named("velocities/eci-{}-fps")
LOCAL_VELOCITY = [f"velocities/v-{axis}-fps" for axis in ("north", "east", "down")]
AIR_VELOCITY = named("velocities/{}-aero-fps", "uvw")
AIR_RATES = named("velocities/{}-aero-rad_sec", "pqr")


def canonical(name: str) -> str:
    """A name as JSBSim knows it: the first of several has no number, or 0."""
    return name.strip().replace("[0]", "")


class Properties:
    """Values by name, and the frames and forces that parts of the step hand on to each other.

    Names that begin with ``_`` are numbers that JSBSim does not show.
    """

    def __init__(self, graph: Graph, dt: float) -> None:
        self.graph = graph
        self.dt = dt  # length of a step of the flight, s
        # Time that passes for motion and engines, s: components count steps of the flight.
        self.elapsed: Number = dt
        # Whether JSBSim evaluates a state for a trim: actuators and delays settle at once.
        self.trimming = False
        # Whether starters may turn engines.
        self.starting = False
        self.now: dict[str, Number] = {}
        self.inputs: dict[str, Value] = {}
        # Rotations: local to body, body to local, Earth to body, wind to body, body to wind
        self.local_to_body: Matrix = ()
        self.body_to_local: Matrix = ()
        self.earth_to_body: Matrix = ()
        self.wind_to_body: Matrix = ()
        self.body_to_wind: Matrix = ()
        self.sin_theta: Number = 0.0
        self.gravity: Vector = ()
        self.turbulent_rates: Vector = (0.0, 0.0, 0.0)
        self.viscosity: Number = 0.0
        self.engine = "#"  # number of the engine whose functions are evaluated
        self.cg: Vector = ()
        # From the centre of gravity to the aerodynamic reference point, ft in body axes.
        self.reference_point: Vector = ()
        # By kind, aero or prop, and their sums
        self.forces: dict[str, Vector] = {}
        self.moments: dict[str, Vector] = {}

    def __getitem__(self, name: str) -> Number:
        name = canonical(name)
        return self.now[name] if name in self.now else self._input(name)

    def _input(self, name: str) -> Value:
        if name not in self.inputs:
            self.inputs[name] = self.graph.node("input", name)
        return self.inputs[name]

    def __setitem__(self, name: str, x: Number) -> None:
        name = canonical(name)
        self.now[name] = x
        base, _, unit = name.rpartition("-")
        if base.removeprefix("fcs/") in _SURFACES and unit in ("rad", "deg"):
            radians = x if unit == "rad" else x * RADIANS
            self.now[f"{base}-rad"] = radians
            self.now[f"{base}-deg"] = x if unit == "deg" else x * DEGREES
            self.now[f"fcs/mag-{base.removeprefix('fcs/')}-rad"] = fabs(radians)

    def keep_unless(self, condition: Truth, before: Mapping[str, Number]) -> None:
        """Undo, where a condition does not hold, all that was written since `before`."""
        for name, new in list(self.now.items()):
            old = before[name] if name in before else self._input(name)
            if new is not old:
                self.now[name] = select(condition, new, old)

    def vector(self, names: Sequence[str]) -> Vector:
        """Values of several names."""
        return [self[name] for name in names]

    def put(self, names: Sequence[str], values: Vector) -> None:
        """Write several values."""
        for name, value in zip(names, values, strict=True):
            self[name] = value
