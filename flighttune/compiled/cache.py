# SPDX-License-Identifier: LGPL-2.1-or-later
"""Compiled steps in the cache of the user: made once, theirs alone, checked before they are loaded.

A file that is lost, cut, forged or open to others is made anew.
"""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from itertools import accumulate
from pathlib import Path
from typing import Any

from flighttune.base.errors import FlightTuneError
from flighttune.base.files.owned import believed_bytes, own_folder
from flighttune.base.files.whole import apart, whole_file
from flighttune.compiled.step import Names

# Longest wait for another process that makes the same step, s.
_WAIT = 120.0

_DIGEST, _LENGTH = 32, 8

# Most files in the folder, with their locks, and their size.
MAX_FILES, MAX_BYTES = 400, 32_000_000

# Folders below the cache of the user, of this user alone.
_BELOW = "flighttune", "compiled"


@dataclass(frozen=True, kw_only=True)
class Kept:
    """A cached step: names, machine code, and what its checks found.

    Attributes
    ----------
    names : Names
    code : bytes
    equal : bool
        Whether a check found it equal to JSBSim.
    differences : dict
        The difference that a check found, by its case.
    loaded : dict
        What JSBSim shows of the aircraft, of a start.
    """

    names: Names
    code: bytes
    equal: bool = False
    differences: dict[str, str] = field(default_factory=dict)
    loaded: dict[str, Any] = field(default_factory=dict)

    def bytes_for(self, key: str) -> bytes:
        """The file under a key."""
        found = {"equal": self.equal, "differences": self.differences, "loaded": self.loaded}
        head = json.dumps({"key": key, "names": asdict(self.names), "found": found})
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
    return Kept(names=names, code=body[end:], **head["found"])


def folder() -> Path:
    """The folder of compiled steps of this user."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    # An environment may name a relative folder, which would depend on where a command runs.
    home = Path(base) if os.path.isabs(base) else Path.home() / ".cache"
    return home.joinpath(*_BELOW)


def kept_or_made(
    key: str, make: Callable[[], Kept], check: Callable[[Kept], Kept] = lambda kept: kept
) -> Kept:
    """The step of a key: read, or made and kept if that can be done; what `check` adds is kept."""
    if (place := _own_folder()) is None:
        return check(make())
    file = place / f"{key}.step"
    with _alone(file):
        found = _read(file, key)
        if (kept := check(found or make())) is not found:
            with suppress(OSError, FlightTuneError):
                _write(file, kept.bytes_for(key))
                remove_oldest(place)
        return kept


def _own_folder() -> Path | None:
    """The folder, of this user alone; None where there cannot be one."""
    with suppress(OSError, RuntimeError):  # no home, or no writing there
        return own_folder(folder().parents[1], *_BELOW)
    return None


@contextmanager
def _alone(file: Path) -> Iterator[None]:
    """Let one process at a time make a step; the wait of others is limited."""
    from filelock import FileLock, Timeout  # it has the weight of NumPy's half

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
        kept = kept_from(believed_bytes(file), key)
        os.utime(file)  # for `remove_oldest`
        return kept
    return None


def _write(file: Path, data: bytes) -> None:
    with apart(), whole_file(file) as part:
        part.write_bytes(data)


def remove_oldest(place: Path) -> None:
    """Remove steps and locks beyond `MAX_FILES` and `MAX_BYTES`, the oldest by use first.

    That does no harm to other processes: they read a step whole, or make it again.
    """
    used: list[tuple[int, int, Path]] = []
    for file in (*place.glob("*.step"), *place.glob("*.lock")):
        with suppress(FileNotFoundError):  # another process has removed it
            state = os.lstat(file)
            used.append((state.st_mtime_ns, state.st_size, file))
    used.sort(reverse=True)
    sizes = accumulate(size for _, size, _ in used)
    for i, ((_, _, file), size) in enumerate(zip(used, sizes, strict=True)):
        if i >= MAX_FILES or size > MAX_BYTES:
            file.unlink(missing_ok=True)
