"""What a file may cost, whoever wrote it: one budget for each format that the package reads.

Each reader takes its limits from here. A file is bounded on disk before it is read, and what it
unpacks to before it is unpacked. Reading a file then takes at most half a gigabyte beside the
program. Recordings, counts and logs may hold hours of flight, and take up to a gigabyte.
"""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple

from flighttune.base.errors import InputError, RecordingError
from flighttune.base.files.whole import allowed, current

# Maximum length of a name in a folder and of a path, bytes: those of Linux.
MAX_NAME, MAX_PATH = 255, 4096

# Range of an integer: 64 bits, as in TOML. Python takes seconds for a million digits.
LEAST_INTEGER, LARGEST_INTEGER = -(2**63), 2**63 - 1


class Budget(NamedTuple):
    """Limits of the files of one format; 0 where the format has nothing of the kind."""

    size: int = 0  # bytes on disk
    unpacked: int = 0  # bytes of all that is unpacked together
    entries: int = 0  # values, lines, elements, numbers, files: what the format is made of
    depth: int = 0  # levels inside each other
    marks: str = ""  # characters of a text of which each begins another entry


# A route of a thousand waypoints has a tenth of it. Each value may be a mistake of its own.
TOML = Budget(size=2**20, entries=2**16, depth=32, marks="=,")

# A certificate at a thousand conditions has a tenth of the bytes; the largest forecast, 500,000
# winds, has half of the entries. An empty object takes 21 times its text.
JSON = Budget(size=16_000_000, entries=2**21, depth=200, marks="[{,")
CSV = Budget(size=16_000_000, entries=2**21, marks=",\n")

# Entries are the numbers of all winds at one place; of its header those of a list, and the depth
# are the axes of a variable.
NETCDF, HEADER = Budget(size=16_000_000, entries=2**21), Budget(entries=8192, depth=16)

# Parameters, and items and corners of Mission Planner: ArduPilot has 1,500 parameters.
LINES = Budget(size=2**22, entries=2**17, marks=" \t,")

# Places of a map: routes and fences have at most thousands.
KML = Budget(size=16_000_000, unpacked=16_000_000, entries=200_000, depth=200)

# Elements of a model, of which JSBSim's largest have some thousands.
XML = Budget(size=8_000_000, entries=2**19, depth=200, marks="<")
INCLUDED = Budget(size=8_000_000, entries=200, depth=60)  # files of FlightGear in one description

# The list of the members of a zip archive, of which each takes ten times as much memory.
MEMBERS = Budget(size=2**20)

# Arrays: a band of 30,000 flights has 80 MB, and the largest known tube unpacks to 40 MB.
ARRAYS = Budget(size=2**28, unpacked=2**28)

# Two hours of 40 signals at 100 Hz; a page of a column usually has a megabyte.
PARQUET = Budget(size=2**28, unpacked=2**28, entries=30_000_000)
PAGES = Budget(entries=2**16)

# Any file that carries its hash: what it holds has the budget of its format too.
SEALED = Budget(size=2**28)

# A log is read in a process of its own with so much memory; entries are cells of a table.
LOG = Budget(size=2**30, unpacked=900_000_000, entries=50_000_000)

# Blocks of a raster, which GDAL unpacks whole: each one, those read at once and those of all reads.
# Entries are TIFF directories.
BLOCK = Budget(unpacked=64_000_000, entries=32)
BLOCKS, RASTER = Budget(unpacked=32_000_000), Budget(unpacked=4_000_000_000)

# Flights that a killed command keeps, a line each.
KEPT = Budget(size=2**26, entries=2**16)


def is_name(path: object) -> bool:
    """Whether a system may have a file with this path."""
    text = str(path)
    parts = text.encode(errors="surrogateescape").split(b"/")
    return "\0" not in text and len(text) < MAX_PATH and max(map(len, parts)) <= MAX_NAME


@contextmanager
def opened(path: Path, kind: type[Exception] = RecordingError) -> Iterator[BinaryIO]:
    """An open file; a pipe, which may make its reader wait for ever, or a device is refused."""
    with allowed(path, "readable", kind), open(current(path), "rb", opener=_at_once) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise kind(f"{path}: must be a file, got a pipe or a device.")
        yield file


def _at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # which Windows lacks


def file_bytes(
    path: Path, budget: Budget, kind: type[Exception] = RecordingError, remedy: str = ""
) -> bytes:
    """All bytes of a file, which may not have more than its budget."""
    with opened(path, kind) as file:
        # A read of a stated size takes this memory before the first byte.
        large = os.fstat(file.fileno()).st_size > budget.size
        data = b"" if large else file.read()
    if large or len(data) > budget.size:
        raise kind(
            f"{path}: the file must have at most {budget.size} bytes, got more{remedy and ': '}"
            f"{remedy}."
        )
    return data


def check_entries(text: str, budget: Budget) -> None:
    """Refuse a text, before it is parsed, with more entries than its budget: an InputError."""
    if (count := sum(map(text.count, budget.marks))) > budget.entries:
        raise InputError(f"it must have at most {budget.entries} values, got {count}.")
