"""An aircraft as the compiler of JSBSim's step takes it: its files, and what its flights show."""

from collections.abc import Mapping, Sequence
from functools import cache, partial
from hashlib import sha256
from pathlib import Path

from flighttune import vehicles
from flighttune.base.units import FT, G_0, LBF
from flighttune.compiled.engine_files import EngineFile
from flighttune.compiled.model import Source
from flighttune.compiled.properties import Properties
from flighttune.compiled.trace import Number, cos, sin
from flighttune.compiled.vectors import Vector
from flighttune.vehicles.aircraft.aircraft import SURFACES, AircraftConfig
from flighttune.vehicles.aircraft.model_xml import numbers_in
from flighttune.vehicles.plants.base import N_X_SIGNALS
from flighttune.vehicles.plants.jsbsim import model_files, properties
from flighttune.vehicles.plants.jsbsim.fdm import weigh
from flighttune.vehicles.plants.jsbsim.properties import GUARDED, SIGNALS

# Height above the ground (m) at the start, and that of the ground.
HEIGHT_0, GROUND = "_height-0", "_ground"


def source_of(config: AircraftConfig, steps: int, files: model_files.Unchanged) -> Source:
    """An aircraft with so many integration `steps` in a sample of the inner loop.

    `files` are those that JSBSim has loaded, or shall load.
    """
    template, values = model_files.template_and_values(files, weigh, steps)
    folders, engines = model_files.folders_of(files), config.engines
    # The fingerprint is that of the model: rate, lowest throttle and thrust are not in it.
    stated = config.inner_loop_rate, steps, engines.throttle[0], engines.thrust
    return Source(
        template=template,
        numbers=numbers_in(template, values),
        file=folders.file,
        folders=folders.parts,
        dt=1.0 / (config.inner_loop_rate * steps),
        signals=partial(shown_signals, config=config),
        stated=(config.fingerprint, *map(repr, stated), _own_digest()),
        key=files.key,
    )


@cache
def _own_digest() -> str:
    """Digest of the code that makes a source, starts it and checks its step."""
    files = sorted(Path(vehicles.__file__).parent.rglob("*.py"))
    return sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def shown_signals(
    now: Properties, engines: Sequence[EngineFile], config: AircraftConfig
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
