"""Numbers as text: one way to write a value, a share, an angle, an interval and a matrix."""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from flighttune.units import DEG_PER_RAD

if TYPE_CHECKING:  # the command line imports this module before anything heavy
    import numpy.typing as npt

# Stands where there is no number.
MISSING = "–"

# Smallest angle that is written, deg; smaller ones are rounded up to it.
RESOLUTION = 0.001


def number(value: float, form: str = ".4g", *, missing: str = MISSING) -> str:
    """A number in a format of its own; infinity as a sign, `missing` for NaN."""
    if math.isnan(value):
        return missing
    if math.isinf(value):
        return "∞" if value > 0.0 else "−∞"
    return f"{value:{form}}"


def figures(value: float) -> str:
    """A number with three significant figures, and none after the point from 1000 on."""
    return number(value, ".0f" if abs(value) >= 1000.0 else ".3g")


def interval(
    value: float, lo: float, hi: float, *, written: Callable[[float], str] = figures
) -> str:
    """``4.63 [4.25, 4.89]`` with three figures, ``4.63 [<= 4.89]`` with one bound."""
    if math.isnan(value):
        return MISSING
    if math.isinf(lo) != math.isinf(hi):
        bound = f"<= {written(hi)}" if math.isinf(lo) else f">= {written(lo)}"
        return f"{written(value)} [{bound}]"
    return f"{written(value)} [{written(lo)}, {written(hi)}]"


def percent(share: float) -> str:
    """A share in per cent, without the sign: one decimal, more near 0 and 100."""
    if not math.isfinite(share):
        return MISSING
    value = 100.0 * share
    edge = min(value, 100.0 - value)
    decimals = 0 if edge == 0.0 else 1 if edge >= 0.1 else 2 if edge >= 0.01 else 3
    return f"{value:.{decimals}f}"


def degrees(angle: float) -> str:
    """An angle (rad) in degrees with their sign: two figures, whole degrees from 100 on."""
    value = max(angle * DEG_PER_RAD, RESOLUTION)
    return f"{value:.2g}°" if value < 100.0 else f"{value:.0f}°"


def matrix(values: "npt.NDArray | Sequence[Sequence[float]]", form: str = "z.4f") -> str:
    """A matrix in one line, its rows separated by semicolons."""
    return "[" + "; ".join(", ".join(f"{value:{form}}" for value in row) for row in values) + "]"
