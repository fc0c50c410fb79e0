"""Files that were written: one place asks what each is, by its content, and reads it.

The readers stand in a table and are imported on first use: this module knows every kind of file,
and nothing of what they hold.
"""

from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from flighttune.errors import RecordingError
from flighttune.files.mistakes import abridged
from flighttune.files.seal import (
    BAND,
    BOUND,
    CERTIFICATE,
    DATASET,
    LOG,
    MONITOR,
    RECORDING,
    SHOWN,
    TUBE,
    file_bytes,
    stated_format,
)
from flighttune.files.table import json_tables

CLAIMS = (CERTIFICATE, BOUND, TUBE, BAND)

# Reader of each kind of file, as module:function.
READERS = {
    CERTIFICATE: "flighttune.certificates.certificate:load_certificate",
    BOUND: "flighttune.certificates.bound:load_bound",
    TUBE: "flighttune.tubes.enclosure:load_tube",
    BAND: "flighttune.campaign.band:load_counted",
    MONITOR: "flighttune.claims.of_logs:load_monitor",
    RECORDING: "flighttune.records.parquet:load_recording",
    DATASET: "flighttune.campaign.dataset:open_dataset",
    LOG: "flighttune.logs.log:load_part",
}

A_LOG = "log of a flight (.ulg, .bin, .tlog or .csv)"

CAMPAIGN = "campaign.json"  # the file that makes a folder that of a campaign

# What files begin with; a telemetry log has the time of its first message before it.
RERUN, PARQUET, ARCHIVE = b"RRF", b"PAR1", b"PK"
LOG_STARTS = {"ULog": b"ULog\x01\x12\x35", "DataFlash": b"\xa3\x95", "csv": b"<LABELS>"}
MAVLINK_STARTS = b"\xfe\xfd"

# Kind of a file whose content does not tell it: a table has no mark.
ENDINGS: dict[str, str] = dict.fromkeys((".rrd", ".parquet"), RECORDING)
ENDINGS |= dict.fromkeys((".ulg", ".bin", ".tlog", ".csv"), LOG)


def load_one(path: str | Path, what: str, *kinds: str, columns: Any = ()) -> Any:
    """Read a file of one of some kinds; a RecordingError says that it must be `what`."""
    if (value := written(path, *kinds, columns=columns)) is not None:
        return value
    place, kind = _place(path), kind_of(path)
    if not kind and file_bytes(place, what).lstrip().startswith(b"{"):
        got = abridged(json_tables(place).get("format"))
        raise RecordingError(f"{place}: `format` must be that of a {what}, got {got}.")
    raise RecordingError(f"{place}: must be a {what}, got {SHOWN[kind]}.")


def written(source: object, *kinds: str, columns: Any = ()) -> Any:
    """The value in a file of one of some kinds; None for all else, which may be flown."""
    kind = kind_of(source) if isinstance(source, str | Path) else ""
    if kind not in kinds:
        return None
    module, _, reader = READERS[kind].partition(":")
    read = getattr(import_module(module), reader)
    return read(str(source), columns) if kind == LOG else read(_place(str(source)))


def kind_of(source: str | Path) -> str:
    """Kind of a file by its content, or else by its ending; empty for what nobody wrote."""
    path, head, stated = _place(source), b"", ""
    if path.is_dir():
        return DATASET if (path / CAMPAIGN).is_file() else RECORDING
    with suppress(OSError), path.open("rb") as file:
        head = file.read(16)
        stated = stated_format(file)
    if head.startswith((RERUN, PARQUET)):
        return RECORDING
    if stated in READERS:
        return stated
    if head.startswith(ARCHIVE):
        raise RecordingError(
            f"{path}: must be a file that can be read, got an archive that flighttune did not "
            "write, or that is damaged or cut off."
        )
    return LOG if kind_of_log(head) else ENDINGS.get(path.suffix.lower(), "")


def kind_of_log(head: bytes) -> str:
    """Kind of a log by its first bytes; empty for another file and most tables."""
    for kind, start in LOG_STARTS.items():
        if head.startswith(start):
            return kind
    return "MAVLink" if len(head) > 8 and head[8] in MAVLINK_STARTS else ""


def _place(source: str | Path) -> Path:
    """The file of a source, without the part that is chosen of it behind an ``@``."""
    path = Path(source)
    return path if path.exists() else Path(str(source).partition("@")[0])
