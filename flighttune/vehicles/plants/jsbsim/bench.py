"""The test bench: an aircraft in any state of flight, with its accelerations read.

`check_moves` uses it before the first flight: engines must push, surfaces move what they should.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import PlantError
from flighttune.base.units import DEG, FT, G_0
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.model_files import Unchanged

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
    """An aircraft at the height `h` (m), inner loop disengaged, actuators and engine settled."""

    def __init__(self, fdm: Fdm, h: float) -> None:
        self.fdm = fdm
        self._evaluations = MAX_EVALUATIONS if fdm.own_flight_control else 1
        fdm.writer(properties.ENGAGED)(0.0)
        fdm.writer("ic/h-sl-ft")((h - fdm.ground) / FT)
        angles = [f"ic/{name}-rad" for name in ("phi", "theta", "psi-true")]
        self._angles = list(map(fdm.reader, angles))
        # The velocity comes first: JSBSim keeps what was set last when attitudes follow.
        self._state = [
            *(fdm.writer(f"ic/{axis}-fps") for axis in "uvw"),
            *map(fdm.writer, angles),
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
        """Accelerations (m/s^2, rad/s^2), and load factors to the right and along lift."""
        first = math.isnan(self._settled_for[0])
        if first and self.fdm.electric and self.fdm.engine_settles and state.throttle != SPIN_UP:
            # From rest, full throttle makes the speed of a light propeller diverge, and a closed
            # one leaves it at rest.
            self.accelerations(replace(state, throttle=SPIN_UP))
        u, v, w = (component / FT for component in state.velocity)
        # JSBSim takes headings from 0 to 2 pi only.
        motion = state.phi, state.theta, state.psi % math.tau, state.p, state.q, state.r
        phi, theta, psi = self._angles
        self.fdm.attitude = (phi(), theta(), psi()), motion[:3]
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
    """Central differences of `measure` about `trimmed` by each attribute of `half_widths`."""
    # Airspeed and throttle, which the engine follows, must come last: all other slopes are then
    # taken with the engine settled at `trimmed`.
    derivatives = {}
    for name, half in half_widths.items():
        above, below = (
            measure(replace(trimmed, **{name: getattr(trimmed, name) + by})) for by in (half, -half)
        )
        derivatives[name] = (above - below) / (2.0 * half)
    return derivatives


# Acceleration that a surface is for, and the sign of it by a positive position.
EFFECTS = {"aileron": ("p_dot", 1.0), "elevator": ("q_dot", -1.0), "rudder": ("r_dot", -1.0)}

# Properties in which a model may show the position of a surface.
POSITIONS = {
    "aileron": ("fcs/left-aileron-pos-rad", "fcs/right-aileron-pos-rad", "fcs/aileron-pos-rad"),
    "elevator": ("fcs/elevator-pos-rad",),
    "rudder": ("fcs/rudder-pos-rad",),
}

# Share by which the travel of a model may differ from its file.
TRAVEL_TOLERANCE = 0.02

# Share of the effect of half the travel that the other half must have at least.
MIN_SECOND_HALF = 0.1

# Position (rad) and acceleration (rad/s^2) that count as none.
NEGLIGIBLE = 1e-6

# Flight in which an aircraft is checked: angle of attack, height and throttle.
ALPHA, HEIGHT, FULL = 3.0 * DEG, 1000.0, 0.95


def check_moves(config: AircraftConfig) -> None:
    """Refuse an aircraft whose engines or surfaces do not do what its file says."""
    # A check is remembered in this process while the files stay the same. Gains must have been made
    # for the files as they are.
    nominal = config.with_off_nominal(None)
    if fault := _fault(Unchanged(nominal, config.gains.made_for if config.gains else None)):
        raise PlantError(f"{config.file}: {fault}.")


@lru_cache(maxsize=256)
def _fault(checked: Unchanged) -> str:
    config = checked.config
    fdm = Fdm(config)
    low, high = config.envelope.V_a
    V_a = config.design.V_a if config.design else 0.5 * (low + high)
    bench = Bench(fdm, config.design.h if config.design else HEIGHT)
    throttle = FULL * config.engines.throttle[1]
    level = AirframeState(V_a=V_a, alpha=ALPHA, theta=ALPHA, throttle=throttle)
    return next(chain(_engine_faults(fdm, bench, level), surface_faults(bench, level)), "")


def _engine_faults(fdm: Fdm, bench: Bench, level: AirframeState) -> Iterator[str]:
    count = fdm.config.engines.count
    # Without any it glides, whatever the model has.
    if count and fdm.has(f"propulsion/engine[{count}]/set-running"):
        yield f"[engines] `count` must be that of the model, which has more, got {count}"
    bench.accelerations(level)
    for i, thrust in enumerate(fdm.thrusts):
        if not thrust() > 0.0:
            runs = fdm.reader(f"propulsion/engine[{i}]/set-running")()
            how = "runs and does not" if runs else "does not start"
            yield f"[engines] engine {i + 1} of {count} must push at full throttle, it {how}"


def surface_faults(bench: Bench, level: AirframeState) -> Iterator[str]:
    """Sentences about surfaces that do not do what the file of the aircraft says."""
    fdm = bench.fdm
    for name, surface in fdm.config.surfaces.named():
        rate, sign = EFFECTS[name]
        readers = [fdm.reader(position) for position in POSITIONS[name] if fdm.has(position)]
        neutral = bench.accelerations(level)[rate]
        before = [read() for read in readers]
        for stop in surface.travel:
            halfway = bench.accelerations(replace(level, **{name: 0.5 * stop}))[rate] - neutral
            whole = bench.accelerations(replace(level, **{name: stop}))[rate] - neutral
            moved = max(
                (abs(read() - was) for read, was in zip(readers, before, strict=True)), default=0
            )
            if not math.isfinite(whole):
                return  # forces that are not finite are reported by the trim
            key, at = f"[surfaces] `{name}`", stop / DEG
            if not sign * stop * whole > NEGLIGIBLE * abs(stop):
                yield (
                    f"{key} must {'raise' if sign * stop > 0.0 else 'lower'} {rate} at "
                    f"{at:.3g} deg, got {whole:.2g} rad/s2"
                )
            # A model that limits its surface below `travel_deg` shows no more effect from there on.
            if abs(whole) < (1.0 + MIN_SECOND_HALF) * abs(halfway):
                yield f"{key} must have an effect up to {at:.3g} deg, it is saturated at half"
            # Where the position is replaced, the model's own property does not follow it.
            if (
                not surface.replaces
                and moved > NEGLIGIBLE
                and abs(moved / abs(stop) - 1.0) > TRAVEL_TOLERANCE
            ):
                yield (
                    f"{key} must move to {abs(at):.3g} deg as `travel_deg` says, the model "
                    f"moves it by {moved / DEG:.3g} deg"
                )
