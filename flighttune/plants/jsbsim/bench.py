"""The test bench: puts an aircraft into any state of flight and reads its accelerations."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from flighttune.arrays import FloatArray
from flighttune.plants.jsbsim import properties
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.units import FT, G_0

# Most evaluations of one state, in which the flight control of the model settles: its filters move
# a part of their way in each. Of one that never comes to rest there are few.
MAX_EVALUATIONS, FEW_EVALUATIONS = 200, 8

# Change of an angular acceleration from one evaluation to the next that is at rest, rad/s^2.
AT_REST = 1e-12

MEASURED = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot", "n_y", "n_z")

CONTROLS = ("aileron", "elevator", "rudder", "throttle")

# Throttle at which an electric propeller starts to turn.
SPIN_UP = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class AirframeState:
    """Motion and controls of an aircraft in still air."""

    V_a: float  # m/s: airspeed
    # `alpha` and `beta` (rad): angle of attack, sideslip
    alpha: float = 0.0
    beta: float = 0.0
    # `phi`, `theta` and `psi` (rad): roll, pitch attitude, heading
    phi: float = 0.0
    theta: float = 0.0
    psi: float = 0.0
    # `p`, `q` and `r` (rad/s): body rates
    p: float = 0.0
    q: float = 0.0
    r: float = 0.0
    # `aileron`, `elevator` and `rudder` (rad): surface positions: rolls right, trailing edge down,
    # trailing edge left.
    aileron: float = 0.0
    elevator: float = 0.0
    rudder: float = 0.0
    throttle: float = 0.0  # throttle position

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Velocity through the air along the body axes, m/s: ahead, right, down."""
        level, right = self.V_a * math.cos(self.beta), self.V_a * math.sin(self.beta)
        return level * math.cos(self.alpha), right, level * math.sin(self.alpha)


class Bench:
    """An aircraft at one height, its inner loop disengaged, actuators and engine settled.

    `fdm`: the aircraft; it is left in the state measured last. `h` (m): height above sea level.
    """

    def __init__(self, fdm: Fdm, h: float) -> None:
        self.fdm = fdm
        self._evaluations = MAX_EVALUATIONS if fdm.own_flight_control else 1
        fdm.writer(properties.ENGAGED)(0.0)
        fdm.writer("ic/h-sl-ft")((h - fdm.ground) / FT)
        # The velocity comes first: JSBSim keeps what was set last when attitudes follow.
        self._state = [
            *(fdm.writer(f"ic/{axis}-fps") for axis in "uvw"),
            *(fdm.writer(f"ic/{name}-rad") for name in ("phi", "theta", "psi-true")),
            *(fdm.writer(f"ic/{axis}-rad_sec") for axis in "pqr"),
            *(fdm.writer(name) for name in properties.TRIMS),
        ]
        self._linear = [fdm.reader(f"accelerations/{axis}dot-ft_sec2") for axis in "uvw"]
        self._angular = [fdm.reader(f"accelerations/{axis}dot-rad_sec2") for axis in "pqr"]
        self._forces = [fdm.reader(f"forces/fb{axis}-total-lbs") for axis in "xyz"]
        self._weight_lbf = fdm.reader("inertia/mass-slugs")() * G_0 / FT
        # NaN equals nothing: the first state always settles the engine.
        self._settled_for = (math.nan, math.nan)

    def accelerations(self, state: AirframeState) -> dict[str, float]:
        """Put the aircraft into `state` and measure.

        Returns ``u_dot``, ``v_dot``, ``w_dot`` (m/s^2), ``p_dot``, ``q_dot``, ``r_dot`` (rad/s^2),
        ``n_y`` and ``n_z`` (1): load factors along the right wing and the lift axis.
        """
        first = math.isnan(self._settled_for[0])
        if first and self.fdm.electric and self.fdm.engine_settles and state.throttle != SPIN_UP:
            # From rest, full throttle makes the speed of a light propeller diverge, and a closed
            # one leaves it at rest.
            self.accelerations(replace(state, throttle=SPIN_UP))
        u, v, w = (component / FT for component in state.velocity)
        # JSBSim takes headings from 0 to 2 pi only.
        motion = state.phi, state.theta, state.psi % math.tau, state.p, state.q, state.r
        controls = state.aileron, state.elevator, state.rudder, state.throttle
        for write, value in zip(self._state, (u, v, w, *motion, *controls), strict=True):
            write(value)
        self.fdm.evaluate()
        # Settling takes seconds of engine time and depends on airspeed and throttle alone.
        if (state.V_a, state.throttle) != self._settled_for:
            self._settled_for = state.V_a, state.throttle
            self.fdm.settle_engine()
            self.fdm.evaluate()
        self._settle_flight_control()
        F_x, F_y, F_z = (read() for read in self._forces)
        linear = [read() * FT for read in self._linear]
        angular = [read() for read in self._angular]
        lift = F_x * math.sin(state.alpha) - F_z * math.cos(state.alpha)
        load_factors = F_y / self._weight_lbf, lift / self._weight_lbf
        return dict(zip(MEASURED, (*linear, *angular, *load_factors), strict=True))

    def _settle_flight_control(self) -> None:
        """Evaluate again until nothing changes: a flight control sees the evaluation before."""
        before = None
        for _ in range(self._evaluations - 1):
            now = [read() for read in self._angular]
            if before and all(abs(a - b) <= AT_REST for a, b in zip(now, before, strict=True)):
                return
            before = now
            self.fdm.evaluate()
        self._evaluations = min(self._evaluations, FEW_EVALUATIONS)


def slopes(
    measure: Callable[[AirframeState], FloatArray],
    trimmed: AirframeState,
    half_widths: Mapping[str, float],
) -> dict[str, FloatArray]:
    """Central differences of `measure` about `trimmed` by each attribute of `half_widths`, in turn.

    Airspeed and throttle, which the engine follows, must come last: all other slopes are then taken
    with the engine settled at `trimmed`.
    """
    derivatives = {}
    for name, half in half_widths.items():
        above, below = (
            measure(replace(trimmed, **{name: getattr(trimmed, name) + by})) for by in (half, -half)
        )
        derivatives[name] = (above - below) / (2.0 * half)
    return derivatives
