"""From a plant and a flight condition to its identified inner loop."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import Order
from flighttune.control.limits import Limits
from flighttune.plants.base import FlightCondition, Plant
from flighttune.plants.identification.excitation import (
    DT,
    Excitation,
    check_manoeuvre,
    multisines,
)
from flighttune.plants.identification.experiment import Response, respond
from flighttune.plants.identification.fit import (
    Candidate,
    FrequencyResponse,
    candidates,
    frequency_responses,
    predicted,
    variance_explained,
)
from flighttune.plants.identification.model import IdentifiedChannel, IdentifiedCondition

PERIODS = 2
"""Periods flown: the first lets the aircraft forget its start."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification:
    """What was identified at one condition, with the flights that show it.

    Attributes
    ----------
    condition : IdentifiedCondition
        The result.
    candidates : tuple of two tuples of Candidate
        Fits of every order, of roll and load factor, the chosen one first.
    frequency : tuple of two FrequencyResponse
        Flown, of roll and load factor.
    check : Response
        The manoeuvre that was not used for the fit.
    check_model : ndarray, shape (samples, 2)
        What the chosen lags make of its commands.
    """

    condition: IdentifiedCondition
    candidates: tuple[tuple[Candidate, ...], tuple[Candidate, ...]]
    frequency: tuple[FrequencyResponse, FrequencyResponse]
    check: Response
    check_model: FloatArray


def identify(
    plant_factory: Callable[[], Plant],
    condition: FlightCondition,
    limits: Limits,
    *,
    seed: int = 0,
) -> Identification:
    """Identify the inner loop of a plant about a trim.

    Parameters
    ----------
    plant_factory : callable
        Returns a plant that was not flown before.
    condition : FlightCondition
        The trim, wings level.
    limits : Limits
        Of the commands (phi, n_z), which the excitation keeps inside.
    seed : int
        Of the excitation.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If the limits leave no room about level flight.
    TrimError
        If there is no steady flight at `condition`.
    PlantError
        If even a small excitation ends the flight.
    """
    sines = multisines(limits, seed=seed)
    repeated = Excitation(commands=np.tile(sines.commands, (PERIODS, 1)), lines=sines.lines)
    frequency = frequency_responses(respond(plant_factory, condition, repeated))
    fitted = candidates(frequency[0]), candidates(frequency[1])
    check = respond(plant_factory, condition, check_manoeuvre(limits))
    return _identification(condition, frequency, fitted, check)


def of_one_order(found: Sequence[Identification]) -> tuple[Identification, ...]:
    """The same conditions with lags of one order a channel, chosen by all of them together.

    Models of one structure can be mixed, and one Lyapunov function can speak of them all.

    Parameters
    ----------
    found : sequence of Identification
        Of one aircraft.

    Returns
    -------
    tuple of Identification
        With the order of the lowest sum of information criteria first among the candidates.
    """
    orders = tuple(_best_order([one.candidates[i] for one in found]) for i in range(2))
    chosen = []
    for one in found:
        fitted = tuple(
            tuple(sorted(of_channel, key=lambda fit: fit.lag.order != order))
            for of_channel, order in zip(one.candidates, orders, strict=True)
        )
        at = one.condition
        condition = FlightCondition(V_a=at.V_a, gamma=at.gamma, h=at.h)
        chosen.append(_identification(condition, one.frequency, (fitted[0], fitted[1]), one.check))
    return tuple(chosen)


def _best_order(candidates: Sequence[tuple[Candidate, ...]]) -> Order:
    total: dict[Order, float] = {}
    for fit in (fit for fits in candidates for fit in fits):
        total[fit.lag.order] = total.get(fit.lag.order, 0.0) + fit.bic
    return min(total, key=total.__getitem__)


def _identification(
    condition: FlightCondition,
    frequency: tuple[FrequencyResponse, FrequencyResponse],
    fitted: tuple[tuple[Candidate, ...], tuple[Candidate, ...]],
    check: Response,
) -> Identification:
    commanded, flown = check.commanded, check.flown
    model = np.column_stack(
        [
            flown[0, i] + predicted(fitted[i][0].lag, commanded[:, i] - commanded[0, i], DT)
            for i in range(2)
        ]
    )
    fits = [variance_explained(flown[:, i], model[:, i]) for i in range(2)]
    phi, n_z = (_channel(frequency[i], fitted[i], fits[i]) for i in range(2))
    return Identification(
        condition=IdentifiedCondition(
            V_a=condition.V_a, gamma=condition.gamma, h=condition.h, phi=phi, n_z=n_z
        ),
        candidates=fitted,
        frequency=frequency,
        check=check,
        check_model=model,
    )


def _channel(
    response: FrequencyResponse, fitted: tuple[Candidate, ...], fit_percent: float
) -> IdentifiedChannel:
    best = fitted[0]
    return IdentifiedChannel(
        lag=best.lag,
        fit_percent=fit_percent,
        residual=best.residual,
        cross=float(np.abs(response.other).max()),
        simpler=best.lag
        if best.lag.order < 3
        else min((one for one in fitted if one.lag.order < 3), key=lambda one: one.bic).lag,
    )
