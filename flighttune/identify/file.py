"""Identified aircraft as JSON files: units in the keys, written whole or not at all."""

import json
import math
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from flighttune.aircraft.aircraft import GAINS_FILE, load_aircraft
from flighttune.errors import ScenarioError
from flighttune.identify.model import IdentifiedAircraft
from flighttune.mistakes import abridged, first_mistake, shown
from flighttune.shipped import aircraft_folder
from flighttune.table_file import json_tables, stamp
from flighttune.whole_file import write_text

FILE_NAME = "identified.json"

# Significant digits written: more than a flight gives, fewer than two machines differ in.
DIGITS = 6

EXACT = ("V_a_mps", "h_m")

# Share by which a number may differ from the one that the rounded lags give.
ROUNDING = 1e-4


def identified_tables(aircraft: IdentifiedAircraft) -> dict[str, Any]:
    """An identified aircraft as the object of its file."""
    tables = aircraft.model_dump()
    if not aircraft.gains:
        del tables["gains_sha256"]
    return _rounded(tables)


def save_identified(aircraft: IdentifiedAircraft, path: str | Path) -> None:
    """Write an identified aircraft as JSON, under a temporary name until it is whole.

    Parameters
    ----------
    aircraft : IdentifiedAircraft
    path : str or Path
        Its folder is made if missing.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    text = json.dumps(identified_tables(aircraft), indent=2, allow_nan=False) + "\n"
    write_text(Path(path), text)


def load_identified(source: str | Path) -> IdentifiedAircraft:
    """Read an identified aircraft.

    Parameters
    ----------
    source : str or Path
        A JSON file as `save_identified` writes it, the folder of an aircraft that holds one named
        ``identified.json``, or the name of a shipped aircraft.

    Raises
    ------
    InputError
        If there is no such aircraft.
    ScenarioError
        If the file cannot be read or does not hold an identified aircraft; the message names file
        and key.
    """
    path = Path(source)
    if path.name == str(source) and path.suffix != ".json":
        path = aircraft_folder(str(source))
    if path.is_dir():
        path = path / FILE_NAME
    if not path.exists():
        raise ScenarioError(f"{path}: must be there; `flighttune identify` writes one.")
    aircraft = _read(path, stamp(path))
    _check_gains(aircraft, path)
    return aircraft


@lru_cache(maxsize=32)  # every flight behind a reference of shape feasible asks for its lags
def _read(path: Path, _stamp: tuple[int, ...]) -> IdentifiedAircraft:
    """The identified aircraft of a file, read anew when it was written to."""
    tables = json_tables(path)
    try:
        aircraft = IdentifiedAircraft.model_validate(tables)
    except ValidationError as error:
        raise ScenarioError(f"{path}: {first_mistake(error)}") from error
    for fault in _contradictions(tables, identified_tables(aircraft)):
        raise ScenarioError(f"{path}: {fault}.")
    return aircraft


def _check_gains(aircraft: IdentifiedAircraft, path: Path) -> None:
    """Refuse a model that was measured with other gains than those of the aircraft beside it."""
    if not (aircraft.gains and (path.parent / "aircraft.toml").is_file()):
        return
    gains = load_aircraft(path.parent).gains
    if gains is None or gains.sha256 != aircraft.gains:
        raise ScenarioError(
            f"{path}: must be identified with the gains in {GAINS_FILE}, got others; "
            "`flighttune identify` measures it anew."
        )


def _contradictions(stated: Any, derived: Any, key: str = "") -> Iterator[str]:
    """Entries of a file that contradict its lags: its matrices are for other programs."""
    if isinstance(stated, dict) and isinstance(derived, dict):
        for name, value in stated.items():
            inside = f"{key}.{name}".removeprefix(".")
            if name in derived:
                yield from _contradictions(value, derived[name], inside)
            else:
                yield f"`{shown(inside)}` is not a known key; known are {', '.join(derived)}"
    elif isinstance(stated, list) and isinstance(derived, list) and len(stated) == len(derived):
        for i, (entry, other) in enumerate(zip(stated, derived, strict=True)):
            yield from _contradictions(entry, other, f"{key}[{i}]")
    elif not _same(stated, derived):
        got = abridged(stated)
        yield f"`{key}` must be {abridged(derived)}, as the lags of the file make it, got {got}"


def _same(stated: Any, derived: Any) -> bool:
    if isinstance(stated, float | int) and isinstance(derived, float):
        return math.isclose(stated, derived, rel_tol=ROUNDING, abs_tol=ROUNDING)
    return stated == derived


def _rounded(value: Any) -> Any:
    """Nested values with every number rounded to `DIGITS`, but for airspeed and height."""
    if isinstance(value, dict):
        return {key: item if key in EXACT else _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
