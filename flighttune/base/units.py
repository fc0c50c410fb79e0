"""Constants, and conversions for the edges where SI and radians end."""

import math
from typing import Annotated, TypeAlias

# Floats with their unit, for signatures: a command line shows it, and takes degrees for radians.
Degrees: TypeAlias = Annotated[float, "deg"]
Metres: TypeAlias = Annotated[float, "m"]
MetresPerSecond: TypeAlias = Annotated[float, "m/s"]
Radians: TypeAlias = Annotated[float, "rad"]
RadiansPerSecond: TypeAlias = Annotated[float, "rad/s"]
RadiansPerSecond2: TypeAlias = Annotated[float, "rad/s^2"]
Seconds: TypeAlias = Annotated[float, "s"]

G_0 = 9.80665  # standard gravity, m/s^2

# Acceleration of gravity in Table 1 of arXiv 2411.13140, m/s^2.
G_PAPER = 9.81

FT = 0.3048  # one foot, m

KNOT = 1852.0 / 3600.0  # one knot, m/s

LBF = 4.4482216152605  # one pound-force, N

SLUG = 14.593902937206  # one slug, kg

DEG = math.pi / 180.0  # one degree, rad

DEG_PER_RAD = 180.0 / math.pi  # one radian, deg


def wrap_angle(angle: float) -> float:
    """Return `angle` (rad) moved by whole turns into (-pi, pi]."""
    return math.pi - (math.pi - angle) % math.tau


def shown_unit(unit: str) -> tuple[str, float]:
    """Unit that a reader sees for an SI unit, and the factor to it: degrees for radians."""
    if unit in ("rad", "rad/s"):
        return unit.replace("rad", "deg"), DEG_PER_RAD
    return unit, 1.0
