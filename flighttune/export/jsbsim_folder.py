"""A flight as a folder that JSBSim flies by itself: aircraft, inner and outer loop, script."""

import math
import shlex
import shutil
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
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
from flighttune.plants.jsbsim.fdm import EARTH, weigh
from flighttune.plants.jsbsim.model_files import ModelFolders, model_folders, not_xml
from flighttune.plants.jsbsim.plant import JSBSimPlant, inner_loop_settings
from flighttune.scenario.schema import Scenario
from flighttune.simulate.feasible import FeasibleReference
from flighttune.units import FT, G_0
from flighttune.whole_file import reason_of, write_text

SCRIPT, CSV, START, OUTER_LOOP = "flight.xml", "flight.csv", "start", "ft_outer_loop"

AT_REST = 10.0
"""Time for which the aircraft is held still before the flight, plus that of its engine, s:
delays of sensors fill, and filters of the model's own flight control settle.
"""

STRAIGHT = 1e-15
"""Departure from a straight line above which a sample of a reference has a row of its own."""

_OUTER_LOOP, _SCRIPT = (
    Path(__file__).with_name(f"{name}.xml") for name in ("outer_loop", "flight")
)

_MEASURED = {
    *(f"ft/outer/{name}" for name in ("sample", "chi-rad", "gamma-rad", "gain")),
    *(f"ft/outer/{name}-rad" for name in ("half-turn-less", "chi-err", "gamma-err")),
    *(f"ft/outer/{u}/{name}" for u in ("phi", "n_z") for name in ("in-force", "low", "high")),
}
"""Components of the outer loop that every law has."""

MOVED_BY_AIR = "wind", "gust", "turbulence"


@dataclass(frozen=True, slots=True)
class JSBSimFolder:
    """A folder as written, and how to fly it."""

    # `folder`, `script` and `csv`: the folder, the script in it, and the file that JSBSim writes
    # there.
    folder: Path
    script: Path
    csv: Path
    command: str  # command line that flies it, from any working directory
    t_0: float  # s: JSBSim's time at the start of the flight; the aircraft is held still before


def export_jsbsim(
    scenario: Scenario, name: str, gains: PIGains, folder: Path, *, plant: str | None = None
) -> JSBSimFolder:
    """Write the flight of one gain set on one aircraft as files that JSBSim flies by itself.

    `name` is that of the gain set with its law. The `folder` is made if there is none; files of the
    same names are replaced. `plant`: label of the aircraft; by default the first of the scenario.
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
    folder = folder.absolute()
    flight = _Flight(scenario, setup, loop, flown)
    try:
        flight.write(folder)
    except OSError as error:
        raise OutputError(f"{folder}: must be writable, got {reason_of(error)}.") from error
    rate = f"--simulation-rate={flight.rate!r}"  # the command takes no step from a script
    console = shutil.which("jsbsim", path=Path(sys.executable).parent) or "jsbsim"
    command = [console, f"--root={folder}", rate, f"--outputpath={folder}", f"--script={SCRIPT}"]
    return JSBSimFolder(folder, folder / SCRIPT, folder / CSV, shlex.join(command), flight.t_0)


class _Flight:
    """One flight: the aircraft at its start, the law, and the samples of what it follows."""

    def __init__(
        self, scenario: Scenario, setup: LawSetup, loop: OuterLoop, plant: JSBSimPlant
    ) -> None:
        assert plant.fdm is not None
        self._scenario, self._fdm = scenario, plant.fdm
        self._setup, self._loop = setup, loop
        self.rate = self._fdm.rate
        self._frames = round(self.rate * setup.dt)
        # Whole samples of both computers, so that both have one at the start.
        whole = self._frames * self._fdm.steps
        rest = AT_REST + 3.0 * self._fdm.engine_settles
        self.t_0 = math.ceil(rest * self.rate / whole) * whole / self.rate

    def write(self, folder: Path) -> None:
        """Write the files of the aircraft, its systems, its start and the script."""
        fdm, values = self._fdm, self._values()
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
        outer = self._outer_loop()
        declared = set()
        for tree, file in ((root, aircraft / folders.file.name), (outer, systems / OUTER_LOOP)):
            declared |= _declare(tree, values)
            ElementTree.indent(tree)
            ElementTree.ElementTree(tree).write(
                file.with_suffix(".xml"), "utf-8", xml_declaration=True
            )
        write_text(aircraft / f"{START}.xml", self._start())
        rest = {name: value for name, value in values.items() if name not in declared}
        write_text(folder / SCRIPT, self._script(folders.name, rest))

    def _outer_loop(self) -> Element:
        """The law as a system: the paper's, or another one behind the same measurements."""
        outer = _parsed(_OUTER_LOOP)
        (channel,) = outer.iterfind("channel")
        channel.set("execrate", str(self._frames))
        if self._loop.components is not None:
            for component in channel.findall("fcs_function"):
                if component.get("name") not in _MEASURED:
                    channel.remove(component)
            own = _parsed(_OUTER_LOOP.with_name(self._loop.components))
            channel.extend(own.iterfind("channel/fcs_function"))
            outer[0:0] = own.iterfind("property")
        return outer

    def _values(self) -> dict[str, float]:
        """Properties of the aircraft at rest before the flight, and those of the law."""
        setup, condition, fdm = self._setup, self._scenario.condition, self._fdm
        values = {**fdm.settings, **inner_loop_settings(fdm.config)}
        for trim_name, law_name in zip(properties.TRIMS, properties.LAWS, strict=True):
            values[trim_name] = fdm.reader(trim_name)() + fdm.reader(law_name)()
        values |= self._read((properties.PHI_CMD, properties.N_Z_CMD, properties.V_A_CMD))
        values |= {
            "ft/outer/dt-s": setup.dt,
            "ft/outer/phi/start": condition.phi,
            "ft/outer/n_z/start": condition.n_z_start,
            **self._loop.values,
        }
        if "ft/outer/plan/n_z" in self._sampled():
            values["ft/outer/planned"] = 1.0
        limits, gains = setup.limits, setup.gains
        assert gains is not None
        bounds = (limits.lower, limits.upper, limits.rate_lower, limits.rate_upper)
        for i, command in enumerate(("phi", "n_z")):
            for j, error in enumerate(("chi", "gamma")):
                entry = f"{self._loop.rows[i]}-{error}"
                values[f"ft/outer/K_P/{entry}"] = float(gains.K_P[i, j])
                values[f"ft/outer/K_I/{entry}"] = float(gains.K_I[i, j])
            for bound, limit in zip(("min", "max", "rate-min", "rate-max"), bounds, strict=True):
                values[f"ft/outer/{command}/{bound}"] = float(limit[i])
        return values

    def _read(self, names: Iterable[str]) -> dict[str, float]:
        """Properties of the aircraft at its start."""
        return {name: self._fdm.reader(name)() for name in names}

    def _sampled(self) -> dict[str, FloatArray]:
        """Inputs of the law at every sample that are not measured, by property."""
        t, followed = self._t, self._scenario.followed()
        chi, gamma = followed.sampled(t)
        sampled = {"ft/outer/chi-ref-rad": chi, "ft/outer/gamma-ref-rad": gamma}
        if self._loop.takes_rates:
            rates = followed.rates(t)
            for name, rate in zip(("chi", "gamma"), rates, strict=True):
                sampled[f"ft/outer/{name}-ref-rate-rad_sec"] = rate
        if self._loop.takes_plan and isinstance(followed, FeasibleReference):
            sampled["ft/outer/plan/phi-rad"], sampled["ft/outer/plan/n_z"] = followed.commands(t).T
        if self._scenario.sensors is not None:
            errors = self._scenario.sensors.sensors(self._scenario.seed).errors(
                len(t), self._setup.dt
            )
            for name, error in zip(("chi-rad", "gamma-rad", "V_a-mps"), errors.T, strict=True):
                sampled[f"ft/outer/sensor/{name}"] = error
        return sampled

    @cached_property
    def _t(self) -> FloatArray:
        samples = round(self._scenario.flight.duration_s / self._setup.dt)
        return np.arange(samples + 1, dtype=np.float64) * self._setup.dt

    def _start(self) -> str:
        read = self._fdm.reader
        lines = (
            f'  <{tag} unit="{unit}"> {read(f"ic/{name}")()!r} </{tag}>'
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

    def _script(self, model: str, values: Mapping[str, float]) -> str:
        fdm, t_0 = self._fdm, self.t_0
        half, end = 0.5 / self.rate, t_0 + float(self._t[-1])
        rates = [f"ic/{axis}-rad_sec" for axis in "pqr"]
        moving = {name: read() for name, (_, read) in fdm.integrators.items()}
        tanks = [name for name in fdm.names("propulsion/tank") if name.endswith("/contents-lbs")]
        at_start = {
            **self._read(properties.TRIMS),
            properties.ENGAGED: 1.0,
            "ft/outer/engaged": 1.0,
            "simulation/output/log_rate_hz": 1.0 / self._setup.dt,
        }
        at_rest = {**values, **self._read(rates), **dict.fromkeys(moving, 0.0)}
        return _SCRIPT.read_text(encoding="utf-8").format(
            title=escape(self._scenario.title, {'"': "&quot;"}),
            model=escape(model),
            start=START,
            end=end,
            rate=self.rate,
            dt=1.0 / self.rate,
            shorter=0.999 / self.rate,
            longer=1.001 / self.rate,
            csv=CSV,
            at_rest="\n".join(
                f'<property value="{value!r}"> {name} </property>'
                for name, value in at_rest.items()
            ),
            t_0=t_0,
            before=t_0 - half,
            after=t_0 + half,
            sample=self._setup.dt,
            tanks=_sets(self._read(tanks)),
            at_start=_sets(at_start),
            moving=_sets(moving),
            references="\n".join(
                _reference(name, self._t, values) for name, values in self._sampled().items()
            ),
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
