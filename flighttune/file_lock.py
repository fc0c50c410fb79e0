"""Locks that the system holds for a process, and drops when it ends, however it ends."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_FAR = 2**30
"""Byte that is locked on Windows, where no process can read what another has locked."""

SCRATCH = "flighttune-scratch-"
"""What the names of temporary folders begin with."""

_RANDOM = "?" * 8
"""The end that `tempfile` gives them."""


def try_lock(path: Path, *, make: bool = False) -> int | None:
    """Lock a file or a folder.

    Parameters
    ----------
    path : Path
    make : bool
        Make the file, where there is none, and open it to be written.

    Returns
    -------
    int or None
        The descriptor that has the lock, to be closed; None where another one has it.

    Raises
    ------
    OSError
        If it cannot be opened, or not locked on this system.

    Notes
    -----
    ``flock(2)``, on Windows ``_locking``. The lock belongs to the open file, so that it holds
    against this process too; a process started from this one does not get it, because Python opens
    no file for its children. Windows opens no folders, so that none can be locked there.
    """
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT if make else os.O_RDONLY, 0o644)
        try:
            _lock(descriptor)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                    return descriptor
        except OSError as error:
            os.close(descriptor)
            if isinstance(error, BlockingIOError):
                return None
            raise
        os.close(descriptor)  # who had the lock removed the file: what is there now is another


def _lock(descriptor: int) -> None:
    """Lock an open file.

    Raises
    ------
    BlockingIOError
        If another one has it.
    """
    if fcntl is not None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return
    msvcrt: Any = import_module("msvcrt")
    os.lseek(descriptor, _FAR, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    except PermissionError as error:
        raise BlockingIOError(*error.args) from error
    finally:
        os.lseek(descriptor, 0, os.SEEK_SET)


@contextmanager
def scratch_folder(place: Path | None = None) -> Iterator[Path]:
    """Give a temporary folder; the first call also removes those of processes that were killed.

    Parameters
    ----------
    place : Path, optional
        Where to make it; by default where `tempfile` does.

    Yields
    ------
    Path
        Of a folder that only this user can read.

    Raises
    ------
    OSError
        If none can be made.
    """
    where = Path(tempfile.gettempdir()) if place is None else place
    _sweep(where)
    folder, lock = _locked_folder(where)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if lock is not None:
            os.close(lock)


@cache
def _sweep(where: Path) -> None:
    for folder in where.glob(f"{SCRATCH}{_RANDOM}"):
        with suppress(OSError):  # of another user, or gone by now
            lock = try_lock(folder)
            if lock is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(lock)


def _locked_folder(where: Path) -> tuple[Path, int | None]:
    """A new folder and its lock; no lock where the system has none, and then it is not swept."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=SCRATCH, dir=where))
        try:
            lock = try_lock(folder)
        except FileNotFoundError:
            continue  # swept by another process before it was locked
        except OSError:
            return folder, None
        if lock is not None:
            return folder, lock
