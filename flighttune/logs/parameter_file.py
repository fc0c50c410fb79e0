"""Parameter files of ground stations: QGroundControl's and Mission Planner's, read and changed."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from flighttune.base.errors import InputError, naming
from flighttune.base.files.budget import LINES, check_entries, file_bytes, opened
from flighttune.base.files.table import abridged

# MAVLink's component number of the autopilot.
AUTOPILOT = 1

# Mark of the byte order, with which some editors begin a file.
MARK = "\ufeff"

# A name of a parameter, and text that ArduPilot's own files may have after a value.
NAME, READ_ONLY = re.compile("[A-Z][A-Z0-9_]{0,15}"), "@READONLY"


class Stated(NamedTuple):
    """The content of a file."""

    values: Mapping[str, float]
    vehicle: str
    version: str
    # parameters that the file states a second time with another value, with the place
    others: Mapping[str, list[str]]


class Row(NamedTuple):
    """A parameter in a line of a file."""

    vehicle: int
    component: int
    name: str
    value: float


def read_text(path: Path) -> Stated:
    """The content of a parameter file of QGroundControl or Mission Planner."""
    head = {"Vehicle": "", "Version": ""}
    rows: list[Row] = []
    for number, line in enumerate(_lines(path), start=1):
        text, _, comment = line.partition("#")
        key, _, value = comment.strip().partition(":")
        if key in head:
            head[key] = value.strip()
        if text.strip():
            rows.append(_row(text, f"{path}: line {number}"))
    values, others = _of_autopilot(rows)
    return Stated(values, head["Vehicle"], head["Version"], others)


def changed_text(path: Path, changes: Mapping[str, float], comment: Sequence[str]) -> str:
    """The text of a parameter file with other values of the first vehicle's autopilot.

    All else stays to the byte. The lines of the `comment` follow those at the head of the file.
    InputError if the file lacks a name.
    """
    lines = _lines(path)
    texts = {n: line.partition("#")[0] for n, line in enumerate(lines)}
    rows = {n: _row(text, f"{path}: line {n + 1}") for n, text in texts.items() if text.strip()}
    place, changed = _autopilot(rows.values()), set[str]()
    for n, row in rows.items():
        if row.name in changes and (row.vehicle, row.component) == place:
            changed.add(row.name)
            value = re.compile(rf"(\b{row.name}[\s,]+)[^\s,]+")
            lines[n] = value.sub(rf"\g<1>{number_text(changes[row.name])}", lines[n], count=1)
    if missing := changes.keys() - changed:
        raise InputError(f"{path}: must have {', '.join(sorted(missing))}, got none.")
    first = min(rows)
    end = "\r\n" if lines[first].endswith("\r\n") else "\n"
    lines[first:first] = [f"# {line}{end}" for line in comment]
    with opened(path) as file:
        mark = MARK if file.read(len(MARK.encode())) == MARK.encode() else ""
    return mark + "".join(lines)


def new_text(changes: Mapping[str, float], comment: Sequence[str], *, px4: bool) -> str:
    """The text of a file of these parameters alone, QGroundControl's or Mission Planner's."""
    row = "1\t1\t{}\t{}\t9" if px4 else "{},{}"  # 9: a number in 32 bits
    rows = [row.format(name, number_text(value)) for name, value in changes.items()]
    return "\n".join([*(f"# {line}" for line in comment), *rows, ""])


def number_text(value: float) -> str:
    """A value with the digits that a parameter of 32 bits keeps."""
    return f"{value:.7g}"


def _lines(path: Path) -> list[str]:
    """The lines of a file with their ends, without a mark of the byte order."""
    try:
        text = file_bytes(path, LINES, InputError).decode("utf-8-sig")
        with naming(path):
            check_entries(text, LINES)
        return text.splitlines(keepends=True)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: must be a file of parameters or a log, got a binary file."
        ) from error


def _row(text: str, place: str) -> Row:
    """The parameter in a line without its comment."""
    fields = [field for field in re.split(r"[\s,]+", text.strip()) if field != READ_ONLY]
    vehicle, component = 0, AUTOPILOT
    # QGroundControl: the type of the value follows
    if len(fields) in (4, 5) and fields[0].isdecimal() and fields[1].isdecimal():
        vehicle, component, fields = int(fields[0][:9]), int(fields[1][:9]), fields[2:4]
    with suppress(ValueError):
        name, value = fields
        if NAME.fullmatch(name):
            return Row(vehicle, component, name, float(value))
    comma = " with a decimal point" if re.search(r"\d,\d", text) else ""
    raise InputError(
        f"{place} must be NAME,VALUE or VEHICLE COMPONENT NAME VALUE TYPE{comma}, got "
        f"{abridged(text.strip())}."
    )


def _autopilot(rows: Iterable[Row]) -> tuple[int, int]:
    """Vehicle and component of the first vehicle's autopilot."""
    places = list(dict.fromkeys((row.vehicle, row.component) for row in rows))
    vehicle = places[0][0]
    components = [component for of, component in places if of == vehicle]
    return vehicle, AUTOPILOT if AUTOPILOT in components else min(components)


def _of_autopilot(rows: Sequence[Row]) -> tuple[dict[str, float], dict[str, list[str]]]:
    """Values of the first vehicle's autopilot, and other values of the same names."""
    stated: dict[tuple[int, int], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for vehicle, component, name, value in rows:
        stated[vehicle, component][name].append(value)
    if not stated:
        return {}, {}
    chosen = vehicle, _ = _autopilot(rows)
    values = {name: several[-1] for name, several in stated[chosen].items()}
    others: dict[str, list[str]] = defaultdict(list)
    for place, parameters in stated.items():
        where = "" if place == chosen else f" of component {place[1]}"
        where += f" of vehicle {place[0]}" * (place[0] != vehicle)
        for name, several in parameters.items():
            for value in dict.fromkeys(several):
                if value != values.get(name):
                    others[name].append(f"{value:g}{where or ' before'}")
    return values, others
