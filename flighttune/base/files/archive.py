"""Foreign zip archives: names and sizes are checked before anything is unpacked."""

import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import SEEK_END
from pathlib import Path

from flighttune.base.errors import InputError
from flighttune.base.files import table, whole
from flighttune.base.files.budget import MEMBERS, Budget

# Compressions that never unpack more than the stated size; bzip2 and LZMA unpack a whole block.
PACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


# First bytes of the record at the end of an archive and of that for larger ones, length of the
# first one, and maximum length of the comment after it.
END, LARGE, LENGTH, COMMENT = b"PK\x05\x06", b"PK\x06\x07", 22, 2**16


def _check_directory(path: Path) -> None:
    """Refuse an archive whose list of members does not fit into memory."""
    with path.open("rb") as file:
        file.seek(max(0, file.seek(0, SEEK_END) - LENGTH - COMMENT))
        end = file.read()
    at = end.rfind(END)
    size = struct.unpack_from("<I", end, at + 12)[0] if 0 <= at <= len(end) - LENGTH else 0
    if size > MEMBERS.size or LARGE in end:
        raise InputError(f"the list of its members must have at most {MEMBERS.size} bytes.")


@contextmanager
def opened(
    path: Path, kind: str, held: str, wanted: Callable[[str], bool], of: Budget
) -> Iterator[tuple[zipfile.ZipFile, list[str]]]:
    """An archive, and its `wanted` members, which have the budget `of` together.

    `kind` and `held` name in messages what the archive and its members must be.
    """
    try:
        if path.stat().st_size > of.size:
            raise InputError(f"the file must have at most {of.size} bytes, got more.")
        _check_directory(path)
        with zipfile.ZipFile(path) as archive:
            entries = [entry for entry in archive.infolist() if wanted(entry.filename)]
            seen = set[str]()
            for entry in entries:
                if entry.filename in seen:
                    name = table.shown(entry.filename)
                    raise InputError(f"`{name}` must be in the file once, got it twice.")
                seen.add(entry.filename)
                if entry.compress_type not in PACKED:
                    raise InputError(
                        f"`{table.shown(entry.filename)}` must be stored or deflated, got another "
                        "compression."
                    )
            if sum(entry.file_size for entry in entries) > of.unpacked:
                raise InputError(f"{held} must have at most {of.unpacked} bytes, got more.")
            yield archive, [entry.filename for entry in entries]
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"the file must be readable: {whole.reason_of(error)}.") from error
    except Exception as error:  # `zipfile` and readers of members raise a dozen kinds on damage
        reason = table.first_line(error)
        raise InputError(f"must be a {kind}, got {reason}.") from error
