"""Files written whole or not at all, alone or together as an answer, and scratch folders."""

import errno
import os
import shutil
import stat
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import IO, TypeAlias

from flighttune.base.errors import (
    FORKS,
    DifferenceError,
    InputError,
    OutputError,
    RecordingError,
    StoppedError,
)
from flighttune.base.files import owned

MEMORY = Path("/dev/shm")  # a folder in memory, ten times as fast as a disk

# Prefix of unfinished files and folders, and the age (s) from which they may be abandoned.
UNFINISHED, ABANDONED_S = ".flighttune-", 60.0

# Folder of a whole answer whose files are being put in place. It is of its user alone, and has the
# files to move, marks of files to remove, and a file that says what it is.
WHOLE, NEW, OLD, MARK = ".flighttune.whole", "new", "old", ".flighttune-answer"
KINDS = NEW, OLD

# Files to move and to remove, from the folder in which they get their places.
Places: TypeAlias = dict[str, list[Path]]

# Deepest folder in it. Without a limit, one that somebody packed could be as deep as memory.
DEEPEST = 64

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
        remove_unfinished(folder)
        # Windows does not rename an open file
        with part.open("ab") if FORKS else nullcontext(-1) as file:
            if FORKS and _APART.get():
                part.chmod(0o600)
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


def remove_unfinished(folder: Path, older_s: float = ABANDONED_S) -> None:
    """Remove unfinished files of this user that killed commands left in a folder."""
    if not FORKS:
        return
    with suppress(OSError), _named(folder) as at:
        for name in os.listdir(at):
            if name.startswith(UNFINISHED):
                with suppress(OSError):  # locked, of another user, or just finished
                    _remove_abandoned(name, at, older_s)


def _remove_abandoned(name: str, at: int, older_s: float) -> None:
    if not owned.is_mine(os.stat(name, dir_fd=at, follow_symlinks=False)):
        return  # it is not even opened
    with owned.opened(name, at) as file:
        lock(file)
        state = os.fstat(file)
        if not owned.is_mine(state) or time.time() - state.st_mtime < older_s:
            return
        if not stat.S_ISDIR(state.st_mode):
            os.unlink(name, dir_fd=at)
        elif _is_answer(file):
            _remove(name, file, at)
        else:
            os.rmdir(name, dir_fd=at)  # if nothing is in it


class _Answer:
    """The files of an answer, staged in a folder until all are put in their places together."""

    def __init__(self) -> None:
        self.folders: list[Path] = []  # all files below it are staged in one folder
        self.kept: list[Path] = []  # files that are written even if the block ends in an error
        self._stages: dict[Path, Path] = {}
        self._open: dict[Path, int] = {}  # the staging folders, locked
        self._locks = ExitStack()

    def staged(self, path: Path, kind: str = NEW) -> Path:
        """Path of a file, or of the mark that removes it, until the answer is whole."""
        folder, place = self._place(path)
        if folder not in self._stages:
            settle(folder)
            folder.mkdir(parents=True, exist_ok=True)
            remove_unfinished(folder)
            stage = folder / f"{UNFINISHED}{uuid.uuid4().hex}"
            self._stages[folder] = stage
            stage.mkdir(mode=0o700)
            if FORKS:
                self._open[folder] = self._locks.enter_context(owned.opened(stage))
                _wait_for(self._open[folder], stage)
            (stage / MARK).touch()
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
        for folder in self.folders:
            if below.is_relative_to(inside := os.path.realpath(folder)):
                return folder, below.relative_to(inside) / path.name
            if path.is_relative_to(folder):
                owned.check_inside(path, folder)
        return below, Path(path.name)

    def put_in_place(self) -> None:
        """Put all files in place; if this process is killed meanwhile, the next one continues.

        What lies in different folders is put there one folder after the other.
        """
        for folder, stage in self._stages.items():
            for place in _places(stage, NEW):
                with allowed(folder / place, "writable", OutputError):
                    (folder / place).parent.mkdir(parents=True, exist_ok=True)
                    if (folder / place).is_dir():
                        raise IsADirectoryError(0, "Is a directory")
                (stage / OLD / place).unlink(missing_ok=True)  # removed, then written anew
        places = [{kind: _places(x, kind) for kind in KINDS} for x in self._stages.values()]
        try:
            self._finish(places)
        except KeyboardInterrupt:
            self._finish(places)
            raise

    def _finish(self, places: list[Places]) -> None:
        """Commit the answer, unless one file is all of it, and move its files."""
        if not FORKS:  # without locks, no command could tell that this one was killed
            for (folder, stage), files in zip(self._stages.items(), places, strict=True):
                for place in files[NEW]:
                    (stage / NEW / place).replace(folder / place)
                for place in files[OLD]:
                    (folder / place).unlink(missing_ok=True)
            return
        several = sum(len(files[kind]) for files in places for kind in KINDS) > 1
        for stage in self._stages.values() if several else ():
            with allowed(stage.parent, "writable", OutputError):
                _commit(stage)
        for (folder, stage), files in zip(self._stages.items(), places, strict=True):
            whole = stage.with_name(WHOLE) if several else stage
            try:
                with _named(folder) as at:
                    _move(self._open[folder], at, files)
                    _remove(whole.name, self._open[folder], at)
            except OSError as error:
                got = reason_of(error)
                raise OutputError(
                    f"{folder}: must be writable, got {got}; the answer is in {whole}."
                ) from error

    def put_kept_in_place(self) -> None:
        """Put in place only the files that an error must not lose."""
        kept = [self._place(path) for path in self.kept]
        for folder, stage in self._stages.items():
            for place in _places(stage, NEW):
                if (folder, place) not in kept:
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

# Whether a block is inside `apart`.
_APART: ContextVar[bool] = ContextVar("apart", default=False)


@contextmanager
def together(folder: str | Path | None = None) -> Iterator[None]:
    """Put the files of the block in place once all are whole, else none of them.

    All files below `folder` share one staging folder. A block inside another is part of the outer
    block. If a command is killed before the answer is whole, the earlier files stay. If it is
    killed later, the next command that writes there first puts the new files in place (`settle`),
    and until then none reads them (`check_whole`).
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
    """Write the files of the block at once, not with an answer: only this user reads them again."""
    token, alone = _ANSWER.set(None), _APART.set(True)
    try:
        yield
    finally:
        _ANSWER.reset(token)
        _APART.reset(alone)


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
    """Put the files of an answer in place whose command was killed when the answer was whole.

    Only a command that writes into the folder does this, for answers of the same user alone.
    """
    with ExitStack() as stack:
        if (left := _left(folder, stack)) is None:
            return
        at, source = left
        if not _is_answer(source):
            return
        with allowed(folder / WHOLE, "put in place", OutputError):
            _move(source, at, {kind: _checked_places(source, kind) for kind in KINDS})
            _remove(WHOLE, source, at)


def check_whole(path: Path) -> None:
    """Refuse a file or folder that a killed command of this user left between two answers."""
    for folder, name in ((path.parent, path.name), (path, "")):
        with ExitStack() as stack:
            if (left := _left(folder, stack)) is None:
                continue
            if any(_holds(left[1], kind, name) for kind in KINDS):
                raise InputError(
                    f"{path}: must be whole, got a killed command that was putting its files in "
                    f"place; run that command again, or remove {folder / WHOLE}."
                )


def _left(folder: Path, stack: ExitStack) -> tuple[int, int] | None:
    """A folder and the whole answer that a command of this user left in it, open and locked."""
    if not (FORKS and os.path.lexists(folder / WHOLE)):  # in nearly every call
        return None
    try:
        at = stack.enter_context(_named(folder))
        if not owned.is_mine(os.stat(WHOLE, dir_fd=at, follow_symlinks=False)):
            return None
        source = stack.enter_context(owned.opened(WHOLE, at, owned.FOLDER))
        if not owned.is_mine(os.fstat(source)):
            return None
        _wait_for(source, folder / WHOLE)
        same = os.path.samestat(os.fstat(source), os.stat(WHOLE, dir_fd=at, follow_symlinks=False))
        return (at, source) if same else None
    except OSError:  # just put in place, or not readable
        return None


def _is_answer(source: int) -> bool:
    """Whether an open folder is an answer that this user staged and nobody else can change."""
    return owned.is_private(os.fstat(source), owned.OTHERS) and _exists(Path(MARK), source)


def _commit(stage: Path) -> Path:
    """Rename a staging folder to the name of a whole answer."""
    whole, end = stage.with_name(WHOLE), time.monotonic() + WAIT_S
    while stage.exists():  # else an interrupt came after it was renamed
        settle(stage.parent)
        try:
            stage.rename(whole)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
                raise
            # It belongs to another process, which has moved its files when `settle` returns; or
            # it is believed to be none.
            with suppress(FileNotFoundError):
                ours = owned.is_private(os.lstat(whole), owned.OTHERS) and (whole / MARK).exists()
                if not ours or time.monotonic() > end:
                    raise OutputError(
                        f"{whole}: must be absent, or what a killed command of this user left; "
                        "remove it, or write elsewhere."
                    ) from error
    return whole


def _move(source: int, at: int, places: Places) -> None:
    """Move files of an open answer to their places in an open folder, and remove others."""
    for kind in KINDS:
        for place in places[kind]:
            name, parents = place.name, place.parts[:-1]
            with suppress(FileNotFoundError), ExitStack() as stack:  # done before an interrupt
                staged = stack.enter_context(owned.folder_inside(source, (kind, *parents)))
                if kind == NEW:
                    to = stack.enter_context(owned.folder_inside(at, parents, make=True))
                    os.replace(name, name, src_dir_fd=staged, dst_dir_fd=to)
                    continue
                with suppress(FileNotFoundError), owned.folder_inside(at, parents) as to:
                    os.unlink(name, dir_fd=to)
                os.unlink(name, dir_fd=staged)


def _remove(name: str, source: int, at: int) -> None:
    """Remove an open staging folder whose files have their places, or that was abandoned."""
    for kind in KINDS:
        if _exists(Path(kind), source):
            shutil.rmtree(kind, dir_fd=source)
    with suppress(FileNotFoundError):
        os.unlink(MARK, dir_fd=source)
    with suppress(OSError):  # already removed, or not empty
        os.rmdir(name, dir_fd=at)


def _places(stage: Path, kind: str) -> list[Path]:
    """Paths of the files of a staging folder, from the folder in which they get their places."""
    files = [Path(at, name) for at, _, names in os.walk(stage / kind) for name in names]
    return sorted(file.relative_to(stage / kind) for file in files)


def _checked_places(source: int, kind: str) -> list[Path]:
    """The same of an answer that was left; OSError unless all in it is of this user."""
    places, folders = list[Path](), [Path(kind)] if _exists(Path(kind), source) else []
    while folders:
        below = folders.pop()
        if len(below.parts) > DEEPEST:
            raise OSError(errno.ELOOP, "Folders of another command")
        with owned.folder_inside(source, below.parts) as folder:
            for name in os.listdir(folder):
                state = os.stat(name, dir_fd=folder, follow_symlinks=False)
                if not owned.is_mine(state):
                    raise PermissionError(errno.EPERM, "No files of this user")
                found = folders if stat.S_ISDIR(state.st_mode) else places
                found.append(below / name)
    return sorted(place.relative_to(kind) for place in places)


def _holds(source: int, kind: str, name: str) -> bool:
    """Whether a file is among those of an open answer, or any if there is no name."""
    with suppress(OSError):
        return _exists(Path(kind, name), source) if name else bool(_checked_places(source, kind))
    return True


def _exists(path: Path, inside: int) -> bool:
    with suppress(OSError), owned.folder_inside(inside, path.parts[:-1]) as folder:
        os.stat(path.name, dir_fd=folder, follow_symlinks=False)
        return True
    return False


@contextmanager
def _named(folder: Path) -> Iterator[int]:
    """Open a folder that the command named, which may be a link."""
    descriptor = os.open(folder, owned.FOLDER)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _wait_for(folder: int, name: Path) -> None:
    """Lock an open folder, if it has a lock, after the process that holds the lock now."""
    end = time.monotonic() + WAIT_S
    while True:
        try:
            return lock(folder)
        except BlockingIOError:
            if time.monotonic() > end:
                raise OutputError(f"{name}: another process must end its writing.") from None
            time.sleep(LOOK_S)
        except OSError:  # not every file system has locks
            return None


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
