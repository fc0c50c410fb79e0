"""Whether a file is a recording of ours, before anything is done with it."""

import struct
import textwrap
import warnings
from pathlib import Path

from flighttune.errors import RecordingError
from flighttune.recording.names import APPLICATION

MAGIC = b"RRF2"
"""What every Rerun file (0.41) begins with."""

HEADER = 12
FRAME = struct.Struct("<QQ")
END, LAST_KIND = 0, 3

LONGEST_REASON = 160
"""Characters of what a library says about a file that are repeated."""


def brief(text: object) -> str:
    """The first line of `text`, cut to what a reader takes in."""
    first = next(iter(str(text).splitlines()), "no reason")
    return textwrap.shorten(first, LONGEST_REASON, placeholder=" ...").rstrip(".")


def check_kind(path: Path) -> None:
    """Make sure that a file begins like a recording.

    Raises
    ------
    RecordingError
        If it does not.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{path}: must be a recording (.rrd), got a file of another kind.")


def whole_part(path: Path) -> tuple[int, bool]:
    """How far the messages of a Rerun file (0.41) are whole.

    A file is a header of 12 bytes and then messages, each behind 16 bytes: its kind and its length,
    little-endian. Kind 0 ends the file; what follows is an index.

    Returns
    -------
    int
        Bytes up to the end of the last message that is whole.
    bool
        Whether that is all of them.

    Raises
    ------
    RecordingError
        If the file is damaged otherwise than by a cut.
    """
    size, end = path.stat().st_size, HEADER
    with path.open("rb") as file:
        while end + FRAME.size <= size:
            file.seek(end)
            kind, length = FRAME.unpack(file.read(FRAME.size))
            if kind > LAST_KIND:
                raise RecordingError(
                    f"{path}: must be a sound recording (.rrd), got damage at byte {end}."
                )
            if kind == END:
                return end, True
            if end + FRAME.size + length > size:
                return end, False
            end += FRAME.size + length
    return end, end == size


def check_recording(path: str | Path, *, whole: bool = False) -> None:
    """Make sure that `path` is a recording written by flighttune, and read all of it once.

    Parameters
    ----------
    path : path-like
        A ``.rrd`` file.
    whole : bool
        Refuse also a file whose writer was ended before it could write the index at the end.

    Raises
    ------
    RecordingError
        If there is no such file, it is empty, cut off in the middle, damaged anywhere, not from
        Rerun, or written by another program.
    """
    from rerun.chunk import RrdReader
    from rerun.error_utils import RerunWarning

    path = Path(path)
    if not path.is_file():
        what = "a folder" if path.is_dir() else "no such file"
        raise RecordingError(f"{path}: must be a recording (.rrd), got {what}.")
    if path.stat().st_size == 0:
        raise RecordingError(f"{path}: must be a recording (.rrd), got an empty file.")
    check_kind(path)
    end, all_whole = whole_part(path)
    if not all_whole:
        raise RecordingError(
            f"{path}: must be a sound recording (.rrd), got a message cut off at byte {end}."
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error" if whole else "ignore", RerunWarning)
            reader = RrdReader(path)
            recordings = reader.recordings()
            for store in (*recordings, *reader.blueprints()):
                for _ in reader.stream(store=store):
                    pass
    except (RuntimeError, ValueError, RerunWarning) as error:
        reason = brief(str(error).split(f"{path}: ")[-1])
        raise RecordingError(f"{path}: must be a sound recording (.rrd), got: {reason}.") from error
    programs = {entry.application_id for entry in recordings}
    if not any(name == APPLICATION or name.startswith(f"{APPLICATION}-") for name in programs):
        got = brief(", ".join(sorted(programs)) or "nothing")
        raise RecordingError(f"{path}: must be a recording of flighttune, got one of {got}.")
