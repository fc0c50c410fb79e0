"""``[controller]``, ``[limits]`` and ``[envelope]`` of a scenario."""

import math
from functools import lru_cache
from typing import Annotated, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field

from flighttune.base import quantities as q
from flighttune.base.arrays import FloatArray
from flighttune.base.units import DEG
from flighttune.control.limits import AntiWindup, Limits
from flighttune.control.linear_model import Envelope


class ControllerTable(q.Table):
    """``[controller]``: sample rate and options of the discrete MIMO-PI."""

    rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)] = 50.0
    anti_windup: AntiWindup = "conditional"
    # Time constant of back_calculation; computed from the gains if left out
    tracking_time_s: q.TimeConstant | None = None
    feed_forward: bool = False  # adds the load factor of the reference
    schedule: bool = False  # true: gains proportional to the airspeed
    # true: the path angle gives way if the airspeed of an aircraft falls towards 0.875 of its value
    # in [flight]; it always does if the law follows the airspeed
    speed_priority: bool | None = None


def _with_zero(rates: tuple[float, float]) -> tuple[float, float]:
    if not rates[0] <= 0.0 <= rates[1]:
        raise ValueError("must be a range of rates that includes zero")
    return rates


Rates: TypeAlias = q.PositiveRate | Annotated[q.AngularRates, AfterValidator(_with_zero)]


class LimitsTable(q.Table):
    """``[limits]`` of the commands; without it, the limits of the first aircraft hold for all."""

    # If left out, as for every limit, only the aircraft's own limit holds
    phi_deg: q.Angles | None = None
    phi_rate_dps: Rates | None = None  # a number (both ways) or a range
    n_z: q.LoadFactors | None = None
    n_z_rate_per_s: Rates | None = None  # a number (both ways) or a range
    # If the law follows the airspeed; for a plant without engines it holds at any airspeed
    n_x: q.LoadFactors | None = None
    n_x_rate_per_s: Rates | None = None  # a number (both ways) or a range

    @lru_cache(maxsize=64)  # noqa: B019 - equal tables share it
    def limits(self, *, airspeed: bool = False) -> Limits:
        """Limits of (phi, n_z), and n_x with an `airspeed`, in rad, 1, s; inf by default."""
        m = 3 if airspeed else 2
        lower, upper = _ends(*(self.phi_deg, self.n_z, self.n_x)[:m])
        rates = self.phi_rate_dps, self.n_z_rate_per_s, self.n_x_rate_per_s
        rate_lower, rate_upper = _ends(*rates[:m])
        return Limits(lower=lower, upper=upper, rate_lower=rate_lower, rate_upper=rate_upper)


def _ends(*limits: float | tuple[float, float] | None) -> list[FloatArray]:
    """Lower and upper ends of (phi in deg, n_z, ...), in rad and 1."""
    ranges = [math.inf if limit is None else limit for limit in limits]
    pairs = [limit if isinstance(limit, tuple) else (-limit, limit) for limit in ranges]
    pairs[0] = pairs[0][0] * DEG, pairs[0][1] * DEG
    return [np.array(ends) for ends in zip(*pairs, strict=True)]


class EnvelopeTable(q.Table):
    """``[envelope]``: ranges of flight over which ``certify --envelope`` seeks one proof."""

    V_a_mps: q.Airspeeds
    gamma_deg: q.Inclinations
    phi_deg: q.Inclinations
    n_z: q.LoadFactors

    def envelope(self) -> Envelope:
        """The ranges in m/s, rad and 1."""
        gamma, phi = ((low * DEG, high * DEG) for low, high in (self.gamma_deg, self.phi_deg))
        return Envelope(V_a=self.V_a_mps, gamma=gamma, phi=phi, n_z=self.n_z)
