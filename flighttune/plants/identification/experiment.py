"""Flights under an excitation about a trim, on any plant."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import PlantError
from flighttune.plants.base import FlightCondition, Plant
from flighttune.plants.identification.excitation import DT, Excitation

ATTEMPTS = 4
"""Flights tried, each at half the size of the one before."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """What was commanded and what was flown, every `DT` seconds.

    Attributes
    ----------
    commanded, flown : ndarray, shape (samples, 2), rad and 1
        Roll and load factor; flown is read when the command is given.
    excitation : Excitation
        As it was flown, after any shrinking.
    """

    commanded: FloatArray
    flown: FloatArray
    excitation: Excitation


def respond(
    plant_factory: Callable[[], Plant], condition: FlightCondition, excitation: Excitation
) -> Response:
    """Fly an excitation on fresh plants, at half the size where the flight ends early.

    The load-factor command is what steady flight at the attitude flown needs, plus the excitation,
    so that the path stays near the trim.

    Parameters
    ----------
    plant_factory : callable
        Returns a plant that was not flown before.
    condition : FlightCondition
        Where to start, wings level.
    excitation : Excitation

    Returns
    -------
    Response

    Raises
    ------
    TrimError
        If there is no steady flight at `condition`.
    PlantError
        If every flight ended early; the message holds the reason of the last.
    """
    reason = ""
    for attempt in range(ATTEMPTS):
        tried = excitation.scaled(0.5**attempt)
        commanded, flown, reason = _flight(plant_factory(), condition, tried)
        if not reason:
            return Response(commanded=commanded, flown=flown, excitation=tried)
    raise PlantError(
        f"the excitation must be flown to its end, but even at {0.5 ** (ATTEMPTS - 1):g} of its "
        f"size: {reason}"
    )


def _flight(
    plant: Plant, condition: FlightCondition, excitation: Excitation
) -> tuple[FloatArray, FloatArray, str]:
    plant.start(condition)
    commanded, flown = [], []
    for phi_cmd, n_z_change in excitation.commands.tolist():
        _, gamma, phi, n_z = plant.observe()[:4]
        n_z_cmd = math.cos(gamma) / math.cos(phi) + n_z_change
        commanded.append((phi_cmd, n_z_cmd))
        flown.append((phi, n_z))
        stop = plant.advance(phi_cmd, n_z_cmd, DT)
        if stop is not None:
            return np.empty(0), np.empty(0), stop.reason
    return np.array(commanded), np.array(flown), ""
