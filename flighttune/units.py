"""Constants, and conversions for the edges where SI and radians end."""

import math

G_0 = 9.80665
"""Standard gravity, m/s^2."""

FT = 0.3048
"""One foot, m."""

LBF = 4.4482216152605
"""One pound-force, N."""

SLUG = 14.593902937206
"""One slug, kg."""

DEG = math.pi / 180.0
"""One degree, rad."""


def wrap_angle(angle: float) -> float:
    """Return `angle` (rad) moved by whole turns into (-pi, pi]."""
    return math.pi - (math.pi - angle) % math.tau
