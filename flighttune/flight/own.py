"""The user's laws and plants: classes from Python or from files, loaded when they fly."""

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from flighttune.base.errors import ScenarioError
from flighttune.base.files import code
from flighttune.base.files.table import validated
from flighttune.control.controller import FAILURES, Controller, failure
from flighttune.control.law_keys import LawTable
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.plants.base import Plant

# Called with a `LawSetup` and the parameters of a scenario's table, for every flight.
LawMaker = Callable[..., Controller]

# Called with the parameters of a scenario's table, for every flight.
PlantMaker = Callable[..., Plant]

T = TypeVar("T", LawTable, PlantTable)


def with_own(
    scenario: Scenario,
    laws: Mapping[str, LawMaker] | None = None,
    plants: Mapping[str, PlantMaker] | None = None,
    *,
    flown: Collection[str] | None = None,
) -> Scenario:
    """A scenario with the classes of the user's laws and plants in its tables.

    Only files of laws and plants that are `flown`, by name, are run; by default all.
    """
    laws, plants = laws or {}, plants or {}
    # The caller's laws and plants are flown in addition to the scenario's, or replace tables of the
    # same name.
    names = {law.name for law in scenario.laws}
    more = [_python(name, made) for name, made in laws.items() if name not in names]
    labels = {plant.label for plant in scenario.plant}
    others = [_python(name, made) for name, made in plants.items() if name not in labels]
    if more or others:
        tables = scenario.as_dict()
        listed = [law.model_dump(exclude_none=True) for law in scenario.law_tables]
        tables |= {"law": [*listed, *more], "plant": [*tables["plant"], *others]}
        scenario = validated(Scenario, tables, "`laws`, `plants`")
    if not any(table.of_the_user for table in (*scenario.law_tables, *scenario.plant)):
        return scenario
    bound = {
        "law": scenario.law and _bound(scenario, "law", scenario.law, laws, flown),
        "plant": _bound(scenario, "plant", scenario.plant, plants, flown),
    }
    return scenario.model_copy(update=bound)


def _bound(
    scenario: Scenario,
    key: str,
    tables: Sequence[T],
    made: Mapping[str, Callable[..., Any]],
    flown: Collection[str] | None,
) -> list[T]:
    """The tables with the classes of the user's laws or plants."""
    bound = list(tables)
    for i, table in enumerate(tables):
        maker = made.get(table.name or "")
        flies = flown is None or table.name in flown
        if table.of_the_user and (maker or (flies and table.maker is None)):
            bound[i] = table.made_by(maker or _loaded(scenario.title, key, table))
    return bound


def ask_to_fly(scenario: Scenario, flown: Collection[str] | None = None) -> None:
    """Give notice of the Python files of laws and plants; ScenarioError if they may not run."""
    for key, table in scenario.of_files(flown):
        code.ask(table.module or "", table.sha256, _where(scenario.title, key, table))


def _python(name: str, made: Any) -> dict[str, Any]:
    """The table of a law or plant from Python, with the hash of its file, if any."""
    target = getattr(made, "func", made)  # the class inside a functools.partial
    table: dict[str, Any] = {"name": name, "kind": "python"}
    if getattr(target, "takes_gains", False):
        table["takes_gains"] = True
    try:
        file = inspect.getsourcefile(target)
        if file is None:
            return table
        return {**table, "sha256": sha256(Path(file).read_bytes()).hexdigest()}
    except (TypeError, OSError):
        return table


def _where(title: str, key: str, table: LawTable | PlantTable) -> str:
    return f"{title}: [[{key}]] {table.name}:"


def _loaded(title: str, key: str, table: LawTable | PlantTable) -> Any:
    where, file = _where(title, key, table), table.module
    if file is None or table.class_ is None:
        raise ScenarioError(
            f"{where} `module` and `class` must be given in the scenario, or the class from "
            f"Python, `{key}s={{{table.name!r}: ...}}`."
        )
    content = code.ask(file, table.sha256, where)
    try:
        members = vars(code.run(file, content))
    except FAILURES as error:
        raise ScenarioError(failure(f"{where} {file}", error, None)) from error
    if table.class_ not in members:
        own = [name for name, value in members.items() if isinstance(value, type)]
        raise ScenarioError(
            f"{where} `class` must be one of {file} ({', '.join(own) or 'which has none'}), got "
            f"{table.class_}."
        )
    return members[table.class_]
