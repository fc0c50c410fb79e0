"""An aircraft's inner loop as it was identified, at one or more flight conditions."""

import math
from dataclasses import dataclass

from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import InnerLag, with_inner_loop
from flighttune.control.law import Law, Trim, made_law
from flighttune.control.linear_model import LinearModel
from flighttune.errors import InputError
from flighttune.present.names import columns
from flighttune.present.tables import Table
from flighttune.units import DEG_PER_RAD

# Difference of climb that counts like a doubling of airspeed in `nearest`.
ANGLE_PER_SPEED = math.radians(60.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedChannel:
    """One channel: the identified lag, and how well it fits."""

    lag: InnerLag
    # %: share of the variance explained on a manoeuvre that was not used for the fit
    fit_percent: float
    residual: float  # 1: root mean square distance between fitted and measured frequency response
    # unit of the other channel over that of this one: largest response of the other channel to this
    # one's command over the band
    cross: float
    simpler: InnerLag  # the best lag of at most second order; `lag` itself where that is one


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedCondition:
    """The inner loop at one flight condition."""

    V_a: float  # m/s: airspeed
    gamma: float  # rad: flight-path angle, climb positive
    h: float  # m: height above sea level
    phi: IdentifiedChannel
    n_z: IdentifiedChannel

    @property
    def lags(self) -> tuple[InnerLag, InnerLag]:
        """Lags of roll and load factor."""
        return self.phi.lag, self.n_z.lag


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedAircraft:
    """An aircraft's inner loop at every condition identified."""

    aircraft: str
    conditions: tuple[IdentifiedCondition, ...]  # at least one; the first is the nominal one
    seed: int = 0  # of the excitation
    gains: str = ""  # Hash of the inner loop's gains; empty where it is not known

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignModel:
    """The chi/gamma law behind an identified inner loop: what gains are designed on."""

    model: LinearModel  # states (chi, gamma, lags), inputs (phi, n_z) commands, errors (chi, gamma)
    scaling: FloatArray  # (n + 2,): as `flighttune.control.inner_loop.inner_loop_scaling`
    # m/s and rad: airspeed and flight-path angle of the law
    V_a: float
    gamma: float
    roll_lag: float  # s: whole lag and delay of roll


def design_model(
    condition: IdentifiedCondition,
    *,
    g: float,
    V_a: float | None = None,
    gamma: float | None = None,
    hold: float = 0.0,
    schedule_speed: float | None = None,
    law: Law | None = None,
) -> DesignModel:
    """Return the plant of the outer loop: the chi/gamma law behind the identified inner loop.

    Parameters
    ----------
    condition : IdentifiedCondition
    g : float, m/s^2
    V_a, gamma : float, m/s and rad, optional
        Condition of the law, by default `condition`.
    hold : float, s
        Delay added to both channels: half the sample time of the controller.
    schedule_speed : float, m/s, optional
        Airspeed for which gains that grow with airspeed are stated: the inputs of the law are then
        scaled by ``V_a / schedule_speed``, which is the same loop.
    law : Law, optional
        Law whose error dynamics stand behind the lags of roll and of load factor; by default the
        paper's.
    """
    V_a = condition.V_a if V_a is None else V_a
    gamma = condition.gamma if gamma is None else gamma
    law = law or made_law("paper")
    model = law.linear_model(Trim(V_a=V_a, gamma=gamma, g=g, schedule_speed=schedule_speed))
    lags = [lag.delayed(hold) for lag in condition.lags]
    return DesignModel(
        model=with_inner_loop(model, lags),
        scaling=law.state_scaling(model, lags),
        V_a=V_a,
        gamma=gamma,
        roll_lag=lags[0].whole,
    )
