"""One campaign at a time in a folder: the process that flies into it locks a file there."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from flighttune.errors import InputError, OutputError
from flighttune.whole_file import reason_of

LOCK = "campaign.lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock the folder for the block; the system drops the lock of a process that was killed.

    The folder is made where it does not exist. InputError if another process has locked it,
    OutputError if it cannot be written or its file system has no locks.
    """
    path = folder / LOCK
    lock = FileLock(path, timeout=0.0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        raise InputError(f"{folder}: a campaign is being flown into it{_owner(path)}.") from error
    except OSError as error:
        got = reason_of(error)
        raise OutputError(f"{path}: must be writable and locked, got {got}.") from error
    with suppress(OSError):  # the owner is only for the message; the lock works without it
        path.write_bytes(f" by process {os.getpid()} on {socket.gethostname()}".encode())
    try:
        yield
    finally:
        lock.release()


def _owner(path: Path) -> str:
    with suppress(OSError, UnicodeDecodeError):
        return path.read_text(encoding="utf-8")
    return ""
