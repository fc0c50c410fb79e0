"""The SHA-256 that a file carries over all its other bytes: a changed file is refused.

In a Parquet file the digits stand in the metadata of the schema, which is never compressed, in a
JSON file under a key. They are compared before any library decodes the file.
"""

import hashlib
from pathlib import Path

from flighttune.errors import RecordingError
from flighttune.whole_file import reason_of

MARK = b"SHA-256="
DIGITS = 64

# Write this as the value of the last key in the metadata: whatever looks like it stands before it.
BLANK = MARK.decode() + "0" * DIGITS


def seal(data: bytes) -> bytes:
    """Put the SHA-256 of all other bytes of a file in the place of `BLANK`."""
    before, _, after = data.rpartition(BLANK.encode())
    return before + MARK + _sha256(before, after) + after


def sealed_bytes(path: Path, kind: str, remedy: str = "fly it again") -> bytes:
    """Bytes of a file, if they are those that `seal` returned; `kind` is what it must be."""
    data = file_bytes(path, kind)
    before, mark, rest = data.rpartition(MARK)
    if not mark:
        raise RecordingError(
            f"{path}: must be a {kind} with the SHA-256 that flighttune writes, got none: it is "
            f"cut off, of another program, or of flighttune 0.1.0; {remedy}."
        )
    if rest[:DIGITS] != _sha256(before, rest[DIGITS:]):
        raise RecordingError(
            f"{path}: must be a {kind} as it was written, got another SHA-256: it is damaged, cut "
            f"off or edited; {remedy}."
        )
    return data


def file_bytes(path: Path, kind: str) -> bytes:
    """Bytes of a file that is not empty, or one line that says why there are none."""
    if not path.is_file():
        got = "a folder" if path.is_dir() else "no such file"
        raise RecordingError(f"{path}: must be a {kind}, got {got}.")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: must be readable, got {reason_of(error)}.") from error
    if not data:
        raise RecordingError(f"{path}: must be a {kind}, got an empty file.")
    return data


def _sha256(before: bytes, after: bytes) -> bytes:
    return hashlib.sha256(before + after).hexdigest().encode()
