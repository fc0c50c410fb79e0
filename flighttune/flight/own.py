"""Laws and plants of the user's: classes given from Python, or in files that a scenario names."""

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from functools import lru_cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from flighttune.control.controller import Controller
from flighttune.control.guarded import FAILURES, failure
from flighttune.errors import ScenarioError
from flighttune.flight.apart import before_running
from flighttune.plants.base import Plant
from flighttune.scenario.load import file_sha256, module_sha256
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import LawTable, PlantTable

# Called with a `LawSetup` and the parameters of a scenario's table, for every flight.
LawMaker = Callable[..., Controller]

# Called with the parameters of a scenario's table, for every flight.
PlantMaker = Callable[..., Plant]

T = TypeVar("T", LawTable, PlantTable)


def with_own(
    scenario: Scenario,
    laws: Mapping[str, LawMaker] | None = None,
    plants: Mapping[str, PlantMaker] | None = None,
) -> Scenario:
    """A scenario whose tables of the user's laws and plants hold their classes."""
    laws, plants = laws or {}, plants or {}
    # Laws and plants from the caller are flown besides those of the scenario, or in place of its
    # tables of that name.
    names = {law.name for law in scenario.laws}
    more = [_python(name, made) for name, made in laws.items() if name not in names]
    labels = {plant.label for plant in scenario.plant}
    flown = [_python(name, made) for name, made in plants.items() if name not in labels]
    if more or flown:
        tables = scenario.as_dict()
        listed = [law.model_dump(exclude_none=True) for law in scenario.law_tables]
        tables |= {"law": [*listed, *more], "plant": [*tables["plant"], *flown]}
        scenario = Scenario.model_validate(tables)
    if not any(table.of_the_user for table in (*scenario.law_tables, *scenario.plant)):
        return scenario
    bound = {
        "law": _bound(scenario.title, "law", scenario.law, laws) if scenario.law else None,
        "plant": _bound(scenario.title, "plant", scenario.plant, plants),
    }
    return scenario.model_copy(update=bound)


def _bound(
    title: str, key: str, tables: Sequence[T], made: Mapping[str, Callable[..., Any]]
) -> list[T]:
    """The same tables, where those of a user's law or plant hold its class."""
    bound = list(tables)
    for i, table in enumerate(tables):
        maker = made.get(table.name or "")
        if table.of_the_user and (maker or table.maker is None):
            bound[i] = table.made_by(maker or _loaded(title, key, table))
    return bound


def _python(name: str, made: Any) -> dict[str, Any]:
    """The table of a law or plant given from Python: with the hash of its file, if it has one."""
    target = getattr(made, "func", made)  # of a functools.partial
    table: dict[str, Any] = {"name": name, "kind": "python"}
    if getattr(target, "takes_gains", False):
        table["takes_gains"] = True
    try:
        file = inspect.getsourcefile(target)
        return table if file is None else {**table, "sha256": file_sha256(Path(file))}
    except (TypeError, OSError):
        return table


def _loaded(title: str, key: str, table: LawTable | PlantTable) -> Any:
    name = table.name
    where = f"{title}: [[{key}]] {name}"
    if table.module is None or table.class_ is None:
        raise ScenarioError(
            f"{where}: `module` and `class` must be given in the scenario, or the class from "
            f"Python, `{key}s={{{name!r}: ...}}`."
        )
    path = Path(table.module)
    digest = module_sha256(path, f"{where}:")
    if table.sha256 not in (None, digest):
        raise ScenarioError(
            f"{where}: `module` must be the file that was planned or recorded with, {table.module} "
            "has other contents now."
        )
    before_running([table.module])
    try:
        members = vars(_module(str(path.resolve()), digest))
    except FAILURES as error:
        raise ScenarioError(failure(f"{where}: {table.module}", error, None)) from error
    if table.class_ not in members:
        own = [name for name, value in members.items() if isinstance(value, type)]
        raise ScenarioError(
            f"{where}: `class` must be one of {table.module} ({', '.join(own) or 'which has none'})"
            f", got {table.class_}."
        )
    return members[table.class_]


@lru_cache(maxsize=32)
def _module(path: str, _digest: str) -> ModuleType:
    spec = spec_from_file_location(Path(path).stem, path)
    if spec is None or spec.loader is None:
        raise ImportError("the file must be Python")
    module = module_from_spec(spec)
    with redirect_stdout(sys.stderr):  # stdout is for the answer of a command
        spec.loader.exec_module(module)
    return module
