"""The paper's continuous loop, integrated so exactly that it can serve as a reference."""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, read_only_vector
from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import AntiWindup
from flighttune.errors import InputError, ShapeError
from flighttune.plants.base import FlightCondition
from flighttune.plants.kinematic import G_PAPER
from flighttune.simulate.disturbance import Sinusoid
from flighttune.simulate.limited_command import LimitedCommand
from flighttune.simulate.switched_loop import SwitchedLoop

Roll: TypeAlias = Literal["below_90_deg", "any"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContinuousFlight:
    """What the continuous loop did, at the times asked for, k of them.

    Attributes
    ----------
    t : ndarray, shape (k,), s
        The times asked for, up to the end of the flight.
    x, error, error_rate : ndarray, shape (k, 2), rad, rad, rad/s
        Course and flight-path angle; reference minus them, not wrapped; its rate by the law.
    u, unlimited : ndarray, shape (k, 2), rad and 1
        Roll and load-factor command after all limits and before them.
    integral : ndarray, shape (k, 2), rad and 1
        Part of the command that comes from the integrator.
    switches : ndarray, shape (s,), s
        Times at which a limit was met or left, or a stopped integrator went on.
    status : {"completed", "diverged"}
        Whether the last time asked for was reached.
    reason : str
        A sentence with time and numbers where it was not.
    """

    t: FloatArray
    x: FloatArray
    error: FloatArray
    error_rate: FloatArray
    u: FloatArray
    unlimited: FloatArray
    integral: FloatArray
    switches: FloatArray
    status: Literal["completed", "diverged"]
    reason: str


def continuous_flight(
    gains: PIGains,
    t: npt.ArrayLike,
    *,
    condition: FlightCondition,
    ref: tuple[float, float],
    limits: Limits | None = None,
    anti_windup: AntiWindup = "none",
    tracking_time: float | None = None,
    disturbance: Sinusoid | None = None,
    roll: Roll = "below_90_deg",
    g: float = G_PAPER,
) -> ContinuousFlight:
    r"""Fly the continuous MIMO-PI law on the chi/gamma law to within 1e-9 rad.

    Parameters
    ----------
    gains : PIGains
        From (chi, gamma) to (phi, n_z).
    t : array_like, shape (k,), s
        Increasing times to report, not before 0, where the flight starts.
    condition : FlightCondition
        Start; its roll and load factor are the commands in force before t = 0, which only rate
        limits look at.
    ref : tuple of float, rad
        Constant reference of course and flight-path angle.
    limits : Limits, optional
        Of the two commands; none by default.
    anti_windup : {"none", "conditional", "back_calculation"}
        What the integrator does while a limit holds a command.
    tracking_time : float, s, optional
        Of back-calculation; by default ``norm(K_P) / norm(K_I)``.
    disturbance : Sinusoid, optional
        Disturbance of the two rates; none by default.
    roll : {"below_90_deg", "any"}
        ``below_90_deg`` ends the flight where the roll command reaches 90 deg; ``any`` takes
        ``tan(phi)`` and ``cos(phi)`` as they are printed, whatever the roll.
    g : float, m/s^2
        Acceleration of gravity.

    Returns
    -------
    ContinuousFlight
        Up to its end where it diverged: 90 deg of roll, or an angle beyond 1000 rad.

    Raises
    ------
    InputError
        If a value cannot be used.
    ShapeError
        If gains or limits are not made for two commands and two errors.

    Notes
    -----
    With ``e = ref - x``, a wanted command v and a command u, both of two components,

    .. math::
        \dot\chi = \tfrac{g}{V}\tan u_1 + d_\chi, \quad
        \dot\gamma = \tfrac{g}{V}(u_2\cos u_1 - \cos\gamma) + d_\gamma, \quad
        v = K_P e + z,

    Eq. (38) and the control law of arXiv 2411.13140, z(0) = 0. Without rate limits
    ``u = clip(v, lower, upper)`` and, without anti-windup, ``z' = K_I e``: the paper's simulation.
    With rate limits u is a state that starts from the roll and load factor of `condition`:
    ``u' = rate_upper`` where u is below ``clip(v, lower, upper)``, ``rate_lower`` above,
    and u stays equal to it where they are equal and its rate is permitted (the solution in the
    sense of Filippov). Outside its range u comes back at the rate limit. `LimitedCommand` states
    the anti-windup. The course error is not wrapped: the paper's is not.

    Between two switches the right-hand side is smooth and is integrated by DOP853 with relative
    and absolute tolerances of 1e-12; each switch is located on the dense output to 1e-12 of what
    runs out there (distance to a limit, to the wanted command, to a rate), and the integration
    starts anew.
    """
    if roll not in ("below_90_deg", "any"):
        raise InputError(f"`roll` must be below_90_deg or any, got {roll!r}.")
    t = read_only_vector("t", t)
    if not (len(t) and t[0] >= 0.0 and np.all(np.diff(t) > 0.0)):
        raise InputError("`t` must hold increasing times that are not negative.")
    loop = SwitchedLoop(
        gains,
        _commands(gains, limits, anti_windup, tracking_time),
        condition=condition,
        ref=ref,
        disturbance=disturbance,
        stop_at_90_deg=roll == "below_90_deg",
        g=g,
    )
    rows = np.array(list(loop.fly(t.tolist()))).reshape(-1, 12)
    rows.flags.writeable = False
    return ContinuousFlight(
        t=t[: len(rows)],
        x=rows[:, 0:2],
        error=rows[:, 2:4],
        error_rate=rows[:, 4:6],
        u=rows[:, 6:8],
        unlimited=rows[:, 8:10],
        integral=rows[:, 10:12],
        switches=np.array(loop.switches),
        status="diverged" if loop.reason else "completed",
        reason=loop.reason,
    )


def _commands(
    gains: PIGains, limits: Limits | None, anti_windup: AntiWindup, tracking_time: float | None
) -> tuple[LimitedCommand, ...]:
    limits = Limits.none(2) if limits is None else limits
    if gains.K_P.shape != (2, 2) or limits.lower.shape != (2,):
        raise ShapeError("`gains` and `limits` must be of two commands and two errors.")
    if anti_windup not in ("none", "conditional", "back_calculation"):
        raise InputError(
            f"`anti_windup` must be none, conditional or back_calculation, got {anti_windup!r}."
        )
    if tracking_time is not None and not (math.isfinite(tracking_time) and tracking_time > 0.0):
        raise InputError(f"`tracking_time` must be positive, got {tracking_time}.")
    lead = 0.0
    if anti_windup == "back_calculation":
        proportional = float(np.linalg.norm(gains.K_P))
        if tracking_time is None and proportional == 0.0:
            raise InputError("`tracking_time` must be given where `K_P` is zero.")
        lead = (
            float(np.linalg.norm(gains.K_I)) / proportional
            if tracking_time is None
            else 1.0 / tracking_time
        )
    bounds = (limits.lower, limits.upper, limits.rate_lower, limits.rate_upper)
    return tuple(
        LimitedCommand(
            lower=low,
            upper=high,
            rate_lower=down,
            rate_upper=up,
            anti_windup=anti_windup,
            lead=lead,
        )
        for low, high, down, up in zip(*(bound.tolist() for bound in bounds), strict=True)
    )
