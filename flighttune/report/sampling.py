"""What the rate of the controller does to the loop: predicted from the model, and flown."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.mimo_pi import MimoPI
from flighttune.control.sampled import sampled_eigenvalues, sampled_response
from flighttune.errors import InputError, PlantError
from flighttune.plants.base import FlightCondition
from flighttune.plants.identification.file import load_identified
from flighttune.plants.identification.model import flown_model
from flighttune.plants.jsbsim.plant import JSBSimPlant
from flighttune.simulate.loop import simulate
from flighttune.simulate.reference import Reference
from flighttune.units import DEG, G_0

RATES = 10.0, 12.5, 16.0, 20.0, 25.0, 40.0, 50.0, 100.0
"""Controller rates, 1/s."""

STEP = 0.1 * DEG
"""Step of both references, rad: so small that no limit is met."""

SECONDS = 12.0
LOWEST_FDM_RATE_HZ = 200.0

NEARLY_CONTINUOUS = 1e-3
"""Sample time, s, at which the loop with half a sample of delay is solved."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledStep:
    """One step of course and climb with one gain set at one controller rate.

    Attributes
    ----------
    rate : float, 1/s
        Of the controller.
    t : ndarray, shape (samples,), s
    flown, exact, delayed : ndarray, shape (samples, 2)
        Errors of course and climb over the step: on the aircraft; of the sampled controller on the
        identified model; of the continuous controller on the same behind half a sample of delay.
    damping : float, 1
        Smallest damping ratio of the sampled loop on the model.
    """

    rate: float
    t: FloatArray
    flown: FloatArray
    exact: FloatArray
    delayed: FloatArray
    damping: float


def sampled_step(
    aircraft: str, gains: PIGains, rate: float, *, V_a: float, h: float = 1000.0
) -> SampledStep:
    """Fly a small step from level flight at a controller rate, and predict it.

    Parameters
    ----------
    aircraft : str
        Name of an aircraft with an identified model.
    gains : PIGains
    rate : float, 1/s
        Of the controller.
    V_a, h : float, m/s and m
        Airspeed and height.

    Returns
    -------
    SampledStep

    Raises
    ------
    InputError, ScenarioError
        If there is no such aircraft or model, or `rate` is not positive.
    TrimError
        If there is no steady flight.
    PlantError
        If the flight ended early.
    """
    if not (math.isfinite(rate) and rate > 0.0):
        raise InputError(f"`rate` must be positive, got {rate}.")
    dt = 1.0 / rate
    history = simulate(
        JSBSimPlant(aircraft, fdm_rate_hz=rate * math.ceil(LOWEST_FDM_RATE_HZ / rate)),
        MimoPI(gains, dt=dt),
        Reference(chi=STEP, gamma=STEP),
        condition=FlightCondition(V_a=V_a, h=h),
        duration=SECONDS,
        feed_forward=True,
    )
    if history.stop is not None:
        raise PlantError(f"{aircraft} at {rate:g} Hz: {history.stop.reason}")
    flown = history.signals[["chi_err", "gamma_err"]].to_numpy() / STEP
    condition = load_identified(aircraft).nearest(V_a, 0.0)
    model, late = (
        flown_model(condition, g=G_0, V_a=V_a, gamma=0.0, hold=hold).model
        for hold in (0.0, 0.5 * dt)
    )
    return SampledStep(
        rate=rate,
        t=history.signals.index.to_numpy(dtype=float),
        flown=flown,
        exact=sampled_response(model, gains, dt, e_0=np.ones(2), samples=len(flown)),
        delayed=_at_samples(
            sampled_response(
                late,
                gains,
                NEARLY_CONTINUOUS,
                e_0=np.ones(2),
                samples=round(SECONDS / NEARLY_CONTINUOUS) + 1,
            ),
            history.signals.index.to_numpy(dtype=float),
        ),
        damping=_smallest_damping(sampled_eigenvalues(model, gains, dt)),
    )


def overshoot(errors: FloatArray) -> FloatArray:
    """Largest overshoot of each error, shape (2,), over the step: errors of shape (samples, 2)."""
    return np.maximum(0.0, -errors.min(axis=0))


def sampled_steps(
    aircraft: str, gain_sets: dict[str, PIGains], *, V_a: float, rates: Sequence[float] = RATES
) -> dict[str, tuple[SampledStep, ...]]:
    """`sampled_step` of every gain set at every rate.

    Parameters
    ----------
    aircraft : str
    gain_sets : dict of str to PIGains
        By name.
    V_a : float, m/s
    rates : sequence of float, 1/s

    Returns
    -------
    dict of str to tuple of SampledStep

    Raises
    ------
    InputError, ScenarioError, TrimError, PlantError
        As `sampled_step`.
    """
    return {
        name: tuple(sampled_step(aircraft, gains, rate, V_a=V_a) for rate in rates)
        for name, gains in gain_sets.items()
    }


def _at_samples(response: FloatArray, t: FloatArray) -> FloatArray:
    return response[np.round(t / NEARLY_CONTINUOUS).astype(int)]


def _smallest_damping(eigenvalues: np.ndarray) -> float:
    kept = eigenvalues[np.isfinite(eigenvalues)]
    return float(np.min(-np.real(kept) / np.abs(kept)))
