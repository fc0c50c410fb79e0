"""Python files of users: the one place that runs them, after it has asked who named them.

A scenario or campaign file names its code, and verbs that fly it run it. What flighttune wrote
(recordings, folders of campaigns, claims) names no code, whoever sent it: its own runs only where
`run_code` says so. Where no verb has asked for flights, nothing runs.
"""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from contextvars import ContextVar
from enum import IntEnum
from functools import lru_cache, wraps
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import NamedTuple, ParamSpec, TypeVar

from flighttune.base.errors import ScenarioError
from flighttune.base.files.whole import allowed

# Environment variable; while it is set, JSBSim itself flies every aircraft.
JSBSIM = "FLIGHTTUNE_JSBSIM"

P = ParamSpec("P")
T = TypeVar("T")


class Runs(IntEnum):
    """Files that may run."""

    NONE = 0
    NAMED = 1  # by a scenario or campaign file that was read in this process
    ANY = 2  # also by what flighttune wrote, which must have the hash of the file


class Grant(NamedTuple):
    """What a command may run, and what flies, for the processes that fly for it."""

    runs: Runs
    named: frozenset[str]
    jsbsim: bool  # flies every aircraft itself


# What the outermost verb decided. Verbs inside it cannot widen it.
_RUNS: ContextVar[Runs | None] = ContextVar("runs", default=None)

# Whether JSBSim itself flies every aircraft.
_JSBSIM: ContextVar[bool] = ContextVar("jsbsim", default=False)

# SHA-256 of the files that scenario and campaign files named. A file of the same content is the
# same code, wherever it lies and whatever else names it.
_NAMED: set[str] = set()

# Called with the name of a Python file. It does nothing for callers from Python, who chose the
# code: it is set in a command, and not in the processes that it starts.
NOTICE: ContextVar[Callable[[str], object] | None] = ContextVar("notice", default=None)


@contextmanager
def running(runs: Runs) -> Iterator[None]:
    """Let the block run these files, unless a block around it has decided already."""
    token = _RUNS.set(runs if (decided := _RUNS.get()) is None else decided)
    try:
        yield
    finally:
        _RUNS.reset(token)


def flies(verb: Callable[P, T]) -> Callable[P, T]:
    """A verb that flies what is stated: it runs the code of its files, with `run_code` any."""
    return _deciding(verb, Runs.NAMED)


def flies_again(verb: Callable[P, T]) -> Callable[P, T]:
    """A verb that flies again what was recorded, in JSBSim: code runs with `run_code` alone."""
    decided = _deciding(verb, Runs.NONE)

    @wraps(verb)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        with in_jsbsim():
            return decided(*args, **kwargs)

    return called


@contextmanager
def in_jsbsim() -> Iterator[None]:
    """Let JSBSim itself fly every aircraft, here and in the processes that fly for the block."""
    token = _JSBSIM.set(True)
    try:
        yield
    finally:
        _JSBSIM.reset(token)


def jsbsim_flies() -> bool:
    """Whether JSBSim itself flies every aircraft: the environment or the command says so."""
    return _JSBSIM.get() or JSBSIM in os.environ


def _deciding(verb: Callable[P, T], runs: Runs) -> Callable[P, T]:
    @wraps(verb)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        with running(Runs.ANY if kwargs.get("run_code") else runs):
            return verb(*args, **kwargs)

    return called


def grant() -> Grant:
    """What may run here, for another process."""
    return Grant(_RUNS.get() or Runs.NONE, frozenset(_NAMED), jsbsim_flies())


def take(granted: Grant) -> None:
    """Run what the command may run that this process flies for."""
    _RUNS.set(granted.runs)
    _JSBSIM.set(granted.jsbsim)
    _NAMED.update(granted.named)


def named_sha256(file: Path, where: str) -> str:
    """Hash of a file that a scenario or campaign file names: it may run where that is flown."""
    digest = sha256(_content(file, where)).hexdigest()
    _NAMED.add(digest)
    return digest


def ask(file: str, stated: str | None, where: str) -> bytes:
    """The content of a file that may run, after a notice; a ScenarioError refuses another.

    `stated` is its hash in the table that names it, if there is one; errors begin with `where`.
    """
    runs = _RUNS.get() or Runs.NONE
    content = _content(Path(file), where) if runs else b""
    digest = sha256(content).hexdigest()
    if not runs or (runs is Runs.NAMED and (stated or digest) not in _NAMED):
        raise ScenarioError(
            f"{where} `module` names Python code, {file}, which must be allowed by `--run-code` "
            "or be named by the scenario file that is flown."
        )
    if stated != digest and (stated is not None or digest not in _NAMED):
        raise ScenarioError(
            f"{where} `module` must be the file that was planned or recorded with, {file} has "
            "other contents now."
        )
    if (notice := NOTICE.get()) is not None:
        notice(file)
    return content


def run(file: str, content: bytes) -> ModuleType:
    """The module of a file that `ask` gave the content of: no other code of a file is ever run."""
    return _run(os.path.realpath(file), content)


@lru_cache(maxsize=32)
def _run(path: str, content: bytes) -> ModuleType:
    # The bytes that were asked about: an import would read the file again, or what Python compiled
    # of another one of its name.
    module = ModuleType(Path(path).stem)
    module.__file__ = path
    with redirect_stdout(sys.stderr):  # stdout is for the answer of a command
        exec(compile(content, path, "exec", dont_inherit=True), vars(module))
    return module


def _content(file: Path, where: str) -> bytes:
    from flighttune.base.files.table import abridged  # here: --help must be quick

    if not os.path.isfile(file):  # False for what can be no name of a file
        raise ScenarioError(f"{where} `module` must be a file, got {abridged(str(file))}.")
    with allowed(f"{where} `module` {file}", "readable", ScenarioError):
        return file.read_bytes()
