"""The errors that flighttune raises, exit codes of processes in words, and missing extras.

FlightTuneError
├── InputError (ValueError)      a value the caller gave cannot be used
│   ├── ShapeError               ... because of its array shape
│   ├── ScenarioError            ... and it came from a scenario file: names file and key
│   ├── RecordingError           ... and it came from a recording or run folder
│   └── OutputError              ... because the file to write cannot be written
├── InfeasibleError              there are no such gains: their tuning is infeasible
├── PlantError (RuntimeError)    the simulated aircraft failed
│   └── TrimError                ... to reach the steady flight asked for
├── CampaignError (RuntimeError) a campaign was cut short: its cluster is gone
├── DifferenceError (RuntimeError) compiled code flew otherwise than JSBSim: no number is right
└── StoppedError                 the observer of a count or search stopped its flights
"""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, redirect_stderr, suppress
from importlib.util import find_spec
from pathlib import Path
from traceback import walk_tb
from typing import Any, cast

OURS = "flighttune"

# What NumPy's message has if a library was compiled for its first version.
MADE_FOR = "compiled using NumPy 1.x"

# Whether the system can fork a process, so that a crash ends only the copy. Windows cannot.
FORKS = hasattr(os, "fork")


def printable(text: str) -> str:
    """Text with a space for each character that steers a terminal or that XML does not allow."""
    return "\n".join(
        line  # a picture has 100,000 characters, and a line of it no such one
        if line.isprintable()
        else "".join(char if char.isprintable() or char == "\u00a0" else " " for char in line)
        for line in text.split("\n")
    )


class FlightTuneError(Exception):
    """Base of all errors that flighttune raises on purpose.

    Examples
    --------
    >>> try:
    ...     ft.load_gains("nowhere.json")
    ... except ft.FlightTuneError as error:
    ...     print(type(error).__name__)
    ScenarioError
    """

    def __str__(self) -> str:
        """The message without the control characters that a foreign file may contain."""
        return printable(super().__str__())


class InputError(FlightTuneError, ValueError):
    """A value given by the caller cannot be used.

    Examples
    --------
    >>> ft.loop.indicators([[float("nan")]])
    Traceback (most recent call last):
    InputError: `A_K` must be finite, got [[nan]].
    """


class ShapeError(InputError):
    """An array has the wrong shape."""


class ScenarioError(InputError):
    """A scenario, gains or aircraft file cannot be used; the message names file and key.

    Examples
    --------
    >>> ft.load_gains("nowhere.json")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ScenarioError: nowhere.json: must be readable, got ...
    """


class RecordingError(InputError):
    """A recording or run folder cannot be read.

    Examples
    --------
    >>> ft.load("nowhere.rrd")
    Traceback (most recent call last):
    RecordingError: nowhere.rrd: there is no such file.
    """


class OutputError(InputError):
    """A file cannot be written; an earlier file in its place is unchanged."""


class InfeasibleError(FlightTuneError):
    """No solution exists: no gains of a tuning problem, or no flight inside a fence."""


class PlantError(FlightTuneError, RuntimeError):
    """The simulated aircraft could not be built or flown.

    Examples
    --------
    >>> ft.loop.JSBSimPlant().observe()
    Traceback (most recent call last):
    PlantError: `JSBSimPlant` must be started before it can be observed or flown.
    """


class TrimError(PlantError):
    """No steady flight was found at the condition asked for."""


class CampaignError(FlightTuneError, RuntimeError):
    """A campaign was cut short because its cluster failed; finished runs are kept."""


class DifferenceError(FlightTuneError, RuntimeError):
    """A compiled flight differs from JSBSim's, so no compiled flight of a command can be trusted.

    It is never an outcome of a flight: it ends the command, also from the processes of its workers.

    Examples
    --------
    >>> issubclass(ft.loop.DifferenceError, ft.loop.PlantError)
    False
    """


class StoppedError(FlightTuneError):
    """The observer of a count or search stopped it before its answer.

    Attributes
    ----------
    kept : tuple of str
        The files with its flights, by stage, from which the same call goes on.
    lost : bool
        Whether the flights of the stage that was stopped are not kept.
    """

    kept: tuple[str, ...] = ()
    lost: bool = False


@contextmanager
def keeping(*files: Path | None) -> Iterator[None]:
    """Name the files that keep flights, as far as they exist, to a StoppedError of the block.

    The innermost block is that of the stage that was stopped. A DifferenceError removes the files,
    as their compiled flights must not go on to a result.
    """
    try:
        yield
    except DifferenceError:
        for file in filter(None, files):
            with suppress(OSError):  # the difference is what must be reported
                file.unlink(missing_ok=True)
        raise
    except StoppedError as stopped:
        there = [str(file) for file in files if file is not None and file.exists()]
        stopped.lost |= not (there or stopped.kept)
        stopped.kept = tuple(dict.fromkeys([*there, *stopped.kept]))
        raise


@contextmanager
def naming(place: object, kind: type[InputError] = InputError) -> Iterator[None]:
    """Put a place, such as a file, before the message of an InputError that the block raises."""
    try:
        yield
    except InputError as error:
        message = str(error).removeprefix(f"{place}: ")  # it may be there already
        raise kind(f"{place}: {message}") from error


# Errors of one flight: it is then a row, a draw or a part that was not flown, with this reason.
OF_A_FLIGHT = (InputError, InfeasibleError, PlantError)


def ending_of(code: int) -> str:
    """Signal that ended a process with this return code, or its exit status."""
    if code >= 0:
        return f"exit status {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:  # a real-time signal, which has no name
        return f"signal {-code}"


def need_fork(what: str) -> None:
    """Raise InputError where the system cannot copy a process."""
    if not FORKS:
        raise InputError(
            f"{what} must run on Linux, on macOS or, on Windows, in WSL2, because a crash or a "
            f"hang there ends a copy of the process: got {sys.platform}, which makes no copies."
        )


# Extra by module, as in pyproject.toml.
EXTRAS = {
    "dask": "cluster",
    "distributed": "cluster",
    "gymnasium": "gym",
    "numba": "fast",
    "pymavlink": "logs",
    "pyulog": "logs",
    "rasterio": "terrain",
    "rerun_notebook": "notebook",
}


def need(what: str, *modules: str) -> None:
    """Refuse a feature if one of its modules is not installed, and name the extra of `EXTRAS`."""
    if absent := [module for module in modules if find_spec(module) is None]:
        raise InputError(_message(what, absent))


def missing_extra(error: ImportError, what: str) -> str | None:
    """The message of `need` for an import that failed; None where no extra would help."""
    module = (error.name or "").partition(".")[0]
    return _message(what, [module]) if module in EXTRAS and find_spec(module) is None else None


class _WithoutNumpy:
    """A stream without what NumPy writes where a library was compiled for its first version."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def write(self, text: str) -> None:
        if MADE_FOR not in text:
            self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def said_in_one_line() -> AbstractContextManager[Any]:
    """Leave what is said of a library that cannot be imported to the error that this raises."""
    return redirect_stderr(cast("Any", _WithoutNumpy(sys.stderr)))


def broken_library(error: ImportError) -> str:
    """One line about a library that is installed, or should be, and cannot be imported."""
    from importlib.metadata import version

    modules = [str(x.f_globals.get("__name__")) for x, _ in walk_tb(error.__traceback__)]
    names = [name.partition(".")[0] for name in modules]
    ours = len(names) - names[::-1].index(OURS) if OURS in names else 0
    libraries = [x for x in names[ours:] if "importlib" not in x]
    library = next(iter([*libraries, (error.name or "").partition(".")[0]]), "") or "a library"
    with suppress(ImportError):
        library += f" {version(library)}"
    got = next((line.strip() for line in str(error).splitlines() if line.strip()), "no reason")
    line = f"{library}: must be a library that can be imported, got: {got.rstrip('.')}"
    room = "map segment" in got or "memory" in got
    return f"{line}; it must fit into the memory there is." if room else f"{line}."


def _message(what: str, absent: list[str]) -> str:
    names = ", ".join(absent).replace("_", "-")
    return f"{what} needs {names}; install it with: pip install 'flighttune[{EXTRAS[absent[0]]}]'"
