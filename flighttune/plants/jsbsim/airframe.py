"""Derivatives of a trimmed airframe with its inner loop off: what gains are made from."""

import math
from dataclasses import dataclass

from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.trim import TrimPoint, trim
from flighttune.units import FT, G_0

_ANGLE = 1e-3
_RATE = 1e-3
_THROTTLE = 0.05
"""Half-widths of the central differences, rad, rad/s and 1."""

_MOVED = {
    "p": _RATE, "q": _RATE, "r": _RATE, "alpha": _ANGLE, "beta": _ANGLE,
    "aileron": _ANGLE, "elevator": _ANGLE, "rudder": _ANGLE, "throttle": _THROTTLE,
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Airframe:
    """Slopes of accelerations and load factors about wings-level flight, SI and rad.

    Attributes
    ----------
    V_a, alpha : float, m/s and rad
        Airspeed and angle of attack.
    slopes : mapping of str to mapping of str to float
        ``slopes[what][by]``: of ``p_dot``, ``q_dot``, ``r_dot`` (rad/s^2), ``u_dot`` (m/s^2),
        ``n_z``, ``n_y`` (1), by ``p``, ``q``, ``r`` (rad/s), ``alpha``, ``beta``, ``aileron``,
        ``elevator``, ``rudder`` (rad) and ``throttle`` (1).
    """

    V_a: float
    alpha: float
    slopes: dict[str, dict[str, float]]

    def of(self, what: str, by: str) -> float:
        """Return the slope of `what` by `by`."""
        return self.slopes[what][by]


def airframe(fdm: Fdm, condition: FlightCondition) -> Airframe:
    """Return the derivatives of `fdm` about wings-level flight at `condition`.

    Central differences of evaluations in the trimmed state, actuators and engine settled.

    Raises
    ------
    TrimError
        If there is no steady flight at `condition`.
    """
    point = trim(fdm, condition)
    bench = _Bench(fdm, point, condition.V_a)
    slopes: dict[str, dict[str, float]] = {}
    for by, width in _MOVED.items():
        above, below = bench.measure(**{by: width}), bench.measure(**{by: -width})
        for what in above:
            slopes.setdefault(what, {})[by] = (above[what] - below[what]) / (2.0 * width)
    bench.measure()
    return Airframe(V_a=condition.V_a, alpha=point.alpha, slopes=slopes)


class _Bench:
    """Puts the aircraft near its trim and reads what follows."""

    def __init__(self, fdm: Fdm, point: TrimPoint, V_a: float) -> None:
        self._fdm, self._point, self._V_a_fps = fdm, point, V_a / FT
        channels = fdm.config.channels
        self._set = {
            name: fdm.writer(f"ic/{name}")
            for name in ("u-fps", "v-fps", "w-fps", "p-rad_sec", "q-rad_sec", "r-rad_sec")
        }
        self._controls = {
            "aileron": fdm.writer(channels.aileron_trim_rad),
            "elevator": fdm.writer(channels.elevator_trim_rad),
            "rudder": fdm.writer(channels.rudder_trim_rad),
            "throttle": fdm.writer(channels.throttle_trim),
        }
        self._read = {
            "p_dot": fdm.reader("accelerations/pdot-rad_sec2"),
            "q_dot": fdm.reader("accelerations/qdot-rad_sec2"),
            "r_dot": fdm.reader("accelerations/rdot-rad_sec2"),
            "u_dot": fdm.reader("accelerations/udot-ft_sec2"),
        }
        self._forces = [fdm.reader(f"forces/fb{axis}-total-lbs") for axis in "xyz"]
        self._weight_lbf = fdm.reader("inertia/mass-slugs")() * G_0 / FT

    def measure(self, **moved: float) -> dict[str, float]:
        """Return accelerations and load factors with some variables moved off the trim."""
        point, write = self._point, self._set
        alpha, beta = point.alpha + moved.get("alpha", 0.0), point.beta + moved.get("beta", 0.0)
        write["u-fps"](self._V_a_fps * math.cos(alpha) * math.cos(beta))
        write["v-fps"](self._V_a_fps * math.sin(beta))
        write["w-fps"](self._V_a_fps * math.sin(alpha) * math.cos(beta))
        for rate in "pqr":
            write[f"{rate}-rad_sec"](moved.get(rate, 0.0))
        for name, write_control in self._controls.items():
            write_control(getattr(point, name) + moved.get(name, 0.0))
        self._fdm.evaluate()
        if "throttle" in moved:
            self._fdm.settle_engine()
            self._fdm.evaluate()
        F_x, F_y, F_z = (read() for read in self._forces)
        found = {name: read() for name, read in self._read.items()}
        found["u_dot"] *= FT
        found["n_z"] = (F_x * math.sin(alpha) - F_z * math.cos(alpha)) / self._weight_lbf
        found["n_y"] = F_y / self._weight_lbf
        return found
