"""Identification of a JSBSim aircraft over airspeeds and flight-path angles."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from flighttune.errors import TrimError
from flighttune.plants.base import FlightCondition
from flighttune.plants.identification.identify import Identification, identify, of_one_order
from flighttune.plants.identification.model import IdentifiedAircraft
from flighttune.plants.jsbsim.aircraft import AircraftConfig
from flighttune.plants.jsbsim.linearize import RigidBodyModel, linearize
from flighttune.plants.jsbsim.plant import JSBSimPlant

DESIGN_SPEED = "inner-loop/V_a-design-mps"
"""Gain of the inner loop that tells the airspeed it was made for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftIdentification:
    """All that was identified of an aircraft, and its airframe without the inner loop.

    Attributes
    ----------
    identified : IdentifiedAircraft
        What the file holds.
    conditions : tuple of Identification
        In the same order, with the flights.
    skipped : tuple of str
        Why a condition asked for is not among them: one sentence each.
    rigid_body : RigidBodyModel
        About the first condition.
    """

    identified: IdentifiedAircraft
    conditions: tuple[Identification, ...]
    skipped: tuple[str, ...]
    rigid_body: RigidBodyModel


def design_speed(config: AircraftConfig) -> float:
    """Airspeed (m/s) the inner loop was made for; the middle of the envelope if it says none."""
    low, high = config.envelope.V_a
    speed = config.gains.get(DESIGN_SPEED, 0.0)
    return speed if low < speed < high else 0.5 * (low + high)


def identify_aircraft(
    aircraft: str | Path,
    *,
    V_a: Sequence[float] = (),
    gamma: Sequence[float] = (0.0,),
    h: float = 1000.0,
    seed: int = 0,
) -> AircraftIdentification:
    """Identify the inner loop of an aircraft at every airspeed with every flight-path angle.

    Parameters
    ----------
    aircraft : str or Path
        Name of a shipped aircraft, or a folder with an ``aircraft.toml``.
    V_a : sequence of float, m/s
        Airspeeds; by default the one the inner loop was made for. The first is the nominal one.
    gamma : sequence of float, rad
        Flight-path angles, climb positive; the first is the nominal one.
    h : float, m
        Height above sea level.
    seed : int
        Of the excitation.

    Returns
    -------
    AircraftIdentification
        Conditions without steady flight are left out and listed. The lags of a channel are of one
        order, the one that suits all conditions together.

    Raises
    ------
    InputError, ScenarioError
        If there is no such aircraft, or a condition lies outside its envelope.
    TrimError
        If there is no steady flight at any of the conditions.
    PlantError
        If the aircraft cannot be built or excited.
    """
    plant = JSBSimPlant(aircraft)
    speeds = tuple(V_a) or (design_speed(plant.config),)
    found, trims, skipped = [], [], []
    for condition in (FlightCondition(V_a=v, gamma=g, h=h) for v in speeds for g in gamma):
        try:
            found.append(
                identify(partial(JSBSimPlant, aircraft), condition, plant.limits, seed=seed)
            )
        except TrimError as error:
            skipped.append(str(error))
        else:
            trims.append(condition)
    if not found:
        raise TrimError(skipped[0])
    chosen = of_one_order(found)
    return AircraftIdentification(
        identified=IdentifiedAircraft(
            aircraft=plant.config.folder.name,
            conditions=tuple(one.condition for one in chosen),
            seed=seed,
        ),
        conditions=chosen,
        skipped=tuple(skipped),
        rigid_body=linearize(plant.config, trims[0]),
    )
