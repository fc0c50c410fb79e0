"""Steady flights of an aircraft over airspeeds and flight-path angles."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.errors import TrimError
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.aircraft import AircraftConfig
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.start_check import start_faults
from flighttune.plants.jsbsim.trim import TrimPoint, trim
from flighttune.units import DEG

SPEEDS = 6
"""Airspeeds shown over the envelope."""

CLIMBS = (-10.0 * DEG, -5.0 * DEG, 0.0, 5.0 * DEG, 10.0 * DEG, 20.0 * DEG, 45.0 * DEG)
FDM_RATE_HZ = 200.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TrimRow:
    """One flight condition, and the steady flight there or why there is none.

    Attributes
    ----------
    condition : FlightCondition
    point : TrimPoint or None
    reason : str
        Empty where there is a trim. Outside the envelope it tells the range, and what stands
        against steady flight there or that nothing does.
    """

    condition: FlightCondition
    point: TrimPoint | None
    reason: str


def trim_table(
    config: AircraftConfig,
    *,
    V_a: Sequence[float] | None = None,
    gamma: Sequence[float] | None = None,
    phi: float = 0.0,
    h: float = 1000.0,
) -> tuple[TrimRow, ...]:
    """Return the steady flights of an aircraft at every airspeed with every flight-path angle.

    Parameters
    ----------
    config : AircraftConfig
        The aircraft.
    V_a : sequence of float, m/s, optional
        Airspeeds; by default `SPEEDS` over the envelope.
    gamma : sequence of float, rad, optional
        Flight-path angles; by default `CLIMBS`.
    phi, h : float, rad and m
        Bank and height of all of them.

    Raises
    ------
    InputError
        If an airspeed or angle is no number for a flight.
    PlantError
        If the aircraft cannot be built.
    """
    speeds = np.linspace(*config.envelope.V_a, SPEEDS).tolist() if V_a is None else V_a
    return tuple(
        _row(config, FlightCondition(V_a=speed, h=h, gamma=climb, phi=phi))
        for speed in speeds
        for climb in (CLIMBS if gamma is None else gamma)
    )


def _row(config: AircraftConfig, condition: FlightCondition) -> TrimRow:
    faults = list(start_faults(config, condition, ground=0.0))
    outside = "; ".join(f"`{name}` {fault}" for name, fault in faults)
    outside = outside.replace(f" ({config.file})", "")
    if "h" in dict(faults):
        return TrimRow(condition=condition, point=None, reason=outside)
    if not outside:
        point, obstacle = _search(config, condition)
        return TrimRow(condition=condition, point=point, reason=obstacle)
    point, obstacle = _search(_without_edges(config), condition)
    if point is not None:
        angle = f"with alpha at {point.alpha / DEG:.1f} deg"
        obstacle = f"it would fly, {angle} and the throttle at {point.throttle:.2f}"
    return TrimRow(
        condition=condition,
        point=None,
        reason=f"outside the envelope: {outside}; there: {obstacle}",
    )


def _search(config: AircraftConfig, condition: FlightCondition) -> tuple[TrimPoint | None, str]:
    """The trim, or what stands against it."""
    try:
        return trim(Fdm(config, FDM_RATE_HZ), condition), ""
    except TrimError as error:
        return None, str(error).split(" (left over")[0].rsplit(": ", 1)[-1]


def _without_edges(config: AircraftConfig) -> AircraftConfig:
    """The aircraft where only alpha, surfaces and engine stand against a steady flight."""
    anything = (-math.inf, math.inf)
    envelope = config.envelope.model_copy(update={"V_a": anything})
    limits = config.limits.model_copy(update={"phi": anything, "n_z": anything})
    return config.model_copy(update={"envelope": envelope, "limits": limits})
