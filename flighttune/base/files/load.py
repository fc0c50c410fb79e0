"""Files that flighttune reads: this module recognises the kind of each by content and reads it.

The readers stand in a table and are imported on first use, so this module knows the kinds of files
but not their contents. Most files carry the SHA-256 of all their other bytes, and a changed file is
refused before any library decodes it. A Parquet file has the hash in the metadata of its schema,
which is never compressed; an archive has it in its comment, and a claim in JSON as its last value.
"""

import hashlib
import os
import re
import struct
import zlib
from contextlib import suppress
from importlib import import_module
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZIP_DEFLATED, ZIP_STORED

from flighttune.base.errors import RecordingError
from flighttune.base.files import budget, table, whole

MARK = b"SHA-256="
DIGITS = 64

# Placeholder of the hash. It must be the last value in the metadata, so that the last match in the
# file is the placeholder.
BLANK = MARK.decode() + "0" * DIGITS

# Kinds of files. The kind of a claim is the beginning of its `format`.
CERTIFICATE, BOUND = "flighttune certificate", "flighttune rate bound"
TUBE, BAND, MONITOR = "flighttune tube", "flighttune band", "flighttune monitor"
PER_HOUR = "flighttune flight hours"
RECORDING, DATASET, LOG = "recording", "campaign", "log"

# Each kind of file in words, with the commands that take it.
SHOWN = {
    CERTIFICATE: "a certificate, which `flighttune verify` takes",
    BOUND: "a bound on R_K, which `flighttune verify` takes",
    TUBE: "the proof of a tube, which `fly --claim`, `verify` and `worst` take",
    BAND: "a band file, which `flighttune band`, `fly --claim` and `verify` take",
    MONITOR: "a monitor of logs, which `flighttune report LOG --claim` and `verify` take",
    PER_HOUR: "a claim per flight hour, which `flighttune verify` takes",
    RECORDING: "a recording, which `flighttune view`, `report` and `verify` take",
    DATASET: "the folder of a campaign, which `flighttune report` and `verify` take",
    LOG: "the log of a flight, which `flighttune report` and `gap` take",
    "": "another file, or a damaged one",
}

# Bytes at the beginning of a file, or of its first array, that hold its `format`
HEAD = 4096

# Number of bytes of a file that are read at a time to hash it.
AT_A_TIME = 2**20

# Reader of each kind of file, as module:function.
READERS = {
    CERTIFICATE: "flighttune.control.certificates.certificate:load_certificate",
    BOUND: "flighttune.control.certificates.bound:load_bound",
    TUBE: "flighttune.claims.tubes.enclosure:load_tube",
    BAND: "flighttune.claims.counted_file:load_counted",
    MONITOR: "flighttune.claims.monitor:load_monitor",
    PER_HOUR: "flighttune.claims.per_hour:load_per_hour",
    RECORDING: "flighttune.flight.records.parquet:load_recording",
    DATASET: "flighttune.campaigns.dataset:open_dataset",
    LOG: "flighttune.logs.log:load_part",
}

CLAIMS = tuple(kind for kind in READERS if kind.startswith("flighttune "))

# Claims that can be drawn around flights.
AROUND_FLIGHTS = TUBE, BAND, MONITOR

A_LOG = "log of a flight (.ulg, .bin, .tlog or .csv)"

CAMPAIGN = "campaign.json"  # a folder with this file is the folder of a campaign

# First bytes of files; in a telemetry log they follow the time of the first message.
RERUN, PARQUET, ARCHIVE = b"RRF", b"PAR1", b"PK"

# First bytes and maximum size of the record at the end of a zip archive.
ARCHIVE_END, LONGEST_END = b"PK\x05\x06", 2**16 + 22

LOG_STARTS = {"ULog": b"ULog\x01\x12\x35", "DataFlash": (b"\xa3\x95", b"FMT,"), "csv": b"<LABELS>"}

# Kind of a file whose content does not show it: a table has no signature.
ENDINGS: dict[str, str] = dict.fromkeys((".rrd", ".parquet"), RECORDING)
ENDINGS |= dict.fromkeys((".ulg", ".bin", ".tlog", ".csv"), LOG)


def load_one(path: object, what: str, *kinds: str, columns: Any = ()) -> Any:
    """Read a file of one of some kinds; a RecordingError says that it must be `what`.

    A value that is not a path has been read before and is returned as it is.
    """
    if not isinstance(path, str | Path):
        return path
    if (value := written(path, *kinds, columns=columns)) is not None:
        return value
    place, kind = _place(path), kind_of(path)
    if not kind and file_bytes(place, what, HEAD).lstrip().startswith(b"{"):
        got = table.abridged(table.json_tables(place).get("format"))
        raise RecordingError(f"{place}: `format` must be that of a {what}, got {got}.")
    raise RecordingError(f"{place}: must be a {what}, got {SHOWN[kind]}.")


def written(source: object, *kinds: str, columns: Any = ()) -> Any:
    """The value in a file of one of some kinds; None for anything else, such as a scenario."""
    kind = kind_of(source) if isinstance(source, str | Path) else ""
    if kind not in kinds:
        return None
    module, _, reader = READERS[kind].partition(":")
    read = getattr(import_module(module), reader)
    return read(str(source), columns) if kind == LOG else read(_place(str(source)))


def kind_of(source: str | Path) -> str:
    """Kind of a file by its content, else by its ending; empty for an unknown kind."""
    path, head, stated = _place(source), b"", ""
    whole.check_whole(path)
    if os.path.isdir(path):
        return DATASET if (path / CAMPAIGN).is_file() else RECORDING
    with suppress(RecordingError), budget.opened(path) as file:
        head = file.read(16)
        stated = stated_format(file)
    if head.startswith((RERUN, PARQUET)):
        return RECORDING
    if stated in READERS:
        return stated
    if head.startswith(ARCHIVE) and path.suffix.lower() != ".kmz":  # a map, packed as a zip
        raise RecordingError(
            f"{path}: must be a file that can be read, got an archive that flighttune did not "
            "write, or that is damaged or cut off."
        )
    return LOG if kind_of_log(head) else ENDINGS.get(path.suffix.lower(), "")


def kind_of_log(head: bytes) -> str:
    """Kind of a log by its first bytes; empty for other files and for most tables."""
    for kind, start in LOG_STARTS.items():
        if head.startswith(start):
            return kind
    return "MAVLink" if len(head) > 8 and head[8] in b"\xfe\xfd" else ""


def _place(source: str | Path) -> Path:
    """The file of a source, without the selection after an ``@``."""
    path = Path(source)
    return path if os.path.exists(path) else Path(str(source).partition("@")[0])


def words_of(stated: str) -> str:
    """The kind of file with a `format`, in words without an article."""
    return SHOWN[stated.rpartition(" ")[0]].partition(",")[0].partition(" ")[2]


def is_sealed(path: Path) -> bool:
    """Whether a file has the SHA-256 of its other bytes, right or wrong."""
    return MARK in file_bytes(path, "file")


def seal(data: bytes) -> bytes:
    """Put the SHA-256 of all other bytes of a file in the place of `BLANK`."""
    before, _, after = data.rpartition(BLANK.encode())
    return before + MARK + _sha256(before, after) + after


def seal_end(path: Path) -> None:
    """Put the SHA-256 of all other bytes of a file in the place of `BLANK`, which are its last."""
    with path.open("r+b") as file:
        length, digest = file.seek(-len(BLANK), SEEK_END), hashlib.sha256()
        file.seek(0)
        while part := file.read(min(AT_A_TIME, length - file.tell())):
            digest.update(part)
        file.write(MARK + digest.hexdigest().encode())


def sealed_bytes(path: Path, kind: str, remedy: str = "fly it again") -> bytes:
    """Bytes of a file whose hash, set by `seal`, is right; messages call the file a `kind`."""
    data = file_bytes(path, kind)
    if kind not in (actual := SHOWN.get(stated_format(BytesIO(data)) or kind, kind)):
        raise RecordingError(f"{path}: must be a {kind}, got {actual}.")
    # Slices of `data` would be copies, and the file of 30,000 flights has 80 MB.
    at, seen = data.rfind(MARK), memoryview(data)
    if at < 0:
        raise RecordingError(
            f"{path}: must be a {kind} with the SHA-256 that flighttune writes, got none: it is "
            f"cut off, of another program, or of an early flighttune; {remedy}."
        )
    begin, end = at + len(MARK), at + len(MARK) + DIGITS
    if data[begin:end] != _sha256(seen[:at], seen[end:]):
        raise RecordingError(
            f"{path}: must be a {kind} as it was written, got another SHA-256: it is damaged, cut "
            f"off or edited; {remedy}."
        )
    return data


def file_bytes(path: Path, kind: str, first: int | None = None) -> bytes:
    """All bytes, or the `first` bytes, of a file that is not empty; else a RecordingError."""
    if not os.path.isfile(path):
        if not os.path.exists(path):
            raise RecordingError(f"{path}: there is no such file.")
        got = "a folder" if path.is_dir() else "no file"
        raise RecordingError(f"{path}: must be a {kind}, got {got}.")
    if first is None:
        data = budget.file_bytes(path, budget.SEALED)
    else:
        with budget.opened(path) as file:
            data = file.read(first)
    if not data:
        raise RecordingError(f"{path}: must be a {kind}, got an empty file.")
    return data


def stated_format(file: BinaryIO) -> str:
    """The `format` in the JSON text or in the first array of a file, without its number."""
    file.seek(0)
    data = file.read(2 * HEAD)
    if data.startswith(ARCHIVE):
        file.seek(max(0, file.seek(0, SEEK_END) - LONGEST_END))
        cut = ARCHIVE_END not in file.read()
        # NumPy's letters have four bytes
        data = b"" if cut else _first_member(data).replace(b"\0", b"")
    match = re.search(r'"format":\s*"([a-z ]+) \d', data[:HEAD].decode(errors="replace"))
    return match[1] if match else ""


def _first_member(data: bytes) -> bytes:
    """First bytes of the first member of a zip archive; empty unless it is stored or deflated."""
    with suppress(struct.error, zlib.error):
        packing, *lengths = struct.unpack_from("<8xH16xHH", data)
        body = data[30 + sum(lengths) :]
        if packing == ZIP_DEFLATED:
            return zlib.decompressobj(-zlib.MAX_WBITS).decompress(body, HEAD)
        return body[:HEAD] if packing == ZIP_STORED else b""
    return b""


def _sha256(before: bytes | memoryview, after: bytes | memoryview) -> bytes:
    digest = hashlib.sha256(before)
    digest.update(after)
    return digest.hexdigest().encode()
