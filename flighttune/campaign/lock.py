"""One campaign at a time in a folder: a small file that says which process is flying into it."""

import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from flighttune.errors import InputError, OutputError

LOCK = "campaign.lock"
CLOCK_SLACK_S = 2.0
"""Start times of a process, read twice, differ by less; two processes of one number by more."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock the folder for the block; a lock left by a process of this machine is taken over.

    Parameters
    ----------
    folder : Path
        Of a campaign; made where it does not exist.

    Raises
    ------
    InputError
        If another process has locked it.
    OutputError
        If the folder cannot be written.
    """
    lock = folder / LOCK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _lock(lock)
    except OSError as error:
        raise OutputError(f"{lock}: must be writable, got: {error.strerror}.") from error
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink()


def _lock(lock: Path) -> None:
    if _created(lock):
        return
    owner = _owner(lock)
    if _may_be_running(owner):
        raise InputError(
            f"{lock.parent}: a campaign is being flown into it by process {owner.get('pid')} on "
            f"{owner.get('host')}; if that one is gone, remove {lock}."
        )
    lock.unlink(missing_ok=True)  # its process was killed
    if not _created(lock):
        raise InputError(f"{lock.parent}: another campaign has just been started into it.")


def _created(lock: Path) -> bool:
    """Whether the file was made now, for this process; False where it was there already."""
    import psutil

    started = psutil.Process().create_time()
    try:
        with lock.open("x", encoding="utf-8") as file:
            json.dump({"host": socket.gethostname(), "pid": os.getpid(), "started": started}, file)
    except FileExistsError:
        return False
    return True


def _owner(lock: Path) -> dict[str, Any]:
    try:
        found = json.loads(lock.read_bytes())
    except (OSError, ValueError):  # gone by now; or its process was killed while it wrote
        return {}
    return found if isinstance(found, dict) else {}


def _may_be_running(owner: dict[str, Any]) -> bool:
    """Whether the owner may still run; of a process of another machine that cannot be known."""
    import psutil

    pid, started = owner.get("pid"), owner.get("started")
    if not isinstance(pid, int) or not isinstance(started, float):
        return False
    if owner.get("host") != socket.gethostname():
        return True
    try:
        process = psutil.Process(pid)
        # the system gives the number of an ended process to another one
        same = abs(process.create_time() - started) < CLOCK_SLACK_S
        return same and process.status() != psutil.STATUS_ZOMBIE
    except psutil.Error:
        return False
