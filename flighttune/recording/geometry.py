"""Positions, attitudes, sizes and cameras of the 3D scene, in local NED and m."""

import math
from collections.abc import Sequence
from functools import cache
from typing import TypeAlias

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.arrays import FloatArray
from flighttune.errors import FlightTuneError
from flighttune.plants.jsbsim.model_files import wing_span
from flighttune.recording.derived import positions
from flighttune.recording.entities import DrawnRun
from flighttune.simulate.run import Run

MODEL_SPAN = 2.9  # m, of the aircraft in ``aircraft.glb``

FIELD_OF_VIEW = math.radians(52.0)  # vertical, that the flight should fill; the viewer's is 55 deg
ASPECT = 1.25  # width over height of the view, or less
VIEWED_FROM = math.radians(-120.0)  # azimuth of the camera, clockwise from the direction of flight
ELEVATION = math.radians(22.0)  # of the camera

SHARE_OF_FLIGHT = 1.0 / 10.0  # width of a drawn aircraft over the size of the flight
ROUND = (1.0, 2.0, 5.0)
FINELY_ROUND = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
AXES = 2.0  # length of the arrows that name the axes, in spacings of the grid
GROUND_LINES = 12  # approximate number along the longer side of the ground grid

Eye: TypeAlias = tuple[FloatArray, FloatArray]  # of a camera: where it is and where it looks, m


def all_positions(drawn: Sequence[DrawnRun]) -> FloatArray:
    """All finite positions of all runs, shape (n, 3), m."""
    points = np.vstack([positions(drawn_run.run.signals) for drawn_run in drawn])
    return points[np.isfinite(points).all(axis=1)]


def headings(signals: pd.DataFrame) -> FloatArray:
    """Rotation to NED from level axes that turn with the course, shape (n, 4): x, y, z, w."""
    return Rotation.from_euler("z", signals[["chi"]].to_numpy(dtype=float)).as_quat()


def attitudes(signals: pd.DataFrame) -> FloatArray:
    """Rotation from body axes to the axes of `headings`, shape (n, 4): x, y, z, w.

    A plant without pitch and heading is drawn along its path.
    """
    pitch = signals["theta" if "theta" in signals else "gamma"]
    crab = signals["psi"] - signals["chi"] if "psi" in signals else 0.0 * pitch
    angles = np.column_stack([crab, pitch, signals["phi"]]).astype(float)
    return Rotation.from_euler("ZYX", angles).as_quat()  # yaw, pitch, roll about the turned axes


def span_of(run: Run) -> float:
    """Wing span of the run's aircraft, m; `MODEL_SPAN` if there is none.

    A plant without an aircraft is drawn as the first aircraft of its scenario.
    """
    tables = run.provenance.scenario.get("plant") or []
    names = [run.provenance.aircraft, *(table.get("aircraft") for table in tables)]
    return next((_span(name) for name in names if name), MODEL_SPAN)


@cache
def _span(aircraft: str) -> float:
    try:
        return wing_span(load_aircraft(aircraft)) or MODEL_SPAN
    except FlightTuneError:  # the aircraft of an old recording may be gone
        return MODEL_SPAN


def widest(drawn: Sequence[DrawnRun]) -> float:
    """Largest wing span of all aircraft, m."""
    return max(span_of(drawn_run.run) for drawn_run in drawn)


def drawn_scale(drawn: Sequence[DrawnRun]) -> float:
    """Factor by which all aircraft are drawn larger than they are."""
    return enlargement(all_positions(drawn), widest(drawn))


def all_to_see(drawn: Sequence[DrawnRun]) -> FloatArray:
    """Positions of all runs, and corners of the ground below them, shape (n, 3), m."""
    points = all_positions(drawn)
    lines, spacing = ground_grid(points)
    axes = lines[0][0] + AXES * spacing * np.eye(3)[:2]
    return np.vstack([points, axes, *lines])


def enlargement(points: FloatArray, span: float) -> float:
    """Factor by which aircraft are drawn larger than they are: a round number, at least 1.

    `points` are all positions, and `span` is that of the widest aircraft, m.
    """
    factor = float(np.linalg.norm(np.ptp(points, axis=0))) * SHARE_OF_FLIGHT / span
    return max(1.0, _round_below(factor, FINELY_ROUND))


def ground_grid(points: FloatArray) -> tuple[list[FloatArray], float]:
    """Lines of a level grid half a spacing below the flight and as wide as it, and their spacing.

    Each line is its two ends, shape (2, 3), m; the spacing is 1, 2 or 5 times a power of ten.
    """
    longest = float(np.ptp(points[:, :2], axis=0).max())
    spacing = _round_below(max(longest, 1.0) * 2.0 / GROUND_LINES)
    low = np.floor(points[:, :2].min(axis=0) / spacing) * spacing
    high = np.ceil(points[:, :2].max(axis=0) / spacing) * spacing
    high = np.maximum(high, low + AXES * spacing)
    return grid_lines(low, high, spacing, float(points[:, 2].max()) + spacing / 2.0), spacing


def grid_lines(low: FloatArray, high: FloatArray, spacing: float, down: float) -> list[FloatArray]:
    """Lines of a level grid from corner `low` to corner `high` (north, east), ends as rows, m."""
    norths, easts = (
        np.arange(a, b + spacing / 2.0, spacing) for a, b in zip(low, high, strict=True)
    )
    lines = [np.array([[north, low[1], down], [north, high[1], down]]) for north in norths]
    return lines + [np.array([[low[0], east, down], [high[0], east, down]]) for east in easts]


def _round_below(value: float, steps: tuple[float, ...] = ROUND) -> float:
    """Largest of `steps` times a power of ten that is not above `value`."""
    decade = 10.0 ** math.floor(math.log10(value)) if value > 0.0 else 1.0
    return decade * max(factor for factor in steps if factor * decade <= value or factor == 1.0)


def overview_eye(points: FloatArray, *, margin: float) -> Eye:
    """Camera that sees the whole flight from its left, a little from behind and above.

    The picture holds `points`, shape (n, 3), m, and `margin` (m) around them: half the width of an
    aircraft as drawn.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    # The direction of flight is that diagonal of the box around it which it takes.
    moved = (low + high) / 2.0 - points[0]
    north, east = (high - low)[:2] * np.where(moved[:2] < 0.0, -1.0, 1.0)
    azimuth = math.atan2(east, north) + VIEWED_FROM
    level = math.cos(ELEVATION)
    back = np.array([level * math.cos(azimuth), level * math.sin(azimuth), -math.sin(ELEVATION)])
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    up = np.cross(right, back)
    # A point is in the picture if its distance from the axis is at most that of the edge there.
    centre = (low + high) / 2.0
    depth, seen = (points - centre) @ back, (points - centre) @ np.column_stack([right, up])
    slopes = math.tan(FIELD_OF_VIEW / 2.0) * np.array([ASPECT, 1.0])
    distance = float(np.max((np.abs(seen) + margin) / slopes + depth[:, None]))
    return centre + distance * back, centre


def chase_eye(width: float) -> Eye:
    """Camera behind and above an aircraft `width` m wide, in axes that turn with its course.

    The aircraft takes two fifths of the width of a square view.
    """
    return width * np.array([-2.0, -0.9, -1.0]), width * np.array([0.3, 0.0, 0.0])
