"""Identification of the third channel: from commanded to flown longitudinal load factor."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import PlantError
from flighttune.identification.experiment import (
    ATTEMPTS,
    BAND,
    CHECK_DURATION,
    CHECK_START,
    CHECK_UNIT,
    DT,
    LINES,
    PEAK_SHARE,
    PERIOD,
    multisine,
    pulses,
    ramped,
)
from flighttune.identification.file import IdentifiedChannel, LagTable, lag_table
from flighttune.identification.fit import (
    SAMPLES,
    FrequencyResponse,
    LagCandidate,
    candidates,
    fit_percent,
    lag_response,
)
from flighttune.plants.base import N_X_SIGNALS, FlightCondition
from flighttune.plants.jsbsim.plant import JSBSimPlant

# Rate of n_x that is commanded where the aircraft has no limit on it, 1/s.
FASTEST = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ThrustIdentification:
    """Flights at one condition under changes of n_x, and the lags fitted to them."""

    candidates: tuple[LagCandidate, ...]  # of every order, the chosen one first
    manoeuvre: tuple[FloatArray, FloatArray]  # for validation: command and response, (samples,)

    @property
    def channel(self) -> IdentifiedChannel:
        """The channel, as the file of a model has it."""
        best = self.candidates[0]
        simpler = next(fit.lag for fit in self.candidates if fit.lag.order < 3)
        commanded, flown = self.manoeuvre
        fit = flown[0] + lag_response(best.lag, DT, commanded - commanded[0], 0.0)
        return IdentifiedChannel.model_construct(
            **lag_table(best.lag),
            fit_percent=fit_percent(flown, fit),
            residual=best.residual,
            cross=None,
            simpler=LagTable.model_construct(**lag_table(simpler)),
        )


def identify_thrust(
    plant_factory: Callable[..., JSBSimPlant], condition: FlightCondition, *, seed: int = 0
) -> ThrustIdentification:
    """Identify the third channel of an aircraft about a wings-level trim.

    The changes keep to a share of what the limits and the throttle leave at the trim. Raises
    PlantError if they cannot be flown, even at a fraction of it.
    """
    plant = plant_factory(takes_n_x=True)
    plant.start(condition)
    now, least, most = _n_x(plant)
    limits = plant.limits
    peak = PEAK_SHARE * min(min(most, limits.upper[2]) - now, now - max(least, limits.lower[2]))
    rate = min(float(limits.rate_upper[2]), FASTEST)
    if not peak > 0.0:
        raise PlantError(
            f"`n_x` of [limits] must leave room about steady flight at {condition.V_a:g} m/s, got "
            f"{limits.lower[2]:g} to {limits.upper[2]:g} about {now:.3g}, of which the throttle "
            f"gives {least:.3g} to {most:.3g}."
        )
    harmonics = np.unique(np.round(np.geomspace(*BAND, LINES // 2) * PERIOD / math.tau).astype(int))
    excitation = multisine(harmonics, peak, rate, np.random.default_rng(seed))
    commanded, flown = _respond(plant_factory, condition, np.tile(excitation, 2))
    spectra = (np.fft.rfft(signal[-SAMPLES:])[harmonics] for signal in (commanded, flown))
    command_lines, answer = spectra
    omega = harmonics * (math.tau / PERIOD)
    hold = np.sinc(omega * DT / math.tau) * np.exp(-0.5j * omega * DT)
    response = FrequencyResponse(
        omega=omega, own=answer / command_lines / hold, other=np.zeros(len(omega), complex)
    )
    t = np.arange(round(CHECK_DURATION / DT), dtype=np.float64) * DT
    check = ramped(pulses(t, CHECK_START[0], CHECK_UNIT[0]) * 0.8 * peak, rate)
    return ThrustIdentification(
        candidates=candidates(response), manoeuvre=_respond(plant_factory, condition, check)
    )


def of_one_order(points: Sequence[ThrustIdentification]) -> tuple[ThrustIdentification, ...]:
    """The identifications with lags of the order that is best over all of them."""
    total: dict[int, float] = {}
    for point in points:
        for fit in point.candidates:
            total[fit.lag.order] = total.get(fit.lag.order, 0.0) + fit.bic
    order = min(total, key=total.__getitem__)
    return tuple(
        replace(p, candidates=tuple(sorted(p.candidates, key=lambda fit: fit.lag.order != order)))
        for p in points
    )


def _n_x(plant: JSBSimPlant) -> tuple[Any, ...]:
    first = plant.signals.index(N_X_SIGNALS[0])
    return plant.observe()[first : first + len(N_X_SIGNALS)]


def _respond(
    plant_factory: Callable[..., JSBSimPlant], condition: FlightCondition, changes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Fly changes of n_x; return commands and responses, shape (samples,)."""
    reason = ""
    for attempt in range(ATTEMPTS):
        plant = plant_factory(takes_n_x=True)
        plant.start(condition)
        commanded, flown = [], []
        for change in (0.5**attempt * changes).tolist():
            # About what holds the present airspeed and path angle.
            _, gamma, phi = plant.observe()[:3]
            command = math.sin(gamma) + change
            commanded.append(command)
            flown.append(_n_x(plant)[0])
            lift = math.cos(condition.gamma) / math.cos(phi) + (condition.gamma - gamma)
            stop = plant.advance(0.0, lift, DT, command)
            if stop is not None:
                reason = stop.reason
                break
        else:
            return np.array(commanded), np.array(flown)
    raise PlantError(
        f"the excitation of n_x must be flown to its end, but even at {0.5 ** (ATTEMPTS - 1):g} of "
        f"its size: {reason}"
    )
