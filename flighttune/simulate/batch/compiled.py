"""How the kernels are compiled: once, kept on disk, and anew when a source of theirs changes."""

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba import njit
from numba.extending import register_jitable

from flighttune import units
from flighttune.control import mimo_pi
from flighttune.units import wrap_angle

SOURCES = (
    *sorted(Path(__file__).parent.glob("*.py")),
    Path(mimo_pi.__file__),
    Path(units.__file__),
)
DIGEST = sha256(b"".join(path.read_bytes() for path in SOURCES)).hexdigest()[:12]

pi_step = register_jitable(inline="always")(mimo_pi.pi_step)
register_jitable(wrap_angle)


def kernel(function: Callable[..., None]) -> Any:
    """Compile `function` for use from several threads and keep the result on disk.

    Numba looks only at the file of the function to see whether a kept result is still good. The
    digest of every source that goes into it is therefore made a part of its name.
    """
    function.__qualname__ = f"{function.__qualname__}_{DIGEST}"
    try:
        return njit(nogil=True, cache=True)(function)
    except RuntimeError:  # nowhere to write
        return njit(nogil=True)(function)
