"""Files written whole or not at all, and temporary folders."""

import os
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import IO

from flighttune.errors import FORKS, OutputError, RecordingError

MEMORY = Path("/dev/shm")  # a folder in memory, ten times as fast as a disk

# Beginning of the names of unfinished files, and the age from which one may be abandoned, s.
UNFINISHED, ABANDONED_S = ".flighttune-", 60.0


@contextmanager
def whole_file(path: Path, unfinished: Path | None = None) -> Iterator[Path]:
    """Give a temporary name beside `path`, or in `unfinished`; rename it if the block ends well."""
    folder = path.parent if unfinished is None else unfinished
    # Several blocks in an `ExitStack` are renamed after all are written, the last one first.
    part = folder / f"{UNFINISHED}{path.stem}-{uuid.uuid4().hex}{path.suffix}"
    try:
        for needed in (path.parent, folder):
            needed.mkdir(parents=True, exist_ok=True)
        for old in folder.glob(f"{UNFINISHED}*"):
            with suppress(OSError), old.open("rb") as file:  # locked, or just finished
                lock(file)
                if time.time() - old.stat().st_mtime > ABANDONED_S:
                    old.unlink()
        # Windows does not rename an open file
        with part.open("ab") if FORKS else nullcontext(-1) as file:
            with suppress(OSError):  # not every file system has locks
                lock(file)
            yield part
            part.replace(path)  # under its lock: nobody takes it for abandoned
    except OSError as error:
        raise OutputError(f"{path}: must be writable, got {reason_of(error)}.") from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def lock(file: "IO[bytes] | int") -> None:
    """Lock an open file until it is closed; OSError if another process has, or it has no locks."""
    if not FORKS:
        raise OSError("no locks of POSIX")
    import fcntl

    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def write_text(path: Path, text: str) -> Path:
    """Write a file whole, in UTF-8 with the line ends of `text`; OutputError if it cannot be."""
    with whole_file(path) as part:
        part.write_bytes(text.encode())
    return path


def reason_of(error: OSError) -> str:
    """Message of the system without error number and file: ``no space left on device``."""
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


@contextmanager
def allowed(path: object, what: str, kind: type[Exception] = RecordingError) -> Iterator[None]:
    """Raise `kind` where the system refuses the block: `path` must be `what`, such as readable."""
    try:
        yield
    except OSError as error:
        raise kind(f"{path}: must be {what}, got {reason_of(error)}.") from error


def made_folder(folder: Path) -> Path:
    """Make a folder and those above it; OutputError if it cannot be made."""
    with allowed(folder, "writable", OutputError):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def scratch_folder() -> "TemporaryDirectory[str]":
    """A private temporary folder; OSError if none can be made."""
    return TemporaryDirectory(prefix="flighttune-", dir=scratch_place(), ignore_cleanup_errors=True)


def scratch_place() -> Path:
    """Folder for temporary folders: in memory, unless ``TMPDIR`` says otherwise."""
    in_memory = "TMPDIR" not in os.environ and os.access(MEMORY, os.W_OK | os.X_OK)
    return MEMORY if in_memory else Path(gettempdir())
