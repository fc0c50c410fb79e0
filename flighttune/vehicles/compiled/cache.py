# SPDX-License-Identifier: LGPL-2.1-or-later
"""Compiled steps in the cache of the user: made once, theirs alone, checked before they are loaded.

A file that is lost, cut, forged or open to others is made anew.
"""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from flighttune.base.errors import FlightTuneError
from flighttune.base.files.owned import believed_bytes, own_folder
from flighttune.base.files.whole import apart, whole_file
from flighttune.vehicles.compiled.step import Names

# Longest wait for another process that makes the same step, s.
_WAIT = 120.0

_DIGEST, _LENGTH = 32, 8

# Folders below the cache of the user, of this user alone.
_BELOW = "flighttune", "compiled"


@dataclass(frozen=True, kw_only=True)
class Kept:
    """A cached step: names, machine code, and the record of its check flight."""

    names: Names
    code: bytes
    verdict: dict[str, Any]

    def bytes_for(self, key: str) -> bytes:
        """The file under a key."""
        head = json.dumps({"key": key, "names": asdict(self.names), "verdict": self.verdict})
        body = len(head).to_bytes(_LENGTH, "little") + head.encode() + self.code
        return sha256(body).digest() + body


def kept_from(data: bytes, key: str) -> Kept | None:
    """Content of a cache file; None if it is damaged or belongs to another key."""
    body = data[_DIGEST:]
    if len(body) < _LENGTH or sha256(body).digest() != data[:_DIGEST]:
        return None
    end = _LENGTH + int.from_bytes(body[:_LENGTH], "little")
    head = json.loads(body[_LENGTH:end])
    if head["key"] != key:
        return None
    names = Names(**{field: tuple(names) for field, names in head["names"].items()})
    return Kept(names=names, code=body[end:], verdict=head["verdict"])


def folder() -> Path:
    """The folder of compiled steps of this user."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    # An environment may name a relative folder, which would depend on where a command runs.
    home = Path(base) if os.path.isabs(base) else Path.home() / ".cache"
    return home.joinpath(*_BELOW)


def kept_or_made(key: str, make: Callable[[], Kept]) -> Kept:
    """The step of a key: read, or made and kept if that can be done."""
    if (place := _own_folder()) is None:
        return make()
    file = place / f"{key}.step"
    with _alone(file):
        if (found := _read(file, key)) is not None:
            return found
        made = make()
        with suppress(OSError, FlightTuneError):
            _write(file, made.bytes_for(key))
        return made


def _own_folder() -> Path | None:
    """The folder, of this user alone; None where there cannot be one."""
    with suppress(OSError, RuntimeError):  # no home, or no writing there
        return own_folder(folder().parents[1], *_BELOW)
    return None


@contextmanager
def _alone(file: Path) -> Iterator[None]:
    """Let one process at a time make a step; the wait of others is limited."""
    lock = FileLock(file.with_suffix(".lock"), mode=0o600)
    held = False
    with suppress(OSError, Timeout):
        lock.acquire(timeout=_WAIT)
        held = True
    try:
        yield
    finally:
        if held:
            lock.release()


def _read(file: Path, key: str) -> Kept | None:
    # Whatever is wrong with a file, the step is made again.
    with suppress(Exception):
        return kept_from(believed_bytes(file), key)
    return None


def _write(file: Path, data: bytes) -> None:
    with apart(), whole_file(file) as part:
        part.write_bytes(data)
