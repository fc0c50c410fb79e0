"""What can be had of a recording that was cut off: all messages that are whole."""

from pathlib import Path

from flighttune.errors import RecordingError
from flighttune.recording.check import HEADER, check_kind, whole_part


def whole_messages(path: Path) -> bytes:
    """The file up to its last message that is whole.

    Raises
    ------
    RecordingError
        If it does not begin like a recording, is damaged otherwise than by a cut, or holds no whole
        message.
    """
    check_kind(path)
    end, _ = whole_part(path)
    if end == HEADER:
        raise RecordingError(f"{path}: must be a recording (.rrd), got nothing whole in it.")
    with path.open("rb") as file:
        return file.read(end)
