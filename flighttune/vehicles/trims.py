"""Steady flights of an aircraft over its envelope, as a result that is shown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flighttune.base.answering import Answering
from flighttune.base.units import Metres, MetresPerSecond, Radians
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.plants.jsbsim.trim import trim_table


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trims(Answering):
    """Steady flights of an aircraft, and why there is none at some conditions.

    Attributes
    ----------
    aircraft : str
        Its name or folder.
    title : str
        Its title.
    records : sequence of mapping
        A record a condition: ``V_a_mps``, ``gamma_deg``, ``phi_deg``, ``h_m``, ``trim`` (angles of
        attack, sideslip, pitch and of the surfaces in deg, throttle 0 to 1; None if there is no
        steady flight) and ``reason``, what stands against it.
    not_compiled : str
        Why JSBSim flies all its flights itself; empty if long ones are compiled.

    Examples
    --------
    >>> trims = ft.trim("aerosonde", V_a=[25.0], gamma=[0.0])
    >>> 0.1 < trims.records[0]["trim"]["throttle"] < 0.5
    True
    """

    aircraft: str
    title: str
    records: Sequence[Mapping[str, Any]]
    not_compiled: str = ""


def trim(
    aircraft: str | Path,
    *,
    V_a: Sequence[MetresPerSecond] | None = None,
    gamma: Sequence[Radians] | None = None,
    phi: Radians = 0.0,
    h: Metres = 1000.0,
) -> Trims:
    """Trim an aircraft at every airspeed with every flight-path angle.

    Parameters
    ----------
    aircraft : str or Path
        A shipped aircraft, or the folder of one.
    V_a : sequence of float, m/s, optional
        Airspeeds, by default six over the envelope.
    gamma : sequence of float, rad, optional
        Flight-path angles, climb positive, by default -10 to 45 deg, or the glide of an aircraft
        without an engine.
    phi : float, rad
        Bank, right wing down positive.
    h : float, m
        Height above sea level.

    Returns
    -------
    Trims

    Raises
    ------
    InputError
        If there is no such aircraft, or an airspeed or angle is no number for a flight.
    PlantError
        If the aircraft cannot be built.

    Examples
    --------
    >>> ft.trim("a4", V_a=[50.0], gamma=[0.0]).records[0]["trim"] is None
    True
    """
    # Here: the help of a command must be quick.
    from flighttune.vehicles.plants.jsbsim import steps

    config = load_aircraft(aircraft)
    records = trim_table(config, V_a=V_a, gamma=gamma, phi=phi, h=h)
    return Trims(
        aircraft=str(aircraft),
        title=config.title,
        records=records,
        not_compiled=steps.not_compiled(config),
    )
