"""One campaign at a time in a folder: a small file that says whose it is."""

import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from flighttune.campaign.dataset.storage import Store
from flighttune.errors import InputError, OutputError

LOCK = "campaign.lock"
_CLOCK_SLACK_S = 2.0


@contextmanager
def held(store: Store) -> Iterator[None]:
    """Hold the folder for the block; a lock whose process on this machine is gone is taken over.

    Parameters
    ----------
    store : Store
        The folder of a campaign.

    Raises
    ------
    InputError
        If another process holds it.
    OutputError
        If the folder cannot be written.
    """
    mine = _me()
    if not store.create(LOCK, mine):
        owner = _owner(store)
        if _lives(owner):
            raise InputError(
                f"{store.url}: a campaign is being flown into it by process {owner.get('pid')} on "
                f"{owner.get('host')}; if that one is gone, remove {store.place(LOCK)}."
            )
        store.remove(LOCK)
        if not store.create(LOCK, mine):
            raise InputError(f"{store.url}: another campaign has just been started into it.")
    try:
        yield
    finally:
        with suppress(OutputError):
            store.remove(LOCK)


def _me() -> bytes:
    import psutil

    started = psutil.Process().create_time()
    who = {"host": socket.gethostname(), "pid": os.getpid(), "started": started}
    return json.dumps(who).encode()


def _owner(store: Store) -> dict[str, object]:
    try:
        found = json.loads(store.read(LOCK))
    except ValueError:  # not a whole lock: its writer was ended while it wrote
        return {}
    return found if isinstance(found, dict) else {}


def _lives(owner: dict[str, object]) -> bool:
    """Whether the owner may still be there; of another machine that cannot be known."""
    import psutil

    pid, started = owner.get("pid"), owner.get("started")
    if not isinstance(pid, int) or not isinstance(started, float):
        return False
    if owner.get("host") != socket.gethostname():
        return True
    try:
        process = psutil.Process(pid)
        return (
            process.status() != psutil.STATUS_ZOMBIE
            and abs(process.create_time() - started) < _CLOCK_SLACK_S
        )
    except psutil.Error:
        return False
