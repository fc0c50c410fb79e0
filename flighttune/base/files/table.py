"""TOML and JSON files, read whole and strictly: tables, values of classes, and their mistakes.

The class of a value, a frozen dataclass, is the format of its file too. The keys are the names of
the fields, and the first one names the format with its version. An unknown, missing or repeated
key, a value of another type and another version are refused in one line that names file and key.
The checks of the class itself apply to files too.
"""

import difflib
import hashlib
import json
import re
import textwrap
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, wraps
from pathlib import Path
from reprlib import Repr
from typing import Any, ClassVar, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from flighttune.base.errors import InputError, ScenarioError, naming
from flighttune.base.files import budget
from flighttune.base.files.whole import check_whole, write_text

# Maximum number of mistakes that one line lists, and maximum number that are counted.
MAX_LISTED, MAX_MISTAKES = 5, 10_000

# Maximum length of a key or value in a message, and of a library's message, characters.
MAX_CHARACTERS, MAX_REASON = 80, 160

Model = TypeVar("Model", bound=BaseModel)

_ABRIDGED = Repr()
_ABRIDGED.maxstring = _ABRIDGED.maxother = MAX_CHARACTERS


def shown(key: str) -> str:
    """A key as a message repeats it: the middle of a long one is left out."""
    return abridged(key)[1:-1]


def abridged(value: object) -> str:
    """A value as a message repeats it: the middle of a long one is left out."""
    return _ABRIDGED.repr(value)


def first_line(error: object) -> str:
    """The first line of a library's message, cut to a readable length."""
    line = next(iter(str(error).splitlines()), "no reason")
    return textwrap.shorten(line, MAX_REASON, placeholder=" ...").rstrip(".")


def joined(faults: Iterable[str], count: int = 0) -> str:
    """Faults as one line that ends in a full stop, or in the last one's question mark.

    `count` is the number of all faults if `joined` gets only the first of them.
    """
    sentences = [fault.removesuffix(".") for fault in faults]
    more = max(count, len(sentences)) - MAX_LISTED
    line = "; ".join(sentences[:MAX_LISTED]) + (f"; and {more} more" if more > 0 else "")
    words = (word if len(word) <= budget.MAX_NAME else shown(word) for word in line.split())
    return " ".join(words) + ("" if line.endswith("?") else ".")


def mistakes(error: ValidationError, tables: object, model: type[BaseModel] | None = None) -> str:
    """All mistakes in `tables` in one line, the deepest first; `model` is set for a TOML file."""
    # An unknown key comes before the missing key, which it may misspell. The fault of a range comes
    # before the remark that a range is not a number.
    problems = sorted(
        error.errors(include_url=False),
        key=lambda problem: (len(problem["loc"]), problem["type"] not in ("missing", "float_type")),
        reverse=True,
    )
    sentences: list[str] = []
    count, seen = 0, set[tuple[int | str, ...]]()
    for problem in problems:
        place = _place(problem, tables)
        # A value of a union has a problem for each member: the member that fits best fails deepest.
        if place in seen:
            continue
        seen |= {place[:length] for length in range(len(place) + 1)}
        count += 1
        if count <= MAX_LISTED:
            sentences.append(_sentence(problem, place, model))
    return joined(sentences, count)


def validated(model: type[Model], tables: Any, source: object) -> Model:
    """Tables read as `model`; a ScenarioError names `source`, the file, and each wrong key."""
    try:
        return model.model_validate(tables)
    except ValidationError as error:
        if error.error_count() > MAX_MISTAKES:  # listing them all would take gigabytes
            raise ScenarioError(
                f"{source}: it must be a {model.__name__}, got {error.error_count()} wrong values."
            ) from None
        named = None if str(source).endswith(".json") else model
        raise ScenarioError(f"{source}: {mistakes(error, tables, named)}") from None


def refused_in_a_line(model: type[Model]) -> type[Model]:
    """The class of a table, with mistakes of a call from Python told in one line too."""
    made = model.__init__

    @wraps(made)
    def init(self: Model, /, **tables: Any) -> None:
        try:
            made(self, **tables)
        except ValidationError as error:
            raise ScenarioError(f"{model.__name__}: {mistakes(error, tables, model)}") from None

    setattr(model, "__init__", init)  # noqa: B010
    return model


def _place(problem: ErrorDetails, tables: Any) -> tuple[int | str, ...]:
    """Keys and indices down to the wrong value, without the members of unions in between."""
    place: list[int | str] = []
    for part in problem["loc"]:
        if isinstance(tables, dict):
            there = part in tables
        else:
            there = isinstance(tables, list) and part in range(len(tables))
        if there:
            inside: Any = tables
            tables = inside[part]
            place.append(part)
    if problem["type"] == "missing":
        place.append(problem["loc"][-1])
    return tuple(place)


def _sentence(
    problem: ErrorDetails, place: tuple[int | str, ...], model: type[BaseModel] | None
) -> str:
    kind, message = problem["type"], problem["msg"].removeprefix("Value error, ")
    if message.startswith("["):  # a validator has named table and key
        return message
    keys = [str(part) for part in place if model is None or isinstance(part, str)]
    if message.startswith("`"):  # a table that checks itself has named its key
        inside, fault = message[1:].split("`", 1)
        return f"{_named([*keys, inside], model)}{fault}"
    key, subject = keys[-1] if keys else "", _named(keys, model)
    if kind == "missing":
        return f"{subject} must be given"
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        names = _known_keys(model, keys[:-1]) if model else []
        close = difflib.get_close_matches(shown(key), names, n=1, cutoff=0.5)
        hint = f"did you mean `{close[0]}`?" if close else f"the keys are {', '.join(names)}"
        return f"{subject} is not a known key" + (f"; {hint}" if names else "")
    if kind in ("model_type", "dict_type", "dataclass_type"):
        message = "must be a table"
    # "List should have at least 1 item after validation, ..." becomes "must have at least 1 item".
    message = re.sub("^(Input|List|Tuple|String) | after validation.*", "", message)
    message = message.replace("should", "must", 1)
    value = problem.get("input")
    if kind == "too_long" and isinstance(value, list):
        return f"{subject} {message}, got {len(value)}"
    return f"{subject} {message}, got {abridged(value)}"


def _named(keys: list[str], model: type[BaseModel] | None) -> str:
    if model is None or len(keys) < 2:
        return f"`{shown('.'.join(keys))}`"
    return f"[{shown('.'.join(keys[:-1]))}] `{shown(keys[-1])}`"


def _known_keys(model: type[BaseModel], place: Sequence[str]) -> list[str]:
    """Keys of the table at `place` in a model, or of all tables that may stand there."""
    tables = [_fields(model)]
    for key in place:
        kinds = [table[key].annotation for table in tables if key in table]
        inside = []
        for kind in kinds:  # the list grows by the members of lists and unions
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                inside.append(_fields(kind))
            kinds += getattr(kind, "__args__", ())
        tables = inside or tables  # the key of a dictionary leads to no other table
    return list(dict.fromkeys(key for table in tables for key in table))


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    return {field.alias or name: field for name, field in model.model_fields.items()}


STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

# A dotted key of over 32 parts: `tomllib` takes minutes for 100,000. The expression begins only
# where a key can and gives nothing back, so that it costs one pass of any text.
PART = r"""(?:"[^"\n]*+"|'[^'\n]*+'|[\w-]++)"""
DEEP_KEY = re.compile(rf"(?m)(?:^|[\[{{,])[ \t]*+(?:{PART}[ \t]*+\.[ \t]*+){{{budget.TOML.depth}}}")


def stamp(file: Path) -> tuple[int, ...]:
    """Modification time, inode number and size of a file; empty without a file."""
    try:
        status = file.stat()
    except OSError:
        return ()
    return status.st_mtime_ns, status.st_ctime_ns, status.st_ino, status.st_size


def toml_tables(path: Path) -> dict[str, Any]:
    """The tables of a TOML file; ScenarioError if it cannot be read."""
    return _parsed(file_text(path, budget.TOML), f"{path}: the file", _toml, "TOML")


def json_tables(path: Path) -> dict[str, Any]:
    """The object of a JSON file, read strictly; ``NaN`` and ``Infinity`` are read as floats."""
    return _parsed(file_text(path, budget.JSON), f"{path}: the file", _json, "JSON")


def json_object(text: str, place: str) -> dict[str, Any]:
    """The object of a JSON text inside a file; a ScenarioError begins with `place`."""
    return _parsed(text, place, _json, "JSON")


def toml_value(text: str, place: str) -> Any:
    """A value written as TOML; a text that is not valid TOML is itself the value."""

    def parse(line: str) -> Any:
        try:
            return _toml(line)
        except tomllib.TOMLDecodeError:
            return {"value": text}

    return _parsed(f"value = {text}", place, parse, "TOML")["value"]


def _toml(text: str) -> Any:
    if DEEP_KEY.search(text):
        raise RecursionError
    budget.check_entries(text, budget.TOML)
    return _checked(tomllib.loads(text), budget.TOML.depth)


def _json(text: str) -> Any:
    budget.check_entries(text, budget.JSON)
    return _checked(json.loads(text, object_pairs_hook=_unique), budget.JSON.depth)


def _checked(tables: Any, depth: int) -> Any:
    """Tables that are not too deep, without an integer that Python may refuse to print."""
    above: list[tuple[object, Iterator[tuple[object, Any]]]] = [("", iter([("", tables)]))]
    while above:
        for key, value in above[-1][1]:
            kind = type(value)
            if kind is dict or kind is list:
                pairs = value.items() if kind is dict else enumerate(value)
                above.append((key, iter(pairs)))
                break
            if kind is int and not budget.LEAST_INTEGER <= value <= budget.LARGEST_INTEGER:
                keys = ".".join(str(name) for name, _ in [*above[2:], (key, None)])
                raise ValueError(f"`{shown(keys)}` must be an integer of at most 64 bits")
        else:
            above.pop()
        if len(above) > depth + 1:
            raise RecursionError
    return tables


def file_text(path: Path, of: budget.Budget) -> str:
    """The text of a file; ScenarioError if it is too large or not UTF-8."""
    check_whole(path)
    data = budget.file_bytes(path, of, ScenarioError)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: the file must be UTF-8 text: {error}.") from error


def _parsed(text: str, place: str, parse: Callable[[str], Any], language: str) -> dict[str, Any]:
    try:
        tables = parse(text)
    except ValueError as error:
        # Python's advice is for programmers
        reason = str(error).partition("; use sys")[0].removesuffix(".")
        raise ScenarioError(f"{place} must be valid {language}: {reason}.") from error
    except RecursionError:
        raise ScenarioError(f"{place} must not be nested so deeply.") from None
    if not isinstance(tables, dict):
        raise ScenarioError(f"{place} must hold one object, got {type(tables).__name__}.")
    return tables


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of a JSON file; a key that is given twice would hide its first value."""
    table = dict(pairs)
    if len(table) < len(pairs):
        seen = set[str]()
        for key, _ in pairs:
            if key in seen:
                raise ValueError(f"`{shown(key)}` is given twice")
            seen.add(key)
    return table


def hash_of(values: Any) -> str:
    """SHA-256 of plain values, the same for any order of their keys."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def toml_text(tables: Mapping[str, Any]) -> str:
    """TOML of nested plain values, such as a recorded scenario; None is left out."""
    import tomlkit

    return tomlkit.dumps(_without_none(tables))


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, (list, tuple)):
        return [_without_none(item) for item in value]
    return value


class ValueOfFile(Protocol):
    """A frozen dataclass that can be read and written; `STRICT` is its pydantic configuration."""

    __pydantic_config__: ClassVar[ConfigDict]
    FORMAT: ClassVar[str]  # name and version: readers refuse any other
    UNITS: ClassVar[Mapping[str, str]]  # a note for people who read the file: nothing is converted


V = TypeVar("V", bound=ValueOfFile)


def write(value: ValueOfFile, path: str | Path) -> None:
    """Write a value whole or not at all; an OutputError says that it cannot be written."""
    write_text(Path(path), json.dumps(tables_of(value), indent=2, allow_nan=False) + "\n")


def read(path: str | Path, kind: type[V]) -> V:
    """Read a value of some class; a ScenarioError names file and key."""
    with naming(path, ScenarioError):
        return value_of(json_tables(Path(path)), kind)


def tables_of(value: ValueOfFile) -> dict[str, Any]:
    """The JSON object of a value, whose floats are read back to the same bits."""
    fields = _adapter(type(value)).dump_python(value, mode="json")
    return {"format": value.FORMAT, "units": dict(value.UNITS), **fields}


def value_of(tables: Mapping[str, Any], kind: type[V]) -> V:
    """The value whose JSON object `tables` is."""
    fields = dict(tables)
    if (written := fields.pop("format", None)) != kind.FORMAT:
        raise InputError(
            f"`format` must be {kind.FORMAT!r}, got {abridged(written)}; make the file again."
        )
    units = fields.pop("units", None) or {}
    # An earlier version of a format has neither a field that came later nor its unit.
    known = units if isinstance(units, dict) else {}
    if units != {name: x for name, x in kind.UNITS.items() if name in fields or name in known}:
        raise InputError("`units` must be those of this format: nothing is converted.")
    try:
        # From text, because pydantic's strict mode accepts an array as a tuple only there.
        return _adapter(kind).validate_json(json.dumps(fields))
    except ValidationError as error:
        raise InputError(mistakes(error, fields)) from error


@cache
def _adapter(kind: type[V]) -> TypeAdapter[V]:
    return TypeAdapter(kind)
