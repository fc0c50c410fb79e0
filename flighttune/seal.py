"""The SHA-256 that a file carries over all its other bytes: a changed file is refused.

It is found by searching the bytes, before any library decodes them: one flipped bit can make
Rerun's decoder abort the process.
"""

import hashlib
from pathlib import Path

from flighttune.errors import RecordingError
from flighttune.whole_file import reason_of

MARK = b"SHA-256="
DIGITS = 64

RECORDING_FILE = "recording (.rrd)"

# As many bytes as the digits. LZ4, with which Rerun compresses, leaves as it is what has no four
# bytes in common with what comes before: letters that occur in no name, and not hexadecimal digits,
# of which the ids of Rerun are made.
BLANK = MARK.decode() + "".join(map(chr, range(0x100, 0x100 + DIGITS // 2)))
"""Placeholder that a file must contain, after all other text, where `seal` puts the SHA-256."""

GUARD = "".join(map(chr, range(0x180, 0x184)))
"""Text that follows `BLANK` in a recording, where zeros follow a text. LZ4 may store them as a
copy of earlier zeros, and with them the bytes before as far as these are equal too: an id may end
in the same byte. It then takes of these eight, and leaves `BLANK` as it is."""


def seal(data: bytes) -> bytes:
    """Replace `BLANK` in the bytes of a file by the SHA-256 of the rest.

    Raises RecordingError if the file does not hold `BLANK` as plain bytes.
    """
    before, blank, after = data.rpartition(BLANK.encode())
    if not blank:
        raise RecordingError("the file must have room for its SHA-256, got none.")
    return before + MARK + _sha256(before, after) + after


def sealed_bytes(path: Path, kind: str, remedy: str = "fly it again") -> bytes:
    """Bytes of a file, if they are those that `seal` returned.

    `kind`, `remedy`: what the file must be and what to do where it is not, for messages. Raises
    RecordingError if there is no such file, it cannot be read, is empty, has no SHA-256 or another
    one.
    """
    if not path.is_file():
        got = "a folder" if path.is_dir() else "no such file"
        raise RecordingError(f"{path}: must be a {kind}, got {got}.")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: must be readable, got {reason_of(error)}.") from error
    if not data:
        raise RecordingError(f"{path}: must be a {kind}, got an empty file.")
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


def seal_of(data: bytes) -> str:
    """The SHA-256 in the bytes that `seal` or `sealed_bytes` returned."""
    return data.rpartition(MARK)[2][:DIGITS].decode()


def _sha256(before: bytes, after: bytes) -> bytes:
    digest = hashlib.sha256(before)
    digest.update(after)
    return digest.hexdigest().encode()
