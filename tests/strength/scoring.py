"""Breaks one line after the other, and runs the tests that run it until one fails.

pytest collects once. For each broken line a fork of that process gives the functions of the file
their new code, so that a line costs its tests and no start. Limits are of processor time: a busy
machine changes no verdict.
"""

import gc
import json
import os
import select
import shutil
import signal
import sys
import tempfile
import time
import types
from collections import Counter
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from strength.breaking import PACKAGE

MOST, SECONDS, LONGEST = 80, 30.0, 15.0  # tests of a line, their time, and that of one
SLOWER, BESIDE = 10.0, 20.0  # a broken line may take ten times the tests' time and 20 s
OPTIONS = "addopts=--import-mode=importlib -p no:cacheprovider -p no:xdist -p no:terminal"
NOTICED = ("killed", "ended", "out of time")


@dataclass
class Tried:
    """What became of the tests of one broken line."""

    tests: list = field(default_factory=list)  # (name, passed)
    ended: str = "ended"  # "" if all reported

    @property
    def failed(self):
        return [name for name, passed in self.tests if not passed]

    @property
    def verdict(self):
        return "killed" if self.failed else self.ended or "survived"


def tests_of(learnt, change, outside):
    """The tests of a line that `outside` accepts: those that run the fewest lines come first."""
    size, seconds, names = learnt["size"], learnt["seconds"], learnt["tests"]
    numbers = [
        i
        for i in learnt["lines"].get(change.path, {}).get(change.line, ())
        if not learnt["failed"][i] and outside(names[i])
    ]
    numbers.sort(key=lambda i: (size[i], names[i]))
    chosen, total = [], 0.0
    for i in [i for i in numbers if seconds[i] <= LONGEST] or numbers[:1]:
        if chosen and (len(chosen) == MOST or total + seconds[i] > SECONDS):
            break
        chosen.append(i)
        total += seconds[i]
    return [names[i] for i in chosen], BESIDE + SLOWER * total


def score(learnt, changes, outside):
    """Break each line and run its tests that `outside` accepts: (change, verdict, test) of each."""
    tests = [tests_of(learnt, change, outside) for change in changes]
    files = sorted({name.partition("::")[0] for names, _ in tests for name in names})
    scorer = Scorer([*zip(changes, tests, strict=True)])
    with own_cache(), whole_again():
        pytest.main(["-o", OPTIONS, *files], plugins=[scorer])
    return scorer.results


@contextmanager
def own_cache():
    """Nothing that a broken line compiled is kept for anybody."""
    kept = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "flighttune"
    with tempfile.TemporaryDirectory() as folder:
        if kept.is_dir():
            shutil.copytree(kept, Path(folder, "flighttune"))
        os.environ |= {"XDG_CACHE_HOME": folder, "OPENBLAS_NUM_THREADS": "1"}
        yield


@contextmanager
def whole_again():
    """A line is put back also if the command is ended by SIGTERM."""
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    yield
    signal.signal(signal.SIGTERM, before)


@contextmanager
def broken(change):
    """The file with the change in it, for processes that import it; put back at the end."""
    file = PACKAGE / change.path
    source, stat = file.read_text("utf-8"), file.stat()
    try:
        file.write_text(change.within(source), "utf-8")
        yield file
    finally:
        file.write_text(source, "utf-8")
        os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))


class Scorer:
    """A plugin of pytest that breaks lines in place of running all tests."""

    def __init__(self, work):
        self._work, self.results = work, []

    def pytest_runtestloop(self, session):
        items = {item.nodeid: item for item in session.items}
        gc.unfreeze()
        for change, (names, limit) in self._work:
            verdict, test = self._tried(change, [items[x] for x in names if x in items], limit)
            print(f"{verdict:12s} {change}   {test}", flush=True)
            self.results.append((change, verdict, test))
        return True

    def _tried(self, change, items, limit):
        if not items:
            return "no test", ""
        with broken(change) as file:
            tried = forked(items, limit, file)
        if not tried.failed:
            return tried.verdict, ""
        name = tried.failed[0]
        again = forked([item for item in items if item.nodeid == name], limit)
        return ("unsure" if again.failed or again.ended else "killed"), name


def forked(items, limit, file=None):
    """Run tests in a fork of this process until one fails, with the code that `file` has now."""
    read, write = os.pipe()
    child = os.fork()
    if not child:
        os.close(read)
        run_in_fork(items, file, write)
    os.close(write)
    tried = Tried()
    try:
        listen(tried, read, child, limit)
    finally:
        for kill in (os.killpg, os.kill):
            with suppress(OSError):
                kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(read)
    return tried


def run_in_fork(items, file, write):
    """Report each test to the parent, and leave no process behind; never return."""
    with suppress(BaseException):
        os.setsid()
        quiet()
        if file is not None:
            exchange(file)
        with os.fdopen(write, "w") as pipe:
            for item, following in zip(items, [*items[1:], None], strict=True):
                passed = runs(item, following)
                print(json.dumps([item.nodeid, passed]), file=pipe, flush=True)
                if not passed:
                    break
            print("null", file=pipe, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)


def quiet():
    for number in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), number)


class Listener:
    failed = False

    def pytest_runtest_logreport(self, report):
        self.failed |= report.failed


def runs(item, following):
    """Whether a test passes; it is set up and torn down as by pytest."""
    listener = Listener()
    item.config.pluginmanager.register(listener)
    item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
    item.config.pluginmanager.unregister(listener)
    return not listener.failed


def listen(tried, read, child, limit):
    """Take in what the child reports, until its end, or until it has used `limit` seconds."""
    rest, latest = b"", time.monotonic() + 30.0 + SLOWER * limit
    while True:
        ready, _, _ = select.select([read], [], [], 0.5)
        some = os.read(read, 1 << 16) if ready else b""
        if ready and not some:
            return
        *lines, rest = (rest + some).split(b"\n")
        for line in map(json.loads, lines):
            if line is None:
                tried.ended = ""
                return
            tried.tests.append(line)
        if used(child) > limit or time.monotonic() > latest:
            tried.ended = "out of time"
            return


def used(process):
    """Seconds of the processor that a process and its ended children have used."""
    try:
        words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, words[11:15])) / os.sysconf("SC_CLK_TCK")


def exchange(file):
    """Give each living function of a file the code that its source has now."""
    new, todo = {}, [compile(file.read_text("utf-8"), str(file), "exec", dont_inherit=True)]
    while todo:
        code = todo.pop()
        new[code.co_qualname, code.co_firstlineno] = code
        todo += [x for x in code.co_consts if isinstance(x, types.CodeType)]
    for function in gc.get_objects():
        if isinstance(function, types.FunctionType):
            old = function.__code__
            code = new.get((old.co_qualname, old.co_firstlineno))
            if old.co_filename == str(file) and code and code.co_freevars == old.co_freevars:
                function.__code__ = code


def summary(results):
    """The figures of a score: how many were noticed, in all and by room."""
    by_room = Counter(), Counter()
    for change, verdict, _ in results:
        if verdict != "unsure":
            room = change.path.partition("/")[0]
            by_room[1][room] += 1
            by_room[0][room] += verdict in NOTICED
    noticed, judged = (sum(x.values()) for x in by_room)
    rooms = ", ".join(f"{room} {by_room[0][room]}/{n}" for room, n in sorted(by_room[1].items()))
    return f"{noticed} of {judged} broken lines were noticed ({rooms})"
