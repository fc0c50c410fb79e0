"""Origin of a recording: the runs it shows, and the folder of their Parquet files."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa

from flighttune.errors import RecordingError
from flighttune.recording.run_record import first_line
from flighttune.seal import file_bytes

if TYPE_CHECKING:
    import rerun as rr

RECORDING_FILE = "recording (.rrd)"
PROPERTY = "record"  # name of the recording property; the viewer shows it with the recording


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Place of the record behind a drawing."""

    folder: str  # as the user gave it; only the last name of an absolute path
    sha256: tuple[str, ...]  # of each run, in order, as its Parquet file states it


def origin_in(folder: Path, sha256: tuple[str, ...]) -> Origin:
    """The origin of a recording written to `folder`, without the private part of its path."""
    return Origin(folder=folder.name if folder.is_absolute() else str(folder), sha256=sha256)


def log_origin(stream: "rr.RecordingStream", origin: Origin) -> None:
    """State in a recording which runs it shows."""
    import rerun as rr

    stated = rr.AnyValues(folder=origin.folder, sha256=list(origin.sha256))
    stream.send_property(PROPERTY, stated)


def check_recording(path: str | Path) -> None:
    """Refuse a file that is no Rerun recording; the viewer reports faults inside one."""
    if not file_bytes(Path(path), RECORDING_FILE).startswith(b"RRF"):
        raise RecordingError(f"{path}: must be a {RECORDING_FILE}, got another file.")


def read_origin(path: Path) -> Origin | None:
    """Names of the runs in a recording; None if they were not recorded with it."""
    from rerun.chunk import RrdReader

    try:
        reader = RrdReader(path)
        store = reader.store(store=reader.recordings()[0])
        for chunk in store.stream().filter(content=f"/__properties/{PROPERTY}").to_chunks():
            stated = chunk.to_record_batch()
            (folder,), sha256 = (stated.column(key)[0].as_py() for key in ("folder", "sha256"))
            return Origin(folder=folder, sha256=tuple(sha256))
    except (RuntimeError, ValueError, KeyError, IndexError, pa.ArrowException) as error:
        got = first_line(error)
        raise RecordingError(f"{path}: must be a {RECORDING_FILE}, got: {got}.") from error
    return None
