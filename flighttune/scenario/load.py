"""Files to values, and what is wrong with them in one line that names file and key."""

import json
import os
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import Any

from flighttune.aircraft.aircraft import AircraftConfig, load_aircraft, start_faults
from flighttune.control.gains import PIGains
from flighttune.control.law import DEFAULT, split_name
from flighttune.errors import InputError, ScenarioError
from flighttune.files.mistakes import abridged, joined, validated
from flighttune.files.shipped import aircraft_folders, campaign_files, nearest_name, scenario_files
from flighttune.files.table import json_tables, toml_tables
from flighttune.files.whole import reason_of
from flighttune.identification.file import load_identified
from flighttune.plants.jsbsim.plant import check_off_nominal
from flighttune.references.mission import read_route
from flighttune.scenario.places import leaves, with_changes
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.scenario.tables import TUNED_IDENTIFIED, LawTable, PlantTable
from flighttune.units import DEG

# Largest difference of the height that a scenario states for its start from that of a file, m.
SAME_HEIGHT = 1.0

# Key of [flight] for each attribute of a condition that an aircraft bounds.
FLIGHT_KEYS = {"V_a": "V_a_mps", "h": "h_m", "phi": "phi_deg", "n_z": "n_z"}

# Longest flight along the route of a file, s.
LONGEST_S = 10_000.0

# Endings of files of gains.
GAINS_FILES = (".json", ".toml")


def load_scenario(
    path: str | Path, *, changes: Mapping[str, Any] | None = None, gains: Sequence[str] = ()
) -> Scenario:
    """Read and check a scenario file.

    Parameters
    ----------
    path : path-like
        A TOML file, or the name of a scenario that ships with the package.
    changes : mapping of str to value, optional
        Values to set by dotted key, ``{"flight.V_a_mps": 30.0}``; the title then names them.
    gains : sequence of str, optional
        Gain sets in place of the scenario's: names as runs have them, or files.

    Returns
    -------
    Scenario
        Frozen and valid.

    Raises
    ------
    ScenarioError
        If the file cannot be read, a key is unknown, missing or impossible, or an aircraft does not
        exist or cannot start where it shall, or a model named in [tuning] cannot be read.

    Examples
    --------
    >>> ft.load_scenario("level_turn").flight.V_a_mps
    25.0
    """
    path = existing_file(path, "scenario", scenario_files(), ["scenarios"])
    tables, source = _with_files(toml_tables(path), path), str(path)
    scenario = validated(Scenario, tables, source)
    if changes:
        source = f"{path} with its changes"
        tables = with_changes(scenario.as_dict(), changes, f"{source}:")
        scenario = validated(Scenario, tables | {"title": title_with(tables, changes)}, source)
    check_aircraft(scenario, source)
    check_identified(scenario, source)
    return with_gains(scenario, gains, source) if gains else scenario


def as_scenario(
    source: Scenario | str | Path,
    changes: Mapping[str, Any] | None = None,
    gains: Sequence[str] = (),
) -> Scenario:
    """A scenario as it is, from a file, or that of a name, with other gain sets if there are any.

    Raises InputError if there are `changes` to a scenario that is not read from a file.
    """
    if not isinstance(source, Scenario):
        return load_scenario(source, changes=changes, gains=gains)
    if changes:
        raise InputError(
            f"`changes` must be absent for a scenario that is not read from a file, got "
            f"{', '.join(changes)}."
        )
    return with_gains(source, gains, source.title) if gains else source


def as_arguments(source: str | Path, changes: Mapping[str, Any] | None) -> str:
    """A scenario and values set in it as the arguments of a command."""
    words = (("--set", f"{key}={json.dumps(value)}") for key, value in leaves(changes or {}))
    return shlex.join([str(source), *chain(*words)])


def title_with(tables: Mapping[str, Any], changes: Mapping[str, Any]) -> Any:
    """The title of a scenario or campaign with the values set in it."""
    values = [
        f"{key} = {json.dumps(value, default=str)}"
        for key, value in leaves(changes)
        if key != "title"
    ]
    title = tables.get("title")
    return f"{title} ({', '.join(values)})" if values and isinstance(title, str) else title


def with_gains(
    scenario: Scenario, names: Sequence[str], source: str, tables: Sequence[GainsTable] = ()
) -> Scenario:
    """The scenario with these gain sets in place of its own, and the requirements about them.

    A name is one that runs can have (``tuned``, ``exact:tuned``, one of the scenario's or of
    `tables`), or a file, whose gains are flown by the first law of the scenario that they fit.
    Errors name `source`.
    """
    listed = [entry for entry in scenario.gains if isinstance(entry, GainsTable)]
    own = {entry.name: entry for entry in (*listed, *tables)}
    laws: dict[str, LawTable] = {}
    entries: list[str | GainsTable] = []
    wanted: list[str] = []
    for name in names:
        entry: str | GainsTable
        if Path(name).suffix.lower() in GAINS_FILES:
            entry = gains_table(Path(name))
            gains, law = entry.name, f"{scenario.law_of('', entry.gains())[0].name}:"
        else:
            gains, law = split_name(name)[1], name
            entry = own.get(gains, gains)
        flown_by = scenario.law_table(law)
        laws[flown_by.name] = flown_by
        wanted += flown_by.law().names_of([gains])
        if entry not in entries:
            entries.append(entry)
    changed: dict[str, Any] = {"gains": entries, "expect": []}
    if [*laws] != [law.name for law in scenario.laws]:
        changed["law"] = [*laws.values()]
    chosen = validated(Scenario, scenario.model_copy(update=changed).as_dict(), source)
    if sorted(wanted) != sorted(chosen.gain_names):
        raise InputError(
            f"{source}: `gains` must be the same for every law ({', '.join(laws)}) and name "
            f"nothing twice, got {', '.join(names)}."
        )
    expect = [table for table in scenario.expect if table.gains in (None, *chosen.gain_names)]
    return chosen.model_copy(update={"expect": expect})


def gains_table(path: Path) -> GainsTable:
    """The gain set in a file, called by the name of the file without its ending."""
    tables = json_tables(path) if path.suffix.lower() == ".json" else toml_tables(path)
    kept = {key: tables[key] for key in ("K_P", "K_I", "law") if key in tables}
    name = re.sub(r"[^\w.*+-]", "_", path.stem)
    return validated(GainsTable, {"name": name, "law": DEFAULT, **kept}, str(path))


def gain_entries(entries: Any, folder: Path) -> Any:
    """The list ``gains`` of a file in `folder`, with gain sets in place of files of them."""
    if not isinstance(entries, list):
        return entries
    return [
        gains_table(folder / entry).model_dump()
        if isinstance(entry, str) and Path(entry).suffix.lower() in GAINS_FILES
        else entry
        for entry in entries
    ]


def _with_files(tables: dict[str, Any], path: Path) -> dict[str, Any]:
    """Tables whose modules and aircraft are those beside the scenario; modules have their hash."""
    listed = {
        key: [table for table in tables[key] if isinstance(table, dict)]
        for key in ("law", "plant")
        if isinstance(tables.get(key), list)
    }
    for key, entries in listed.items():
        for table in entries:
            module = table.get("module")
            if isinstance(module, str):
                file = path.parent / module
                if not os.path.isfile(file):  # False for what can be no name of a file
                    raise ScenarioError(
                        f"{path}: [[{key}]] `module` must be a file, got {abridged(module)}."
                    )
                table["module"] = str(file)
                try:
                    table.setdefault("sha256", file_sha256(file))
                except OSError as error:
                    raise ScenarioError(
                        f"{path}: [[{key}]] `module` must be a file that can be read, got {file}: "
                        f"{reason_of(error)}."
                    ) from error
    named = [(table, "aircraft") for table in listed.get("plant", ())]
    if isinstance(tables.get("tuning"), dict):
        named.append((tables["tuning"], "identified"))
    for table, key in named:
        name = table.get(key)
        if isinstance(name, str) and os.path.isfile(path.parent / name / "aircraft.toml"):
            beside = path.parent / name
            # A path without a separator is the name of an aircraft.
            table[key] = str(beside) if len(beside.parts) > 1 else os.path.join(".", beside)
    route = tables.get("route")
    if isinstance(route, dict) and "file" in route:
        _add_waypoints(tables, route, path)
    if "gains" in tables:
        tables["gains"] = gain_entries(tables["gains"], path.parent)
    return tables


def _add_waypoints(tables: dict[str, Any], route: dict[str, Any], path: Path) -> None:
    """Replace the file of a route, beside the scenario, by its waypoints, and add its heights."""
    kept = {key: value for key, value in route.items() if key not in ("file", "skip")}
    file, skip = route["file"], route.get("skip", False)
    if "waypoint" in route or not isinstance(file, str) or not isinstance(skip, bool):
        raise ScenarioError(f"{path}: [route] `file` must be a name in place of `waypoint`.")
    try:
        mission = read_route(path.parent / file, skip=skip)
    except InputError as error:
        raise ScenarioError(f"{path}: [route] `file`: {error}") from error
    tables["route"] = {**kept, "waypoint": mission.waypoint, "notes": mission.notes}
    if isinstance(tables.get("flight"), dict):
        tables["flight"] = flight = mission.flight | tables["flight"]
        h, start = flight.get("h_m"), mission.flight.get("h_m")
        if start is not None and isinstance(h, int | float) and abs(h - start) > SAME_HEIGHT:
            raise ScenarioError(
                f"{path}: [flight] `h_m` must be {start:g}, the height of the first waypoint in "
                f"{file}, or absent, got {h:g} m."
            )


def route_scenario(
    file: Path, aircraft: str, *, skip: bool = False, changes: Mapping[str, Any] | None = None
) -> Scenario:
    """A scenario in which an aircraft flies the route of a file, within limits of its own."""
    first, mission = load_identified(aircraft).conditions[0], read_route(file, skip=skip)
    condition = {"V_a_mps": first.V_a, "h_m": first.h, "duration_s": LONGEST_S}
    tables = {
        "title": file.stem,
        "gains": [TUNED_IDENTIFIED],
        "flight": condition | mission.flight,
        "route": {"waypoint": mission.waypoint, "notes": mission.notes},
        "controller": {"feed_forward": True},
        "tuning": {"identified": aircraft},
        "plant": [{"kind": "jsbsim", "aircraft": aircraft}],
    }
    tables = with_changes(tables, changes or {}, f"{file}:")
    scenario = validated(Scenario, tables, str(file))
    check_aircraft(scenario, str(file))
    return scenario


def file_sha256(path: Path) -> str:
    """Hash of a file's contents."""
    return sha256(path.read_bytes()).hexdigest()


def as_recorded(tables: Any) -> Any:
    """Tables of a recorded scenario, with the start in wind of versions that had no key for it."""
    flight = tables.get("flight") if isinstance(tables, Mapping) else None
    if not isinstance(flight, Mapping):
        return tables
    return {**tables, "flight": {"start": "heading", **flight}}


def scenario_from(tables: dict[str, Any]) -> Scenario:
    """Check a scenario given as nested dictionaries with the keys of a scenario file.

    Raises
    ------
    ScenarioError
        If a key is unknown, missing or impossible.

    Examples
    --------
    >>> tables = ft.load_scenario("level_turn").as_dict()
    >>> tables["flight"]["V_a_mps"] = 30.0
    >>> ft.scenario_from(tables).flight.V_a_mps
    30.0
    """
    return validated(Scenario, tables, "scenario")


def load_gains(path: str | Path) -> PIGains:
    """Read gains of the roll and load-factor loop from a JSON or TOML file.

    Parameters
    ----------
    path : path-like
        A file with ``K_P`` and ``K_I``, each two rows (phi, n_z) of two numbers (chi, gamma), and
        ``law = "exact"`` where the rows are rates;
        other keys (as `tune --json` writes them) are passed over.

    Returns
    -------
    PIGains
        The gains.

    Raises
    ------
    ScenarioError
        If the file cannot be read or does not hold such gains.

    Examples
    --------
    >>> from pathlib import Path
    >>> text = '{"K_P": [[1.7, 0.0], [0.0, 2.5]], "K_I": [[0.6, 0.0], [0.0, 1.1]]}'
    >>> size = Path("mine.json").write_text(text)
    >>> ft.load_gains("mine.json").K_P.diagonal().tolist()
    [1.7, 2.5]
    """
    return gains_table(Path(path)).gains()


def existing_file(
    path: str | Path, kind: str, shipped: Mapping[str, Path], folders: Sequence[str]
) -> Path:
    """A file, or the shipped one of that name.

    The name may have the ending and one of the `folders` of the shipped file; `kind` is the kind of
    file for the message.
    """
    file = Path(path)
    if file.is_file():
        return file
    name = file.name.removesuffix(".toml")
    if name in shipped and file.parent in (Path(), *map(Path, folders)):
        return shipped[name]
    taken_by = {
        "a scenario": ("fly", scenario_files()),
        "a campaign": ("campaign run", campaign_files()),
        "an aircraft": ("trim", aircraft_folders()),
    }
    uses = [
        f"; {name} is {other}: `flighttune {command} {name}`."
        for other, (command, names) in taken_by.items()
        if kind not in other and name in names
    ]
    raise ScenarioError(
        f"{path}: there is no such file: the {kind} must be a file or a name that "
        f"`flighttune list` prints{next(iter(uses), nearest_name(name, shipped))}"
    )


def check_aircraft(scenario: Scenario, source: str) -> None:
    """Refuse a scenario that one of its aircraft cannot start.

    Steady flight at the start is not required here: without it a run ends with a status. The
    ScenarioError names `source`, the file of the scenario, and every key, or the first reason why a
    route cannot be planned.
    """
    try:
        if scenario.route is not None:
            scenario.followed()
        faults = {fault: None for plant in scenario.plant for fault in _faults(scenario, plant)}
        if scenario.feasible and not faults:
            scenario.followed()
    except InputError as error:
        raise ScenarioError(f"{source}: {error}") from error
    if faults:
        raise ScenarioError(f"{source}: {joined(faults)}")


def check_identified(scenario: Scenario, source: str) -> None:
    """Refuse a scenario whose identified model cannot be read, naming `source` and key."""
    if scenario.tuning.identified is None:
        return
    try:
        load_identified(scenario.tuning.identified)
    except InputError as error:
        raise ScenarioError(
            f"{source}: [tuning] `identified` must be an aircraft or a model file: {error}"
        ) from error


def _faults(scenario: Scenario, plant: PlantTable) -> Iterator[str]:
    if plant.aircraft is None:
        return
    try:
        config = load_aircraft(plant.aircraft)
    except InputError as error:
        reason = str(error)
        if not reason.startswith("`aircraft` must"):
            reason = f"`aircraft` must be one that can be read: {reason}"
        yield f"[plant] {reason}"
        return
    if plant.throttle_max is not None:
        try:
            config.with_throttle_max(plant.throttle_max)
        except InputError as error:
            yield f"[plant] {error}"
    if plant.airframe is not None:
        try:
            check_off_nominal(config.with_off_nominal(plant.airframe))
        except InputError as error:
            yield f"[plant.airframe] {error}"
    ground = scenario.flight.ground_m
    for name, fault in start_faults(config, scenario.condition, ground):
        yield f"[flight] `{FLIGHT_KEYS[name]}` {fault}"
    yield from _limit_faults(scenario, config)


def _limit_faults(scenario: Scenario, config: AircraftConfig) -> Iterator[str]:
    """Ranges of commands that do not overlap with those of the aircraft."""
    limits = scenario.limits
    for key, asked, (low, high), unit, symbol in (
        ("phi_deg", limits.phi_deg, config.limits.phi, DEG, " deg"),
        ("n_z", limits.n_z, config.limits.n_z, 1.0, ""),
    ):
        if asked is not None and not (asked[0] < high / unit and low / unit < asked[1]):
            yield (
                f"[limits] `{key}` must overlap {low / unit:g} to {high / unit:g}{symbol} "
                f"({config.file}), got {asked}"
            )
