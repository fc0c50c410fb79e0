"""Rigid-body linearisation by central differences of evaluations, for any aircraft that trims."""

import math

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.trim import TrimPoint, trim
from flighttune.units import FT

STATES = "Vt", "Alpha", "Theta", "Q", "Beta", "Phi", "P", "R"
"""Named as JSBSim names them."""
STATE_UNITS = "m/s", "rad", "rad", "rad/s", "rad", "rad", "rad/s", "rad/s"
CONTROLS = "aileron", "elevator", "rudder", "throttle"
CONTROL_UNITS = "rad", "rad", "rad", "1"

WIDTHS = {"Vt": 0.1, "throttle": 0.01}
"""Half-widths of the differences, m/s and 1; `WIDTH` of everything else, rad and rad/s."""
WIDTH = 1e-3

MOVES_ENGINE = "Vt", "throttle"


def differences(fdm: Fdm, condition: FlightCondition) -> tuple[FloatArray, FloatArray]:
    """A and B of the airframe about steady flight, actuators and engine settled.

    Parameters
    ----------
    fdm : Fdm
        The aircraft, its inner loop disengaged by the trim.
    condition : FlightCondition

    Returns
    -------
    A, B : ndarray, shapes (8, 8) and (8, 4)
        States `STATES`, controls `CONTROLS`, SI and rad.

    Raises
    ------
    InputError
        If `condition` lies outside the aircraft's envelope.
    TrimError
        If there is no steady flight at `condition`.
    """
    point = trim(fdm, condition)
    bench = _Bench(fdm, point, condition)
    columns = []
    for name in (*STATES, *CONTROLS):
        width = WIDTHS.get(name, WIDTH)
        above, below = bench.rates(name, width), bench.rates(name, -width)
        columns.append((above - below) / (2.0 * width))
    AB = np.column_stack(columns)
    return AB[:, : len(STATES)], AB[:, len(STATES) :]


class _Bench:
    """Puts the aircraft near its trim and reads how its state changes."""

    def __init__(self, fdm: Fdm, point: TrimPoint, condition: FlightCondition) -> None:
        self._fdm = fdm
        self._steady = {
            "Vt": condition.V_a, "Alpha": point.alpha, "Beta": point.beta, "Theta": point.theta,
            "Phi": condition.phi,
            "P": -point.psi_dot * math.sin(point.theta),
            "Q": point.psi_dot * math.cos(point.theta) * math.sin(condition.phi),
            "R": point.psi_dot * math.cos(point.theta) * math.cos(condition.phi),
            **{name: getattr(point, name) for name in CONTROLS},
        }  # fmt: skip
        channels = fdm.config.channels
        self._write = {
            **{f"{axis}-fps": fdm.writer(f"ic/{axis}-fps") for axis in "uvw"},
            **{f"{axis}-rad_sec": fdm.writer(f"ic/{axis}-rad_sec") for axis in "pqr"},
            **{name: fdm.writer(f"ic/{name}-rad") for name in ("phi", "theta")},
            "aileron": fdm.writer(channels.aileron_trim_rad),
            "elevator": fdm.writer(channels.elevator_trim_rad),
            "rudder": fdm.writer(channels.rudder_trim_rad),
            "throttle": fdm.writer(channels.throttle_trim),
        }
        self._linear = [fdm.reader(f"accelerations/{axis}dot-ft_sec2") for axis in "uvw"]
        self._angular = [fdm.reader(f"accelerations/{axis}dot-rad_sec2") for axis in "pqr"]

    def rates(self, moved: str, by: float) -> FloatArray:
        """Rates of `STATES` with one state or control `by` off the trim."""
        at = {**self._steady, moved: self._steady[moved] + by}
        V, alpha, beta, theta, phi = (at[k] for k in ("Vt", "Alpha", "Beta", "Theta", "Phi"))
        velocity = V * np.array(
            [math.cos(alpha) * math.cos(beta), math.sin(beta), math.sin(alpha) * math.cos(beta)]
        )
        write = self._write
        for axis, value in zip("uvw", velocity.tolist(), strict=True):
            write[f"{axis}-fps"](value / FT)
        for axis in "pqr":
            write[f"{axis}-rad_sec"](at[axis.upper()])
        write["phi"](phi)
        write["theta"](theta)
        for name in CONTROLS:
            write[name](at[name])
        self._fdm.evaluate()
        if moved in MOVES_ENGINE:
            self._fdm.settle_engine()
            self._fdm.evaluate()
        u_dot, v_dot, w_dot = (read() * FT for read in self._linear)
        p_dot, q_dot, r_dot = (read() for read in self._angular)
        u, v, w = velocity.tolist()
        V_dot = (u * u_dot + v * v_dot + w * w_dot) / V
        ahead = math.hypot(u, w)
        p, q, r = at["P"], at["Q"], at["R"]
        return np.array([
            V_dot,
            (u * w_dot - w * u_dot) / ahead**2,
            q * math.cos(phi) - r * math.sin(phi),
            q_dot,
            (v_dot - v * V_dot / V) / ahead,
            p + math.tan(theta) * (q * math.sin(phi) + r * math.cos(phi)),
            p_dot,
            r_dot,
        ])  # fmt: skip
