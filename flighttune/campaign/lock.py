"""One campaign at a time in a folder: the process that flies into it locks a file there."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from flighttune.errors import InputError, OutputError
from flighttune.file_lock import try_lock
from flighttune.whole_file import reason_of

LOCK = "campaign.lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock the folder for the block; the system drops the lock of a process that was killed.

    Parameters
    ----------
    folder : Path
        Of a campaign; made where it does not exist.

    Raises
    ------
    InputError
        If another process has locked it.
    OutputError
        If the folder cannot be written, or its file system has no locks.
    """
    path = folder / LOCK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = try_lock(path, make=True)
        if lock is None:
            raise InputError(f"{folder}: a campaign is being flown into it{_owner(path)}.")
    except OSError as error:
        got = reason_of(error)
        raise OutputError(f"{path}: must be writable and locked, got {got}.") from error
    with suppress(OSError):  # the owner is only for the message; the lock works without it
        os.truncate(lock, 0)
        os.write(lock, f" by process {os.getpid()} on {socket.gethostname()}".encode())
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        os.close(lock)


def _owner(path: Path) -> str:
    with suppress(OSError, UnicodeDecodeError):
        return path.read_text(encoding="utf-8")
    return ""
