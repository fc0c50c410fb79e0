"""Constants, and conversions for the edges where SI and radians end."""

import math

G_0 = 9.80665  # standard gravity, m/s^2

# Acceleration of gravity in Table 1 of arXiv 2411.13140, m/s^2.
G_PAPER = 9.81

FT = 0.3048  # one foot, m

KNOT = 1852.0 / 3600.0  # one knot, m/s

LBF = 4.4482216152605  # one pound-force, N

SLUG = 14.593902937206  # one slug, kg

DEG = math.pi / 180.0  # one degree, rad

DEG_PER_RAD = 180.0 / math.pi  # one radian, deg: the factor of what is shown in degrees


def wrap_angle(angle: float) -> float:
    """Return `angle` (rad) moved by whole turns into (-pi, pi]."""
    return math.pi - (math.pi - angle) % math.tau
