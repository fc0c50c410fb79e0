"""An aircraft's inner loop as it was identified, at one or more flight conditions."""

import math
from dataclasses import dataclass, replace

from flighttune.arrays import FloatArray
from flighttune.control.exact_law import rate_model
from flighttune.control.inner_loop import InnerLag, inner_loop_scaling, with_inner_loop
from flighttune.control.linear_model import LinearModel, kinematic_model
from flighttune.errors import InputError
from flighttune.present.names import columns
from flighttune.present.tables import Table
from flighttune.units import DEG_PER_RAD

ANGLE_PER_SPEED = math.radians(60.0)
"""Difference of climb that counts like a doubling of airspeed in `nearest`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedChannel:
    """One channel: the identified lag, and how well it fits.

    Attributes
    ----------
    lag : InnerLag
    fit_percent : float, %
        Share of the variance explained on a manoeuvre that was not used for the fit.
    residual : float, 1
        Root mean square distance between fitted and measured frequency response.
    cross : float, unit of the other channel over that of this one
        Largest response of the other channel to this one's command over the band.
    simpler : InnerLag
        The best lag of at most second order; `lag` itself where that is one.
    """

    lag: InnerLag
    fit_percent: float
    residual: float
    cross: float
    simpler: InnerLag


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedCondition:
    """The inner loop at one flight condition.

    Attributes
    ----------
    V_a : float, m/s
        Airspeed.
    gamma : float, rad
        Flight-path angle, climb positive.
    h : float, m
        Height above sea level.
    phi, n_z : IdentifiedChannel
        Roll and load factor.
    """

    V_a: float
    gamma: float
    h: float
    phi: IdentifiedChannel
    n_z: IdentifiedChannel

    @property
    def lags(self) -> tuple[InnerLag, InnerLag]:
        """Of roll and load factor."""
        return self.phi.lag, self.n_z.lag


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedAircraft:
    """An aircraft's inner loop at every condition identified.

    Attributes
    ----------
    aircraft : str
        Its name.
    conditions : tuple of IdentifiedCondition
        At least one; the first is the nominal one.
    seed : int
        Of the excitation.
    gains : str
        Hash of the inner loop's gains; empty where it is not known.
    """

    aircraft: str
    conditions: tuple[IdentifiedCondition, ...]
    seed: int = 0
    gains: str = ""

    def __post_init__(self) -> None:
        if not self.conditions:
            raise InputError("`conditions` must not be empty.")

    def nearest(self, V_a: float, gamma: float) -> IdentifiedCondition:
        """The condition nearest to an airspeed (m/s) and a flight-path angle (rad)."""

        def distance(condition: IdentifiedCondition) -> float:
            octaves = math.log2(condition.V_a / V_a)
            return math.hypot(octaves, (condition.gamma - gamma) / ANGLE_PER_SPEED)

        return min(self.conditions, key=distance)


LAG_COLUMNS = columns(
    "V_a_mps gamma_deg channel order natural_frequency_rad_s damping lag_s delay_s bandwidth_rad_s "
    "cross fit_percent"
)


def lags_table(aircraft: IdentifiedAircraft) -> Table:
    """Every lag with its fit, a row each channel of a condition."""
    records = [
        {
            "V_a_mps": at.V_a,
            "gamma_deg": at.gamma * DEG_PER_RAD,
            "channel": name,
            "order": channel.lag.order,
            "natural_frequency_rad_s": channel.lag.natural_frequency,
            "damping": channel.lag.damping if channel.lag.order > 1 else None,
            "lag_s": channel.lag.lag if channel.lag.order > 2 else None,
            "delay_s": channel.lag.delay,
            "bandwidth_rad_s": channel.lag.bandwidth,
            "cross": channel.cross,
            "fit_percent": channel.fit_percent,
        }
        for at in aircraft.conditions
        for name, channel in (("phi", at.phi), ("n_z", at.n_z))
    ]
    title = f"{aircraft.aircraft}: identified inner loop"
    return Table(title=title, columns=LAG_COLUMNS, records=records)


LAGS_PER_ERROR = 3.0
"""Lags of its channel over which an error of the exact law counts as much as its rate, 1/s:
design/exact_gains.md."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignModel:
    """The chi/gamma law behind an identified inner loop: what gains are designed on.

    Attributes
    ----------
    model : LinearModel
        States (chi, gamma, lags), inputs (phi, n_z) commands, errors (chi, gamma).
    scaling : ndarray, shape (n + 2,)
        As `flighttune.control.inner_loop.inner_loop_scaling`.
    V_a, gamma : float, m/s and rad
        Airspeed and flight-path angle of the law.
    roll_lag : float, s
        Whole lag and delay of roll.
    """

    model: LinearModel
    scaling: FloatArray
    V_a: float
    gamma: float
    roll_lag: float


def design_model(
    condition: IdentifiedCondition,
    *,
    g: float,
    V_a: float | None = None,
    gamma: float | None = None,
    hold: float = 0.0,
    schedule_speed: float | None = None,
    rates: bool = False,
) -> DesignModel:
    """Return the plant of the outer loop: the chi/gamma law behind the identified inner loop.

    Parameters
    ----------
    condition : IdentifiedCondition
    g : float, m/s^2
        Acceleration of gravity.
    V_a, gamma : float, m/s and rad, optional
        Of the law; by default those of `condition`.
    hold : float, s
        Delay added to both channels: half the sample time of the controller.
    schedule_speed : float, m/s, optional
        Airspeed for which gains that grow with airspeed are given: the inputs of the law are then
        scaled by ``V_a / schedule_speed``, which is the same loop.
    rates : bool
        Of the exact law, whose inputs are the rates wanted: their response has the lag of roll and
        of load factor. Airspeed, climb and schedule make no difference, and each error is measured
        in units of `LAGS_PER_ERROR` times the whole lag of its channel, so that gains go with one
        over that lag on any aircraft.

    Returns
    -------
    DesignModel

    Raises
    ------
    InputError
        If a value cannot be used.
    """
    V_a = condition.V_a if V_a is None else V_a
    gamma = condition.gamma if gamma is None else gamma
    law = kinematic_model(V_a=V_a, gamma=gamma, g=g)
    if schedule_speed is not None:
        law = replace(law, B=law.B * (V_a / schedule_speed))
    lags = [lag.delayed(hold) for lag in condition.lags]
    if rates:
        law = rate_model()
    scaling = inner_loop_scaling(law, lags)
    if rates:
        scaling[-len(lags) :] = [LAGS_PER_ERROR * lag.whole for lag in lags]
    return DesignModel(
        model=with_inner_loop(law, lags),
        scaling=scaling,
        V_a=V_a,
        gamma=gamma,
        roll_lag=lags[0].whole,
    )
