"""A run as its Parquet file holds it: a description, the signals, and a SHA-256 over both."""

import hashlib
import json
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.errors import RecordingError
from flighttune.simulate.run import SIGNAL_UNITS, Provenance, Run

FORMAT = 2  # version of the layout; a file with a higher one is from a newer flighttune
LONGEST_REASON = 160  # characters of a library's error message that are repeated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunRecord:
    """The parts of a Parquet file of a run."""

    description: str  # JSON: format, status, reason, provenance, name and unit of each column
    rows: FloatArray  # (samples, 1 + signals): time in s and the signals, in that order
    sha256: str  # over the description and the bytes of the rows

    @classmethod
    def of(cls, run: Run) -> "RunRecord":
        """The record of a run whose scenario JSON can hold."""
        names, units = [str(name) for name in run.signals], {**run.units, **SIGNAL_UNITS}
        description = json.dumps(
            {
                "format": FORMAT,
                "status": run.status,
                "reason": run.reason,
                "provenance": _plain(run.provenance),
                "columns": {"t": "s", **{name: units.get(name) for name in names}},
            },
            ensure_ascii=False,
        )
        rows = np.column_stack([run.signals.index, run.signals]).astype(float)
        return cls(description=description, rows=rows, sha256=signals_sha256(description, rows))

    @property
    def columns(self) -> dict[str, str | None]:
        """Unit of each column, by name; the first one is the time."""
        return json.loads(self.description)["columns"]

    def run(self) -> Run:
        """The run, with signals equal to the bit, if the SHA-256 is that of the record."""
        if self.sha256 != signals_sha256(self.description, self.rows):
            raise RecordingError(
                "description and signals must have the SHA-256 that was recorded, got another one; "
                "fly it again."
            )
        try:
            return self._run(json.loads(self.description))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            if isinstance(error, RecordingError):
                raise
            got = f"{type(error).__name__}: {first_line(error)}"
            raise RecordingError(f"must describe a complete run, got {got}.") from error

    def _run(self, entry: Mapping[str, Any]) -> Run:
        if entry["format"] > FORMAT:
            raise RecordingError(
                f"layout must be {FORMAT} or older, got {entry['format']}; "
                "read it with a newer flighttune."
            )
        for name, unit in entry["columns"].items():
            if unit != SIGNAL_UNITS.get(name, unit):
                raise RecordingError(f"`{name}` must be in {SIGNAL_UNITS[name]}, got {unit}.")
        provenance = dict(entry["provenance"])
        if provenance["gains"] is not None:
            names = {key: tuple(provenance["gains"][key]) for key in ("inputs", "errors")}
            provenance["gains"] = PIGains(**{**provenance["gains"], **names})
        index = pd.Index(self.rows[:, 0], name="t", dtype=np.float64)
        _, *names = entry["columns"]
        return Run(
            signals=pd.DataFrame(dict(zip(names, self.rows[:, 1:].T, strict=True)), index=index),
            status=entry["status"],
            reason=entry["reason"],
            provenance=Provenance(**provenance),
            units={
                name: unit
                for name, unit in entry["columns"].items()
                if unit is not None and name not in ("t", *SIGNAL_UNITS)
            },
        )


def signals_sha256(description: str, rows: FloatArray) -> str:
    """SHA-256 over a description in UTF-8 and then the rows as little-endian float64."""
    digest = hashlib.sha256(description.encode())
    digest.update(np.ascontiguousarray(rows, dtype="<f8").tobytes())
    return digest.hexdigest()


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the name of the file before the message of a RecordingError in the block."""
    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def first_line(text: object) -> str:
    """The first line of a library's message, cut to a readable length."""
    line = next(iter(str(text).splitlines()), "no reason")
    return textwrap.shorten(line, LONGEST_REASON, placeholder=" ...").rstrip(".")


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise RecordingError(f"the scenario must hold plain values, got {value!r}.")
