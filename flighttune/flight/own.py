"""Laws and plants of the user's: classes given from Python, or in files that a scenario names."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from flighttune.control.controller import Controller, LawSetup
from flighttune.errors import ScenarioError
from flighttune.plants.base import Plant
from flighttune.plants.guarded import FAILURES, GuardedPlant, failure
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import LawTable, PlantTable
from flighttune.simulate.guarded import GuardedLaw, LawError

LawMaker = Callable[..., Controller]
"""Called with a `LawSetup` and the parameters of a scenario's table, for every flight."""

PlantMaker = Callable[..., Plant]
"""Called with the parameters of a scenario's table, for every flight."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Own:
    """Classes of the user's, by the name of the law or the label of the plant.

    Attributes
    ----------
    laws : mapping of str to callable
    plants : mapping of str to callable
    """

    laws: Mapping[str, LawMaker] = field(default_factory=dict)
    plants: Mapping[str, PlantMaker] = field(default_factory=dict)

    def law(self, table: LawTable, setup: LawSetup) -> GuardedLaw:
        """A fresh law for a flight.

        Raises
        ------
        LawError
            If it cannot be made, or has another sample time than the flight.
        """
        name = f"law {table.name}"
        try:
            law = self.laws[table.name](setup, **(table.parameters or {}))
            guarded = GuardedLaw(law, setup.limits, name)
        except FAILURES as error:
            raise LawError(failure(name, error, 0.0)) from error
        if guarded.dt != setup.dt:
            raise LawError(
                f"{name}: `dt` must be that of the flight, {setup.dt:g} s, got {law.dt}."
            )
        return guarded

    def plant(self, table: PlantTable) -> GuardedPlant:
        """A fresh plant for a flight.

        Raises
        ------
        ScenarioError
            If it cannot be made.
        """
        name = f"plant {table.label}"
        try:
            return GuardedPlant(self.plants[table.label](**(table.parameters or {})), name)
        except FAILURES as error:
            raise ScenarioError(failure(name, error, 0.0)) from error


def with_own(
    scenario: Scenario,
    laws: Mapping[str, LawMaker] | None = None,
    plants: Mapping[str, PlantMaker] | None = None,
) -> tuple[Scenario, Own]:
    """A scenario with the user's laws and plants in it, and their classes.

    Parameters
    ----------
    scenario : Scenario
    laws, plants : mapping of str to callable, optional
        Flown besides those of the scenario, or in place of its tables of that name.

    Returns
    -------
    scenario : Scenario
        The same where no further law or plant is given.
    own : Own

    Raises
    ------
    ScenarioError
        If a file or class that the scenario names cannot be loaded, is not the one it was, or a
        law or plant that was given from Python is not given now.
    """
    laws, plants = dict(laws or {}), dict(plants or {})
    tables = scenario.as_dict()
    known = {law.name for law in scenario.laws}
    more = [_python(name, made) for name, made in laws.items() if name not in known]
    labels = {plant.label for plant in scenario.plant}
    flown = [_python(name, made) for name, made in plants.items() if name not in labels]
    if more or flown:
        given = [law.model_dump(exclude_none=True) for law in scenario.laws]
        tables |= {"law": [*given, *more], "plant": [*tables["plant"], *flown]}
        scenario = Scenario.model_validate(tables)
    for table in scenario.laws:
        if table.kind == "python" and table.name not in laws:
            laws[table.name] = _loaded(scenario, "law", table.name, table)
    for table in scenario.plant:
        if table.kind == "python" and table.label not in plants:
            plants[table.label] = _loaded(scenario, "plant", table.label, table)
    return scenario, Own(laws=laws, plants=plants)


def _python(name: str, made: Any) -> dict[str, Any]:
    """The table of a law or plant given from Python: with the hash of its file, if it has one."""
    target = getattr(made, "func", made)  # of a functools.partial
    table = {"name": name, "kind": "python"}
    try:
        file = inspect.getsourcefile(target)
        return table if file is None else {**table, "sha256": file_sha256(Path(file))}
    except (TypeError, OSError):
        return table


def _loaded(scenario: Scenario, key: str, name: str, table: LawTable | PlantTable) -> Any:
    where = f"{scenario.title}: [[{key}]] {name}"
    if table.module is None or table.class_ is None:
        raise ScenarioError(
            f"{where}: `module` and `class` must be given in the scenario, or the class from "
            f"Python, `{key}s={{{name!r}: ...}}`."
        )
    path = Path(table.module)
    if not path.is_file():
        raise ScenarioError(f"{where}: `module` must be a file, got {table.module}.")
    digest = file_sha256(path)
    if table.sha256 not in (None, digest):
        raise ScenarioError(
            f"{where}: `module` must be the file that was planned or recorded with, {table.module} "
            "has other contents now."
        )
    try:
        return getattr(_module(str(path.resolve()), digest), table.class_)
    except FAILURES as error:
        raise ScenarioError(failure(f"{where}: {table.module}", error, None)) from error


@lru_cache(maxsize=32)
def _module(path: str, digest: str) -> ModuleType:
    spec = spec_from_file_location(f"flighttune_own_{digest[:16]}", path)
    if spec is None or spec.loader is None:
        raise ImportError("the file must be Python")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def file_sha256(path: Path) -> str:
    """Hash of a file's contents."""
    return sha256(path.read_bytes()).hexdigest()
