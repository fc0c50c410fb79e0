"""Which test runs which line, also in the processes that it starts: a plugin of pytest.

The lines that a fixture of a module or of the session runs count for each test that uses it.
"""

import atexit
import gzip
import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from functools import cache
from multiprocessing import connection
from pathlib import Path

import coverage
import pytest

from strength.breaking import PACKAGE

FOLDER = "STRENGTH_FOLDER"  # of what is being learned
CURRENT = "STRENGTH_CURRENT"  # the file with the name of what runs now
TESTS = Path(__file__).parents[1]
# Python runs this in each process that it starts.
STARTED = f"""
import os
if {CURRENT!r} in os.environ:
    from strength.learning import in_child
    in_child()
"""


def learn(path, arguments):
    """Run the tests that `arguments` of pytest select; write what each runs to `path`."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "sitecustomize.py").write_text(STARTED)
        python_path = os.pathsep.join([folder, str(TESTS), os.environ.get("PYTHONPATH", "")])
        environment = os.environ | {FOLDER: folder, "PYTHONPATH": python_path}
        command = [sys.executable, "-m", "pytest", "-p", "strength.learning", *arguments]
        subprocess.run(command, env=environment, cwd=TESTS.parent, check=False)
        learnt = gather(Path(folder))
    with gzip.open(path, "wt", compresslevel=3) as file:
        json.dump(learnt, file)
    return learnt


def recorder(kind):
    """Coverage that writes lines to a file of this process, under the name of what runs them."""
    found = coverage.Coverage(
        data_file=os.path.join(os.environ[FOLDER], f"{kind}-{os.getpid()}.lines"),
        source=[str(PACKAGE)],
        config_file=False,
        messages=False,
    )
    found.set_option("run:disable_warnings", ["no-data-collected", "module-not-measured"])
    found.start()
    return found


def current():
    try:
        return Path(os.environ[CURRENT]).read_text()
    except OSError:
        return ""


def in_child():
    """Record a process that a test has started; a worker flies for one test after the other."""
    lines = recorder("child")
    lines.switch_context(current())
    send = connection.Connection.send

    def told(self, answer):
        lines.switch_context(current())
        return send(self, answer)

    connection.Connection.send = told
    atexit.register(lambda: (lines.stop(), lines.save()))


class Learner:
    """What a process of pytest that runs tests tells of them."""

    def __init__(self):
        folder, process = Path(os.environ[FOLDER]), os.getpid()
        self._current, self._facts = folder / f"current-{process}", folder / f"{process}.facts"
        os.environ[CURRENT] = str(self._current)
        self._lines = recorder("main")
        self._failed = False
        self._say("")

    def _say(self, name):
        self._current.write_text(name)
        self._lines.switch_context(name)

    def pytest_runtest_logreport(self, report):
        self._failed |= report.failed

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item):
        self._say(item.nodeid)
        self._failed, start = False, processor_seconds()
        try:
            return (yield)
        finally:
            facts = {
                "test": item.nodeid,
                "seconds": processor_seconds() - start,
                "failed": self._failed,
                "fixtures": list(item.fixturenames),
            }
            with self._facts.open("a") as file:
                file.write(json.dumps(facts) + "\n")
            self._say("")

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_fixture_setup(self, fixturedef):
        if fixturedef.scope == "function":
            return (yield)
        before = current()
        self._say(f"fixture {fixturedef.argname} of {fixturedef.baseid}")
        try:
            return (yield)
        finally:
            self._say(before)

    def pytest_sessionfinish(self):
        self._lines.stop()
        self._lines.save()


def processor_seconds():
    """Of this process and of those that it has started and that have ended."""
    return sum(os.times()[:4])


def pytest_configure(config):
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        config.pluginmanager.register(Learner(), "strength-learner")


def gather(folder):
    """The tests with their seconds, and for each file of the package the tests of each line."""
    facts = {}
    for path in folder.glob("*.facts"):
        for line in path.read_text().splitlines():
            fact = json.loads(line)
            facts[fact["test"]] = fact
    tests = sorted(facts)
    of_context = users(facts, tests)
    lines = defaultdict(lambda: defaultdict(set))
    for path in folder.glob("*.lines"):
        data = coverage.CoverageData(str(path))
        data.read()
        for file in data.measured_files():
            for line, contexts in data.contexts_by_lineno(file).items():
                found = lines[Path(file).relative_to(PACKAGE).as_posix()][line]
                found.update(number for context in contexts for number in of_context(context))
    size = [0] * len(tests)
    for of_line in lines.values():
        for found in of_line.values():
            for number in found:
                size[number] += 1
    return {
        "tests": tests,
        "seconds": [facts[test]["seconds"] for test in tests],
        "failed": [facts[test]["failed"] for test in tests],
        "size": size,
        "lines": {
            path: {line: sorted(found) for line, found in of_line.items() if found}
            for path, of_line in lines.items()
        },
    }


def users(facts, tests):
    """A function that gives the numbers of the tests of a context, a test's or a fixture's."""
    number = {test: i for i, test in enumerate(tests)}
    using = defaultdict(list)
    for test, fact in facts.items():
        for name in fact["fixtures"]:
            using[name].append(test)

    def of_context(context):
        if not context.startswith("fixture "):
            return [number[context]] if context in number else []
        _, name, _, base = context.split(" ", 3)
        return [number[test] for test in using[name] if test.startswith(base)]

    return cache(of_context)


def load(path):
    with gzip.open(path, "rt") as file:
        learnt = json.load(file)
    learnt["lines"] = {
        path: {int(line): found for line, found in of_line.items()}
        for path, of_line in learnt["lines"].items()
    }
    return learnt
