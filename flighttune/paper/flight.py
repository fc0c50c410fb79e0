"""One flight of the paper's loop over time, its measures, and the commands it begins with."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.limits import Limits
from flighttune.paper import parameters as printed
from flighttune.paper.continuous import ContinuousLoop, integrate
from flighttune.simulate.disturbance import Sinusoid

# Time between the samples of a flight, s.
SAMPLE = 0.01

# Errors below this are called near the origin, rad.
NEAR = 0.05


@dataclass(frozen=True, eq=False)
class PaperFlight:
    """One flight of the paper's loop, sampled every `SAMPLE` seconds."""

    t: FloatArray  # (k,), s
    # (k, 2), rad, rad, rad/s: course and flight-path angle; errors (reference minus actual); their
    # rates by the law
    x: FloatArray
    error: FloatArray
    error_rate: FloatArray
    # (k, 2), rad and 1: commands of roll and load factor after the limits, before them, and their
    # integral part
    u: FloatArray
    unlimited: FloatArray
    integral: FloatArray
    reason: str  # why the flight diverged, in a sentence; empty if it did not
    disturbance: Sinusoid | None

    @property
    def status(self) -> Literal["completed", "diverged"]:
        """Whether the flight lasted as long as asked."""
        return "diverged" if self.reason else "completed"

    @cached_property
    def channels(self) -> dict[str, FloatArray]:
        """Errors, their rates, and ``s = sqrt(e^2 + e_dot^2)`` over time, each of shape (k,)."""
        error, rate = self.error.T, self.error_rate.T
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
        """The paper's measures over the printed 20 s, one row per channel."""
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
        return np.diff(self.u, axis=0) / SAMPLE

    @property
    def released(self) -> float:
        """Last time at which a command was limited, s; 0 if none ever was."""
        limited = self.t[np.any(self.u != self.unlimited, axis=1)]
        return float(limited[-1]) if len(limited) else 0.0

    @property
    def converged(self) -> bool:
        """Whether both errors stay below `NEAR` for the last two seconds."""
        late = self.t >= self.t[-1] - 2.0
        return not self.reason and bool(np.max(np.abs(self.error[late])) < NEAR)


def fly(
    gains: PIGains,
    disturbance: Sinusoid | None,
    *,
    limits: Limits | None = None,
    conditional: bool = False,
    duration: float = printed.DURATION,
) -> PaperFlight:
    """Fly the paper's manoeuvre for `duration` seconds.

    By default under the printed ranges without rate limits, as the paper must have flown, and
    without the conditional anti-windup that it does not have.
    """
    loop = ContinuousLoop(
        gains,
        printed.printed_ranges() if limits is None else limits,
        conditional=conditional,
        disturbance=disturbance,
    )
    t = np.arange(round(duration / SAMPLE) + 1, dtype=np.float64) * SAMPLE
    signals, reason = integrate(loop, t)
    # `integrate` has the signals in the order of the fields.
    return PaperFlight(
        t[: len(signals)], *signals.transpose(1, 0, 2), reason=reason, disturbance=disturbance
    )


def oscillations(x: FloatArray) -> int:
    """Number of times a signal crosses zero."""
    signs = np.sign(x)
    return int(np.count_nonzero(np.diff(signs[signs != 0.0])))


def decay_rate(t: FloatArray, norm: FloatArray) -> float:
    """Rate of the exponential that `norm` follows, by a straight line through its logarithm."""
    seen = norm > 0.0
    return -float(np.polyfit(t[seen], np.log(norm[seen]), 1)[0]) if seen.sum() > 2 else math.nan


def measures(t: FloatArray, signals: Mapping[str, FloatArray]) -> pd.DataFrame:
    """The paper's measures: a row per signal, a column per measure; ``_rad`` is rad/s for rates.

    Every signal should go to zero; `t` is equally spaced, from zero.

    Notes
    -----
    ITAE is the integral of ``t |x|`` by the trapezoidal rule; MO the largest value of x and PT its
    time (the errors of the paper begin below zero and overshoot upwards); MS and ST the mean and
    standard deviation over the last quarter; mean and std those over the whole time; energy the
    integral of x^2. Section 5.2 of arXiv 2411.13140, in words.
    """
    late = t >= 0.75 * t[-1]
    rows = {}
    for name, x in signals.items():
        peak = int(np.argmax(x))
        rows[name] = {
            "ITAE": float(np.trapezoid(t * np.abs(x), t)),
            "MO_rad": max(0.0, float(x[peak])),
            "PT_s": float(t[peak]),
            "MS_rad": float(np.mean(x[late])),
            "ST_rad": float(np.std(x[late])),
            "mean": float(np.mean(x)),
            "std": float(np.std(x)),
            "energy": float(np.trapezoid(x**2, t)),
        }
    return pd.DataFrame.from_dict(rows, orient="index")


class LimitUse(NamedTuple):
    """A command, or its rate, and the range printed for it."""

    value: float
    lower: float
    upper: float

    @property
    def share(self) -> float:
        """Value as a share of the limit on its side; above one it breaks that limit."""
        return self.value / (self.upper if self.value > 0.0 else self.lower)


def initial_commands(gains: PIGains) -> dict[str, LimitUse]:
    """Both commands and their rates at the first instant, by name (``phi``, ``phi rate``, ...).

    Notes
    -----
    ``u(t_0) = K (x_0; x_0 dt)`` and ``u'(t_0) = K (0; x_0)`` of section 4.4 with dt = 0.1 s.
    """
    x_0, limits = printed.E_0, printed.printed_limits()
    u = gains.K @ np.concatenate([x_0, x_0 * printed.OPTIMISATION_DT])
    u_dot = gains.K @ np.concatenate([np.zeros(2), x_0])
    uses = {}
    for i, name in enumerate(("phi", "n_z")):
        ranges = u[i], limits.lower[i], limits.upper[i]
        rates = u_dot[i], limits.rate_lower[i], limits.rate_upper[i]
        uses[name] = LimitUse(*map(float, ranges))
        uses[f"{name} rate"] = LimitUse(*map(float, rates))
    return uses


def largest_share(gains: PIGains) -> float:
    """Largest share of a limit among `initial_commands`; at most one where all limits hold."""
    return max(use.share for use in initial_commands(gains).values())
