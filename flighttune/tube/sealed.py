"""Parquet files of tubes and of flights in them, each with the SHA-256 of its content."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar, Literal, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import ConfigDict, TypeAdapter, ValidationError

from flighttune.arrays import FloatArray
from flighttune.conformance.probability import CountedProbability
from flighttune.errors import InputError
from flighttune.mistakes import first_mistake
from flighttune.seal import BLANK, seal, sealed_bytes
from flighttune.whole_file import whole_file

ABOUT, SEAL = b"flighttune.tube", b"flighttune.file"
"""Keys in the metadata, in the order of the file: what it is about, as JSON, and its SHA-256."""

KIND, REMEDY = "Parquet file of a tube", "delete it and make it again with --tube"


@dataclass(frozen=True, slots=True, kw_only=True)
class AboutTube:
    """Description in the file of a tube, beside its bounds."""

    __pydantic_config__: ClassVar = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    run: str  # `flight_sha256` of its flight
    status: Literal["bounded", "unbounded"]
    reason: str
    model: str
    start_deg: float  # flights start within this of the scenario's course and path angle
    handed_over_s: float | None
    counted_from_s: float | None
    probability: CountedProbability | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AboutWorst:
    """Description in the file of the worst flight in a tube, beside its errors."""

    __pydantic_config__: ClassVar = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    tube: str  # SHA-256 in the file of its tube
    chi: float  # width of the tube over the width that this flight needs
    gamma: float


A = TypeVar("A", AboutTube, AboutWorst)


def write_sealed(table: pa.Table, about: AboutTube | AboutWorst, path: Path) -> None:
    """Write signals over time, whole or not at all."""
    metadata = {ABOUT: json.dumps(asdict(about)).encode(), SEAL: BLANK}
    sink = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata(metadata), sink, compression="zstd")
    data = seal(sink.getvalue().to_pybytes())
    with whole_file(path) as part:
        part.write_bytes(data)


def read_sealed(
    path: Path, kind: type[A], names: Sequence[str]
) -> tuple[A, FloatArray, FloatArray]:
    """Read a file of `write_sealed`: its description, the times and the signals of these names.

    Raises InputError if the file is not as it was written or is of another kind, if time does not
    rise, or a value is not finite.
    """
    data = sealed_bytes(path, KIND, REMEDY)
    try:
        table = pq.read_table(pa.BufferReader(data))
        about = TypeAdapter(kind).validate_json(table.schema.metadata[ABOUT])
        t, *columns = (table[name].to_numpy().astype(float) for name in ("t", *names))
    except ValidationError as error:
        raise InputError(f"{path}: {first_mistake(error)}") from error
    except (pa.ArrowException, OSError, KeyError, TypeError, ValueError) as error:
        got = " ".join(str(error).split())
        raise InputError(f"{path}: must be a {KIND} with `{names[0]}`, got: {got}.") from error
    values = np.column_stack(columns)
    if not (np.isfinite(values).all() and np.isfinite(t).all() and (np.diff(t) > 0.0).all()):
        raise InputError(f"{path}: `t` must rise and every value must be finite; {REMEDY}.")
    return about, t, values
