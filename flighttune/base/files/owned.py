"""Files and folders of this user, in folders where others can write too.

What flighttune wrote itself, and reads back, removes or moves, must be of the user who runs it.
Root is no exception. It is opened without following a link or waiting for a pipe, and looked at
once it is open, so that nobody can exchange it in between.
"""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from flighttune.base.errors import FORKS, OutputError

# A link is not followed, a pipe not waited for. Windows has neither flag.
NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
FOLDER = getattr(os, "O_DIRECTORY", 0)

# Writing by all, by the group too, and everything that both may do.
ALL_WRITE, OTHERS_WRITE, OTHERS = 0o002, 0o022, 0o077


def is_mine(state: os.stat_result) -> bool:
    """Whether it is a regular file or a folder of this user."""
    known = stat.S_ISREG(state.st_mode) or stat.S_ISDIR(state.st_mode)
    return known and (not FORKS or state.st_uid == os.geteuid())


def is_private(state: os.stat_result, others: int = OTHERS_WRITE) -> bool:
    """Whether it is a file or folder of this user with which `others` can do nothing."""
    return is_mine(state) and not (FORKS and state.st_mode & others)


def is_believed(path: Path) -> bool:
    """Whether a file is one that this user wrote, and that nobody else can have changed."""
    with suppress(OSError), opened(path) as file:
        return stat.S_ISREG(os.fstat(file).st_mode) and is_private(os.fstat(file))
    return False


def is_my_file(path: Path) -> bool:
    """Whether a path is that of a file of this user, and no link."""
    with suppress(OSError):
        return stat.S_ISREG(os.lstat(path).st_mode) and is_mine(os.lstat(path))
    return False


def check_inside(path: Path, folder: Path) -> None:
    """Refuse a file to write or remove below a folder if a link leads to another place.

    The folder is what the user named, and may be packed by somebody else.
    """
    if not Path(os.path.realpath(path.parent)).is_relative_to(os.path.realpath(folder)):
        raise OutputError(f"{path.parent}: must be inside {folder}, got a link out of it.")


@contextmanager
def opened(name: str | Path, inside: int | None = None, flags: int = os.O_RDONLY) -> Iterator[int]:
    """Open a file or folder that is no link; one that is made is this user's alone."""
    file = os.open(name, flags | NO_LINK, 0o600, dir_fd=inside)
    try:
        yield file
    finally:
        os.close(file)


@contextmanager
def folder_inside(inside: int, parts: tuple[str, ...], *, make: bool = False) -> Iterator[int]:
    """Open a folder below an open one; no part of the path is a link."""
    at = os.dup(inside)
    try:
        for part in parts:
            if make:
                with suppress(FileExistsError):
                    os.mkdir(part, dir_fd=at)
            below = os.open(part, FOLDER | NO_LINK, dir_fd=at)
            os.close(at)
            at = below
        yield at
    finally:
        os.close(at)


def believed_bytes(path: Path) -> bytes:
    """The bytes of a file of this user in a folder of this user; OSError for any other.

    The group may write into the folder, as many systems let it by default: it can then exchange
    files of this user, which must tell by their content what they are of.
    """
    with opened(path.parent, flags=FOLDER) as folder, opened(path.name, folder) as file:
        if not (is_private(os.fstat(folder), ALL_WRITE) and is_private(os.fstat(file))):
            raise PermissionError(errno.EPERM, "not of this user alone", str(path))
        with open(file, "rb", closefd=False) as data:
            return data.read()


@contextmanager
def appended(path: Path) -> Iterator[int]:
    """Open a file of this user for lines at its end, or make it; OSError for any other."""
    with opened(path, flags=os.O_WRONLY | os.O_APPEND | os.O_CREAT) as file:
        if not (stat.S_ISREG(os.fstat(file).st_mode) and is_mine(os.fstat(file))):
            raise PermissionError(errno.EPERM, "a file of another user", str(path))
        yield file


def own_folder(base: Path, *names: str) -> Path:
    """A folder below `base` for this user alone, made if there is none; OSError where it cannot be.

    `base` may be shared: what another user put there, also a link, is neither used nor changed.
    """
    base.mkdir(parents=True, exist_ok=True)
    for name in names:
        base = base / name
        with suppress(FileExistsError):
            base.mkdir(mode=0o700)
        with opened(base, flags=FOLDER) as folder:
            if not is_mine(os.fstat(folder)):
                raise PermissionError(errno.EPERM, "a folder of another user", str(base))
            os.fchmod(folder, 0o700)
    return base
