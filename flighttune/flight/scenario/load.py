"""Files to values; faults are reported in one line that names file and key.

Keys are dotted paths; this module finds and sets their places.
"""

import json
import os
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError

from flighttune.base.errors import InputError, ScenarioError, naming
from flighttune.base.files import code
from flighttune.base.files.budget import MAX_NAME
from flighttune.base.files.shipped import (
    aircraft_folders,
    campaign_files,
    nearest_name,
    scenario_files,
)
from flighttune.base.files.table import (
    abridged,
    json_tables,
    mistakes,
    shown,
    toml_tables,
    toml_text,
    validated,
)
from flighttune.base.files.whole import current, write_text
from flighttune.control.gains import PIGains
from flighttune.control.gains_keys import GainsTable
from flighttune.control.law import DEFAULT
from flighttune.control.law_keys import LawTable
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.mission import read_route
from flighttune.vehicles.plant_keys import PlantTable

# Names of tables and positions in arrays from the top of a scenario to a value
Place: TypeAlias = tuple[str | int, ...]

SEGMENT = r"[\w/+-]+(?:\[[^\[\]]+\])*"
PATH = re.compile(rf"{SEGMENT}(?:\.{SEGMENT})*")


def places_of(key: str, tables: Mapping[str, Any], value: Any) -> tuple[Place, ...]:
    """Every place of a scenario for a dotted key."""
    if len(key) > MAX_NAME or not PATH.fullmatch(key):
        raise InputError(
            "must be names joined by dots, each with [position] or [name] after it, and have at "
            f"most {MAX_NAME} characters"
        )
    # a position in brackets is a step of its own, `[0]`
    steps = tuple(re.findall(r"\[[^\[\]]+\]|[^.\[\]]+", key))
    # Without a position, ``plant`` means every plant that can have this `value`; ``plant[LABEL]``
    # means the plant with this label.
    if steps[0] == "plant" and not (steps[1:] and steps[1].startswith("[")):
        return _of_plants(steps[1:], tables["plant"], value)
    return (_walked(steps, tables),)


def value_at(tables: Any, place: Iterable[str | int]) -> Any:
    """The value at a place; None if the place is empty."""
    value: Any = tables
    for step in place:
        if isinstance(value, Mapping):
            value = value.get(step)
        else:
            value = value[step] if isinstance(value, list) and isinstance(step, int) else None
    return value


def with_values(tables: Mapping[str, Any], values: Iterable[tuple[Place, Any]]) -> dict[str, Any]:
    """A copy of `tables` with values set; the copy shares unchanged tables."""
    changed = dict(tables)
    for place, value in values:
        changed = _with_value(changed, place, value)
    return changed


def _with_value(table: Any, place: Place, value: Any) -> Any:
    step, *below = place
    changed: Any = list(table) if isinstance(table, list) else dict(table or {})
    if below:
        inside = changed[step] if isinstance(step, int) else changed.get(step)
        value = _with_value(inside, (*below,), value)
    changed[step] = value
    return changed


def with_changes(
    tables: Mapping[str, Any], changes: Mapping[str, Any], source: str
) -> dict[str, Any]:
    """The tables of a scenario with values set by dotted keys; `source` is named in errors."""
    changed = dict(tables)
    for key, value in leaves(changes):
        try:
            places = places_of(key, changed, value)
        except InputError as error:
            stop = "" if str(error).endswith("?") else "."
            raise ScenarioError(f"{source} `{shown(key)}` {error}{stop}") from None
        changed = with_values(changed, [(place, value) for place in places])
    return changed


def leaves(tables: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of nested tables; a list counts as a value."""
    for name, value in tables.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def _walked(steps: tuple[str, ...], tables: Mapping[str, Any]) -> Place:
    place: list[str | int] = []
    table: Any = tables
    for step in steps:
        name, where = step.strip("[]"), spelled(place)
        if isinstance(table, list):
            if not step.startswith("["):
                raise InputError(f"must say which of `{where}` is meant, by its position: [0], ...")
            labels = [_label(each) for each in table if where == "plant"]
            digits = name.isascii() and name.isdigit()
            position = labels.index(name) if name in labels else int(name) if digits else -1
            if not 0 <= position < len(table):
                label = f" or a label ({', '.join(filter(None, labels))})" if labels else ""
                raise InputError(
                    f"must be a position, 0 to {len(table) - 1},{label} of `{where}`, got {step}"
                )
            place.append(position)
        elif isinstance(table, Mapping) or table is None:
            place.append(name)
        else:
            raise InputError(f"must be a key of a table, but `{where}` is {abridged(table)}")
        table = value_at(table, place[-1:])
    return tuple(place)


def _label(plant: Any) -> str:
    """The label of a plant's table; None while a value in it is wrong."""
    try:
        return PlantTable.model_validate(plant).label
    except ValidationError:
        return ""


def _of_plants(
    steps: tuple[str, ...], plants: list[dict[str, Any]], value: Any
) -> tuple[Place, ...]:
    if not steps:
        raise InputError("must be a key of a plant, got the plants themselves")
    flyable: list[Place] = []
    refusals: list[str] = []
    for i, table in enumerate(plants):
        place = _walked(steps, table)
        changed = with_values(table, [(place, value)])
        try:
            PlantTable.model_validate(changed)
        except ValidationError as error:
            refusals.append(mistakes(error, changed, PlantTable))
        else:
            flyable.append(("plant", i, *place))
    if not flyable:
        raise InputError(f"must be a key of a plant that flies: {refusals[-1].removesuffix('.')}")
    return tuple(flyable)


def spelled(place: Iterable[str | int]) -> str:
    """A place as a dotted path, ``plant[0].airframe.mass_factor``."""
    words = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)
    return "".join(words).removeprefix(".")


# Tolerance between the start's height in a scenario and in a file, m.
SAME_HEIGHT = 1.0

# Endings of files of gains.
GAINS_FILES = (".json", ".toml")


def title_with(tables: Mapping[str, Any], changes: Mapping[str, Any]) -> Any:
    """The title of a scenario or campaign, with its changed values."""
    values = [
        f"{key} = {json.dumps(value, default=str)}"
        for key, value in leaves(changes)
        if key != "title"
    ]
    title = tables.get("title")
    return f"{title} ({', '.join(values)})" if values and isinstance(title, str) else title


def as_arguments(source: str | Path, changes: Mapping[str, Any] | None) -> str:
    """A scenario and its changed values as arguments of a command."""
    words = (("--set", f"{key}={json.dumps(value)}") for key, value in leaves(changes or {}))
    return shlex.join([str(source), *chain(*words)])


def with_gains(
    scenario: Scenario, names: Sequence[str], source: str, tables: Sequence[GainsTable] = ()
) -> Scenario:
    """The scenario with these gain sets instead of its own, and the requirements for them."""
    listed = [entry for entry in scenario.gains if isinstance(entry, GainsTable)]
    by_name = {entry.name: entry for entry in (*listed, *tables)}
    laws: dict[str, LawTable] = {}
    entries: list[str | GainsTable] = []
    wanted: list[str] = []
    for name in names:
        entry: str | GainsTable
        if not isinstance(name, str | Path):
            got = type(name).__name__
            raise InputError(f"`gains` must be names or files (which its .save writes), got {got}.")
        if Path(name).suffix.lower() in GAINS_FILES:
            entry = gains_table(Path(name))
            gains, law = entry.name, f"{scenario.law_of('', entry.gains())[0].name}:"
        else:
            gains, law = scenario.listed_as(name), name
            entry = by_name.get(gains, gains)
        flown_by = scenario.law_table(law)
        laws[flown_by.name] = flown_by
        wanted += flown_by.law.names_of([gains])
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
    return chosen.model_copy(update={"expect": expect}).assuming()


def gains_table(path: Path) -> GainsTable:
    """The gain set in a file, named like the file without its ending."""
    tables = json_tables(path) if path.suffix.lower() == ".json" else toml_tables(path)
    keys = ("K_P", "K_I", "law", "feedback", "tuned_for")
    kept = {key: tables[key] for key in keys if key in tables}
    name = re.sub(r"[^\w.*+-]", "_", path.stem)
    return validated(GainsTable, {"name": name, "law": DEFAULT, **kept}, str(path))


def gain_entries(entries: Any, folder: Path) -> Any:
    """The list ``gains`` of a file in `folder`, with files of gains replaced by their gain sets."""
    if not isinstance(entries, list):
        return entries
    return [
        gains_table(folder / entry).model_dump()
        if isinstance(entry, str) and Path(entry).suffix.lower() in GAINS_FILES
        else entry
        for entry in entries
    ]


def _name_beside(table: dict[str, Any], key: str, folder: Path) -> None:
    """Replace the name of an aircraft or model file beside a scenario by its path.

    An aircraft is in the scenario's `folder` or in its folder ``aircraft``; that of the working
    directory is one of `flighttune.base.files.shipped.aircraft_places`.
    """
    name = table.get(key)
    if not isinstance(name, str):
        return
    places = [folder / name]
    if folder != Path() and Path(name).name == name:
        places.append(folder / "aircraft" / name)
    for beside in places:
        model = name.endswith(".json") and os.path.isfile(beside)
        if model or os.path.isfile(beside / "aircraft.toml"):
            # A path without a separator means the name of an aircraft.
            table[key] = str(beside) if len(beside.parts) > 1 else os.path.join(".", beside)
            return


def with_code(tables: dict[str, Any], path: Path) -> dict[str, Any]:
    """Tables with the paths and hashes of the Python files beside the file."""
    for key in ("law", "plant"):
        for table in _listed(tables, key):
            if isinstance(module := table.get("module"), str):
                file = path.parent / module
                table["module"] = str(file)
                table.setdefault("sha256", code.named_sha256(file, f"{path}: [[{key}]]"))
    return tables


def _listed(tables: dict[str, Any], key: str) -> list[dict[str, Any]]:
    """The tables of a list; other values are refused later."""
    entries = tables.get(key)
    return [x for x in entries if isinstance(x, dict)] if isinstance(entries, list) else []


def with_files(tables: dict[str, Any], path: Path) -> dict[str, Any]:
    """Tables with modules and aircraft resolved beside the scenario; modules have their hash."""
    folder = path.parent
    with_code(tables, path)
    for table in _listed(tables, "plant"):
        _name_beside(table, "aircraft", folder)
        _name_beside(table, "identified", folder)
    if isinstance(tables.get("tuning"), dict):
        _name_beside(tables["tuning"], "identified", folder)
    route = tables.get("route")
    if isinstance(route, dict) and "file" in route:
        _add_waypoints(tables, route, path)
    if "gains" in tables:
        tables["gains"] = gain_entries(tables["gains"], folder)
    return tables


def _add_waypoints(tables: dict[str, Any], route: dict[str, Any], path: Path) -> None:
    """Replace a route's file, beside the scenario, by its waypoints, and add its heights."""
    kept = {key: value for key, value in route.items() if key not in ("file", "skip")}
    file, skip = route["file"], route.get("skip", False)
    if "waypoint" in route or not isinstance(file, str) or not isinstance(skip, bool):
        raise ScenarioError(f"{path}: [route] `file` must be a name in place of `waypoint`.")
    with naming(f"{path}: [route] `file`", ScenarioError):
        mission = read_route(path.parent / file, skip=skip)
    tables["route"] = mission.route | kept
    if isinstance(tables.get("flight"), dict):
        tables["flight"] = flight = mission.flight | tables["flight"]
        h, start = flight.get("h_m"), mission.flight.get("h_m")
        if start is not None and isinstance(h, int | float) and abs(h - start) > SAME_HEIGHT:
            raise ScenarioError(
                f"{path}: [flight] `h_m` must be {start:g}, the height of the first waypoint in "
                f"{file}, or absent, got {h:g} m."
            )


def as_recorded(tables: Any) -> Any:
    """Tables of a recorded scenario; an older version's start in wind gets its key."""
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
    return validated(Scenario, tables, "scenario").assuming()


def save_scenario(scenario: Scenario, path: Path) -> None:
    """Write a scenario (.toml) that flies from anywhere: paths of its files are absolute."""
    tables = scenario.as_dict()
    for table in (*tables.get("law", ()), *tables["plant"], tables["tuning"]):
        for key in ("module", "aircraft", "identified"):
            # an aircraft without a separator is a shipped one
            if key in table and (key == "module" or Path(table[key]).name != table[key]):
                table[key] = str(Path(table[key]).absolute())
    write_text(path, toml_text(tables))


def scenario_of(run: Run) -> Scenario:
    """The scenario of a run, which takes a quarter of a millisecond."""
    return scenario_from(dict(run.provenance.scenario))


def from_level(scenario: Scenario) -> Scenario:
    """A flight that turns back, with a level start; laws and plants keep their classes."""
    turns, tables = scenario.turn_back, scenario.as_dict()
    assert turns is not None  # other flights begin as stated
    wind = (0.0, 0.0)
    if scenario.wind is not None:
        wind = scenario.wind.profile().at(turns.here[5])[:2]
    tables["turn_back"]["sloped_s"] = turns.time_on_slope(*wind)
    kept = {"law": scenario.law, "plant": scenario.plant}
    return scenario_from(tables).model_copy(update=kept)


def gains_notes(runs: Iterable[Run]) -> list[str]:
    """`Scenario.gains_notes` for the flown gains of runs, each once."""
    notes: dict[str, None] = {}
    for run in runs:
        made_by = run.provenance
        # a log has no gains, and the scenario of an older version may no longer be valid
        if any("tuned_for" in entry for entry in made_by.scenario.get("gains", ())):
            notes |= dict.fromkeys(scenario_of(run).gains_notes(gains=made_by.gains_name))
        notes |= dict.fromkeys(made_by.scenario.get("assumed") or ())
    return [*notes]


def load_gains(path: str | Path) -> PIGains:
    """Read gains of the roll and load-factor loop from a JSON or TOML file.

    Parameters
    ----------
    path : path-like
        A file with ``K_P`` and ``K_I``, each two rows (phi, n_z) of two numbers (chi, gamma), and
        ``law = "exact"`` if the rows are rates, perhaps with ``feedback``; other keys (as in the
        output of `tune --json`) are ignored.

    Returns
    -------
    PIGains
        The gains.

    Raises
    ------
    ScenarioError
        If the file cannot be read or does not have such gains.

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
    """A file, or a shipped file by its name, perhaps with ending and one of its `folders`."""
    file = Path(path)
    if current(file).is_file():
        if file.suffix.lower() not in ("", ".toml"):
            also = "a file of another kind that the command reads"
            raise ScenarioError(f"{path}: must be a {kind} (.toml), or {also}, got {file.suffix}.")
        return file
    name = file.name.removesuffix(".toml")
    if name in shipped and file.parent in (Path(), *map(Path, folders)):
        return shipped[name]
    if os.path.exists(file) and not os.path.isdir(file):
        raise ScenarioError(f"{path}: the {kind} must be a regular file, got a pipe or a device.")
    taken_by = {
        "a scenario": ("fly", scenario_files()),
        "a campaign": ("campaign", campaign_files()),
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
