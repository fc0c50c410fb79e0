"""Steady flight of a JSBSim aircraft: straight or turning, climbing or descending."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from flighttune.arrays import FloatArray
from flighttune.errors import InputError, TrimError
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.newton import interior_root
from flighttune.plants.jsbsim.start_check import start_faults
from flighttune.units import DEG, FT, G_0

_SIDESLIP_SEARCHED = 10.0 * DEG
_RESIDUAL_ALLOWED = 1e-6
"""Largest unbalanced acceleration of a trim, in units of g or rad/s^2."""

_DIFFERENCE = 2.0**-26
"""Difference of an unknown, as a share of its range, where nothing but rounding is in the way."""

_SETTLED = 1e-8
"""Residual that an engine which is still settling leaves."""

_TOO_LITTLE = "full throttle has too little thrust"
_TOO_MUCH = "the aircraft speeds up with the throttle closed"

_STEPS = (1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 3e-4)
"""Differences of the unknowns: rad, rad/s, throttle. The one that an engine follows comes last."""

_AT_STOP = 0.01
"""Share of its interval within which a trim variable counts as lying at the end of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrimPoint:
    """Steady flight found by `trim`.

    Attributes
    ----------
    alpha, beta, theta, psi : float, rad
        Angle of attack, sideslip, pitch attitude, heading.
    aileron, elevator, rudder : float, rad
        Surface positions: rolls right, trailing edge down, trailing edge left.
    throttle : float, 1
        Throttle position.
    psi_dot : float, rad/s
        Turn rate, clockwise seen from above.
    """

    alpha: float
    beta: float
    theta: float
    psi: float
    aileron: float
    elevator: float
    rudder: float
    throttle: float
    psi_dot: float


def trim(fdm: Fdm, condition: FlightCondition) -> TrimPoint:
    """Put `fdm`, its inner loop disengaged, into steady coordinated flight at `condition`.

    Seven unknowns (angle of attack, sideslip, three surfaces, turn rate, throttle) bring six body
    accelerations and the lateral load factor to zero: by Newton's method, and where that gets
    stuck, by bounded least squares.

    Parameters
    ----------
    fdm : Fdm
        The aircraft.
    condition : FlightCondition
        Airspeed, height, course, flight-path angle and roll; `n_z` follows from them.

    Returns
    -------
    TrimPoint
        The steady flight the aircraft is left in.

    Raises
    ------
    InputError
        If `condition` lies outside the aircraft's envelope or command limits.
    TrimError
        If there is no steady flight; the message says what stands against it.
    """
    _check_condition(fdm, condition)
    problem = _TrimProblem(fdm, condition)
    lower, upper = problem.bounds
    start = np.clip(problem.guess, lower + 0.02 * (upper - lower), upper - 0.02 * (upper - lower))
    x = interior_root(
        problem.residuals,
        start,
        (lower, upper),
        widths=np.array(_STEPS) if fdm.engine_settles else _DIFFERENCE * (upper - lower),
        enough=_SETTLED if fdm.engine_settles else 0.0,
    )
    if x is None:
        differences: Any = problem.jacobian if fdm.engine_settles else "2-point"
        x = least_squares(
            problem.residuals, start, bounds=(lower, upper), x_scale=upper - lower, max_nfev=60,
            xtol=1e-14, ftol=1e-14, gtol=1e-14, jac=differences,
        ).x  # fmt: skip
    worst = float(np.max(np.abs(problem.residuals(x))))
    if not worst < _RESIDUAL_ALLOWED:
        raise TrimError(
            f"{fdm.config.file}: no steady flight at {_described(condition)}: "
            f"{problem.obstacle(x)} (left over: {worst:.2g} g)."
        )
    return problem.point(x)


class _TrimProblem:
    """Accelerations of the aircraft as a function of the seven unknowns."""

    def __init__(self, fdm: Fdm, condition: FlightCondition) -> None:
        self._fdm = fdm
        self._condition = condition
        channels = fdm.config.channels
        self._set = {
            name: fdm.writer(f"ic/{name}")
            for name in ("u-fps", "v-fps", "w-fps", "phi-rad", "theta-rad", "psi-true-rad",
                         "p-rad_sec", "q-rad_sec", "r-rad_sec", "h-sl-ft")
        }  # fmt: skip
        self._controls = [
            fdm.writer(channels.aileron_trim_rad),
            fdm.writer(channels.elevator_trim_rad),
            fdm.writer(channels.rudder_trim_rad),
            fdm.writer(channels.throttle_trim),
        ]
        ft_over_g = FT / G_0
        weight_lbf = fdm.reader("inertia/mass-slugs")() / ft_over_g
        self._balance = [
            (fdm.reader("accelerations/udot-ft_sec2"), ft_over_g),
            (fdm.reader("accelerations/vdot-ft_sec2"), ft_over_g),
            (fdm.reader("accelerations/wdot-ft_sec2"), ft_over_g),
            (fdm.reader("accelerations/pdot-rad_sec2"), 1.0),
            (fdm.reader("accelerations/qdot-rad_sec2"), 1.0),
            (fdm.reader("accelerations/rdot-rad_sec2"), 1.0),
            (fdm.reader("forces/fby-total-lbs"), 1.0 / weight_lbf),
        ]
        self._settled_throttle = math.nan
        fdm.writer(channels.engaged)(0.0)
        self._set["h-sl-ft"]((condition.h - fdm.ground) / FT)

    @property
    def guess(self) -> FloatArray:
        """Where the search starts."""
        c = self._condition
        alpha = 0.05 * math.cos(c.gamma) / math.cos(c.phi)
        return np.array([alpha, 0.0, 0.0, 0.0, 0.0, G_0 / c.V_a * math.tan(c.phi), 0.3])

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest value of each unknown."""
        config = self._fdm.config
        turn_rate = 2.0 * G_0 / self._condition.V_a * (0.1 + abs(math.tan(self._condition.phi)))
        intervals = np.array([
            config.envelope.alpha,
            (-_SIDESLIP_SEARCHED, _SIDESLIP_SEARCHED),
            config.actuators.aileron,
            config.actuators.elevator,
            config.actuators.rudder,
            (-turn_rate, turn_rate),
            config.actuators.throttle,
        ])  # fmt: skip
        return intervals[:, 0], intervals[:, 1]

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Return the derivative of `residuals` by one-sided differences inside the bounds.

        Their steps are wide: an engine settles to within 1e-6 g, and its thrust has kinks.
        """
        here, (_, upper) = self.residuals(x), self.bounds
        columns = []
        for i, step in enumerate(_STEPS):
            signed = step if x[i] + step < upper[i] else -step
            moved = x.copy()
            moved[i] += signed
            columns.append((self.residuals(moved) - here) / signed)
        return np.array(columns).T

    def point(self, x: FloatArray) -> TrimPoint:
        """Return the flight that the unknowns `x` stand for."""
        alpha, beta, aileron, elevator, rudder, psi_dot, throttle = map(float, x)
        theta = pitch_attitude(self._condition.gamma, self._condition.phi, alpha, beta)
        psi = self._condition.chi - _drift_angle(theta, self._condition.phi, alpha, beta)
        return TrimPoint(
            alpha=alpha, beta=beta, theta=theta, psi=psi, aileron=aileron, elevator=elevator,
            rudder=rudder, throttle=throttle, psi_dot=psi_dot,
        )  # fmt: skip

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return what is left of six accelerations and the lateral load factor at `x`."""
        point, phi, write = self.point(x), self._condition.phi, self._set
        V_a_fps = self._condition.V_a / FT
        write["u-fps"](V_a_fps * math.cos(point.alpha) * math.cos(point.beta))
        write["v-fps"](V_a_fps * math.sin(point.beta))
        write["w-fps"](V_a_fps * math.sin(point.alpha) * math.cos(point.beta))
        write["phi-rad"](phi)
        write["theta-rad"](point.theta)
        write["psi-true-rad"](point.psi % math.tau)
        write["p-rad_sec"](-point.psi_dot * math.sin(point.theta))
        write["q-rad_sec"](point.psi_dot * math.cos(point.theta) * math.sin(phi))
        write["r-rad_sec"](point.psi_dot * math.cos(point.theta) * math.cos(phi))
        controls = (point.aileron, point.elevator, point.rudder, point.throttle)
        for write_control, value in zip(self._controls, controls, strict=True):
            write_control(value)
        self._fdm.evaluate()
        if point.throttle != self._settled_throttle:
            self._settled_throttle = point.throttle
            self._fdm.settle_engine()
            self._fdm.evaluate()
        return np.array([read() * scale for read, scale in self._balance])

    def obstacle(self, x: FloatArray) -> str:
        """Name the bounds the best compromise leans on, and what the engine cannot do."""
        low, high = self.bounds
        share = (x - low) / (high - low)
        reasons = (
            (share[-1] > 1 - _AT_STOP, _TOO_LITTLE),
            (share[-1] < _AT_STOP, _TOO_MUCH),
            (share[0] > 1 - _AT_STOP, f"it would stall, alpha is at {x[0] / DEG:.1f} deg"),
            (share[0] < _AT_STOP, f"negative stall, alpha is at {x[0] / DEG:.1f} deg"),
            (min(share[3], 1 - share[3]) < _AT_STOP, "the elevator is at its stop"),
            (min(share[2], 1 - share[2]) < _AT_STOP, "the aileron is at its stop"),
            (min(share[4], 1 - share[4]) < _AT_STOP, "the rudder is at its stop"),
        )
        leans = [text for holds, text in reasons if holds]
        return ", ".join(leans) or self._engine_obstacle(x) or "the search did not converge"

    def _engine_obstacle(self, x: FloatArray) -> str:
        """Say what is wrong where neither stop of the throttle balances the speed at `x`."""
        lower, upper = self.bounds
        for stop, sense, text in ((upper, -1.0, _TOO_LITTLE), (lower, 1.0, _TOO_MUCH)):
            at_stop = x.copy()
            at_stop[-1] = stop[-1]
            if sense * self.residuals(at_stop)[0] > _RESIDUAL_ALLOWED:
                return text
        return ""


def pitch_attitude(gamma: float, phi: float, alpha: float, beta: float) -> float:
    """Return theta (rad) of flight at `gamma` with `phi`, `alpha`, `beta` (rad), in still air.

    Notes
    -----
    Eq. (3.6-19) ff. of [1]_, the rate-of-climb constraint of a trimmed aircraft.

    References
    ----------
    .. [1] B. L. Stevens, F. L. Lewis and E. N. Johnson, *Aircraft Control and Simulation*, Wiley.
    """
    a = math.cos(alpha) * math.cos(beta)
    b = math.sin(phi) * math.sin(beta) + math.cos(phi) * math.sin(alpha) * math.cos(beta)
    climb = math.sin(gamma)
    root = math.sqrt(a * a - climb * climb + b * b)
    return math.atan2(a * b + climb * root, a * a - climb * climb)


def _drift_angle(theta: float, phi: float, alpha: float, beta: float) -> float:
    """Return course minus heading (rad) in still air."""
    u = math.cos(alpha) * math.cos(beta)
    v = math.sin(beta)
    w = math.sin(alpha) * math.cos(beta)
    down_bank = v * math.sin(phi) + w * math.cos(phi)
    ahead = u * math.cos(theta) + down_bank * math.sin(theta)
    aside = v * math.cos(phi) - w * math.sin(phi)
    return math.atan2(aside, ahead)


def _check_condition(fdm: Fdm, condition: FlightCondition) -> None:
    for name, fault in start_faults(fdm.config, condition, fdm.ground):
        raise InputError(f"`{name}` {fault}.")


def _described(condition: FlightCondition) -> str:
    return (
        f"V_a {condition.V_a:g} m/s, h {condition.h:g} m, gamma {condition.gamma / DEG:g} deg, "
        f"phi {condition.phi / DEG:g} deg"
    )
