"""The SHA-256 that a file carries over all its other bytes: a changed file is refused.

In a Parquet file the digits stand in the metadata of the schema, which is never compressed, in a
JSON file under a key. They are compared before any library decodes the file.
"""

import hashlib
import re
from collections.abc import Collection
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile

from flighttune.errors import RecordingError
from flighttune.files.mistakes import abridged
from flighttune.files.table import json_tables
from flighttune.files.whole import reason_of

MARK = b"SHA-256="
DIGITS = 64

# Write this as the value of the last key in the metadata: whatever looks like it stands before it.
BLANK = MARK.decode() + "0" * DIGITS

# Kinds of files by what their `format` begins with
FILES = {
    "flighttune band": "a band file, which `flighttune band`, `fly --claim` and `verify` take",
    "flighttune tube": "the proof of a tube, which `fly --claim`, `verify` and `worst` take",
    "flighttune certificate": "a certificate, which `flighttune verify` takes",
    "flighttune rate bound": "a bound on R_K, which `flighttune verify` takes",
}

# Kinds of files without a `format` by what they begin with
BEGINNINGS = {
    b"RRF": "a recording, which `flighttune view` and `refly` take",
    b"PAR1": "a Parquet file, which `flighttune report` and `refly` take",
}

# Bytes at the beginning of a file, or of its first array, that hold its `format`
HEAD = 4096


# What the files of tubes and bands begin with, whatever follows it
ARCHIVE = b"PK"


def seal(data: bytes) -> bytes:
    """Put the SHA-256 of all other bytes of a file in the place of `BLANK`."""
    before, _, after = data.rpartition(BLANK.encode())
    return before + MARK + _sha256(before, after) + after


def sealed_bytes(path: Path, kind: str, remedy: str = "fly it again") -> bytes:
    """Bytes of a file, if they are those that `seal` returned; `kind` is what it must be."""
    data = file_bytes(path, kind)
    if kind not in (actual := FILES.get(_format_in(data), kind)):
        raise RecordingError(f"{path}: must be a {kind}, got {actual}.")
    before, mark, footer = data.rpartition(MARK)
    if not mark:
        raise RecordingError(
            f"{path}: must be a {kind} with the SHA-256 that flighttune writes, got none: it is "
            f"cut off, of another program, or of flighttune 0.1.0; {remedy}."
        )
    if footer[:DIGITS] != _sha256(before, footer[DIGITS:]):
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


def format_of(path: Path, formats: Collection[str], kind: str) -> str:
    """Which of some `formats` a file has; a RecordingError if it is no `kind`."""
    data = file_bytes(path, kind)
    stated = _format_in(data)
    if stated in formats:
        return stated
    if data.lstrip().startswith(b"{") and stated not in FILES:
        got = abridged(json_tables(path).get("format"))
        raise RecordingError(f"{path}: `format` must be that of a {kind}, got {got}.")
    begun = [what for begin, what in BEGINNINGS.items() if data.startswith(begin)]
    got = FILES.get(stated) or (begun or ["another file, or a damaged one"])[0]
    raise RecordingError(f"{path}: must be a {kind}, got {got}.")


def _format_in(data: bytes) -> str:
    """The `format` in the JSON text or in the first array of a file, without its number."""
    with suppress(Exception):  # `zipfile` raises a dozen kinds on what is no archive, or damaged
        archive = ZipFile(BytesIO(data))
        with archive.open(archive.infolist()[0]) as member:
            data = member.read(HEAD).replace(b"\0", b"")  # NumPy's letters have four bytes
    match = re.search(r'"format":\s*"([a-z ]+) \d', data[:HEAD].decode(errors="replace"))
    return match[1] if match else ""


def _sha256(before: bytes, after: bytes) -> bytes:
    return hashlib.sha256(before + after).hexdigest().encode()


def is_claim_file(path: str | Path) -> bool:
    """Whether a file is that of a claim, by its content, or a damaged one of a tube or band."""
    with suppress(OSError), Path(path).open("rb") as file:
        if file.read(len(ARCHIVE)) == ARCHIVE:
            return True
    with suppress(RecordingError):
        return bool(format_of(Path(path), FILES, "claim"))
    return False
