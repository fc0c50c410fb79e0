"""Files to values, and what is wrong with them in one line that names file and key."""

import difflib
import json
import tomllib
from collections.abc import Iterable
from itertools import takewhile
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from flighttune.control.gains import PIGains
from flighttune.errors import ScenarioError
from flighttune.scenario.schema import GainsTable, Scenario

UNION_TAGS = {"step", "ramp", "doublet", "str", "float", "constrained-float", "GainsTable"}

Model = TypeVar("Model", bound=BaseModel)


def load_scenario(path: str | Path) -> Scenario:
    """Read and check a scenario file.

    Parameters
    ----------
    path : path-like
        A TOML file, or the name of a scenario that ships with the package.

    Returns
    -------
    Scenario
        Frozen and valid.

    Raises
    ------
    ScenarioError
        If the file cannot be read, or a key is unknown, missing or impossible.
    """
    path = _existing(path)
    return _validated(Scenario, _toml(path), str(path))


def scenario_from(tables: dict[str, Any]) -> Scenario:
    """Check a scenario given as nested dictionaries with the keys of a scenario file.

    Raises
    ------
    ScenarioError
        If a key is unknown, missing or impossible.
    """
    return _validated(Scenario, tables, "scenario")


def load_gains(path: str | Path) -> PIGains:
    """Read gains of the roll and load-factor loop from a JSON or TOML file.

    Parameters
    ----------
    path : path-like
        A file with ``K_P`` and ``K_I``, each two rows (phi, n_z) of two numbers (chi, gamma);
        other keys (as `tune --json` writes them) are passed over.

    Returns
    -------
    PIGains
        The gains.

    Raises
    ------
    ScenarioError
        If the file cannot be read or does not hold such gains.
    """
    path = Path(path)
    tables = _json(path) if path.suffix.lower() == ".json" else _toml(path)
    kept = {key: tables[key] for key in ("K_P", "K_I") if key in tables}
    return _validated(GainsTable, {"name": "file", **kept}, str(path)).gains()


def _existing(path: str | Path) -> Path:
    from flighttune.shipped import scenario_file, scenario_names

    found = Path(path)
    if found.exists():
        return found
    name = found.name.removesuffix(".toml")
    if name in scenario_names() and len(found.parts) <= 2:
        return scenario_file(name)
    raise ScenarioError(
        f"{path}: the scenario must be a file or one of {', '.join(scenario_names())}; "
        "there is no such file."
    )


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{path}: the file must be readable: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: the file must be UTF-8 text: {error}.") from error


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(_text(path))
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path}: the file must be valid TOML: {error}.") from error


def _json(path: Path) -> dict[str, Any]:
    try:
        tables = json.loads(_text(path))
    except json.JSONDecodeError as error:
        raise ScenarioError(f"{path}: the file must be valid JSON: {error}.") from error
    if not isinstance(tables, dict):
        raise ScenarioError(f"{path}: the file must hold one object, got {type(tables).__name__}.")
    return tables


def _validated(model: type[Model], tables: dict[str, Any], source: str) -> Model:
    try:
        return model.model_validate(tables)
    except ValidationError as error:
        problems = error.errors(include_url=False)
        problems.sort(key=_telling, reverse=True)
        places: dict[tuple[int | str, ...], ErrorDetails] = {}
        for problem in problems:
            places.setdefault(_place(problem), problem)
        first = _sentence(next(iter(places.values())), model)
        more = f" ({len(places) - 1} more)" if len(places) > 1 else ""
        raise ScenarioError(f"{source}: {first}{more}") from None


def _keys(problem: ErrorDetails) -> tuple[str, ...]:
    return tuple(part for part in problem["loc"] if isinstance(part, str) and not _is_tag(part))


def _telling(problem: ErrorDetails) -> tuple[int, bool]:
    """Of the readings of a union the one that fits best fails deepest; a typo explains a gap."""
    return len(problem["loc"]), problem["type"] == "extra_forbidden"


def _place(problem: ErrorDetails) -> tuple[int | str, ...]:
    """Where the file is wrong: all readings of a union fail at one place."""
    untagged = takewhile(lambda part: not (isinstance(part, str) and _is_tag(part)), problem["loc"])
    return tuple(untagged)


def _sentence(problem: ErrorDetails, model: type[BaseModel]) -> str:
    keys = _keys(problem)
    key = keys[-1] if keys else ""
    table = f"[{'.'.join(keys[:-1])}] " if len(keys) > 1 else ""
    got = problem.get("input")
    kind = problem["type"]
    if kind == "extra_forbidden":
        known = _known_keys(model, keys[:-1])
        close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
        hint = f"did you mean `{close[0]}`?" if close else f"known are {', '.join(known)}."
        return f"{table}`{key}` is not a known key; {hint}"
    if kind == "missing":
        return f"{table}`{key}` must be given."
    message = problem["msg"]
    if kind == "value_error":
        message = message.removeprefix("Value error, ")
        if message.startswith("`"):
            return f"{table}{message}."
        return f"{table}`{key}` {message}, got {got!r}."
    if kind == "union_tag_invalid" or kind == "union_tag_not_found":
        return f"{table}`{key}` must have a `shape` of step, ramp or doublet, got {got!r}."
    message = message.replace("Input should be", "must be").replace("should have", "must have")
    message = message.removeprefix("List ").removeprefix("String ").split(" after validation")[0]
    if kind == "model_type":
        message = "must be a table"
    return f"{table}`{key}` {message}, got {got!r}."


def _is_tag(part: str) -> bool:
    """Whether `part` is how pydantic names a member of a union, not a key of the file."""
    return part in UNION_TAGS or "[" in part


def _known_keys(model: type[BaseModel], keys: Iterable[str]) -> list[str]:
    for key in keys:
        for candidate in _tables_of(model, key):
            model = candidate
    return list(model.model_fields)


def _tables_of(model: type[BaseModel], key: str) -> list[type[BaseModel]]:
    field = model.model_fields.get(key)
    found: list[type[BaseModel]] = []
    pending = [field.annotation] if field else []
    while pending:
        kind = pending.pop()
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found.append(kind)
        pending.extend(getattr(kind, "__args__", ()))
    return found
