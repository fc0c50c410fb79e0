"""Files to values, and what is wrong with them in one line that names file and key."""

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from flighttune.control.gains import PIGains
from flighttune.control.law import DEFAULT, split_name
from flighttune.errors import InputError, ScenarioError
from flighttune.files.mistakes import abridged, validated
from flighttune.files.shipped import aircraft_folders, campaign_files, nearest_name, scenario_files
from flighttune.files.table import json_tables, toml_tables
from flighttune.files.whole import reason_of
from flighttune.references.mission import read_route
from flighttune.scenario.places import leaves
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.scenario.tables import LawTable
from flighttune.simulate.run import Run

# Largest difference of the height that a scenario states for its start from that of a file, m.
SAME_HEIGHT = 1.0

# Endings of files of gains.
GAINS_FILES = (".json", ".toml")


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
    """The scenario with these gain sets in place of its own, and the requirements about them."""
    listed = [entry for entry in scenario.gains if isinstance(entry, GainsTable)]
    by_name = {entry.name: entry for entry in (*listed, *tables)}
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
            entry = by_name.get(gains, gains)
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
    kept = {key: tables[key] for key in ("K_P", "K_I", "law", "tuned_for") if key in tables}
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


def _name_beside(table: dict[str, Any], key: str, folder: Path) -> None:
    """Put the path of an aircraft or model file that lies in `folder` in the place of its name."""
    name = table.get(key)
    if not isinstance(name, str):
        return
    beside = folder / name
    model = name.endswith(".json") and os.path.isfile(beside)
    if model or os.path.isfile(beside / "aircraft.toml"):
        # A path without a separator is the name of an aircraft.
        table[key] = str(beside) if len(beside.parts) > 1 else os.path.join(".", beside)


def with_files(tables: dict[str, Any], path: Path) -> dict[str, Any]:
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
    plants = listed.get("plant", ())
    named = [(table, "aircraft") for table in plants]
    if isinstance(tables.get("tuning"), dict):
        named.append((tables["tuning"], "identified"))
    named += [(table, "identified") for table in plants]
    for table, key in named:
        _name_beside(table, key, path.parent)
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
    tables["route"] = mission.route | kept
    if isinstance(tables.get("flight"), dict):
        tables["flight"] = flight = mission.flight | tables["flight"]
        h, start = flight.get("h_m"), mission.flight.get("h_m")
        if start is not None and isinstance(h, int | float) and abs(h - start) > SAME_HEIGHT:
            raise ScenarioError(
                f"{path}: [flight] `h_m` must be {start:g}, the height of the first waypoint in "
                f"{file}, or absent, got {h:g} m."
            )


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


def scenario_of(run: Run) -> Scenario:
    """The scenario that a run was flown in, which takes a quarter of a millisecond."""
    return scenario_from(dict(run.provenance.scenario))


def gains_notes(runs: Iterable[Run]) -> list[str]:
    """`Scenario.gains_notes` of the gains that runs flew, each once."""
    notes: dict[str, None] = {}
    for run in runs:
        made_by = run.provenance
        # a log has no gains, and the scenario of an older version may no longer be valid
        if any("tuned_for" in entry for entry in made_by.scenario.get("gains", ())):
            said = scenario_of(run).gains_notes(gains=made_by.gains_name)
            notes |= dict.fromkeys(said)
    return [*notes]


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
    """A file, or the shipped one of that name, maybe with its ending and one of its `folders`."""
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
