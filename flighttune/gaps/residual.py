"""Residuals of a model in rates and roll of a flight, and the mismatch of the law."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray, check_positive
from flighttune.base.errors import InputError
from flighttune.base.units import G_PAPER
from flighttune.control import inner_loop, law
from flighttune.flight.conditions import reference_of
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.identification.fit import lag_response
from flighttune.vehicles.plants import base, point_mass

CHANNELS = ("chi", "gamma")


def trim_of(run: Run) -> law.Trim | None:
    """The trim about which the law of a run is linearised; None if it is unknown."""
    flight = run.provenance.scenario.get("flight") or {}
    if not run.provenance.law.by_gains:
        return None
    if "V_a_mps" not in flight or "gamma_ref" not in run.signals or not len(run.signals):
        return None
    gamma = float(run.signals["gamma_ref"].iloc[0])
    return law.Trim(float(flight["V_a_mps"]), gamma, float(flight.get("g_mps2", G_PAPER)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mismatch:
    """The disturbance under which the kinematic law flies exactly like the aircraft."""

    t: FloatArray  # (n,), s: Start of each sample interval
    # (n, 2), rad/s: Mean rates of course and flight-path angle in the interval, minus the law's
    d: FloatArray
    # (n - 1, 2), rad/s^2: Change of d from each interval to the next, per sample time
    d_dot: FloatArray

    @property
    def bound(self) -> float:
        """Largest norm of d, rad/s."""
        return float(np.linalg.norm(self.d, axis=1).max())

    @property
    def L_d(self) -> float:
        """Largest norm of the derivative of d, rad/s^2."""
        return float(np.linalg.norm(self.d_dot, axis=1).max())


def mismatch(run: Run) -> Mismatch:
    """The mismatch d(t) of a run, evenly sampled, from the kinematic law of its scenario.

    Nothing is smoothed and no sampled signal is differentiated. Commands are held over a sample
    interval, so that they determine the law's mean rates; the flown mean rates are the exact
    increments ``(x[k + 1] - x[k]) / dt``. Only ``cos(gamma)`` changes inside an interval. It is
    averaged over its two ends, with an error of ``dt^2 / 12 g / V_a |d^2 cos(gamma) / dt^2|``: less
    than 1e-5 rad/s at 50 Hz and 0.5 rad/s.
    """
    signals, trim = run.signals, trim_of(run)
    if trim is None:
        raise InputError(f"`run` must be of a scenario with an airspeed, got {run.label}.")
    dt = np.diff(t := run.t)[:, None]
    mean_rates = np.diff(signals[list(CHANNELS)].to_numpy(), axis=0) / dt
    level = np.cos(signals["gamma"].to_numpy())
    level = 0.5 * (level[:-1] + level[1:])
    samples = signals.iloc[:-1]
    turn = base.PLANT_KINDS[run.provenance.law.plant].turn or "exact"
    # The point mass flies at the airspeed that its law measured.
    V_a = samples["V_a"].to_numpy() if turn == "exact" else trim.V_a
    phi, n_z = (samples[name].to_numpy() for name in ("phi_cmd", "n_z_cmd"))
    # at gamma = 0, because the mean cosine over the interval replaces the cosine
    chi_dot, gamma_dot = point_mass.turn_rates(V_a, 0.0, phi, n_z, turn=turn, g=trim.g)
    chi_dot = chi_dot / level if turn == "exact" else chi_dot
    gamma_dot = gamma_dot + trim.g / V_a * (1.0 - level)
    d = mean_rates - np.column_stack([chi_dot, gamma_dot])
    return Mismatch(t=t[:-1], d=d, d_dot=np.diff(d, axis=0) / dt[:-1])


# Residual signals of the model, and their units; a feed-forward of the actual roll sees the last
# two.
RESIDUALS = {
    "residual_chi_dot": "rad/s",
    "residual_gamma_dot": "rad/s",
    "residual_phi": "rad",
    "residual_phi_change": "rad",
}

# Corrections of a residual. Each multiplies its error by about ``g sin(gamma) dt / V``, below 0.01
# at 50 Hz: after five only rounding is left.
ITERATIONS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class ConformantModel:
    """The exact point mass behind the identified lag; commands are constant over a sample."""

    V_a: float  # m/s: airspeed, positive and constant
    g: float  # m/s^2: acceleration of gravity
    lags: tuple[inner_loop.InnerLag, inner_loop.InnerLag]  # lags of roll and load factor

    def __post_init__(self) -> None:
        check_positive(V_a=self.V_a, g=self.g)


def residual_rates(
    model: ConformantModel,
    dt: float,
    angles: FloatArray,
    commands: FloatArray,
    start: tuple[float, float],
) -> FloatArray:
    """Disturbances (rad/s), shape (n - 1, 2), under which the model reproduces a flight.

    They are, for each sample, the constants ``(d_chi, d_gamma)`` with which
    ``chi' = g n_z sin(phi) / (V cos(gamma)) + d_chi`` and
    ``gamma' = g / V (n_z cos(phi) - cos(gamma)) + d_gamma`` lead from the flown course and path
    angle to the angles one sample later. At the samples the flight therefore *is* a flight of the
    model under these disturbances. Roll and load factor behind the lags, with delays, are exact at
    any instant; between samples the classical Runge-Kutta method has errors below 1e-8 rad/s at 50
    Hz.

    `angles` (shape (n, 2), rad): course, which may jump by whole turns, and flight-path angle at
    the samples. `commands` (shape (n, 2), rad and 1): roll and load factor commanded at each
    sample, held until the next. `start`: commands in force before the first sample, with the lags
    at rest.
    """
    edges = sorted({0.0, *(lag.delay % dt for lag in model.lags), dt})
    offsets = sorted({t for a, b in pairwise(edges) for t in (a, 0.5 * (a + b), b)})
    # The response `ahead` seconds into a sample equals the response, at the next sample, of a lag
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
                turning = point_mass.turn_rates(model.V_a, gamma, *now, turn="exact", g=model.g)
                return np.column_stack(turning) + residual  # noqa: B023

            k1 = rates(a, change[:, 1])
            k2 = rates(middle, change[:, 1] + 0.5 * step * k1[:, 1])
            k3 = rates(middle, change[:, 1] + 0.5 * step * k2[:, 1])
            k4 = rates(b, change[:, 1] + step * k3[:, 1])
            change += step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        residual += (moved - change) / dt
    return residual


def residuals_of(
    model: ConformantModel, signals: pd.DataFrame, start: base.FlightCondition
) -> FloatArray:
    """`RESIDUALS` of a flight at every sample but the last, shape (n - 1, 4)."""
    dt = float(signals.index[-1]) / (len(signals) - 1)
    commands = signals[["phi_cmd", "n_z_cmd"]].to_numpy()
    angles = signals[["chi", "gamma"]].to_numpy()
    rates = residual_rates(model, dt, angles, commands, (start.phi, start.n_z_start))
    roll = signals["phi"].to_numpy() - lag_response(model.lags[0], dt, commands[:, 0], start.phi)
    return np.column_stack([rates, roll[:-1], np.diff(roll)])


def conformant_model(scenario: Scenario, plant: str) -> ConformantModel:
    """The point mass behind the lag that was identified nearest to the start of a scenario."""
    flight, table = scenario.flight, scenario.plant_table(plant)
    if table.aircraft is None:
        raise InputError(f"`plant` must be an aircraft to have residual signals, got {plant}.")
    nearest = table.identified_model.nearest(flight.V_a_mps, reference_of(scenario).initial[1])
    return ConformantModel(V_a=flight.V_a_mps, g=flight.g_mps2, lags=nearest.lags)
