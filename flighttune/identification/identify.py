"""Identification of an inner loop: of a plant at one condition, of an aircraft at several."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import Order
from flighttune.control.limits import Limits
from flighttune.errors import TrimError
from flighttune.identification.experiment import DT, check_manoeuvre, multisines, respond
from flighttune.identification.file import (
    IdentifiedAircraft,
    IdentifiedChannel,
    IdentifiedCondition,
    LagTable,
    identified_tables,
    lag_table,
    lags_table,
)
from flighttune.identification.fit import (
    FrequencyResponse,
    LagCandidate,
    candidates,
    fit_percent,
    frequency_responses,
    lag_response,
)
from flighttune.identification.thrust import ThrustIdentification, identify_thrust, of_one_order
from flighttune.plants.base import FlightCondition, Plant
from flighttune.plants.jsbsim.linearize import linearize, modes
from flighttune.plants.jsbsim.plant import JSBSimPlant
from flighttune.plants.jsbsim.trim import level
from flighttune.present.answer import Answer, Answering
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table
from flighttune.units import DEG

# Gain of the inner loop that holds the airspeed it was designed for.
DESIGN_SPEED = "V_a-design-mps"

# Share of the variance, in percent, that the lags of a channel should explain.
GOOD_FIT = 90.0

MODE_COLUMNS = [
    *columns("name"),
    Column("eigenvalue_per_s.0", "real part", "1/s"),
    Column("eigenvalue_per_s.1", "imaginary part", "rad/s"),
    *columns("natural_frequency_rad_s damping"),
]
FIT_NOTE = (
    "fit: share of the variance explained in a manoeuvre not used for the fit; cross: largest "
    "response of the other channel, 1/rad (phi) and rad (n_z)"
)

# Periods flown: in the first the transient of the start decays.
PERIODS = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """Flights at one condition, and the lags identified from them."""

    trim: FlightCondition  # about which was flown
    frequency: tuple[FrequencyResponse, FrequencyResponse]  # measured, of roll and load factor
    # Fits of every order, of roll and load factor, the chosen one first
    candidates: tuple[tuple[LagCandidate, ...], tuple[LagCandidate, ...]]
    manoeuvre: tuple[FloatArray, FloatArray]  # for validation: commands and response
    thrust: ThrustIdentification | None = None  # of an aircraft that takes n_x

    @cached_property
    def check(self) -> dict[str, FloatArray]:
        """Commands, flight and fit of the validation manoeuvre, shape (samples, 2) each."""
        commanded, measured = self.manoeuvre
        change, fit = commanded - commanded[0], np.empty_like(measured)
        for i, fits in enumerate(self.candidates):
            fit[:, i] = measured[0, i] + lag_response(fits[0].lag, DT, change[:, i], 0.0)
        return {"commanded": commanded, "flown": measured, "fit": fit}

    @cached_property
    def condition(self) -> IdentifiedCondition:
        """The inner loop at the trim, as its file has it."""
        measured, fit, channels = self.check["flown"], self.check["fit"], {}
        for i, (name, fits) in enumerate(zip(("phi", "n_z"), self.candidates, strict=True)):
            best, simpler = fits[0], next(fit.lag for fit in fits if fit.lag.order < 3)
            # Not checked: rounding may put a lag beyond the range that it was fitted in.
            channels[name] = IdentifiedChannel.model_construct(
                **lag_table(best.lag),
                fit_percent=fit_percent(measured[:, i], fit[:, i]),
                residual=best.residual,
                cross=float(np.abs(self.frequency[i].other).max()),
                simpler=LagTable.model_construct(**lag_table(simpler)),
            )
        if self.thrust is not None:
            channels["n_x"] = self.thrust.channel
        V_a, gamma, h = self.trim.V_a, self.trim.gamma, self.trim.h
        return IdentifiedCondition.model_construct(V_a=V_a, gamma=gamma, h=h, channels=channels)


def identify_plant(
    plant_factory: Callable[[], Plant],
    condition: FlightCondition,
    limits: Limits,
    *,
    seed: int = 0,
) -> Identification:
    """Identify the inner loop of a plant about a wings-level trim, inside the limits."""
    changes, lines = multisines(limits, seed=seed)
    response = respond(plant_factory, condition, np.tile(changes, (PERIODS, 1)))
    frequency = frequency_responses(response, lines)
    return Identification(
        trim=condition,
        frequency=frequency,
        candidates=(candidates(frequency[0]), candidates(frequency[1])),
        manoeuvre=respond(plant_factory, condition, check_manoeuvre(limits)),
    )


def _of_one_order(identifications: Sequence[Identification]) -> tuple[Identification, ...]:
    """The identifications with lags of one order a channel, the best over all of them."""
    # Models of one structure can be mixed, and one Lyapunov function can cover them all.
    orders = []
    for channel in range(2):
        total: dict[Order, float] = {}
        for point in identifications:
            for fit in point.candidates[channel]:
                total[fit.lag.order] = total.get(fit.lag.order, 0.0) + fit.bic
        orders.append(min(total, key=total.__getitem__))

    def chosen_first(point: Identification) -> Identification:
        phi, n_z = (
            tuple(sorted(fits, key=lambda fit: fit.lag.order != order))
            for fits, order in zip(point.candidates, orders, strict=True)
        )
        return replace(point, candidates=(phi, n_z))

    chosen = tuple(map(chosen_first, identifications))
    thrust = [point.thrust for point in chosen if point.thrust is not None]
    if len(thrust) < len(chosen):
        return chosen
    pairs = zip(chosen, of_one_order(thrust), strict=True)
    return tuple(replace(point, thrust=same) for point, same in pairs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftIdentification(Answering):
    """Identification of an aircraft, and of its airframe without the inner loop.

    Attributes
    ----------
    identified : IdentifiedAircraft
        The content of a model file.
    conditions : tuple of Identification
        The flights, condition by condition.
    skipped : tuple of str
        Why a requested condition is missing: one sentence each.
    modes : sequence of mapping
        Modes of the airframe alone about the first condition.
    """

    identified: IdentifiedAircraft
    conditions: tuple[Identification, ...]
    skipped: tuple[str, ...]
    modes: Sequence[Mapping[str, Any]]

    @property
    def place(self) -> str:
        """The first condition in words."""
        point = self.identified.conditions[0]
        return f"{self.identified.aircraft} at {point.V_a:g} m/s, {point.gamma / DEG:g} deg"

    def answer(self) -> Answer:
        """Lags with their fits, and modes; a failure where a lag explains too little."""
        conditions = identified_tables(self.identified)["conditions"]
        poor = [
            f"{channel} at {point.V_a:g} m/s, {point.gamma / DEG:g} deg: {fitted.fit_percent:.1f} %"
            for point in self.identified.conditions
            for channel, fitted in point.channels.items()
            if fitted.fit_percent < GOOD_FIT
        ]
        title = f"{self.place}: airframe without the inner loop"
        return Answer(
            values={
                "aircraft": self.identified.aircraft,
                "channels": conditions[0]["channels"],
                "conditions": conditions,
                "skipped": self.skipped,
            },
            tables=[
                lags_table(self.identified),
                Table(MODE_COLUMNS, self.modes, title, name="modes"),
            ],
            notes=[FIT_NOTE, *(f"left out: {reason}" for reason in self.skipped)],
            failure=f"{self.identified.aircraft}: a lag explains less than {GOOD_FIT:g} % of "
            f"{'; '.join(poor)}"
            if poor
            else "",
        )


def design_speed(config: AircraftConfig) -> float:
    """Airspeed (m/s) the inner loop was designed for; mid-envelope where it does not say."""
    low, high = config.envelope.V_a
    speed = config.gains.gains.get(DESIGN_SPEED, 0.0) if config.gains else 0.0
    return speed if low < speed < high else 0.5 * (low + high)


def identify(
    aircraft: str | Path,
    *,
    V_a: Sequence[float] = (),
    gamma: Sequence[float] = (),
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
        Flight-path angles, climb positive; by default level flight, or the glide of an aircraft
        without an engine. The first is the nominal one.
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

    Examples
    --------
    >>> made = ft.identify("aerosonde", V_a=[25.0])
    >>> made.identified.conditions[0].channels["phi"].fit_percent > 90.0
    True
    """
    plant = JSBSimPlant(aircraft)
    speeds = tuple(V_a) or (design_speed(plant.config),)
    fresh, measured, skipped = partial(JSBSimPlant, aircraft), [], []
    for v, g in product(speeds, tuple(gamma) or (None,)):
        try:
            point = level(plant.config, v, h) if g is None else FlightCondition(V_a=v, gamma=g, h=h)
            flights = identify_plant(fresh, point, plant.limits, seed=seed)
            if plant.config.limits.n_x is not None:
                flights = replace(flights, thrust=identify_thrust(fresh, point, seed=seed))
            measured.append(flights)
        except TrimError as error:
            skipped.append(str(error))
    if not measured:
        raise TrimError(skipped[0])
    identifications = _of_one_order(measured)
    A, _ = linearize(plant.config, measured[0].trim)
    return AircraftIdentification(
        identified=IdentifiedAircraft.model_construct(
            aircraft=plant.config.folder.name,
            conditions=tuple(point.condition for point in identifications),
            seed=seed,
            gains=plant.config.gains.sha256 if plant.config.gains else "",
        ),
        conditions=identifications,
        skipped=tuple(skipped),
        modes=modes(A),
    )
