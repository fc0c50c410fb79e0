"""Identification of an inner loop: of a plant at one condition, of an aircraft at several."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import Order
from flighttune.control.limits import Limits
from flighttune.errors import TrimError
from flighttune.identify.experiment import (
    DT,
    Excitation,
    Response,
    check_manoeuvre,
    multisines,
    respond,
)
from flighttune.identify.file import (
    IdentifiedAircraft,
    IdentifiedChannel,
    IdentifiedCondition,
    LagTable,
    lag_table,
)
from flighttune.identify.fit import (
    FrequencyResponse,
    LagCandidate,
    candidates,
    fit_percent,
    frequency_responses,
    lag_response,
)
from flighttune.plants.base import FlightCondition, Plant
from flighttune.plants.jsbsim.linearize import RigidBodyModel, linearize
from flighttune.plants.jsbsim.plant import JSBSimPlant

# Gain of the inner loop that holds the airspeed it was designed for.
DESIGN_SPEED = "V_a-design-mps"

# Periods flown: in the first the transient of the start decays.
PERIODS = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification:
    """Result of the identification at one condition, with its data."""

    condition: IdentifiedCondition
    # Fits of every order, of roll and load factor, the chosen one first
    candidates: tuple[tuple[LagCandidate, ...], tuple[LagCandidate, ...]]
    frequency: tuple[FrequencyResponse, FrequencyResponse]  # measured, of roll and load factor
    check: Response  # the validation manoeuvre, not used for the fit
    check_model: FloatArray  # (samples, 2): response of the chosen lags to its commands


def identify(
    plant_factory: Callable[[], Plant],
    condition: FlightCondition,
    limits: Limits,
    *,
    seed: int = 0,
) -> Identification:
    """Identify the inner loop of a plant about a wings-level trim, inside the limits."""
    sines = multisines(limits, seed=seed)
    repeated = Excitation(commands=np.tile(sines.commands, (PERIODS, 1)), lines=sines.lines)
    frequency = frequency_responses(respond(plant_factory, condition, repeated))
    fitted = candidates(frequency[0]), candidates(frequency[1])
    check = respond(plant_factory, condition, check_manoeuvre(limits))
    return _identification(condition, frequency, fitted, check)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftIdentification:
    """Identification of an aircraft, and of its airframe without the inner loop."""

    identified: IdentifiedAircraft  # what the file holds
    conditions: tuple[Identification, ...]  # in the same order, with the flights
    skipped: tuple[str, ...]  # why a requested condition is missing: one sentence each
    rigid_body: RigidBodyModel  # about the first condition


def design_speed(config: AircraftConfig) -> float:
    """Airspeed (m/s) the inner loop was designed for; mid-envelope where it does not say."""
    low, high = config.envelope.V_a
    speed = config.gains.gains.get(DESIGN_SPEED, 0.0) if config.gains else 0.0
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
        Airspeeds; by default the one the inner loop was designed for. The first is the nominal one.
    gamma : sequence of float, rad
        Flight-path angles, climb positive; the first is the nominal one.
    h : float, m
        Height above sea level.
    seed : int
        Seed of the excitation.

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
    identifications, trims, skipped = [], [], []
    for condition in (FlightCondition(V_a=v, gamma=g, h=h) for v in speeds for g in gamma):
        try:
            identifications.append(
                identify(partial(JSBSimPlant, aircraft), condition, plant.limits, seed=seed)
            )
        except TrimError as error:
            skipped.append(str(error))
        else:
            trims.append(condition)
    if not identifications:
        raise TrimError(skipped[0])
    chosen = of_one_order(identifications)
    return AircraftIdentification(
        identified=IdentifiedAircraft.model_construct(
            aircraft=plant.config.folder.name,
            conditions=tuple(identification.condition for identification in chosen),
            seed=seed,
            gains=plant.config.gains.sha256 if plant.config.gains else "",
        ),
        conditions=chosen,
        skipped=tuple(skipped),
        rigid_body=linearize(plant.config, trims[0]),
    )


def of_one_order(identifications: Sequence[Identification]) -> tuple[Identification, ...]:
    """Return the same conditions with lags of one order a channel, the best over all of them.

    Models of one structure can be mixed, and one Lyapunov function can cover them all.
    """
    orders = tuple(
        _best_order([identification.candidates[i] for identification in identifications])
        for i in range(2)
    )
    chosen = []
    for identification in identifications:
        # The fits of the chosen order come first, the others stay in their order.
        phi, n_z = (
            tuple(sorted(fits, key=lambda fit: fit.lag.order != order))
            for fits, order in zip(identification.candidates, orders, strict=True)
        )
        at, check = identification.condition, identification.check
        chosen.append(_identification(at, identification.frequency, (phi, n_z), check))
    return tuple(chosen)


def _best_order(candidates: Sequence[tuple[LagCandidate, ...]]) -> Order:
    total: dict[Order, float] = {}
    for fit in (fit for fits in candidates for fit in fits):
        total[fit.lag.order] = total.get(fit.lag.order, 0.0) + fit.bic
    return min(total, key=total.__getitem__)


def _identification(
    condition: FlightCondition | IdentifiedCondition,
    frequency: tuple[FrequencyResponse, FrequencyResponse],
    fitted: tuple[tuple[LagCandidate, ...], tuple[LagCandidate, ...]],
    check: Response,
) -> Identification:
    change = check.commanded - check.commanded[0]
    responses = [lag_response(fitted[i][0].lag, DT, change[:, i], 0.0) for i in range(2)]
    model = check.measured[0] + np.column_stack(responses)
    channels = {
        name: _channel(frequency[i], fitted[i], fit_percent(check.measured[:, i], model[:, i]))
        for i, name in enumerate(("phi", "n_z"))
    }
    return Identification(
        # Not checked: rounding may put a lag beyond the range that it was fitted in.
        condition=IdentifiedCondition.model_construct(
            V_a=condition.V_a, gamma=condition.gamma, h=condition.h, channels=channels
        ),
        candidates=fitted,
        frequency=frequency,
        check=check,
        check_model=model,
    )


def _channel(
    response: FrequencyResponse, fitted: tuple[LagCandidate, ...], fit_percent: float
) -> IdentifiedChannel:
    best = fitted[0]
    simpler = next(fit.lag for fit in fitted if fit.lag.order < 3)
    return IdentifiedChannel.model_construct(
        **lag_table(best.lag),
        fit_percent=fit_percent,
        residual=best.residual,
        cross=float(np.abs(response.other).max()),
        simpler=LagTable.model_construct(**lag_table(simpler)),
    )
