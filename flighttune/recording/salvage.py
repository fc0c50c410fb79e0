"""What can be had of a recording that was cut off: all messages that are whole.

A Rerun file (0.41) is a header of 12 bytes and then messages, each behind 16 bytes: its kind and
its length, little-endian. Kind 0 ends the file; what follows is an index.
"""

import struct
from pathlib import Path

from flighttune.errors import RecordingError
from flighttune.recording.check import check_kind

HEADER = 12
FRAME = struct.Struct("<QQ")
END, LAST_KIND = 0, 3


def whole_messages(path: Path) -> bytes:
    """The file up to its last message that is whole.

    Raises
    ------
    RecordingError
        If it does not begin like a recording, is damaged otherwise than by a cut, or holds no whole
        message.
    """
    check_kind(path)
    data = path.read_bytes()
    end = HEADER
    while end + FRAME.size <= len(data):
        kind, length = FRAME.unpack_from(data, end)
        if kind > LAST_KIND:
            raise RecordingError(f"{path}: must be a sound recording, got damage at byte {end}.")
        if kind == END or end + FRAME.size + length > len(data):
            break
        end += FRAME.size + length
    if end == HEADER:
        raise RecordingError(f"{path}: must be a recording (.rrd), got nothing whole in it.")
    return data[:end]
