"""The SHA-256 that a file carries over all its other bytes: a changed file is refused.

In a Parquet file the digits stand in the metadata of the schema, which is never compressed, in a
JSON file under a key. They are compared before any library decodes the file.
"""

import hashlib
import re
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO
from zipfile import ZipFile

from flighttune.errors import RecordingError
from flighttune.files.whole import reason_of

MARK = b"SHA-256="
DIGITS = 64

# Write this as the value of the last key in the metadata: whatever looks like it stands before it.
BLANK = MARK.decode() + "0" * DIGITS

# Kinds of files; those of claims are what their `format` begins with.
CERTIFICATE, BOUND = "flighttune certificate", "flighttune rate bound"
TUBE, BAND, MONITOR = "flighttune tube", "flighttune band", "flighttune monitor"
RECORDING, DATASET, LOG = "recording", "campaign", "log"

# What a file is, and what takes it.
SHOWN = {
    CERTIFICATE: "a certificate, which `flighttune verify` takes",
    BOUND: "a bound on R_K, which `flighttune verify` takes",
    TUBE: "the proof of a tube, which `fly --claim`, `verify` and `worst` take",
    BAND: "a band file, which `flighttune band`, `fly --claim` and `verify` take",
    MONITOR: "a monitor of logs, which `flighttune report LOG --claim` takes",
    RECORDING: "a recording, which `flighttune view`, `report` and `verify` take",
    DATASET: "the folder of a campaign, which `flighttune report` and `verify` take",
    LOG: "the log of a flight, which `flighttune report` and `gap` take",
    "": "another file, or a damaged one",
}

# Bytes at the beginning of a file, or of its first array, that hold its `format`
HEAD = 4096


def seal(data: bytes) -> bytes:
    """Put the SHA-256 of all other bytes of a file in the place of `BLANK`."""
    before, _, after = data.rpartition(BLANK.encode())
    return before + MARK + _sha256(before, after) + after


def sealed_bytes(path: Path, kind: str, remedy: str = "fly it again") -> bytes:
    """Bytes of a file, if they are those that `seal` returned; `kind` is what it must be."""
    data = file_bytes(path, kind)
    if kind not in (actual := SHOWN.get(stated_format(BytesIO(data)) or kind, kind)):
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


def stated_format(file: BinaryIO) -> str:
    """The `format` in the JSON text or in the first array of a file, without its number."""
    file.seek(0)
    data = file.read(HEAD)
    with suppress(Exception):  # `zipfile` raises a dozen kinds on what is no archive, or damaged
        archive = ZipFile(file)
        with archive.open(archive.infolist()[0]) as member:
            data = member.read(HEAD).replace(b"\0", b"")  # NumPy's letters have four bytes
    match = re.search(r'"format":\s*"([a-z ]+) \d', data.decode(errors="replace"))
    return match[1] if match else ""


def _sha256(before: bytes, after: bytes) -> bytes:
    return hashlib.sha256(before + after).hexdigest().encode()
