"""Foreign zip archives: names and sizes are checked before anything is unpacked."""

import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from flighttune.base.errors import InputError
from flighttune.base.files import table, whole

# Compressions that never unpack more than the stated size; bzip2 and LZMA unpack a whole block.
PACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


@contextmanager
def opened(
    path: Path, kind: str, held: str, wanted: Callable[[str], bool], max_bytes: int, max_packed: int
) -> Iterator[tuple[zipfile.ZipFile, list[str]]]:
    """An archive, and its `wanted` members, which have at most `max_bytes` together.

    `kind` and `held` name in messages what the archive and its members must be.
    """
    try:
        if path.stat().st_size > max_packed:
            raise InputError(f"the file must have at most {max_packed} bytes, got more.")
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
            if sum(entry.file_size for entry in entries) > max_bytes:
                raise InputError(f"{held} must have at most {max_bytes} bytes, got more.")
            yield archive, [entry.filename for entry in entries]
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"the file must be readable: {whole.reason_of(error)}.") from error
    except Exception as error:  # `zipfile` and readers of members raise a dozen kinds on damage
        reason = table.shown(str(error)).rstrip(".")
        raise InputError(f"must be a {kind}, got {reason}.") from error
