"""The main file of an aircraft that JSBSim loads: made in a private folder for every load.

It is the model's, with the inner loop and the actuators in front of its systems and without its
connections to files and sockets. The files it is made of are never written to. An aircraft's files
are loaded in a process of its own first: some make JSBSim end the process.
"""

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple, NoReturn, TypeAlias
from xml.etree.ElementTree import Element

from flighttune.base.errors import InputError, PlantError, ending_of
from flighttune.base.files.budget import XML, file_bytes
from flighttune.base.files.shipped import is_trusted
from flighttune.base.files.whole import scratch_folder, scratch_place
from flighttune.base.files.xml import CONNECTIONS, found_file, parts_of, read_xml
from flighttune.base.units import FT
from flighttune.vehicles.aircraft import model_xml
from flighttune.vehicles.aircraft.aircraft import AXES, AircraftConfig, OffNominal
from flighttune.vehicles.aircraft.model_xml import COEFFICIENT, MassBalance

MODEL_FILE = "`model` must be a file of JSBSim's"

# Names by which JSBSim knows the folder of engines.
ENGINE_FOLDERS = ("Engines", "engines", "Engine", "engine")

# Engines without an inertia of their own: in long steps the speed of their propellers diverges.
# Root tags of the files of engines: motors without inertia, which settle in milliseconds; rockets.
ELECTRIC, ROCKET = ("electric_engine", "brushless_dc_motor"), ("rocket_engine",)

# JSBSim's own Earth turns and is round: a straight flight would drift off its course by 0.006 deg/s
EARTH = Path(__file__).with_name("earth.xml")

_NOMINAL = OffNominal()

# Time that JSBSim may take to load an aircraft; it takes a tenth of a second.
TIME_LIMIT_S = 60.0

# JSBSim evaluates an aircraft once more when it frees it, and may end the process then: `_exit`.
_PROGRAM = """
import os, sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
except ImportError:  # Windows
    pass
import jsbsim
try:
    fdm = jsbsim.FGFDMExec(sys.argv[1])
    fdm.set_debug_level(0)
    if fdm.load_model_with_paths(*sys.argv[2:], False):
        fdm.run_ic()
except Exception:
    pass
os._exit(0)
"""

# Weighs an aircraft in JSBSim: handed in, because loading an aircraft needs this module.
Weigh: TypeAlias = Callable[[AircraftConfig], MassBalance]


class ModelFolders(NamedTuple):
    """Folders in which JSBSim finds an aircraft's main file, its engines and its systems."""

    # `model` is the folder of the main file, which may have its own ``Engines`` and ``Systems``;
    # `engines` and `systems` are folders that models share.
    model: Path
    engines: Path
    systems: Path
    name: str  # name of the main file, without ``.xml``
    # Folders above a model of the user, whose parts come before those of JSBSim's set
    near: tuple[Path, ...] = ()

    @property
    def file(self) -> Path:
        """The main file."""
        return self.model / f"{self.name}.xml"

    @property
    def parts(self) -> tuple[Path, ...]:
        """Folders in which a part of the model is looked for, in this order."""
        folders = (self.model / name for name in ("", *ENGINE_FOLDERS, "Systems", "systems"))
        return (*folders, *self.above, *self.near, self.engines, self.systems)

    @property
    def above(self) -> tuple[Path, ...]:
        """The folder above where FlightGear's aircraft is that: its parts are named from there."""
        above = self.model.parent
        here = any(self.model.glob("*-set.xml")) or not any(above.glob("*-set.xml"))
        return () if here else (above,)


@cache
def _shipped_models() -> Path:
    """JSBSim's own set of models, found once: it takes as long as all else before a load."""
    import jsbsim

    return Path(jsbsim.get_default_root_dir()).resolve()


def source_folders(config: AircraftConfig) -> ModelFolders:
    """Folders of an aircraft's model: in JSBSim's own set, or the user's."""
    shipped = _shipped_models()
    shared = shipped / "engine", shipped / "systems"
    name = config.model
    if not name.endswith(".xml"):  # a model of JSBSim's own set
        return ModelFolders(shipped / "aircraft" / name, *shared, name)
    file = (config.folder / name).resolve()
    # In a folder laid out like JSBSim's own, parts that models share are two levels up. Those of
    # FlightGear's aircraft are in the folder of the aircraft, which may hold the main file below.
    above, aircraft = file.parent.parent.parent, file.parent.parent
    # Engines are also found beside a main file that has no folder for them.
    alone = not any((file.parent / folder).is_dir() for folder in ENGINE_FOLDERS)
    beside = (file.parent,) if alone else ()
    near = tuple(
        next((place for place in places if place.is_dir()), places[0])
        for places in (
            (above / "engine", above / "Engines", aircraft / "Engines", *beside),
            (above / "systems", above / "Systems", aircraft / "Systems"),
        )
    )
    return ModelFolders(file.parent, *shared, file.stem, near)


def main_root(config: AircraftConfig) -> Element:
    """The root of a model's main file."""
    kind = MODEL_FILE if config.model.endswith(".xml") else "`model` must be shipped with jsbsim"
    return read_xml(source_folders(config).file, f"{config.file}: {kind}")


def wing_span(config: AircraftConfig) -> float | None:
    """Wing span in a model's main file, m; None if there is none."""
    span = main_root(config).find("metrics/wingspan")
    with suppress(ValueError):
        if span is not None:
            return float(span.text or "") * (1.0 if span.get("unit") == "M" else FT)
    return None


def model_files(config: AircraftConfig) -> tuple[Path, ...]:
    """The main file of an aircraft's model and all the files it is made of."""
    folders = source_folders(config)
    files, pending = [], [folders.file]
    while pending:
        if (file := pending.pop()) in files:
            continue
        root = read_xml(file, str(file)) if files else main_root(config)
        files.append(file)
        parts = parts_of(root, folders.parts, file)
        pending += [part for part in parts if os.path.isfile(part)]
    return tuple(files)


def missing_parts(config: AircraftConfig, message: str) -> list[str]:
    """Parts that a model names and that a `message` of JSBSim misses, with where they belong."""
    folders = source_folders(config)
    file = folders.file
    elements = (part for file in model_files(config) for part in read_xml(file, str(file)).iter())
    tags = {name: part.tag for part in elements if (name := part.get("file", "")) in message}
    places = {"engine": "Engines", "thruster": "Engines"}
    return [
        str(found_file(name, [folders.model / places.get(tag, "Systems")], file))
        for name, tag in tags.items()
        if name and not os.path.isfile(found_file(name, folders.parts, file))
    ]


@dataclass(frozen=True, slots=True)
class Unchanged:
    """An aircraft as the key of a cache: equal to itself while `key` stays the same."""

    config: AircraftConfig = field(compare=False)
    key: Hashable


def unchanged(config: AircraftConfig, *further: Hashable) -> Unchanged:
    """An aircraft as the key of a cache, for as long as its files and `further` do not change."""
    return Unchanged(config, (config.fingerprint, _stamps(config), *further))


@lru_cache(maxsize=256)
def folders_of(unchanged: Unchanged) -> ModelFolders:
    """`source_folders` looked up once: a flight asks several times."""
    return source_folders(unchanged.config)


@lru_cache(maxsize=256)
def has_flight_control(unchanged: Unchanged) -> bool:
    """Whether an aircraft's model has systems of its own, which may have a memory."""
    root = main_root(unchanged.config)
    return any(root.find(tag) is not None for tag in ("flight_control", "autopilot", "system"))


@lru_cache(maxsize=256)
def has_engine(unchanged: Unchanged, tags: tuple[str, ...]) -> bool:
    """Whether the file of an engine has one of these root tags."""
    return any(read_xml(file, str(file)).tag in tags for file in model_files(unchanged.config))


def model_hash(config: AircraftConfig, files: Unchanged | None = None) -> str:
    """Hash of an aircraft's model, and of what its file says about surfaces and engines."""
    return _hash(files or unchanged(config))


@lru_cache(maxsize=256)
def _hash(unchanged: Unchanged) -> str:
    digest = hashlib.sha256(unchanged.config.fingerprint.encode())
    for file in model_files(unchanged.config):
        digest.update(f"{file.name}\n".encode())
        digest.update(file_bytes(file, XML, PlantError))
    return digest.hexdigest()


def _stamps(config: AircraftConfig) -> tuple[tuple[str, int, int], ...]:
    """XML files of an aircraft and its model, two levels deep, times of change and sizes."""
    # Strings and directory entries: a flight asks three to five times, and paths take ten times as
    # long.
    model = os.path.join(config.folder, config.model)
    xml = model.endswith(".xml")
    model = os.path.dirname(os.path.realpath(model)) if xml else source_folders(config).model
    entries = [entry for folder in {str(config.folder), str(model)} for entry in _entries(folder)]
    entries += [below for entry in entries if entry.is_dir() for below in _entries(entry.path)]
    files = (entry for entry in entries if entry.name.endswith(".xml") and entry.is_file())
    states = {entry.path: entry.stat() for entry in files}
    with suppress(OSError):
        states[str(config.file)] = config.file.stat()
    return tuple((path, s.st_mtime_ns, s.st_size) for path, s in sorted(states.items()))


def _entries(folder: str) -> list[os.DirEntry[str]]:
    with suppress(OSError), os.scandir(folder) as entries:
        # A link may lead nowhere, or to itself.
        return [entry for entry in entries if not entry.is_symlink() or os.path.exists(entry)]
    return []


@contextmanager
def model_folders(files: Unchanged, weigh: Weigh, steps: int = 1) -> Iterator[ModelFolders]:
    """Give the folders of an aircraft, for as long as JSBSim loads it.

    Its main file is in a private folder, without its connections to files and sockets, with the
    systems of ours in front of its own, with the factors of an aircraft off the nominal in it, and
    for several integration `steps` in a sample of the inner loop. The rest of the model's folder is
    linked beside it.
    """
    folders = folders_of(files)
    text = main_file_text(files, weigh, steps)
    with ExitStack() as stack:
        try:
            # In memory, so that no flight waits for a disk.
            folder = Path(stack.enter_context(scratch_folder()))
            # A main file refers to parts beside it; only this file itself is another.
            for place in (folders.model, *folders.above):
                for beside in os.listdir(place):
                    link = os.path.join(folder, beside)
                    if beside != folders.file.name and not os.path.lexists(link):
                        os.symlink(os.path.join(place, beside), link)
            shared = {}
            for kind, near in zip(("engines", "systems"), folders.near, strict=False):
                if near.is_dir():  # JSBSim takes one folder of each kind: it holds those of both
                    shared[kind] = Path(stack.enter_context(scratch_folder()))
                    places = getattr(folders, kind), near
                    parts = {part.name: part for place in places for part in place.iterdir()}
                    for name, part in parts.items():
                        (shared[kind] / name).symlink_to(part)
            (folder / folders.file.name).write_bytes(text.encode())
        except OSError as error:
            raise PlantError(
                f"{scratch_place()}: must take a folder for {folders.file.name}, "
                f"got {error.strerror}."
            ) from error
        yield folders._replace(model=folder, near=(), **shared)


def main_file_text(files: Unchanged, weigh: Weigh, steps: int = 1) -> str:
    """Return the main file that JSBSim shall load."""
    return model_xml.filled(*template_and_values(files, weigh, steps))


def template_and_values(
    files: Unchanged, weigh: Weigh, steps: int = 1
) -> tuple[str, Mapping[str, float]]:
    """Main file with placeholders where something is off the nominal, and the values for them."""
    off = files.config.off_nominal or _NOMINAL
    return _template_and_values(files, (files.config.model, off.model_dump_json()), weigh, steps)


@lru_cache(maxsize=8)  # a flight asks several times
def _template_and_values(
    files: Unchanged, _key: tuple[str, str], weigh: Weigh, steps: int
) -> tuple[str, Mapping[str, float]]:
    config = files.config
    off = config.off_nominal or _NOMINAL
    # Values are filled in behind the cache: dispersed flights share one template.
    factors = (off.loaded, repr(off.fault), *off.scaled, *off.coefficient_factors)
    of_factors = Unchanged(config, (files.key, config.model, factors))
    template, balance = _template(of_factors, weigh, steps)
    values = off.scaled | {"actuator_rate": 1.0 / off.actuator_lag_factor}
    values |= {f"{COEFFICIENT}{name}": by for name, by in off.coefficient_factors.items()}
    return template, values | balance.values(off) if balance else values


@lru_cache(maxsize=32)
def _template(unchanged: Unchanged, weigh: Weigh, steps: int) -> tuple[str, MassBalance | None]:
    """Main file with placeholders where something is off the nominal; what weighs the aircraft."""
    config, folders = unchanged.config, source_folders(unchanged.config)
    off = config.off_nominal or _NOMINAL
    file, root = folders.file, main_root(config)
    for tag in (*CONNECTIONS, "planet"):
        for element in root.findall(tag):
            root.remove(element)
    # In the file: a planet loaded after it makes JSBSim drop the model's stall hysteresis and the
    # shift of its aerodynamic reference point.
    root.insert(0, read_xml(EARTH, "flat Earth"))
    model_xml.put_in_front(root, config)
    model_xml.mend_engines(root, folders.parts, off=not config.engines.count)
    if steps > 1:
        _slow_computer(root, steps, folders)
    balance = None
    if off.loaded:
        # Factors and shifts are relative to the nominal aircraft, load and fuel included.
        balance = weigh(config.with_off_nominal(None))
        model_xml.open_mass_balance(root, slides=off.slides)
    for name in off.coefficient_factors:
        model_xml.scale_coefficient(root, name, file)
    for name in off.scaled:
        if name in AXES:
            model_xml.scale_axis(root, name, file)
        elif name == "thrust" and config.engines.thrust:
            raise InputError(
                f"`thrust_factor` must be left out: the thrust of {config.file} is a force of the "
                f"model's own, {config.engines.thrust}."
            )
        elif name == "thrust":
            model_xml.scale_thrust(root, folders.parts, file)
        else:
            model_xml.slow_actuators(root)
    if off.fault is not None:
        model_xml.add_fault(root, off.fault, config, file)
    model_xml.strip_text(root)  # JSBSim loads it an eighth faster
    return model_xml.template_of(root), balance


def _slow_computer(root: Element, steps: int, folders: ModelFolders) -> None:
    """Let the channels with an ``execrate`` wait for so many integration steps between samples."""
    for i, system in enumerate(root):
        if system.tag != "system":
            continue
        name = system.get("file")
        file = found_file(name or "", folders.parts, folders.file)
        inline = read_xml(file, str(file)) if name and os.path.isfile(file) else system
        channels = [x for x in inline.iter("channel") if x.get("execrate", "").isdigit()]
        for channel in channels:
            channel.set("execrate", str(steps * int(channel.attrib["execrate"])))
        if channels:  # a system in a file of its own is put in place of the reference to it
            root[i] = inline


def check_loads(files: Unchanged) -> None:
    """Refuse an aircraft whose files make JSBSim end the process, or never come to an end."""
    if is_trusted(files.config.folder) or not sys.executable:
        return
    # Another process loads files that this one has not loaded yet first, in about 0.3 s.
    if how := _end_of_trial(files):
        raise PlantError(f"{source_folders(files.config).file}: JSBSim must load it, but {how}.")


@lru_cache(maxsize=256)
def _end_of_trial(files: Unchanged) -> str:
    """Reason why the process that loaded the files failed; empty if it did not."""
    config = files.config.with_off_nominal(None)  # factors do not decide whether the files load
    model_files(config)  # refuses parts that are not in the folders of the model
    with model_folders(Unchanged(config, files.key), _unweighed) as folders:
        paths = (config.folder, folders.name, folders.model, folders.engines, folders.systems)
        return failure_of_python("-c", _PROGRAM, *map(str, paths), time_limit=TIME_LIMIT_S)


def failure_of_python(*arguments: str, time_limit: float) -> str:
    """Why a new process of Python failed within `time_limit` (s); empty if it did not."""
    # JSBSim may crash or never return: it then ends that process alone.
    try:
        code = subprocess.run(
            # -P: a `jsbsim.py` in the working directory must not be imported.
            [sys.executable, "-P", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=time_limit,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        return f"it did not within {time_limit:.0f} s"
    return f"it ended the process that tried: {ending_of(code)}" if code else ""


def _unweighed(config: AircraftConfig) -> NoReturn:
    raise AssertionError(f"{config.file}: the nominal aircraft needs no weighing")
