"""Where aircraft and cameras are: local NED in m, with plain numpy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.recording.airframe import span_of
from flighttune.recording.cast import Member
from flighttune.recording.mesh import SPAN

FIELD_OF_VIEW = math.radians(52.0)
"""Opening of the camera that the flight shall fill; the viewer's own is 55 deg in height."""

VIEWED_FROM = math.radians(-120.0)
ELEVATION = math.radians(22.0)
"""Side (clockwise from the way flown) and height from which the flight is seen."""

SHARE_OF_FLIGHT = 1.0 / 10.0
"""Width of an aircraft as drawn, over the size of the flight."""

ROUND = (1.0, 2.0, 5.0)
FINELY_ROUND = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
GROUND_LINES = 12
"""About as many lines the ground grid has along its longer side."""


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


def widest(members: Sequence[Member]) -> float:
    """Largest wing span of all aircraft, m."""
    return max(span_of(member.run) for member in members)


def enlargement(points: FloatArray, span: float = SPAN) -> float:
    """Factor by which aircraft are drawn larger than they are, a round number, at least 1

    Parameters
    ----------
    points : ndarray, shape (n, 3), m
        All positions flown.
    span : float, m
        Of the widest aircraft.
    """
    wanted = float(np.linalg.norm(np.ptp(points, axis=0))) * SHARE_OF_FLIGHT / span
    return max(1.0, _round_below(wanted, FINELY_ROUND))


def ground_grid(points: FloatArray) -> tuple[list[FloatArray], float]:
    """Lines of a level grid half a spacing below the flight, a little wider than it.

    Parameters
    ----------
    points : ndarray, shape (n, 3), m
        All positions flown.

    Returns
    -------
    lines : list of ndarray, shape (2, 3), m
        Ends of each line.
    spacing : float, m
        Distance of neighbours: 1, 2 or 5 times a power of ten.
    """
    longest = float(np.ptp(points[:, :2], axis=0).max())
    spacing = _round_below(max(longest, 1.0) * 2.0 / GROUND_LINES)
    low = (np.floor(points[:, :2].min(axis=0) / spacing) - 1.0) * spacing
    high = (np.ceil(points[:, :2].max(axis=0) / spacing) + 1.0) * spacing
    down = float(points[:, 2].max()) + spacing / 2.0
    lines = [
        np.array([[north, low[1], down], [north, high[1], down]])
        for north in np.arange(low[0], high[0] + spacing / 2.0, spacing)
    ]
    lines += [
        np.array([[low[0], east, down], [high[0], east, down]])
        for east in np.arange(low[1], high[1] + spacing / 2.0, spacing)
    ]
    return lines, spacing


def _round_below(value: float, steps: tuple[float, ...] = ROUND) -> float:
    """Largest of `steps` times a power of ten that is not above `value`."""
    decade = 10.0 ** math.floor(math.log10(value)) if value > 0.0 else 1.0
    return decade * max(factor for factor in steps if factor * decade <= value or factor == 1.0)


def overview_eye(points: FloatArray, *, margin: float) -> Eye:
    """Camera that sees the whole flight from the left, a little from behind and above.

    Parameters
    ----------
    points : ndarray, shape (n, 3), m
        All positions to see.
    margin : float, m
        Room to leave around them: half the width of an aircraft as drawn.
    """
    along = math.atan2(*np.ptp(points[:, :2], axis=0)[::-1] * _signs(points))
    azimuth = along + VIEWED_FROM
    back = np.array(
        [
            math.cos(azimuth) * math.cos(ELEVATION),
            math.sin(azimuth) * math.cos(ELEVATION),
            -math.sin(ELEVATION),
        ]
    )
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    up = np.cross(right, back)
    target = points.mean(axis=0)
    slope = math.tan(FIELD_OF_VIEW / 2.0)
    distance = 0.0
    for _ in range(4):
        depth = distance - (points - target) @ back if distance else np.ones(len(points))
        seen = np.column_stack([(points - target) @ right, (points - target) @ up]) / depth[:, None]
        centre = (seen.min(axis=0) + seen.max(axis=0)) / 2.0 * (distance or 1.0)
        target = target + centre[0] * right + centre[1] * up
        around = points - target
        aside = np.maximum(np.abs(around @ right), np.abs(around @ up)) + margin
        distance = float(np.max(around @ back + aside / slope))
    return Eye(tuple(target + distance * back), tuple(target))


def _signs(points: FloatArray) -> FloatArray:
    """Senses, 1 or -1, in which the flight goes east and north over all."""
    gone = points[:, :2].mean(axis=0) - points[0, :2]
    return np.where(gone[::-1] < 0.0, -1.0, 1.0)


def chase_eye(width: float) -> Eye:
    """Camera behind and above an aircraft `width` m wide, in axes that turn with its course."""
    return Eye((-1.7 * width, -0.7 * width, -0.8 * width), (0.4 * width, 0.0, 0.0))
