"""Positions, attitudes, sizes and cameras of the 3D scene, in local NED and m."""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.recording.entities import DrawnRun
from flighttune.shipped import aircraft_folder
from flighttune.simulate.run import Run
from flighttune.units import FT

MODEL_SPAN = 2.9
"""Wing span of the aircraft in ``aircraft.glb``, m."""

METRES = {"M": 1.0, "FT": FT}

FIELD_OF_VIEW = math.radians(52.0)
"""Vertical field of view that the flight should fill; the viewer's own is 55 deg."""

ASPECT = 1.25
"""Width over height of the view, or less."""

VIEWED_FROM = math.radians(-120.0)
ELEVATION = math.radians(22.0)
"""Azimuth (clockwise from the direction of flight) and elevation of the camera."""

SHARE_OF_FLIGHT = 1.0 / 10.0
"""Width of a drawn aircraft as a fraction of the size of the flight."""

ROUND = (1.0, 2.0, 5.0)
FINELY_ROUND = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
AXES = 2.0
"""Length of the arrows that name the axes, in spacings of the grid."""

GROUND_LINES = 12
"""Approximate number of lines along the longer side of the ground grid."""


@dataclass(frozen=True, slots=True)
class Eye:
    """A camera: where it is and where it looks, m."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]


def positions(signals: pd.DataFrame) -> FloatArray:
    """North, east and down of every sample, shape (n, 3), m."""
    return signals[["north", "east", "down"]].to_numpy(dtype=float)


def all_positions(drawn: Sequence[DrawnRun]) -> FloatArray:
    """All finite positions of all runs, shape (n, 3), m."""
    points = np.vstack([positions(drawn_run.run.signals) for drawn_run in drawn])
    return points[np.isfinite(points).all(axis=1)]


def headings(signals: pd.DataFrame) -> FloatArray:
    """Rotation to NED from level axes that turn with the course, shape (n, 4): x, y, z, w."""
    half = 0.5 * signals["chi"].to_numpy(dtype=float)
    none = np.zeros_like(half)
    return np.column_stack([none, none, np.sin(half), np.cos(half)])


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

    Notes
    -----
    B. L. Stevens, F. L. Lewis and E. N. Johnson, *Aircraft Control and Simulation*, Wiley,
    Eq. (1.8-18): the Euler angles in the order yaw, pitch, roll.
    """
    pitch = signals["theta" if "theta" in signals else "gamma"]
    crab = signals["psi"] - signals["chi"] if "psi" in signals else 0.0 * pitch
    halves = 0.5 * np.array([signals["phi"], pitch, crab], dtype=float)
    (s_x, s_y, s_z), (c_x, c_y, c_z) = np.sin(halves), np.cos(halves)
    return np.column_stack(
        [
            s_x * c_y * c_z - c_x * s_y * s_z,
            c_x * s_y * c_z + s_x * c_y * s_z,
            c_x * c_y * s_z - s_x * s_y * c_z,
            c_x * c_y * c_z + s_x * s_y * s_z,
        ]
    )


def span_of(run: Run) -> float:
    """Wing span of the run's aircraft, m.

    A plant without an aircraft is drawn as the first aircraft of its scenario. Without one, or
    without a span in its file, the span is `MODEL_SPAN`.
    """
    tables = run.provenance.scenario.get("plant") or []
    names = [run.provenance.aircraft, *(table.get("aircraft") for table in tables)]
    return next((_span(name) for name in names if name), MODEL_SPAN)


@cache
def _span(aircraft: str) -> float:
    try:
        folder = Path(aircraft)
        folder = folder if folder.name != aircraft else aircraft_folder(aircraft)
        model = tomllib.loads((folder / "aircraft.toml").read_text(encoding="utf-8"))["model"]
        # The file may be in JSBSim's own set; it is found without loading JSBSim.
        installed = find_spec("jsbsim")
        places = [
            Path(place) for place in (installed and installed.submodule_search_locations) or ()
        ]
        for file in (
            folder / model,
            *(p / "aircraft" / model / f"{model}.xml" for p in places),
        ):
            found = ElementTree.parse(file).find("metrics/wingspan") if file.is_file() else None
            if found is not None and found.text:
                return float(found.text) * METRES[found.get("unit", "FT")]
    except (InputError, OSError, ValueError, KeyError, ElementTree.ParseError):
        pass
    return MODEL_SPAN


def widest(drawn: Sequence[DrawnRun]) -> float:
    """Largest wing span of all aircraft, m."""
    return max(span_of(drawn_run.run) for drawn_run in drawn)


def drawn_width(drawn: Sequence[DrawnRun]) -> float:
    """Width at which the widest aircraft is drawn, m."""
    span = widest(drawn)
    return span * enlargement(all_positions(drawn), span)


def all_to_see(drawn: Sequence[DrawnRun]) -> FloatArray:
    """Positions of all runs, and corners of the ground below them, shape (n, 3), m."""
    points = all_positions(drawn)
    lines, spacing = ground_grid(points)
    axes = lines[0][0] + AXES * spacing * np.eye(3)[:2]
    return np.vstack([points, axes, *lines])


def enlargement(points: FloatArray, span: float) -> float:
    """Factor by which aircraft are drawn larger than they are: a round number, at least 1.

    Parameters
    ----------
    points : ndarray, shape (n, 3), m
        All positions.
    span : float, m
        Of the widest aircraft.
    """
    factor = float(np.linalg.norm(np.ptp(points, axis=0))) * SHARE_OF_FLIGHT / span
    return max(1.0, _round_below(factor, FINELY_ROUND))


def ground_grid(points: FloatArray) -> tuple[list[FloatArray], float]:
    """Lines of a level grid half a spacing below the flight, as wide as it.

    Parameters
    ----------
    points : ndarray, shape (n, 3), m
        All positions.

    Returns
    -------
    lines : list of ndarray, shape (2, 3), m
        Ends of each line.
    spacing : float, m
        Distance of neighbours: 1, 2 or 5 times a power of ten.
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

    Parameters
    ----------
    points : ndarray, shape (n, 3), m
        All positions to see.
    margin : float, m
        Space to leave around them: half the width of an aircraft as drawn.
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
    # The middle of the picture depends on the perspective, and so on the distance: a few steps.
    for _ in range(4):
        depth = distance - (points - target) @ back if distance else np.ones(len(points))
        seen = np.column_stack([(points - target) @ right, (points - target) @ up]) / depth[:, None]
        centre = (seen.min(axis=0) + seen.max(axis=0)) / 2.0 * (distance or 1.0)
        target = target + centre[0] * right + centre[1] * up
        around = points - target
        aside = np.maximum(np.abs(around @ right) / ASPECT, np.abs(around @ up)) + margin
        distance = float(np.max(around @ back + aside / slope))
    return Eye(tuple(target + distance * back), tuple(target))


def _signs(points: FloatArray) -> FloatArray:
    """Signs, 1 or -1, of the overall displacement east and north."""
    moved = points[:, :2].mean(axis=0) - points[0, :2]
    return np.where(moved[::-1] < 0.0, -1.0, 1.0)


def chase_eye(width: float) -> Eye:
    """Camera behind and above an aircraft `width` m wide, in axes that turn with its course.

    In a view as wide as high the aircraft takes two fifths of the width.
    """
    return Eye((-2.0 * width, -0.9 * width, -1.0 * width), (0.3 * width, 0.0, 0.0))
