"""Roll, pitch and yaw of the quaternions in a log."""

import math

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.logs.read import Stream

# Angles by quaternion, and whether it is one from front-left-up to east-north-up.
QUATERNIONS = {
    "q": (("phi", "theta", "psi"), False),
    "q_enu": (("phi", "theta", "psi"), True),
    "q_cmd": (("phi_cmd", "theta_cmd", "psi_cmd"), False),
}

# Cost of a turn between two samples over that of a nose that is off the course.
SMOOTH = 20.0


def with_angles(raw: dict[str, Stream]) -> None:
    """Put roll, pitch and yaw (rad, north-east-down) in the place of quaternions.

    The sign of a part w that the log has not is the one that keeps attitude steady and nose ahead.
    """
    for name, (angles, enu) in QUATERNIONS.items():
        parts = {part: raw.pop(f"{name}_{part}") for part in "wxyz" if f"{name}_{part}" in raw}
        if not set("xyz") <= set(parts) or angles[0] in raw:
            continue
        t = parts["x"][0]
        x, y, z = (np.interp(t, *parts[part]) for part in "xyz")
        if "w" in parts:
            w = np.interp(t, *parts["w"])
        else:
            w = np.sqrt(np.maximum(0.0, 1.0 - x * x - y * y - z * z))
            w = w * _signs(w, np.column_stack([x, y, z]), _course(t, raw, enu=enu))
        pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
        yaw = _yaw(w, x, y, z)
        raw[angles[0]] = t, np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        raw[angles[1]] = t, -pitch if enu else pitch
        raw[angles[2]] = t, 0.5 * math.pi - yaw if enu else yaw


def _yaw(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _course(t: FloatArray, raw: dict[str, Stream], *, enu: bool) -> FloatArray:
    """Course over ground as an angle of yaw; NaN without velocities."""
    if not {"v_north", "v_east"} <= set(raw):
        return np.full(len(t), np.nan)
    north, east = (np.interp(t, *raw[name]) for name in ("v_north", "v_east"))
    return np.arctan2(north, east) if enu else np.arctan2(east, north)


def _signs(w: FloatArray, vector: FloatArray, course: FloatArray) -> FloatArray:
    """Signs of w, by dynamic programming over the samples: +1 or -1, shape (n,)."""
    off = [1.0 - np.cos(_yaw(sign * w, *vector.T) - course) for sign in (1.0, -1.0)]
    cost = np.nan_to_num(np.column_stack(off))
    inner, outer = np.sum(vector[1:] * vector[:-1], axis=1), w[1:] * w[:-1]
    stay, flip = (SMOOTH * (1.0 - np.abs(inner + sign * outer)) for sign in (1.0, -1.0))
    total, came = cost[0], np.zeros((len(w), 2), dtype=int)
    for k in range(1, len(w)):
        ways = total + np.array([[stay[k - 1], flip[k - 1]], [flip[k - 1], stay[k - 1]]])
        came[k] = np.argmin(ways, axis=1)
        total = np.min(ways, axis=1) + cost[k]
    state = np.empty(len(w), dtype=int)
    state[-1] = np.argmin(total)
    for k in range(len(w) - 1, 0, -1):
        state[k - 1] = came[k][state[k]]
    return 1.0 - 2.0 * state
