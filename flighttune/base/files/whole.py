"""Files written whole or not at all, alone or together as an answer, and scratch folders."""

import os
import shutil
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import IO

from flighttune.base.errors import FORKS, DifferenceError, OutputError, RecordingError, StoppedError

MEMORY = Path("/dev/shm")  # a folder in memory, ten times as fast as a disk

# Prefix of unfinished files and folders, and the age (s) from which they may be abandoned.
UNFINISHED, ABANDONED_S = ".flighttune-", 60.0

# Folder of a whole answer whose files are being put in place. It has the files to move, marks of
# files to remove, and the paths of the answer's other staging folders.
WHOLE, NEW, OLD, OTHERS = ".flighttune.whole", "new", "old", "others"

# Maximum wait for another process that puts files in place, and interval between checks, s.
WAIT_S, LOOK_S = 10.0, 0.01


@contextmanager
def whole_file(path: Path, unfinished: Path | None = None) -> Iterator[Path]:
    """Give a temporary name beside `path`, or in `unfinished`; rename it if the block ends well."""
    answer = _ANSWER.get() if unfinished is None else None
    part = None
    try:
        place = path if answer is None else answer.staged(path)
        folder = unfinished or place.parent
        # It does not contain the name of the file, since the system may not allow a longer name.
        part = folder / f"{UNFINISHED}{uuid.uuid4().hex}"
        for needed in (place.parent, folder):
            needed.mkdir(parents=True, exist_ok=True)
        settle(folder)
        _remove_abandoned(folder)
        # Windows does not rename an open file
        with part.open("ab") if FORKS else nullcontext(-1) as file:
            with suppress(OSError):  # not every file system has locks
                lock(file)
            yield part
            part.replace(place)  # while it is locked, no process takes it for abandoned
    except OSError as error:
        raise OutputError(f"{path}: must be writable, got {reason_of(error)}.") from error
    finally:
        with suppress(OSError):
            if part is not None:
                part.unlink(missing_ok=True)


def _remove_abandoned(folder: Path) -> None:
    """Remove unfinished files that killed commands left in a folder."""
    for old in folder.glob(f"{UNFINISHED}*"):
        with suppress(OSError):  # locked, or just finished
            descriptor = os.open(old, os.O_RDONLY)
            try:
                lock(descriptor)
                if time.time() - os.fstat(descriptor).st_mtime > ABANDONED_S:
                    shutil.rmtree(old) if old.is_dir() else old.unlink()
            finally:
                os.close(descriptor)


class _Answer:
    """The files of an answer, staged in a folder until all are put in their places together."""

    def __init__(self) -> None:
        self.folders: list[Path] = []  # all files below it are staged in one folder
        self.kept: list[Path] = []  # files that are written even if the block ends in an error
        self._stages: dict[Path, Path] = {}
        self._locks = ExitStack()

    def staged(self, path: Path, kind: str = NEW) -> Path:
        """Path of a file, or of the mark that removes it, until the answer is whole."""
        folder, place = self._place(path)
        if folder not in self._stages:
            settle(folder)
            folder.mkdir(parents=True, exist_ok=True)
            _remove_abandoned(folder)
            stage = folder / f"{UNFINISHED}{uuid.uuid4().hex}"
            self._stages[folder] = stage
            stage.mkdir()
            self._locks.enter_context(_locked(stage))
        return self._stages[folder] / kind / place

    def current(self, path: Path) -> Path:
        """Present path of a file, which is staged if it was written for the answer."""
        folder, place = self._place(path)
        staged = self._stages.get(folder, folder) / NEW / place
        return staged if staged.exists() else path

    def _place(self, path: Path) -> tuple[Path, Path]:
        """The folder beside which a file is staged, and the file's path from that folder."""
        path = Path(os.path.abspath(path))
        below = Path(os.path.realpath(path.parent))  # links may lead to another file system
        holding = (x for x in self.folders if below.is_relative_to(os.path.realpath(x)))
        folder = next(holding, path.parent)
        return folder, path.relative_to(folder)

    def put_in_place(self) -> None:
        """Put all files in place; if this process is killed meanwhile, the next one continues."""
        for folder, stage in self._stages.items():
            for place in _places(stage, NEW):
                with allowed(folder / place, "writable", OutputError):
                    (folder / place).parent.mkdir(parents=True, exist_ok=True)
                    if (folder / place).is_dir():
                        raise IsADirectoryError(0, "Is a directory")
                (stage / OLD / place).unlink(missing_ok=True)  # removed, then written anew
        if not self._stages:
            return
        stage, *others = self._stages.values()
        with allowed(stage.parent, "writable", OutputError):
            (stage / OTHERS).write_bytes(b"\0".join(map(os.fsencode, others)))
            _commit(stage)
        try:
            _move(stage.parent)
        except KeyboardInterrupt:
            _move(stage.parent)
            raise

    def put_kept_in_place(self) -> None:
        """Put in place only the files that an error must not lose."""
        for folder, stage in self._stages.items():
            for place in _places(stage, NEW):
                if folder / place not in self.kept:
                    (stage / NEW / place).unlink()
        # A file that could not be written must not remove the file of an earlier answer.
        if any(self.current(path) != path for path in self.kept):
            self.put_in_place()

    def end(self) -> None:
        """Remove what was not put in place."""
        for stage in self._stages.values():
            shutil.rmtree(stage, ignore_errors=True)
        self._locks.close()


# Collects the files of a block; None outside of `together`.
_ANSWER: ContextVar[_Answer | None] = ContextVar("answer", default=None)


@contextmanager
def together(folder: str | Path | None = None) -> Iterator[None]:
    """Put the files of the block in place once all are whole, else none of them.

    All files below `folder` share one staging folder. A block inside another is part of the outer
    block. If a command is killed before the answer is whole, the earlier files stay. If it is
    killed later, the next process that reads or writes there first puts the new files in place
    (`settle`).
    """
    answer, outer = _Answer(), _ANSWER.get()
    if folder is not None:
        settle(Path(folder))
        (outer or answer).folders.append(Path(os.path.abspath(folder)))
    if outer is not None:
        yield
        return
    token = _ANSWER.set(answer)
    try:
        try:
            yield
        except (StoppedError, DifferenceError):
            raise
        except Exception:
            answer.put_kept_in_place()
            raise
        answer.put_in_place()
    finally:
        _ANSWER.reset(token)
        answer.end()


@contextmanager
def apart() -> Iterator[None]:
    """Write the files of the block at once, not with an answer: they are read before it ends."""
    token = _ANSWER.set(None)
    try:
        yield
    finally:
        _ANSWER.reset(token)


def keep_on_error(path: Path) -> None:
    """Write a file that took long to compute even if the block of `together` raises an error.

    It is not written after a DifferenceError, which says that its numbers are wrong.
    """
    if (answer := _ANSWER.get()) is not None:
        answer.kept.append(Path(os.path.abspath(path)))


def current(path: Path) -> Path:
    """Present path of a file that a block of `together` may have written."""
    answer = _ANSWER.get()
    return path if answer is None else answer.current(path)


def remove_file(path: Path) -> None:
    """Remove a file of an earlier answer, in a block of `together` when the new one is whole."""
    if (answer := _ANSWER.get()) is None:
        path.unlink(missing_ok=True)
    elif path.exists():
        mark = answer.staged(path, OLD)
        mark.parent.mkdir(parents=True, exist_ok=True)
        mark.touch()


def settle(folder: Path) -> None:
    """Put the files of an answer in place whose command was killed when the answer was whole."""
    whole = folder / WHOLE
    if os.path.isdir(whole):  # in nearly every call there is no such folder
        with allowed(whole, "readable", OutputError), suppress(FileNotFoundError), _locked(whole):
            _move(folder)  # unless another process was faster


def _commit(stage: Path) -> None:
    """Rename a staging folder to the name of a whole answer."""
    whole = stage.with_name(WHOLE)
    while True:
        settle(stage.parent)
        try:
            stage.rename(whole)
        except OSError:
            if not whole.exists():  # it belongs to another process
                raise
        else:
            return


def _move(folder: Path) -> None:
    """Move the files of a whole answer to their places."""
    whole, place = folder / WHOLE, folder
    try:
        for other in _others(whole):
            if other.is_dir():
                _commit(other)
            _move(other.parent)
        inside = os.path.realpath(folder)
        for kind in (NEW, OLD):
            for name in _places(whole, kind):
                place = folder / name
                place.parent.mkdir(parents=True, exist_ok=True)
                # A link in the folder of somebody else must not lead out of it.
                if not Path(os.path.realpath(place.parent)).is_relative_to(inside):
                    continue
                with suppress(FileNotFoundError):  # another process was faster
                    (whole / NEW / name).replace(place) if kind == NEW else place.unlink()
        shutil.rmtree(whole, ignore_errors=True)
    except OSError as error:
        got = reason_of(error)
        raise OutputError(f"{place}: must be writable, got {got}; it is in {whole}.") from error


def _others(whole: Path) -> list[Path]:
    """The staging folders of the same answer elsewhere."""
    with suppress(FileNotFoundError):
        paths = (Path(os.fsdecode(path)) for path in (whole / OTHERS).read_bytes().split(b"\0"))
        return [path for path in paths if path.name.startswith(UNFINISHED)]
    return []


def _places(stage: Path, kind: str) -> list[Path]:
    """Paths of the files of a staging folder, from the folder in which they get their places."""
    if stage.is_symlink() or (stage / kind).is_symlink():
        return []
    files = [Path(at, name) for at, _, names in os.walk(stage / kind) for name in names]
    return sorted(file.relative_to(stage / kind) for file in files)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock a folder, if it has a lock, after the process that holds the lock now."""
    if not FORKS:
        yield
        return
    descriptor, end = os.open(folder, os.O_RDONLY), time.monotonic() + WAIT_S
    try:
        while True:
            try:
                lock(descriptor)
                break
            except BlockingIOError:
                if time.monotonic() > end:
                    raise OutputError(f"{folder}: another process must end its writing.") from None
                time.sleep(LOOK_S)
            except OSError:  # not every file system has locks
                break
        yield
    finally:
        os.close(descriptor)


def lock(file: "IO[bytes] | int") -> None:
    """Lock an open file until it is closed; OSError if another process has, or it has no locks."""
    if not FORKS:
        raise OSError("no locks of POSIX")
    import fcntl

    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def write_text(path: Path, text: str) -> Path:
    """Write a file whole, in UTF-8 with the line ends of `text`; OutputError on failure."""
    with whole_file(path) as part:
        part.write_bytes(text.encode())
    return path


def reason_of(error: OSError) -> str:
    """Message of the system without error number and file: ``no space left on device``."""
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


@contextmanager
def allowed(path: object, what: str, kind: type[Exception] = RecordingError) -> Iterator[None]:
    """Turn an OSError of the block into `kind`: `path` must be `what`, such as readable."""
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
