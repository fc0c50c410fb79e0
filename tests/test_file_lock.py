"""Locks and temporary folders of processes that end without a word."""

import os
import signal
import subprocess
import sys
from contextlib import closing

import pytest

from flighttune import file_lock
from flighttune.file_lock import SCRATCH, scratch_folder, try_lock

ROUNDS = 200

HOLDER = """
import sys
from pathlib import Path
from flighttune.file_lock import scratch_folder, try_lock

if sys.argv[1] == "lock":
    lock = try_lock(Path(sys.argv[2]), make=True)
    print("held" if lock is not None else "refused", flush=True)
    sys.stdin.read()
else:
    with scratch_folder(Path(sys.argv[2])) as folder:
        (folder / "model.xml").write_text("<fdm_config/>")
        print("held", flush=True)
        sys.stdin.read()
"""

ROUND = """
import os, sys
from pathlib import Path
from flighttune.file_lock import try_lock

path = Path(sys.argv[1])
for line in sys.stdin:  # a round: try at the word, say it, let go at the next word
    held = try_lock(path, make=True)
    print("held" if held is not None else "refused", flush=True)
    sys.stdin.readline()
    if held is not None and line.strip() == "remove":
        path.unlink()
    if held is not None and line.strip() == "kill":
        os.kill(os.getpid(), 9)
    if held is not None:
        os.close(held)
    print("done", flush=True)
"""


def started(program, *arguments):
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def heard(process):
    return process.stdout.readline().strip()


@pytest.fixture
def holder():
    processes = []

    def start(*arguments):
        processes.append(started(HOLDER, *arguments))
        assert heard(processes[-1]) == "held"
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def killed(process):
    process.send_signal(signal.SIGKILL)
    process.wait()


def test_a_lock_holds_against_others_and_this_process_until_it_is_closed(tmp_path):
    path = tmp_path / "lock"

    with closing(os.fdopen(try_lock(path, make=True), "rb")):
        assert try_lock(path) is None

    os.close(try_lock(path))


def test_the_lock_of_a_process_that_was_killed_is_free(tmp_path, holder):
    path = tmp_path / "lock"
    process = holder("lock", path)
    assert try_lock(path) is None

    killed(process)

    os.close(try_lock(path))


def test_a_scratch_folder_is_private_and_goes_with_its_block(tmp_path):
    with scratch_folder(tmp_path) as folder:
        assert folder.parent == tmp_path
        assert folder.stat().st_mode & 0o777 == 0o700
        (folder / "file").write_text("x")

    assert not list(tmp_path.iterdir())


def test_folders_of_killed_processes_go_and_all_others_stay(tmp_path, holder):
    kept = [f"{SCRATCH}results", "flighttune-0.1.0", f"{SCRATCH}12345678.txt"]
    for name in kept:
        (tmp_path / name).mkdir()
    dead, alive = (holder("folder", tmp_path) for _ in range(2))
    killed(dead)
    file_lock._sweep.cache_clear()

    with scratch_folder(tmp_path):
        left = {path.name for path in tmp_path.iterdir()}

    assert left >= {*kept}
    assert len(left) == len(kept) + 2  # of `alive`, and this one
    killed(alive)


@pytest.mark.soak
@pytest.mark.parametrize("end", ["leave", "remove", "kill"])
def test_no_two_of_four_processes_ever_have_one_lock(tmp_path, end):
    path = tmp_path / "lock"
    processes = [started(ROUND, path) for _ in range(4)]
    try:
        for _ in range(ROUNDS):
            for process in processes:
                process.stdin.write(f"{end}\n")
                process.stdin.flush()
            answers = [heard(process) for process in processes]
            assert sorted(answers) == ["held", "refused", "refused", "refused"]
            for process in processes:
                process.stdin.write("on\n")
                process.stdin.flush()
            for i, (process, answer) in enumerate(zip(processes, answers, strict=True)):
                if end == "kill" and answer == "held":
                    process.communicate()
                    processes[i] = started(ROUND, path)
                else:
                    assert heard(process) == "done"
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def test_a_folder_with_a_file_that_windows_has_open_is_left_without_a_word(tmp_path, monkeypatch):
    """Windows neither locks folders nor removes files that are open."""

    def refused(*_, **__):
        raise PermissionError(13, "The process cannot access the file")

    with monkeypatch.context() as windows:
        windows.setattr(file_lock, "try_lock", refused)
        windows.setattr(os, "unlink", refused)
        with scratch_folder(tmp_path) as folder:
            (folder / "model.xml").write_text("<fdm_config/>")

    assert [path.name for path in folder.iterdir()] == ["model.xml"]


class Msvcrt:
    """What Windows does: a byte of a file is one open file's at a time."""

    LK_NBLCK = 2

    def __init__(self):
        self.held = {}

    def locking(self, descriptor, mode, count):
        assert (mode, count) == (self.LK_NBLCK, 1)
        place = os.fstat(descriptor).st_ino, os.lseek(descriptor, 0, os.SEEK_CUR)
        if self.held.setdefault(place, descriptor) != descriptor:
            raise PermissionError(13, "Permission denied")


def test_on_windows_a_byte_that_nobody_reads_is_locked(tmp_path, monkeypatch):
    windows = Msvcrt()
    monkeypatch.setattr(file_lock, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", windows)
    path = tmp_path / "lock"

    first = try_lock(path, make=True)
    second = try_lock(path, make=True)
    os.write(first, b"owner")
    os.close(first)

    assert second is None
    assert path.read_bytes() == b"owner"
    ((_, byte),) = windows.held
    assert byte > len(b"owner")
