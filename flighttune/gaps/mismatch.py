"""Mismatch of the kinematic law: rates flown minus rates of the law under the same commands."""

from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.law import Trim
from flighttune.errors import InputError
from flighttune.plants.base import PLANT_KINDS
from flighttune.plants.point_mass import turn_rates
from flighttune.simulate.run import Run
from flighttune.units import G_PAPER

CHANNELS = ("chi", "gamma")

# Samples of a flight that give two values of the mismatch's derivative
LEAST_SAMPLES = 4


def trim_of(run: Run) -> Trim | None:
    """The flight about which the law of a run is linearised; None if nothing says which."""
    flight = run.provenance.scenario.get("flight") or {}
    if not run.provenance.law.by_gains:
        return None
    if "V_a_mps" not in flight or "gamma_ref" not in run.signals or not len(run.signals):
        return None
    gamma = float(run.signals["gamma_ref"].iloc[0])
    return Trim(float(flight["V_a_mps"]), gamma, float(flight.get("g_mps2", G_PAPER)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mismatch:
    """The disturbance under which the kinematic law flies just as the aircraft did."""

    t: FloatArray  # (n,), s: Start of each sample interval
    # (n, 2), rad/s: Mean rates of course and flight-path angle in the interval, minus the law's
    d: FloatArray
    # (n - 1, 2), rad/s^2: Change of d from each interval to the next, over the sample time
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
    r"""The mismatch d(t) of a run from the kinematic law of its scenario.

    Parameters
    ----------
    run : Run
        A flight of at least four samples, evenly spaced; with courses that run on through +-pi.

    Raises
    ------
    InputError
        If the run is too short, or its scenario gives no airspeed.

    Notes
    -----
    Nothing is smoothed and no derivative of a sampled signal is taken: commands are held over a
    sample interval, so that the law's mean rates over it are those of the held commands, and the
    mean rates flown are the exact increments ``(x[k + 1] - x[k]) / dt``. The one term of the law
    that moves inside an interval, ``cos(gamma)``, is averaged over its two ends, which errs by
    ``dt^2 / 12 g / V_a |d^2 cos(gamma) / dt^2|``: less than 1e-5 rad/s at 50 Hz and 0.5 rad/s.
    """
    signals, trim = run.signals, trim_of(run)
    if len(signals) < LEAST_SAMPLES:
        raise InputError(f"`run` must have at least {LEAST_SAMPLES} samples, got {len(signals)}.")
    if trim is None:
        raise InputError(f"`run` must be of a scenario with an airspeed, got {run.label}.")
    dt = np.diff(t := run.t)[:, None]
    mean_rates = np.diff(signals[list(CHANNELS)].to_numpy(), axis=0) / dt
    level = np.cos(signals["gamma"].to_numpy())
    level = 0.5 * (level[:-1] + level[1:])
    samples, turn = signals.iloc[:-1], PLANT_KINDS[run.provenance.law.plant].turn
    # The point mass flies at the airspeed that its law measured.
    V_a = samples["V_a"].to_numpy() if turn == "exact" else trim.V_a
    phi, n_z = (samples[name].to_numpy() for name in ("phi_cmd", "n_z_cmd"))
    # asked at gamma = 0, whose cosine is replaced by the mean over the interval
    chi_dot, gamma_dot = turn_rates(V_a, 0.0, phi, n_z, turn=turn, g=trim.g)
    chi_dot = chi_dot / level if turn == "exact" else chi_dot
    gamma_dot = gamma_dot + trim.g / V_a * (1.0 - level)
    d = mean_rates - np.column_stack([chi_dot, gamma_dot])
    return Mismatch(t=t[:-1], d=d, d_dot=np.diff(d, axis=0) / dt[:-1])
