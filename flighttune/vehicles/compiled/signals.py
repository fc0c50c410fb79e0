# SPDX-License-Identifier: LGPL-2.1-or-later
"""Values that a flight shows after a step: the signals of the plant, and those of its guard."""

from collections.abc import Mapping

from flighttune.base.units import FT, G_0, LBF
from flighttune.vehicles.aircraft.aircraft import SURFACES, AircraftConfig
from flighttune.vehicles.compiled.engine_files import EngineFile
from flighttune.vehicles.compiled.properties import Properties
from flighttune.vehicles.compiled.trace import Number, cos, sin
from flighttune.vehicles.compiled.vectors import Vector
from flighttune.vehicles.plants.base import N_X_SIGNALS
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.jsbsim.properties import GUARDED, SIGNALS

# Height above the ground (m) at the start, and that of the ground.
HEIGHT_0, GROUND = "_height-0", "_ground"


def shown_signals(
    now: Properties, engines: tuple[EngineFile, ...], config: AircraftConfig
) -> Mapping[str, Number]:
    """`SIGNALS`, `GUARDED` and `N_X_SIGNALS` after a step.

    Course and heading are those of JSBSim, within a turn.
    """
    F_x, F_y, F_z = (now[f"forces/fb{axis}-total-lbs"] for axis in "xyz")
    alpha, weight = now["aero/alpha-rad"], now["inertia/mass-slugs"] * (G_0 / FT)
    lift = F_x * sin(alpha) - F_z * cos(alpha)
    h = now["position/h-sl-ft"] * FT
    # The thrust of some models is a force of their own.
    thrust = config.engines.thrust
    pushes = [thrust] if thrust else [f"{engine.at}/thrust-lbs" for engine in engines]
    total: Number = 0.0
    for name in pushes:
        total = total + now[name]
    values = (
        *(now["flight-path/psi-gt-rad"], now["flight-path/gamma-rad"], now["attitude/phi-rad"]),
        *(lift / weight, now["velocities/vt-fps"] * FT),
        *(now["position/from-start-neu-n-ft"] * FT, now["position/from-start-neu-e-ft"] * FT),
        *(now[HEIGHT_0] - h, alpha, now["aero/beta-rad"]),
        *(now["attitude/theta-rad"], now["attitude/psi-rad"]),
        *(now[f"velocities/{axis}-rad_sec"] for axis in "pqr"),
        *(h + now[GROUND], now["velocities/vg-fps"] * FT, F_y / weight),
        *(now[f"ft/{name}-rad"] for name in SURFACES),
        *(now[properties.THROTTLE], total * LBF),
        *(now[f"atmosphere/total-wind-{axis}-fps"] * FT for axis in ("north", "east", "down")),
    )
    guarded = (*(now["velocities/vt-fps"], lift, now["position/h-sl-ft"], now[properties.N_Z]),)
    names = *SIGNALS, *GUARDED, *N_X_SIGNALS
    along = _n_x(now, (F_x, F_y, F_z), weight, config.engines.throttle[0])
    return dict(zip(names, (*values, *guarded, *along), strict=True))


def _n_x(now: Properties, force: Vector, weight: Number, closed: float) -> tuple[Number, ...]:
    """`N_X_SIGNALS` of a body force (lbf)."""
    (F_x, F_y, F_z), alpha, beta = force, now["aero/alpha-rad"], now["aero/beta-rad"]
    along = (F_x * cos(alpha) + F_z * sin(alpha)) * cos(beta) + F_y * sin(beta)
    lever, seen = now[properties.THROTTLE], now[properties.N_X]
    per = 1.0 / now[properties.THROTTLE_PER_N_X]
    ends = closed, now[properties.THROTTLE_MAX]
    return (along / weight, *(seen + per * (end - lever) for end in ends))
