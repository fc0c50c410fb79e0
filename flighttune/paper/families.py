"""The flights of the paper: families of gains and of disturbances, and readings of the limits."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.control.gains import PAPER_EPSILON, PIGains
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import AntiWindup
from flighttune.paper import parameters as printed
from flighttune.paper.measures import measures
from flighttune.plants.base import FlightCondition
from flighttune.simulate.continuous import ContinuousFlight, continuous_flight
from flighttune.simulate.disturbance import Sinusoid

SAMPLE = 0.01
"""Time between the samples of a flight, s."""

START = FlightCondition(
    V_a=printed.V_A,
    chi=printed.CHI_0,
    gamma=printed.GAMMA_0,
    phi=printed.PHI_0,
    n_z=printed.N_Z_0,
)
"""Table 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperFlight:
    """One flight of the paper's loop, sampled every `SAMPLE` seconds.

    Attributes
    ----------
    gains : PIGains
    limits : Limits
        That acted on the commands.
    disturbance : Sinusoid or None
    flown : ContinuousFlight
        The time history.
    """

    gains: PIGains
    limits: Limits
    disturbance: Sinusoid | None
    flown: ContinuousFlight

    @property
    def t(self) -> FloatArray:
        """Time, shape (k,), s."""
        return self.flown.t

    @cached_property
    def channels(self) -> dict[str, FloatArray]:
        """`flighttune.paper.measures.CHANNELS` over time, each of shape (k,)."""
        error, rate = self.flown.error.T, self.flown.error_rate.T
        return {
            "chi": error[0],
            "gamma": error[1],
            "chi_dot": rate[0],
            "gamma_dot": rate[1],
            "s_chi": np.hypot(error[0], rate[0]),
            "s_gamma": np.hypot(error[1], rate[1]),
        }

    @cached_property
    def measures(self) -> pd.DataFrame:
        """The paper's measures over the printed 20 s, one row a channel."""
        inside = self.t <= printed.DURATION + 0.5 * SAMPLE
        return measures(self.t[inside], {name: x[inside] for name, x in self.channels.items()})

    def peak(self, channel: str) -> tuple[float, float]:
        """Maximum overshoot in rad and peak time in s of a channel."""
        row = self.measures.loc[channel]
        return float(row["MO_rad"]), float(row["PT_s"])

    def after(self, channel: str, t: float) -> float:
        """Largest magnitude of a channel from time `t` (s) on."""
        return float(np.max(np.abs(self.channels[channel][self.t >= t])))

    @property
    def command_rates(self) -> FloatArray:
        """Rates of the two commands over time by differences, shape (k - 1, 2)."""
        return np.diff(self.flown.u, axis=0) / SAMPLE

    @property
    def converged(self) -> bool:
        """Whether both errors end, and stay for the last two seconds, below `NEAR`."""
        if self.flown.status != "completed":
            return False
        late = self.t >= self.t[-1] - 2.0
        return bool(np.max(np.abs(self.flown.error[late])) < NEAR)


NEAR = 0.05
"""Errors below this are called near the origin, rad."""


def gain_family(star: PIGains) -> dict[str, PIGains]:
    """`star` as ``K*`` and ``K1`` to ``K6`` of Table 2 made from it, by name."""
    shift = np.eye(2)
    return {
        printed.STAR: star,
        **{
            name: PIGains(K_P=star.K_P - epsilon * shift, K_I=star.K_I - epsilon * shift)
            for name, epsilon in PAPER_EPSILON.items()
        },
    }


def fly(
    gains: PIGains,
    disturbance: Sinusoid | None,
    *,
    limits: Limits | None = None,
    anti_windup: AntiWindup = "none",
    duration: float = printed.DURATION,
) -> PaperFlight:
    """Fly the paper's manoeuvre.

    Parameters
    ----------
    gains : PIGains
        From (chi, gamma) to (phi, n_z).
    disturbance : Sinusoid or None
        Of the two rates.
    limits : Limits, optional
        By default the printed ranges without rate limits, as the paper must have flown.
    anti_windup : {"none", "conditional", "back_calculation"}
        None by default, as in the paper.
    duration : float, s
        Time to fly.

    Returns
    -------
    PaperFlight
    """
    limits = printed.printed_ranges() if limits is None else limits
    t = np.arange(round(duration / SAMPLE) + 1) * SAMPLE
    flown = continuous_flight(
        gains,
        t,
        condition=START,
        ref=(printed.CHI_C, printed.GAMMA_C),
        limits=limits,
        anti_windup=anti_windup,
        disturbance=disturbance,
        roll="any",
        g=printed.G,
    )
    return PaperFlight(gains=gains, limits=limits, disturbance=disturbance, flown=flown)


def readings(gains: PIGains) -> dict[str, PaperFlight]:
    """The manoeuvre under each reading of the printed limits, by name."""
    calm = printed.disturbance(printed.PRINTED_DISTURBANCE)
    both = printed.printed_limits()
    return {
        "ranges only": fly(gains, calm),
        "ranges and rate limits": fly(gains, calm, limits=both),
        "with rate limits and anti-windup": fly(
            gains, calm, limits=both, anti_windup="conditional"
        ),
        "no limits": fly(gains, calm, limits=Limits.none(2)),
    }


def command_use(gains: PIGains) -> dict[str, tuple[float, float, float]]:
    """Command and command rate at the first instant: value, lower and upper limit, by name.

    Notes
    -----
    ``u(t_0) = K (x_0; x_0 dt)`` and ``u'(t_0) = K (0; x_0)`` of section 4.4 with dt = 0.1 s.
    """
    x_0 = printed.E_0
    limits = printed.printed_limits()
    u = gains.K @ np.concatenate([x_0, x_0 * printed.OPTIMISATION_DT])
    u_dot = gains.K @ np.concatenate([np.zeros(2), x_0])
    rows = {}
    for i, name in enumerate(("phi", "n_z")):
        rows[name] = float(u[i]), float(limits.lower[i]), float(limits.upper[i])
        rows[f"{name} rate"] = (
            float(u_dot[i]),
            float(limits.rate_lower[i]),
            float(limits.rate_upper[i]),
        )
    return rows


def worst_use(gains: PIGains) -> float:
    """Largest of `command_use` as a part of its limit; at most one where all limits hold."""
    return max(
        value / (upper if value > 0.0 else lower)
        for value, lower, upper in command_use(gains).values()
    )


def oscillations(x: FloatArray) -> int:
    """Number of times a signal crosses zero."""
    signs = np.sign(x)
    return int(np.count_nonzero(np.diff(signs[signs != 0.0])))


def decay_rate(t: FloatArray, norm: FloatArray) -> float:
    """Rate of the exponential that `norm` follows, by a straight line through its logarithm."""
    seen = norm > 0.0
    return -float(np.polyfit(t[seen], np.log(norm[seen]), 1)[0]) if seen.sum() > 2 else math.nan
