"""A command that is ended by a signal exactly at one of its operations on files, each in turn.

``python killed.py FOLDER BEFORE SIGNAL[,SIGNAL] EVERY COMMAND...`` prints a JSON line for each end.
FOLDER is made as BEFORE is, the command runs in a copy of this process, and the signal comes as it
opens, renames, removes or makes a file or folder below FOLDER, or has written half of its bytes.
"""

import hashlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

# Operations, and where their arguments have the open folder from which their path begins.
EVENTS = {"open": None, "os.rename": 2, "os.remove": 1, "os.mkdir": 2, "os.rmdir": 1}


class Ends:
    """Sends a signal to this process at one of its operations, counted from 0."""

    def __init__(self, folder, number, at):
        self.folder, self.number, self.at, self.count = str(folder), number, at, 0

    def step(self):
        self.count += 1
        if self.count == self.at + 1:
            os.kill(os.getpid(), self.number)

    def hook(self, event, arguments):
        if event not in EVENTS:
            return
        path, place = arguments[0], EVENTS[event]
        if place and (inside := arguments[place]) >= 0:
            path = Path(os.readlink(f"/proc/self/fd/{inside}"), path)
        if not str(path).startswith(self.folder):
            return
        if event != "open" or arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            self.step()

    def write_bytes(self, path, data):
        view = memoryview(data)
        with path.open("wb") as file:
            file.write(view[: len(view) // 2])
            file.flush()
            if str(path).startswith(self.folder):
                self.step()
            file.write(view[len(view) // 2 :])
        return len(view)


def files_in(folder):
    """SHA-256 of all files below a folder, by path."""
    files = [path for path in sorted(Path(folder).rglob("*")) if path.is_file()]
    return {
        file.relative_to(folder).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
    }


def run(arguments, ends):
    """Run a command in a copy of this process; its wait status."""
    if child := os.fork():
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    status = 70
    try:
        os.setsid()
        null = os.open(os.devnull, os.O_WRONLY)
        error = os.open(f"{ends.folder}.stderr", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(null, 1)
        os.dup2(error, 2)
        sys.stdout = io.TextIOWrapper(io.FileIO(1, "w"))
        sys.stderr = io.TextIOWrapper(io.FileIO(2, "w"), line_buffering=True)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.argv = ["flighttune", *arguments]
        Path.write_bytes = lambda path, data: ends.write_bytes(path, data)
        sys.addaudithook(ends.hook)
        from flighttune.cli import main

        main()
        status = 0
    except SystemExit as stop:
        status = stop.code or 0
    finally:
        Path(f"{ends.folder}.count").write_text(str(ends.count))
        os._exit(status)


def ended(folder, before, numbers, every, arguments):
    """What each end leaves: as it is, and after the next command has looked at the folder."""
    from flighttune.base.files.whole import settle

    at = 0
    while True:
        number = numbers[at // every % len(numbers)]
        shutil.rmtree(folder, ignore_errors=True)
        if before.exists():
            shutil.copytree(before, folder)
        ends = Ends(folder, number, at)
        status = run(arguments, ends)
        left = files_in(folder)
        settle(folder)
        yield {
            "at": at, "signal": number.name, "status": status, "left": left,
            "settled": files_in(folder), "stderr": Path(f"{folder}.stderr").read_text(),
        }  # fmt: skip
        count = Path(f"{folder}.count")
        if count.exists() and status >= 0 and int(count.read_text()) <= at:
            return  # it ended before the signal
        count.unlink(missing_ok=True)
        at += every


def each_end(folder, before, arguments, numbers=("SIGKILL",), every=1):
    """The ends of a command as a process of its own finds them; the last one was not reached."""
    command = [sys.executable, __file__, folder, before, ",".join(numbers), every, *arguments]
    done = subprocess.run(
        [*map(str, command)], check=True, stdout=subprocess.PIPE, text=True, timeout=3600
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


if __name__ == "__main__":
    # once, for all copies
    import scipy.optimize  # noqa: F401

    import flighttune.cli
    import flighttune.flight.fly
    import flighttune.outputs.pages.adoption
    import flighttune.outputs.recording.record  # noqa: F401

    place, old, names, step, *words = sys.argv[1:]
    signals = [signal.Signals[name] for name in names.split(",")]
    for end in ended(Path(place), Path(old), signals, int(step), words):
        print(json.dumps(end), flush=True)  # noqa: T201
