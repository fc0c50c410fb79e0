"""Residuals: the part of a flight's course and path-angle rates and roll that the model misses."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flighttune.arrays import FloatArray, check_positive
from flighttune.control.inner_loop import InnerLag
from flighttune.errors import InputError
from flighttune.flight.conditions import reference_of
from flighttune.identification.fit import lag_response
from flighttune.plants.base import FlightCondition
from flighttune.plants.point_mass import turn_rates
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run

# Parts of a flight that the model misses, and their units; a feed-forward of the roll flown sees
# the last two.
RESIDUALS = {
    "residual_chi_dot": "rad/s",
    "residual_gamma_dot": "rad/s",
    "residual_phi": "rad",
    "residual_phi_change": "rad",
}

# Corrections of a residual. Each shrinks its error by about ``g sin(gamma) dt / V``, below 0.01 at
# 50 Hz: five leave rounding.
ITERATIONS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class ConformantModel:
    """The exact point mass behind the identified lag; commands are constant over a sample."""

    V_a: float  # m/s: airspeed, positive and constant
    g: float  # m/s^2: acceleration of gravity
    lags: tuple[InnerLag, InnerLag]  # lags of roll and of load factor

    def __post_init__(self) -> None:
        check_positive(V_a=self.V_a, g=self.g)


def residual_rates(
    model: ConformantModel,
    dt: float,
    angles: FloatArray,
    commands: FloatArray,
    start: tuple[float, float],
) -> FloatArray:
    r"""Disturbance of the two rates under which the model reproduces a flight.

    Roll and load factor behind the lags are exact at any instant, delays included. Between the
    instants at which a command takes effect the two rates are integrated by the classical
    Runge-Kutta rule, with an error below 1e-8 rad/s at 50 Hz.

    `dt` (s): sample time of the controller. `angles` (shape (n, 2), rad): course and flight-path
    angle at the samples; the course may jump by whole turns. `commands` (shape (n, 2), rad and 1):
    roll and load factor commanded at each sample, held until the next one. `start` (rad and 1):
    roll and load factor in force before the first sample; the lags are at rest there.

    Returns
    -------
    ndarray, shape (n - 1, 2), rad/s
        For each sample the constant ``(d_chi, d_gamma)`` with which

        .. math:: \dot\chi = \frac{g n_z \sin\phi}{V \cos\gamma} + d_\chi,\quad
                  \dot\gamma = \frac{g}{V} (n_z \cos\phi - \cos\gamma) + d_\gamma

        lead from the flown course and path angle to those one sample later. At the samples the
        flight therefore *is* one of the model under these disturbances.
    """
    late = {lag.delay % dt for lag in model.lags}
    edges = sorted({0.0, *late, dt})
    offsets = sorted({t for a, b in pairwise(edges) for t in (a, 0.5 * (a + b), b)})
    # The response `ahead` seconds into a sample is that at the next sample of a lag that is
    # delayed by the rest of the sample.
    phi, n_z = (
        {ahead: lag_response(lag.delayed(dt - ahead), dt, column, before)[1:] for ahead in offsets}
        for lag, column, before in zip(model.lags, commands.T, start, strict=True)
    )
    turn = np.diff(angles[:, 0])
    turn -= math.tau * np.round(turn / math.tau)
    moved = np.column_stack([turn, np.diff(angles[:, 1])])
    residual = np.zeros_like(moved)
    for _ in range(ITERATIONS):
        change = np.zeros_like(moved)
        for a, b in pairwise(edges):
            middle, step = 0.5 * (a + b), b - a

            def rates(ahead: float, climbed: FloatArray) -> FloatArray:
                gamma = angles[:-1, 1] + climbed
                now = phi[ahead], n_z[ahead]
                turning = turn_rates(model.V_a, gamma, *now, turn="exact", g=model.g)
                return np.column_stack(turning) + residual  # noqa: B023

            k1 = rates(a, change[:, 1])
            k2 = rates(middle, change[:, 1] + 0.5 * step * k1[:, 1])
            k3 = rates(middle, change[:, 1] + 0.5 * step * k2[:, 1])
            k4 = rates(b, change[:, 1] + step * k3[:, 1])
            change += step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        residual += (moved - change) / dt
    return residual


def residuals_of(model: ConformantModel, run: Run, start: FlightCondition) -> FloatArray:
    """`RESIDUALS` of a flight at every sample but the last, shape (n - 1, 4)."""
    signals = run.signals
    dt = run.duration / (len(signals) - 1)
    commands = signals[["phi_cmd", "n_z_cmd"]].to_numpy()
    angles = signals[["chi", "gamma"]].to_numpy()
    rates = residual_rates(model, dt, angles, commands, (start.phi, start.n_z_start))
    roll = signals["phi"].to_numpy() - lag_response(model.lags[0], dt, commands[:, 0], start.phi)
    return np.column_stack([rates, roll[:-1], np.diff(roll)])


def conformant_model(scenario: Scenario, plant: str) -> ConformantModel:
    """The point mass behind the lag identified nearest to the start of a scenario."""
    flight, table = scenario.flight, scenario.plant_table(plant)
    if table.aircraft is None:
        raise InputError(f"`plant` must be an aircraft to have residual signals, got {plant}.")
    nearest = table.identified_model.nearest(flight.V_a_mps, reference_of(scenario).initial[1])
    return ConformantModel(V_a=flight.V_a_mps, g=flight.g_mps2, lags=nearest.lags)
