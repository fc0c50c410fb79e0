"""The C library, whose mathematical functions JSBSim and compiled code call."""

import math
import platform
import struct
from functools import cache
from hashlib import sha256
from pathlib import Path

# Ranges of the arguments at which functions are tried. Python's `math` calls them in the C library,
# which has other code for a processor without FMA: one value in two thousand differs.
RANGES = {
    "sin": ((-10.0, 10.0),),
    "cos": ((-10.0, 10.0),),
    "tan": ((-1.5, 1.5),),
    "asin": ((-1.0, 1.0),),
    "acos": ((-1.0, 1.0),),
    "atan": ((-5.0, 5.0),),
    "exp": ((-5.0, 5.0),),
    "log": ((0.01, 50.0),),
    "log10": ((0.01, 50.0),),
    "atan2": ((-5.0, 5.0), (-5.0, 5.0)),
    "pow": ((0.01, 5.0), (-5.0, 5.0)),
}

# Shares of the ranges for each place: even, and without a pattern by the golden ratio.
_PLACES, _GOLDEN = 2**16, 0.6180339887498949


def arguments(name: str, k: int) -> list[float]:
    """Arguments of a function at a place from 1 to 2^16."""
    shares = k / _PLACES, k * _GOLDEN % 1.0
    ranges = zip(RANGES[name], shares, strict=False)
    return [low + (high - low) * share for (low, high), share in ranges]


@cache
def c_library() -> str:
    """Name, version and machine of the C library, and a digest of 1,001 of its values.

    Where they differ, a flight of the same scenario may have other bits.
    """
    name, version = platform.libc_ver()
    known = f"{name} {version}".strip() or platform.system()
    return f"{known} {platform.machine()}, values {_digest()[:12]}"


def _digest() -> str:
    """Digest of values that are hardest to round, at the places of ``hard_arguments.txt``."""
    text = Path(__file__).with_name("hard_arguments.txt").read_text(encoding="ascii")
    lines = (line.split() for line in text.splitlines())
    values = [
        getattr(math, name)(*arguments(name, int(k))) for name, *places in lines for k in places
    ]
    return sha256(struct.pack(f"<{len(values)}d", *values)).hexdigest()
