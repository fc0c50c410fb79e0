"""A flight as a folder that JSBSim flies by itself: aircraft, inner and outer loop, script."""

import hashlib
import math
import os
import shlex
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from flighttune.base.answering import Answering
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, printable
from flighttune.base.files import owned
from flighttune.base.files.whole import (
    apart,
    remove_file,
    scratch_folder,
    together,
    whole_file,
    write_text,
)
from flighttune.base.units import FT, G_0
from flighttune.control import mimo_pi, wind
from flighttune.control.controller import LawSetup
from flighttune.control.law import OuterLoop
from flighttune.flight import conditions, fly, models
from flighttune.flight.entry import Entry
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.schema import Scenario
from flighttune.outputs.drawing.templates import page_template
from flighttune.outputs.exports.needs import needs
from flighttune.routes.feasible import FeasibleReference
from flighttune.routes.follow import (
    APPROACH,
    APPROACH_BESIDE,
    LEAST_SHARE,
    LEAST_SHARE_BESIDE,
    STEEPEST_DIVE,
)
from flighttune.routes.segments import Reference
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.aircraft.model_xml import template_of
from flighttune.vehicles.plants.jsbsim import model_files, properties
from flighttune.vehicles.plants.jsbsim.fdm import STARTER, STARTING, Fdm, weigh
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant, inner_loop_settings
from flighttune.vehicles.plants.sensors import Sensors

SCRIPT, CSV, START, OUTER_LOOP = "flight.xml", "flight.csv", "start", "ft_outer_loop"
README, SUMS = "README.md", "SHA256SUMS"

# Time at rest before the flight, in addition to its engine's start, s: sensor delays fill, gear and
# flaps move, and filters of the model's flight control settle.
AT_REST = 40.0

# A smaller share of a step counts as rounding.
SAME_TIME = 1e-6

# Flights within this difference are equal up to rounding, rad and 1; relative for the airspeed.
TOLERANCE = 1e-9

# Time limit of JSBSim, s, plus an allowance per second of flight; it takes 2 s.
TIME_LIMIT_S, TIME_LIMIT_PER_S = 60.0, 2.0

# Signals of a run by column of the file; the airspeed is compared if the flight follows it.
COLUMNS = {"chi": "chi_rad", "gamma": "gamma_rad", "phi": "phi_rad", "n_z": "n_z", "V_a": "V_a_mps"}

# A sample of a reference gets its own row if it departs from a straight line by more.
STRAIGHT = 1e-15

_README = Path(__file__).with_name("readme.md")

# Commands of the outer loop, by the names of their rows, and the value for no limit.
_COMMANDS = {"phi": properties.PHI_CMD, "n_z": properties.N_Z_CMD, "n_x": properties.N_X_CMD}
_UNLIMITED = -1e300, 1e300

# The wind of `fly`: JSBSim resets its ``wind-*`` in every evaluation.
WIND = [f"atmosphere/gust-{axis}-fps" for axis in ("north", "east", "down")]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedFlight(Answering):
    """A folder that JSBSim flew, and the comparison of its flight with `fly`."""

    folder: Path
    command: str  # the command that flies the folder from any working directory
    start: float  # s: JSBSim's time at the start of the flight
    # Largest difference by signal, rad, 1 and m/s; empty if JSBSim did not complete the flight
    differences: Mapping[str, float]
    verdict: str  # sentence about the comparison
    same: bool  # whether the flights are equal up to rounding
    notes: tuple[str, ...] = ()


def export_jsbsim(entry: Entry, folder: Path) -> ExportedFlight:
    """Write a flight as files that JSBSim flies by itself, fly them, and compare with `fly`."""
    folder = folder.absolute()
    with scratch_folder() as scratch:
        with apart():
            flight = _built(entry, Path(scratch))
        _put(Path(scratch), folder)
    words = (word.replace(scratch, str(folder)) for word in shlex.split(flight.command))
    return replace(flight, folder=folder, command=shlex.join(words))


def _put(built: Path, folder: Path) -> None:
    """Put the files of an export in place together, and remove the files of an earlier export."""
    names = [file.relative_to(built) for file in sorted(built.rglob("*")) if file.is_file()]
    # JSBSim overwrites its flight every time somebody flies the folder.
    sums = {name.as_posix(): _sha256(built / name) for name in names if name != Path(CSV)}
    with together(folder):
        for name, digest in _sums_in(folder / SUMS).items():
            file = (folder / name).resolve()
            below = file.is_relative_to(folder.resolve())  # the list may come from somebody else
            if below and name not in sums and _sha256(file) == digest:
                remove_file(folder / name)
        for name in names:
            with whole_file(folder / name) as part:
                shutil.copyfile(built / name, part)
        text = "".join(f"{digest}  {name}\n" for name, digest in sums.items())
        write_text(folder / SUMS, text)


def _sums_in(file: Path) -> dict[str, str]:
    """SHA-256 of the files below a folder that an earlier export wrote, by path."""
    lines = file.read_text(encoding="utf-8").splitlines() if owned.is_my_file(file) else []
    return {name: digest for digest, _, name in (line.partition("  ") for line in lines) if name}


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""


def _check_air(scenario: Scenario) -> None:
    """Refuse air that moves in other ways than JSBSim's script knows, and errors of navigation."""
    if scenario.navigation:
        raise InputError(
            "`navigation` must be absent from a scenario that is exported: in JSBSim the law sees "
            "its motion exactly."
        )
    if weather := conditions.weather_of(scenario):
        moves = {
            "gust": weather.gust,
            "turbulence": weather.turbulence,
            "wind.level": weather.wind.varies,
            "disturbance.as_wind": weather.oscillation,
        }
        for key in (key for key, moved in moves.items() if moved):
            raise InputError(
                f"`{key}` must be absent from a scenario that is exported: the only moving air in "
                "JSBSim's script is a steady wind."
            )


def _built(entry: Entry, folder: Path) -> ExportedFlight:
    """An export in a folder of its own."""
    scenario, law = entry.scenario, entry.law
    _check_air(scenario)
    aircraft_plant = fly.plant_of(entry.plant, scenario)
    assert isinstance(aircraft_plant, JSBSimPlant)
    setup = models.law_setup(scenario, entry.found_gains, entry.limits)
    if (loop := law.outer_loop(setup)) is None:
        raise law.refusal("outer_loop", "exported")
    aircraft_plant.start(entry.condition)
    fdm = aircraft_plant.fdm
    assert fdm is not None
    frames, t_0 = round(fdm.rate * setup.dt), _start_time(fdm, setup.dt)
    sensors = scenario.sensors_on(entry.plant.label)
    sampled = _sampled(scenario, setup, loop, entry.lead, sensors)
    values = _values(scenario, setup, loop, fdm)
    if "ft/outer/plan/n_z" in sampled:
        values["ft/outer/planned"] = 1.0
    with model_files.model_folders(fdm.files, weigh, fdm.steps) as folders:
        aircraft = folder / "aircraft" / folders.name
        root = _parsed(folders.file.read_bytes())
    _copy_parts(fdm.config, folder)
    last = max(i for i, element in enumerate(root) if element.tag == "system")
    root.insert(last + 1, Element("system", file=OUTER_LOOP))
    outer = folder / "systems" / f"{OUTER_LOOP}.xml"
    trees = {aircraft / f"{folders.name}.xml": root, outer: _outer_loop(loop, frames, scenario)}
    declared = _written(trees, values)
    write_text(aircraft / f"{START}.xml", _start(fdm))
    script = _script(scenario, setup, aircraft_plant, folders.name, t_0, values, declared, sampled)
    write_text(folder / SCRIPT, script)
    # The console command ignores the script's time step, and writes to its root.
    options = [f"--simulation-rate={fdm.rate!r}", f"--script={SCRIPT}"]
    at_folder = [f"--root={folder}", *options]
    run = fly.fly_once(entry, aircraft_plant, lead=entry.lead)
    largest, differs = _differences(at_folder, folder / CSV, t_0, run)
    verdict = _verdict(entry, run, largest, differs)
    said = " ".join([verdict, *scenario.assumptions])
    command = shlex.join(["jsbsim", "--root=.", *options])
    own = {"model": folders.name, "verdict": said, "command": command, "start": t_0}
    _write_readme(entry, folder / README, own)
    console = shutil.which("jsbsim", path=Path(sys.executable).parent) or "jsbsim"
    return ExportedFlight(
        folder=folder,
        command=shlex.join([console, *at_folder]),
        start=t_0,
        differences=largest,
        verdict=verdict,
        same=not differs,
    )


def _start_time(fdm: Fdm, dt: float) -> float:
    """Time at which the outer loop begins, s: after the engine has settled."""
    # A multiple of both sample times, so that both have a sample at the start.
    whole = round(fdm.rate * dt) * fdm.steps
    still = AT_REST + 4.0 * fdm.engine_settles
    return math.ceil(still * fdm.rate / whole) * whole / fdm.rate


def _written(trees: Mapping[Path, Element], values: Mapping[str, float]) -> set[str]:
    """Write systems with these values; return the names of their declared properties."""
    declared: set[str] = set()
    for file, tree in trees.items():
        declared |= _declare(tree, values)
        ElementTree.indent(tree)
        write_text(file, template_of(tree))
    return declared


def _write_readme(entry: Entry, file: Path, own: Mapping[str, Any]) -> None:
    """Write a description of the folder, its command and the comparison of its flight."""
    scenario = entry.scenario
    text = _README.read_text(encoding="utf-8").format(
        **own,
        needs=" ".join(needs(entry)),
        title=printable(scenario.title),
        gains=entry.name,
        version=version("flighttune"),
        jsbsim=version("jsbsim"),
        csv=CSV,
        rate=scenario.controller.rate_hz,
        duration=scenario.flight.duration_s,
    )
    write_text(file, text)


def _verdict(entry: Entry, run: Run, largest: Mapping[str, float], differs: str) -> str:
    """The comparison of JSBSim's flight with the run, in words."""
    verdict = f"JSBSim's flight is not that of `flighttune fly`: {differs}."
    if not differs:
        verdict = (
            f"JSBSim flew the folder with the gains {entry.name}: its flight is that of "
            f"`flighttune fly` to within {max(largest.values()):.1g} "
            f"(rad{', m/s' * entry.scenario.airspeed}, and 1 for the load factor)."
        )
    if largest and run.status != "completed":
        verdict += f" They were compared until `flighttune fly` ended the flight: {run.reason}"
    return verdict


def _differences(
    options: Sequence[str], csv: Path, start: float, run: Run
) -> tuple[dict[str, float], str]:
    """Largest difference (rad, 1, m/s) of a run's signals from JSBSim's `csv`; what differs."""
    import pandas as pd

    write_text(csv, "")  # so that no earlier flight is compared
    time_limit = TIME_LIMIT_S + TIME_LIMIT_PER_S * (start + run.t[-1])
    if failure := model_files.failure_of_python(
        "-m", "jsbsim.script", *options, time_limit=time_limit
    ):
        return {}, f"JSBSim must fly it, but {failure.replace(f'{csv.parent}/', '')}"
    try:
        written = pd.read_csv(csv, usecols=[*COLUMNS.values()], dtype=float)
    except ValueError:  # pandas raises subclasses of these errors
        return {}, f"JSBSim's {csv.name} cannot be read"
    if len(written) < len(run.t):
        return {}, f"JSBSim's flight ends after {len(written)} of {len(run.t)} samples"
    distances = {
        name: np.abs(written[column].to_numpy()[: len(run.t)] - run.signals[name].to_numpy())
        for name, column in COLUMNS.items()
        if name != "V_a" or "V_ref" in run.signals
    }
    # One of the two courses wraps.
    distances["chi"] = np.abs((distances["chi"] + np.pi) % (2.0 * np.pi) - np.pi)
    largest = {name: float(values.max()) for name, values in distances.items()}
    allowed = dict.fromkeys(largest, TOLERANCE)
    if "V_a" in allowed:
        allowed["V_a"] *= run.signals["V_a"].iloc[0]
    # With "not", because NaN counts as a difference.
    first = {name: np.argmax(~(values <= allowed[name])) for name, values in distances.items()}
    if not (differing := [name for name, value in largest.items() if not value <= allowed[name]]):
        return largest, ""
    name = min(differing, key=lambda name: (first[name], -distances[name][first[name]]))
    return largest, f"{name} differs first, at t = {run.t[first[name]]:g} s"


def _outer_loop(loop: OuterLoop, frames: int, scenario: Scenario) -> Element:
    """The law as a system, with the same measurements for every law."""
    airspeed, priority = scenario.airspeed, scenario.speed_priority
    name = f"{loop.components or 'outer_loop.xml'}.jinja"
    template = page_template("flighttune.outputs.exports", name)
    return _parsed(
        template.render(
            own_law=loop.components is not None,
            commands={u: name for u, name in _COMMANDS.items() if airspeed or u != "n_x"},
            airspeed=airspeed,
            priority=priority,
            given="given" if priority else "ref",  # the path angle may give way to the airspeed
            frames=frames,
        )
    )


def _values(scenario: Scenario, setup: LawSetup, loop: OuterLoop, fdm: Fdm) -> dict[str, float]:
    """Properties of the aircraft at rest before the flight, and properties of the law."""
    condition, limits, gains = conditions.start_condition(scenario), setup.limits, setup.gains
    assert gains is not None
    # An actuator with hysteresis begins at its first input, and JSBSim runs the flight control
    # after the systems.
    own = fdm.names("fcs/") if fdm.own_flight_control else []
    read = _read(fdm, filter(fdm.has, own))
    moved = {name: at for name, at in read.items() if at and math.isfinite(at)}
    values = {**moved, **fdm.settings, **inner_loop_settings(fdm.config)}
    for trim_name, law_name in zip(properties.TRIMS, properties.LAWS, strict=True):
        values[trim_name] = fdm.reader(trim_name)() + fdm.reader(law_name)()
    inner = properties.N_X_FOLLOWED, properties.N_X_SHOWN, properties.V_A_CMD
    values |= _read(fdm, (*_COMMANDS.values(), *inner))
    values |= {
        "ft/outer/dt-s": setup.dt,
        "ft/outer/least-speed": wind.LEAST_SPEED,
        "ft/outer/per-g-s2_m": 1.0 / scenario.flight.g_mps2,
        **loop.values,
    }
    if scenario.airspeed:
        values |= {
            "ft/outer/n_x/throttle-min": fdm.config.engines.throttle[0],
            "ft/outer/n_x/beyond-stop": mimo_pi.BEYOND_STOP,
        }
    if scenario.speed_priority:
        f = scenario.flight
        share, per_g = LEAST_SHARE_BESIDE, APPROACH_BESIDE / f.V_a_mps
        if scenario.airspeed:
            share, per_g = LEAST_SHARE, APPROACH / f.g_mps2
        values |= {
            "ft/outer/V-ref-mps": f.V_a_mps,  # the reference of a third channel is sampled
            "ft/outer/n_x/priority-per-g": per_g,
            "ft/outer/n_x/steepest-dive": STEEPEST_DIVE,
            "ft/outer/V-least-share": share,
        }
    commands = dict(zip(_COMMANDS, condition.commands(len(gains.inputs)), strict=False))
    for i, (command, start) in enumerate(commands.items()):
        for j, error in enumerate(gains.errors):
            entry = f"{loop.rows[i]}-{error}"
            values[f"ft/outer/K_P/{entry}"] = float(gains.K_P[i, j])
            values[f"ft/outer/K_I/{entry}"] = float(gains.K_I[i, j])
        values[f"ft/outer/{command}/start"] = start
        of_range = "range-" if command == "n_x" else ""
        names = f"{of_range}min", f"{of_range}max", "rate-min", "rate-max"
        bounds = limits.lower, limits.upper, limits.rate_lower, limits.rate_upper
        for name, bound in zip(names, bounds, strict=True):
            values[f"ft/outer/{command}/{name}"] = float(np.clip(bound[i], *_UNLIMITED))
    return values


def _read(fdm: Fdm, names: Iterable[str]) -> dict[str, float]:
    """Properties of the aircraft at its start."""
    return {name: fdm.reader(name)() for name in names}


def _times(scenario: Scenario, setup: LawSetup) -> FloatArray:
    return np.arange(round(scenario.flight.duration_s / setup.dt) + 1, dtype=float) * setup.dt


def _sampled(
    scenario: Scenario,
    setup: LawSetup,
    loop: OuterLoop,
    lead: tuple[float, float],
    sensors: Sensors | None,
) -> dict[str, FloatArray]:
    """Unmeasured inputs of the law at every sample, by property."""
    t, followed = _times(scenario, setup), conditions.reference_of(scenario)
    chi, gamma = followed.sampled(t)
    sampled = {"ft/outer/chi-ref-rad": chi, "ft/outer/gamma-ref-rad": gamma}
    if isinstance(followed, Reference) and (airspeed := followed.airspeed(t)):
        sampled["ft/outer/V-ref-mps"], sampled["ft/outer/V-ref-rate-mps2"] = airspeed
    if loop.takes_rates or (loop.takes_plan and scenario.rolls_in):
        rates = followed.rates(t, lead) if isinstance(followed, Reference) else followed.rates(t)
        name = "{}-ref-rate-rad_sec" if loop.takes_rates else "plan/{}-rate-rad_sec"
        for channel, rate in zip(("chi", "gamma"), rates, strict=True):
            sampled[f"ft/outer/{name.format(channel)}"] = rate
    if loop.takes_plan and isinstance(followed, FeasibleReference):
        sampled["ft/outer/plan/phi-rad"], sampled["ft/outer/plan/n_z"] = followed.commands(t).T
    if sensors is not None:
        errors = sensors.errors(len(t), setup.dt)
        for name, error in zip(("chi-rad", "gamma-rad", "V_a-mps"), errors.T, strict=True):
            sampled[f"ft/outer/sensor/{name}"] = error
    return sampled


def _start(fdm: Fdm) -> str:
    lines = (
        f'  <{tag} unit="{unit}"> {fdm.reader(f"ic/{name}")()!r} </{tag}>'
        for tag, unit, name in (
            ("altitudeMSL", "FT", "h-sl-ft"),
            *((f"{axis}body", "FT/SEC", f"{axis}-fps") for axis in "uvw"),
            ("phi", "RAD", "phi-rad"),
            ("theta", "RAD", "theta-rad"),
            ("psi", "RAD", "psi-true-rad"),
        )
    )
    head = '<?xml version="1.0"?>', f'<initialize name="{START}">'
    return "\n".join([*head, *lines, "</initialize>\n"])


def _script(
    scenario: Scenario,
    setup: LawSetup,
    plant: JSBSimPlant,
    model: str,
    t_0: float,
    values: Mapping[str, float],
    declared: Set[str],
    sampled: Mapping[str, FloatArray],
) -> str:
    """The script: the aircraft at rest with `values` until `t_0`, then the flight."""
    t, fdm = _times(scenario, setup), plant.fdm
    assert fdm is not None
    half = 0.5 / fdm.rate
    moving = {name: read() for name, (_, read) in fdm.integrators.items()}
    tanks = [name for name in fdm.names("propulsion/tank") if name.endswith("/contents-lbs")]
    rates = _read(fdm, [f"ic/{axis}-rad_sec" for axis in "pqr"])
    undeclared = {name: value for name, value in values.items() if name not in declared}
    bends = {name: np.abs(np.diff(values, 2)) > STRAIGHT for name, values in sampled.items()}
    return page_template("flighttune.outputs.exports", "flight.xml.jinja").render(
        title=printable(scenario.title),
        model=model,
        start=START,
        end=t_0 + float(t[-1]),
        rate=fdm.rate,
        dt=1.0 / fdm.rate,
        shorter=0.999 / fdm.rate,
        longer=1.001 / fdm.rate,
        csv=CSV,
        at_rest={**undeclared, **rates, **_read(fdm, WIND), **dict.fromkeys(moving, 0.0)},
        engines=_engine_events(fdm, values[properties.THROTTLE_TRIM]),
        engine_count=fdm.config.engines.count,
        failures=[
            (name, t_0 + math.ceil(from_s * fdm.rate - SAME_TIME) / fdm.rate + half, value)
            for from_s, name, value in plant.changes()
        ],
        before=t_0 - half,
        after=t_0 + half,
        sample=setup.dt,
        tanks=_read(fdm, tanks),
        at_start={
            **_read(fdm, properties.TRIMS),
            properties.ENGAGED: 1.0,
            "ft/outer/engaged": 1.0,
            "simulation/output/log_rate_hz": 1.0 / setup.dt,
        },
        moving=moving,
        # Rows on a straight line are left out.
        references={
            name: np.column_stack([t, values])[np.array([True, *bends[name], True])].tolist()
            for name, values in sampled.items()
        },
        g=G_0 / FT,
    )


def _engine_events(
    fdm: Fdm, throttle_trim: float
) -> list[tuple[str, float, bool, Mapping[str, float]]]:
    """Events that start engines: name, time, condition of a stopped engine, and values."""
    if not fdm.config.engines.count:
        return []
    piston = fdm.has("propulsion/magneto_cmd")
    starting = STARTING if piston else 0.0
    events = []
    if piston:
        events += [
            ("starter", 0.0, True, STARTER),
            ("starter off", starting, False, {"propulsion/starter_cmd": 0.0}),
        ]
    # JSBSim's own engine start stops some propellers, so it comes last.
    events += [("engines that did not start", starting, True, {"propulsion/set-running": -1.0})]
    if settle := fdm.engine_settles:
        # Some propellers have two steady states at one throttle; the trim approaches from full
        # throttle.
        trims = (("full throttle", 0.0, 1.0), ("trim", starting + settle, throttle_trim))
        events += [(name, t, False, {properties.THROTTLE_TRIM: x}) for name, t, x in trims]
    return events


def _parsed(text: str | bytes) -> Element:
    """Root of an XML text, with its comments."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    return ElementTree.XML(text, parser)


def _declare(root: Element, values: Mapping[str, float]) -> set[str]:
    """Set the values of properties that systems declare; return their names."""
    names = set()
    for system in (*root.iter("system"), *root.iter("flight_control")):
        for declared in system.iterfind("property"):
            if (name := (declared.text or "").strip()) in values:
                declared.set("value", repr(values[name]))
                names.add(name)
    return names


def _copy_parts(config: AircraftConfig, folder: Path) -> None:
    """Copy all files of a model, except its main file, to their places in the folder."""
    folders = model_files.source_folders(config)
    shared = folder / "engine", folder / "systems"
    places = {
        folders.model: folder / "aircraft" / folders.name,
        **dict(zip((*folders.near, folders.engines, folders.systems), shared * 2, strict=False)),
    }
    for file in model_files.model_files(config)[1:]:
        part = Path(os.path.normpath(file))
        place = next(place for place in places if part.is_relative_to(place))
        with whole_file(places[place] / part.relative_to(place)) as copy:
            shutil.copyfile(file, copy)
