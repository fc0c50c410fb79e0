"""Where aircraft and cameras are: local NED in m, with plain numpy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.recording.cast import Member
from flighttune.recording.mesh import SPAN

FIELD_OF_VIEW = math.radians(50.0)
"""Opening of the viewer's camera assumed for framing, less than it has."""

SHARE_OF_FLIGHT = 1.0 / 13.0
"""Width of an aircraft as drawn, over the size of the flight."""

ROUND_FACTORS = (1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True)
class Eye:
    """A camera: where it is and where it looks, m."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]


def positions(signals: pd.DataFrame) -> FloatArray:
    """North, east and down of every sample, shape (n, 3), m."""
    return signals[["north", "east", "down"]].to_numpy(dtype=float)


def flown(members: Sequence[Member]) -> FloatArray:
    """All finite positions of all runs, shape (n, 3), m."""
    points = np.vstack([positions(member.run.signals) for member in members])
    return points[np.isfinite(points).all(axis=1)]


def headings(signals: pd.DataFrame) -> FloatArray:
    """Rotation to NED from level axes that turn with the course, shape (n, 4): x, y, z, w."""
    chi = signals["chi"].to_numpy(dtype=float)
    return quaternions(np.zeros_like(chi), np.zeros_like(chi), chi)


def attitudes(signals: pd.DataFrame) -> FloatArray:
    """Rotation from body axes to the axes of `headings`.

    Parameters
    ----------
    signals : DataFrame
        Signals of a run. A plant without pitch and heading is drawn along its path.

    Returns
    -------
    ndarray, shape (n, 4), 1
        Unit quaternions x, y, z, w.
    """
    chi = signals["chi"].to_numpy(dtype=float)
    pitch = signals["theta" if "theta" in signals else "gamma"].to_numpy(dtype=float)
    crab = signals["psi"].to_numpy(dtype=float) - chi if "psi" in signals else np.zeros_like(chi)
    return quaternions(signals["phi"].to_numpy(dtype=float), pitch, crab)


def quaternions(roll: FloatArray, pitch: FloatArray, heading: FloatArray) -> FloatArray:
    """Unit quaternions x, y, z, w, shape (n, 4), of Euler angles (rad, shape (n,)), order 3-2-1."""
    sr, cr = np.sin(roll / 2.0), np.cos(roll / 2.0)
    sp, cp = np.sin(pitch / 2.0), np.cos(pitch / 2.0)
    sh, ch = np.sin(heading / 2.0), np.cos(heading / 2.0)
    return np.column_stack(
        [
            sr * cp * ch - cr * sp * sh,
            cr * sp * ch + sr * cp * sh,
            cr * cp * sh - sr * sp * ch,
            cr * cp * ch + sr * sp * sh,
        ]
    )


def enlargement(points: FloatArray) -> float:
    """Factor by which aircraft are drawn larger than they are, one of 1, 2, 5, 10, 20, ...

    Parameters
    ----------
    points : ndarray, shape (n, 3), m
        All positions flown.
    """
    wanted = float(np.linalg.norm(np.ptp(points, axis=0))) * SHARE_OF_FLIGHT / SPAN
    if wanted <= 1.0:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(wanted))
    return decade * max(factor for factor in ROUND_FACTORS if factor * decade <= wanted)


def overview_eye(points: FloatArray, *, margin: float) -> Eye:
    """Camera that sees the whole flight from the side, a little from behind and above.

    Parameters
    ----------
    points : ndarray, shape (n, 3), m
        All positions flown.
    margin : float, m
        Room to leave around them: half the width of an aircraft as drawn.
    """
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    along = math.atan2(*(points[-1] - points[0])[1::-1])
    azimuth, elevation = along + math.radians(-125.0), math.radians(24.0)
    back = np.array(
        [
            math.cos(azimuth) * math.cos(elevation),
            math.sin(azimuth) * math.cos(elevation),
            -math.sin(elevation),
        ]
    )
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    up = np.cross(right, back)
    target = (low + high) / 2.0
    around = corners - target
    slope = math.tan(FIELD_OF_VIEW / 2.0)
    sideways = np.maximum(np.abs(around @ right), np.abs(around @ up))
    distance = float(np.max(around @ back + sideways / slope))
    return Eye(tuple(target + distance * back), tuple(target))


def chase_eye(width: float) -> Eye:
    """Camera behind and above an aircraft `width` m wide, in axes that turn with its course."""
    return Eye((-2.6 * width, -0.9 * width, -1.1 * width), (0.9 * width, 0.0, 0.0))
