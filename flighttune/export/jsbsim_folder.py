"""A flight as a folder that JSBSim flies by itself: aircraft, inner and outer loop, script."""

import math
import shlex
import shutil
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.sax.saxutils import escape

import numpy as np

from flighttune.aircraft.model_xml import found_file
from flighttune.arrays import FloatArray
from flighttune.control.controller import LawSetup
from flighttune.control.gains import PIGains
from flighttune.control.law import OuterLoop
from flighttune.errors import InputError, OutputError
from flighttune.flight.fly import aircraft_table, law_setup, plant_of
from flighttune.plants.jsbsim import properties
from flighttune.plants.jsbsim.fdm import EARTH, Fdm, weigh
from flighttune.plants.jsbsim.model_files import ModelFolders, model_folders, not_xml
from flighttune.plants.jsbsim.plant import JSBSimPlant, inner_loop_settings
from flighttune.scenario.schema import Scenario
from flighttune.simulate.feasible import FeasibleReference
from flighttune.units import FT, G_0
from flighttune.whole_file import reason_of, write_text

SCRIPT, CSV, START, OUTER_LOOP = "flight.xml", "flight.csv", "start", "ft_outer_loop"

# Time for which the aircraft is held still before the flight, plus that of its engine, s: delays of
# sensors fill, and filters of the model's own flight control settle.
AT_REST = 10.0

# Departure from a straight line above which a sample of a reference has a row of its own.
STRAIGHT = 1e-15

_OUTER_LOOP, _SCRIPT = (
    Path(__file__).with_name(f"{name}.xml") for name in ("outer_loop", "flight")
)

# Components of the outer loop that every law has.
_MEASURED = {
    *(f"ft/outer/{name}" for name in ("sample", "chi-rad", "gamma-rad", "gain")),
    *(f"ft/outer/{name}-rad" for name in ("half-turn-less", "chi-err", "gamma-err")),
    *(f"ft/outer/{u}/{name}" for u in ("phi", "n_z") for name in ("in-force", "low", "high")),
}

MOVED_BY_AIR = "wind", "gust", "turbulence"


def export_jsbsim(
    scenario: Scenario, name: str, gains: PIGains, folder: Path, *, plant: str | None = None
) -> tuple[str, float]:
    """Write the flight of one gain set on one aircraft as files that JSBSim flies by itself.

    `name` is that of the gain set with its law. The `folder` is made if there is none; files of the
    same names are replaced. `plant`: label of the aircraft; by default the first of the scenario.
    Returns the command line that flies it, from any working directory, and JSBSim's time at the
    start of the flight (s): the aircraft is held still before.
    Raises InputError if the scenario has no such aircraft or moves the air, or the law is one in
    Python. Raises TrimError if there is no steady flight to start from. Raises PlantError if the
    aircraft cannot be built. Raises OutputError if the folder cannot be written.
    """
    table = aircraft_table(scenario, plant)
    if scenario.weather() is not None:
        moving = [key for key in MOVED_BY_AIR if getattr(scenario, key)] or ["disturbance"]
        raise InputError(
            f"`{moving[0]}` must be absent from a scenario that is exported: JSBSim's start in "
            "moving air is not that of `fly`."
        )
    flown = plant_of(table, scenario)
    assert isinstance(flown, JSBSimPlant)
    law, _ = scenario.law_of(name, gains)
    setup = law_setup(scenario, gains, scenario.limits.limits().within(flown.limits))
    loop = law.outer_loop(setup)
    if loop is None:
        raise law.refusal("outer_loop", "exported")
    flown.start(scenario.condition)
    fdm, folder = flown.fdm, folder.absolute()
    assert fdm is not None
    frames = round(fdm.rate * setup.dt)
    # Whole samples of both computers, so that both have one at the start.
    whole = frames * fdm.steps
    still = AT_REST + 3.0 * fdm.engine_settles
    t_0 = math.ceil(still * fdm.rate / whole) * whole / fdm.rate
    sampled = _sampled(scenario, setup, loop)
    values = _values(scenario, setup, loop, fdm)
    if "ft/outer/plan/n_z" in sampled:
        values["ft/outer/planned"] = 1.0
    try:
        systems = folder / "systems"
        systems.mkdir(parents=True, exist_ok=True)
        with model_folders(fdm.config, weigh, fdm.steps) as folders:
            aircraft = folder / "aircraft" / folders.name
            shutil.copytree(folders.model, aircraft, ignore=not_xml, dirs_exist_ok=True)
            root = _parsed(folders.file)
            _copy_shared_parts(root, folders, folder)
        root.insert(0, _parsed(EARTH))
        last = max(i for i, element in enumerate(root) if element.tag == "system")
        root.insert(last + 1, Element("system", file=OUTER_LOOP))
        declared: set[str] = set()
        for tree, file in (
            (root, aircraft / folders.file.name),
            (_outer_loop(loop, frames), systems / OUTER_LOOP),
        ):
            declared |= _declare(tree, values)
            ElementTree.indent(tree)
            ElementTree.ElementTree(tree).write(
                file.with_suffix(".xml"), "utf-8", xml_declaration=True
            )
        write_text(aircraft / f"{START}.xml", _start(fdm))
        rest = {name: value for name, value in values.items() if name not in declared}
        script = _script(scenario, setup, fdm, folders.name, t_0, rest, sampled)
        write_text(folder / SCRIPT, script)
    except OSError as error:
        raise OutputError(f"{folder}: must be writable, got {reason_of(error)}.") from error
    rate = f"--simulation-rate={fdm.rate!r}"  # the command takes no step from a script
    console = shutil.which("jsbsim", path=Path(sys.executable).parent) or "jsbsim"
    command = [console, f"--root={folder}", rate, f"--outputpath={folder}", f"--script={SCRIPT}"]
    return shlex.join(command), t_0


def _outer_loop(loop: OuterLoop, frames: int) -> Element:
    """The law as a system: the paper's, or another one behind the same measurements."""
    outer = _parsed(_OUTER_LOOP)
    (channel,) = outer.iterfind("channel")
    channel.set("execrate", str(frames))
    if loop.components is not None:
        for component in channel.findall("fcs_function"):
            if component.get("name") not in _MEASURED:
                channel.remove(component)
        own = _parsed(_OUTER_LOOP.with_name(loop.components))
        channel.extend(own.iterfind("channel/fcs_function"))
        outer[0:0] = own.iterfind("property")
    return outer


def _values(scenario: Scenario, setup: LawSetup, loop: OuterLoop, fdm: Fdm) -> dict[str, float]:
    """Properties of the aircraft at rest before the flight, and those of the law."""
    condition, limits, gains = scenario.condition, setup.limits, setup.gains
    assert gains is not None
    values = {**fdm.settings, **inner_loop_settings(fdm.config)}
    for trim_name, law_name in zip(properties.TRIMS, properties.LAWS, strict=True):
        values[trim_name] = fdm.reader(trim_name)() + fdm.reader(law_name)()
    values |= _read(fdm, (properties.PHI_CMD, properties.N_Z_CMD, properties.V_A_CMD))
    values |= {
        "ft/outer/dt-s": setup.dt,
        "ft/outer/phi/start": condition.phi,
        "ft/outer/n_z/start": condition.n_z_start,
        **loop.values,
    }
    bounds = (limits.lower, limits.upper, limits.rate_lower, limits.rate_upper)
    for i, command in enumerate(("phi", "n_z")):
        for j, error in enumerate(("chi", "gamma")):
            entry = f"{loop.rows[i]}-{error}"
            values[f"ft/outer/K_P/{entry}"] = float(gains.K_P[i, j])
            values[f"ft/outer/K_I/{entry}"] = float(gains.K_I[i, j])
        for bound, limit in zip(("min", "max", "rate-min", "rate-max"), bounds, strict=True):
            values[f"ft/outer/{command}/{bound}"] = float(limit[i])
    return values


def _read(fdm: Fdm, names: Iterable[str]) -> dict[str, float]:
    """Properties of the aircraft at its start."""
    return {name: fdm.reader(name)() for name in names}


def _times(scenario: Scenario, setup: LawSetup) -> FloatArray:
    return np.arange(round(scenario.flight.duration_s / setup.dt) + 1, dtype=float) * setup.dt


def _sampled(scenario: Scenario, setup: LawSetup, loop: OuterLoop) -> dict[str, FloatArray]:
    """Inputs of the law at every sample that are not measured, by property."""
    t, followed = _times(scenario, setup), scenario.followed()
    chi, gamma = followed.sampled(t)
    sampled = {"ft/outer/chi-ref-rad": chi, "ft/outer/gamma-ref-rad": gamma}
    if loop.takes_rates:
        rates = followed.rates(t)
        for name, rate in zip(("chi", "gamma"), rates, strict=True):
            sampled[f"ft/outer/{name}-ref-rate-rad_sec"] = rate
    if loop.takes_plan and isinstance(followed, FeasibleReference):
        sampled["ft/outer/plan/phi-rad"], sampled["ft/outer/plan/n_z"] = followed.commands(t).T
    if scenario.sensors is not None:
        errors = scenario.sensors.sensors(scenario.seed).errors(len(t), setup.dt)
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
    fdm: Fdm,
    model: str,
    t_0: float,
    values: Mapping[str, float],
    sampled: Mapping[str, FloatArray],
) -> str:
    """The script: the aircraft at rest with `values` until `t_0`, then the flight."""
    t, half = _times(scenario, setup), 0.5 / fdm.rate
    moving = {name: read() for name, (_, read) in fdm.integrators.items()}
    tanks = [name for name in fdm.names("propulsion/tank") if name.endswith("/contents-lbs")]
    at_start = {
        **_read(fdm, properties.TRIMS),
        properties.ENGAGED: 1.0,
        "ft/outer/engaged": 1.0,
        "simulation/output/log_rate_hz": 1.0 / setup.dt,
    }
    rates = _read(fdm, [f"ic/{axis}-rad_sec" for axis in "pqr"])
    at_rest = {**values, **rates, **dict.fromkeys(moving, 0.0)}
    return _SCRIPT.read_text(encoding="utf-8").format(
        title=escape(scenario.title, {'"': "&quot;"}),
        model=escape(model),
        start=START,
        end=t_0 + float(t[-1]),
        rate=fdm.rate,
        dt=1.0 / fdm.rate,
        shorter=0.999 / fdm.rate,
        longer=1.001 / fdm.rate,
        csv=CSV,
        at_rest="\n".join(
            f'<property value="{value!r}"> {name} </property>' for name, value in at_rest.items()
        ),
        t_0=t_0,
        before=t_0 - half,
        after=t_0 + half,
        sample=setup.dt,
        tanks=_sets(_read(fdm, tanks)),
        at_start=_sets(at_start),
        moving=_sets(moving),
        references="\n".join(_reference(name, t, values) for name, values in sampled.items()),
        g=G_0 / FT,
    )


def _reference(name: str, t: FloatArray, values: FloatArray) -> str:
    """A property looked up by the time since the start; rows on a straight line are left out."""
    bends = np.abs(np.diff(values, 2)) > STRAIGHT
    rows = np.column_stack([t, values])[np.array([True, *bends, True])]
    table = "\n".join(f"{at!r} {value!r}" for at, value in rows.tolist())
    return (
        f'<set name="{name}"> <function> <table> <independentVar> ft/outer/t-s </independentVar> '
        f"<tableData>\n{table}\n</tableData> </table> </function> </set>"
    )


def _sets(values: Mapping[str, float]) -> str:
    return "\n".join(f'<set name="{name}" value="{value!r}"/>' for name, value in values.items())


def _parsed(file: Path) -> Element:
    """Root of a file, with its comments."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    return ElementTree.parse(file, parser).getroot()


def _declare(root: Element, values: Mapping[str, float]) -> set[str]:
    """Give the properties that systems declare their values; return their names."""
    names = set()
    for system in (*root.iter("system"), *root.iter("flight_control")):
        for declared in system.iterfind("property"):
            name = (declared.text or "").strip()
            if name in values:
                declared.set("value", repr(values[name]))
                names.add(name)
    return names


def _copy_shared_parts(root: Element, folders: ModelFolders, folder: Path) -> None:
    """Copy engines, propellers and systems that models share, and what they name in turn."""
    for element in root.iter():
        name = element.get("file", "")
        source = found_file(name, folders.parts)
        if name and source.is_file() and not source.is_relative_to(folders.model):
            kind = "engine" if source.is_relative_to(folders.engines) else "systems"
            copy = folder / kind / (name if name.endswith(".xml") else f"{name}.xml")
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, copy)
            _copy_shared_parts(_parsed(copy), folders, folder)
