"""Arrays in files (.npz), written with their hash, and read strictly: names, sizes and types."""

import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.errors import InputError
from flighttune.base.files import archive, load, table, whole
from flighttune.base.files.budget import ARRAYS

FLOAT, SINGLE, BOOL, TEXT = np.dtype("<f8"), np.dtype("<f4"), np.dtype(bool), np.dtype("<U")

Arrays: TypeAlias = dict[str, npt.NDArray[Any]]


def write_sealed(path: str | Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays with the SHA-256 of their file (.npz), whole or not at all."""
    with whole.whole_file(Path(path)) as part:
        with part.open("wb") as opened:
            np.savez_compressed(opened, **arrays)
        with zipfile.ZipFile(part, "a") as file:
            file.comment = load.BLANK.encode()  # at the end, outside every checksum
        load.seal_end(part)


def read_arrays(
    path: Path, kind: str, kinds: Mapping[str, "np.dtype[Any]"], unbounded: Collection[str] = ()
) -> Arrays:
    """Arrays of a file, of these types and finite unless `unbounded`; the first is required."""

    def known(name: str) -> bool:
        if name.removesuffix(".npy") not in kinds or not name.endswith(".npy"):
            raise InputError(f"`{table.shown(name)}` must not be in the file of a {kind}.")
        return True

    arrays: Arrays = {}
    said = f"{kind} of flighttune", f"the arrays of a {kind}"
    with archive.opened(path, *said, known, ARRAYS) as (file, names):
        for name in names:
            with file.open(name) as member:
                array = np.lib.format.read_array(member, allow_pickle=False)
            key = name.removesuffix(".npy")
            arrays[key] = _checked(name, array, kinds[key], key not in unbounded)
    if (first := next(iter(kinds))) not in arrays:
        raise InputError(f"`{first}.npy` must be in the file of a {kind}.")
    return arrays


def _checked(
    name: str, array: npt.NDArray[Any], kind: "np.dtype[Any]", finite: bool
) -> npt.NDArray[Any]:
    """The array, if it has the type of its name and, unless `unbounded`, finite numbers."""
    if array.dtype != kind and not (kind == TEXT and array.dtype.kind == "U" and array.ndim == 0):
        raise InputError(f"`{name}` must be of type {kind.name}, got {array.dtype}.")
    if finite and kind.kind == "f" and not np.isfinite(array).all():
        raise InputError(f"`{name}` must be finite.")
    return array


def check_shapes(kind: str, arrays: Arrays, shapes: Mapping[str, tuple[int, ...] | None]) -> None:
    """Refuse arrays that are missing or have the wrong shape; None allows any shape."""
    for name, shape in shapes.items():
        if name not in arrays:
            raise InputError(f"`{name}.npy` must be in the file of this {kind}.")
        if shape not in (None, arrays[name].shape):
            raise InputError(f"`{name}` must have shape {shape}, got {arrays[name].shape}.")
