"""Python files of users: the only place that runs them, after it has checked who named them.

A scenario or campaign file may name code, and the verbs that fly the file run it. A recording,
campaign folder or claim may come from anybody, so its code runs only with `run_code`. Outside a
verb that flies, no code runs.
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
    """Which files may run."""

    NONE = 0
    NAMED = 1  # files named by a scenario or campaign file that this process has read
    ANY = 2  # also files named, with their hash, by something that flighttune wrote


class Grant(NamedTuple):
    """Permission of a command to run code and its choice of simulator, for its worker processes."""

    runs: Runs
    named: frozenset[str]
    jsbsim: bool  # JSBSim itself flies every aircraft


# What the outermost verb decided. Verbs inside it cannot widen it.
_RUNS: ContextVar[Runs | None] = ContextVar("runs", default=None)

# `--jsbsim`, or a block of `in_jsbsim`: JSBSim itself flies every aircraft.
BY_JSBSIM: ContextVar[bool] = ContextVar("jsbsim", default=False)

# SHA-256 of the files that scenario and campaign files named. A file of the same content is the
# same code in any place and under any name.
_NAMED: set[str] = set()

# Called with the name of a Python file that is about to run. Only commands set it: callers from
# Python chose the code themselves, and worker processes do not repeat the notice.
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
    """Decorate a verb that flies scenarios: it runs code that they name, or with `run_code` any."""
    return _deciding(verb, Runs.NAMED)


def flies_again(verb: Callable[P, T]) -> Callable[P, T]:
    """Decorate a verb that flies a recording again, in JSBSim: code runs only with `run_code`."""
    decided = _deciding(verb, Runs.NONE)

    @wraps(verb)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        with in_jsbsim():
            return decided(*args, **kwargs)

    return called


@contextmanager
def in_jsbsim() -> Iterator[None]:
    """Let JSBSim fly every step of the flights of a ``with`` block, on all their workers.

    Compiled flights have the same numbers; ``--jsbsim`` is this for a command.

    Examples
    --------
    >>> with ft.in_jsbsim():
    ...     flown = ft.fly("level_turn", "paper")
    >>> [run.compiled for run in flown.runs]
    [False, False]
    """
    token = BY_JSBSIM.set(True)
    try:
        yield
    finally:
        BY_JSBSIM.reset(token)


def jsbsim_flies() -> bool:
    """Whether JSBSim itself flies every aircraft: the environment or the command says so."""
    return BY_JSBSIM.get() or JSBSIM in os.environ


def _deciding(verb: Callable[P, T], runs: Runs) -> Callable[P, T]:
    @wraps(verb)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        with running(Runs.ANY if kwargs.get("run_code") else runs):
            return verb(*args, **kwargs)

    return called


def grant() -> Grant:
    """The permission of this process, for another process."""
    return Grant(_RUNS.get() or Runs.NONE, frozenset(_NAMED), jsbsim_flies())


def take(granted: Grant) -> None:
    """Take over the permission of the command for which this process flies."""
    _RUNS.set(granted.runs)
    BY_JSBSIM.set(granted.jsbsim)
    _NAMED.update(granted.named)


def named_sha256(file: Path, where: str) -> str:
    """Hash of a file that a scenario or campaign file names, which allows it to run in a flight."""
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
    """The module made from content that `ask` returned: no other code of a file is ever run."""
    return _run(os.path.realpath(file), content)


@lru_cache(maxsize=32)
def _run(path: str, content: bytes) -> ModuleType:
    # The checked bytes run. An import would read the file again, or a cached compilation of another
    # file with its name.
    module = ModuleType(Path(path).stem)
    module.__file__ = path
    with redirect_stdout(sys.stderr):  # stdout is for the answer of a command
        exec(compile(content, path, "exec", dont_inherit=True), vars(module))
    return module


def _content(file: Path, where: str) -> bytes:
    from flighttune.base.files.table import abridged  # here: --help must be quick

    if not os.path.isfile(file):  # False if it cannot be the name of a file
        raise ScenarioError(f"{where} `module` must be a file, got {abridged(str(file))}.")
    with allowed(f"{where} `module` {file}", "readable", ScenarioError):
        return file.read_bytes()
