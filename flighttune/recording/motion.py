"""What moves with an aircraft: its trail, velocity and wind, and the certified cone ahead."""

import math

import numpy as np
import pandas as pd
import rerun as rr

from flighttune.arrays import FloatArray
from flighttune.palette import NEUTRAL, rgb
from flighttune.plants.air_path import OVER_GROUND
from flighttune.recording.cast import Member
from flighttune.recording.certified import Certified
from flighttune.recording.geometry import positions
from flighttune.recording.names import AIRCRAFT, TRAILS, times
from flighttune.recording.thinning import evenly

MOST = 1000
"""Instants at which arrows, trail and cone are drawn."""

TRAIL_POINTS = 40
TRAIL_SHARE = 1.0 / 8.0
"""Length of the trail in points, and over the flight."""

WIND_TIMES = 4.0
"""How much longer the arrow of the wind is than that of a speed."""

REACH = 1.5
"""Length of the velocity arrow at the start over the width of the aircraft as drawn."""

WIDEST = math.radians(45.0)
"""Where the certified errors are beyond this there is no ring: it would say nothing."""

CORNERS = 32
WIND_COLOUR = (235, 235, 235)
WIND = ("wind_north", "wind_east", "wind_down")
LEAST_WIND = 1e-3
"""Air slower than this (m/s) is still."""


def metres_per_mps(member: Member, width: float) -> float:
    """Scale of the arrows: length over speed, for an aircraft drawn `width` m wide."""
    V = float(member.run.signals["V_a"].iloc[0])
    return REACH * width / V if math.isfinite(V) and V > 0.0 else 0.0


def log_motion(
    stream: rr.RecordingStream, member: Member, claim: Certified | None, *, width: float
) -> None:
    """Log trail, arrows and cone of one run.

    Parameters
    ----------
    stream : RecordingStream
    member : Member
    claim : Certified or None
        Without one there is no cone.
    width : float, m
        Of the aircraft as drawn.
    """
    signals = member.run.signals
    signals = signals.loc[np.isfinite(positions(signals)).all(axis=1)]
    _log_trail(stream, member, signals)
    signals = signals.iloc[evenly(len(signals), most=MOST)]
    time, scale = times(signals.index), metres_per_mps(member, width)
    frame = f"{AIRCRAFT}/{member.key}"
    gamma = signals["gamma"].to_numpy(dtype=float)
    over_ground = "V_g" in signals and OVER_GROUND[0] not in signals
    speed = signals["V_g" if over_ground else "V_a"].to_numpy(dtype=float)
    ahead = np.column_stack([np.cos(gamma), np.zeros(len(gamma)), -np.sin(gamma)])
    _log_arrow(stream, f"{frame}/velocity", time, ahead * (speed * scale)[:, None], member.look.rgb)
    if set(WIND) <= set(signals) and np.abs(signals[list(WIND)].to_numpy()).max() > LEAST_WIND:
        wind = _turned_back(signals[list(WIND)].to_numpy(dtype=float), signals["chi"].to_numpy())
        _log_arrow(stream, f"{frame}/wind", time, wind * (WIND_TIMES * scale), WIND_COLOUR)
    if claim is not None:
        reach = scale * float(speed[0])
        _log_cone(stream, f"{frame}/certified", signals, claim, reach=reach)


def _log_arrow(
    stream: rr.RecordingStream,
    path: str,
    time: rr.TimeColumn,
    vectors: FloatArray,
    colour: tuple[int, int, int],
) -> None:
    style = rr.Arrows3D.from_fields(colors=[colour], radii=rr.components.Radius.ui_points(1.8))
    stream.log(path, style, static=True)
    stream.send_columns(path, [time], rr.Arrows3D.columns(vectors=vectors))


def _log_trail(stream: rr.RecordingStream, member: Member, signals: pd.DataFrame) -> None:
    path = positions(signals)
    heads = evenly(len(path), most=MOST)
    back = np.linspace(TRAIL_SHARE * len(path), 0.0, TRAIL_POINTS).astype(int)
    strips = path[np.maximum(heads[:, None] - back, 0)]
    entity = f"{TRAILS}/{member.key}"
    style = rr.LineStrips3D.from_fields(
        colors=[member.look.rgb], radii=rr.components.Radius.ui_points(2.0 * member.look.width)
    )
    stream.log(entity, style, static=True)
    stream.send_columns(
        entity, [times(signals.index[heads])], rr.LineStrips3D.columns(strips=list(strips))
    )


def _log_cone(
    stream: rr.RecordingStream,
    path: str,
    signals: pd.DataFrame,
    claim: Certified,
    *,
    reach: float,
) -> None:
    """A ring at the tip of the velocity arrow: inside it the errors are as certified."""
    t = signals.index.to_numpy(dtype=float)
    nearest = np.clip(np.searchsorted(claim.t, t), 0, len(claim.t) - 1)
    widths = claim.angles[nearest]
    claimed = (widths <= WIDEST).all(axis=1)
    chi, chi_ref, gamma_ref = (
        signals[name].to_numpy(dtype=float) for name in ("chi", "chi_ref", "gamma_ref")
    )
    around = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)
    course = (chi_ref - chi)[:, None] + widths[:, :1] * np.cos(around)
    climb = gamma_ref[:, None] + widths[:, 1:] * np.sin(around)
    level = np.cos(climb)
    ring = reach * np.stack([level * np.cos(course), level * np.sin(course), -np.sin(climb)], -1)
    style = rr.LineStrips3D.from_fields(
        colors=[rgb(NEUTRAL)], radii=rr.components.Radius.ui_points(1.0)
    )
    stream.log(path, style, static=True)
    columns = rr.LineStrips3D.columns(strips=list(ring[claimed])).partition(claimed.astype(int))
    stream.send_columns(path, [times(signals.index)], columns)


def _turned_back(vectors: FloatArray, chi: FloatArray) -> FloatArray:
    """NED vectors in axes that turn with the course."""
    north, east, down = vectors.T
    return np.column_stack(
        [
            north * np.cos(chi) + east * np.sin(chi),
            east * np.cos(chi) - north * np.sin(chi),
            down,
        ]
    )
