"""What the kinematic law leaves out: rates flown minus rates of the law under the same commands."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.exact_law import acts_on_rates, rate_model
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, kinematic_model
from flighttune.errors import InputError
from flighttune.plants.point_mass import turn_rates
from flighttune.simulate.run import Run
from flighttune.units import G_PAPER

CHANNELS = ("chi", "gamma")

LEAST_SAMPLES = 4
"""Samples of a flight that give two values of the mismatch's derivative."""


class Law(NamedTuple):
    """The kinematic law of a flight, about wings-level flight on its first reference."""

    V_a: float
    gamma: float
    g: float

    def model(self, gains: PIGains) -> LinearModel:
        """The error dynamics that gains act on: those of the exact law, or the law linearised.

        Raises
        ------
        InputError
            If there is no such flight condition.
        """
        if acts_on_rates(gains):
            return rate_model()
        return kinematic_model(V_a=self.V_a, gamma=self.gamma, g=self.g)


def law_of(run: Run) -> Law | None:
    """The law that a flight is compared with.

    None where its scenario gives no airspeed, or a law of the user's was flown.

    Parameters
    ----------
    run : Run
        Of a scenario with ``V_a_mps`` in its table ``flight``.
    """
    flight = run.provenance.scenario.get("flight") or {}
    if run.provenance.law_kind == "python":
        return None
    if "V_a_mps" not in flight or "gamma_ref" not in run.signals or not len(run.signals):
        return None
    gamma = float(run.signals["gamma_ref"].iloc[0])
    return Law(float(flight["V_a_mps"]), gamma, float(flight.get("g_mps2", G_PAPER)))


def flies_the_law(run: Run) -> bool:
    """Whether the plant of a run is the law itself, undisturbed: its mismatch is rounding.

    The paper's law is so of the kinematic plant, the exact law of the point mass without lag.
    """
    disturbances = ("disturbance", "wind", "gust", "turbulence")
    undisturbed = not any(run.provenance.scenario.get(name) for name in disturbances)
    kind = run.provenance.plant.partition(":")[0]
    if not undisturbed or kind not in ("kinematic", "point_mass"):
        return False
    return inverts_the_point_mass(run) == (kind == "point_mass")


def inverts_the_point_mass(run: Run) -> bool:
    """Whether a run flew the exact law."""
    gains = run.provenance.gains
    return gains is not None and acts_on_rates(gains)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mismatch:
    """The disturbance under which the kinematic law flies just as the aircraft did.

    Attributes
    ----------
    t : ndarray, shape (n,), s
        Start of each sample interval.
    rates : ndarray, shape (n, 2), rad/s
        Mean rates of course and of flight-path angle flown in the interval.
    d : ndarray, shape (n, 2), rad/s
        `rates` minus those of the law.
    d_dot : ndarray, shape (n - 1, 2), rad/s^2
        Change of d from each interval to the next, over the sample time.
    """

    t: FloatArray
    rates: FloatArray
    d: FloatArray
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

    Returns
    -------
    Mismatch

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
    signals, law = run.signals, law_of(run)
    if len(signals) < LEAST_SAMPLES:
        raise InputError(f"`run` must have at least {LEAST_SAMPLES} samples, got {len(signals)}.")
    if law is None:
        raise InputError(f"`run` must be of a scenario with an airspeed, got {run.label}.")
    V_a, _, g = law
    exact, t = inverts_the_point_mass(run), run.t
    dt = np.diff(t)[:, None]
    rates = np.diff(signals[list(CHANNELS)].to_numpy(), axis=0) / dt
    phi, n_z = (signals[name].to_numpy()[:-1] for name in ("phi_cmd", "n_z_cmd"))
    level = np.cos(signals["gamma"].to_numpy())
    level = 0.5 * (level[:-1] + level[1:])
    if exact:
        # The law inverts the point mass at the airspeed flown: what it wanted is what that gives.
        speed = signals["V_a"].to_numpy()[:-1]
        chi_dot, gamma_dot = turn_rates(speed, 0.0, phi, n_z, law="exact", g=g)
        chi_dot, V_a = chi_dot / level, speed
    else:
        chi_dot, gamma_dot = turn_rates(V_a, 0.0, phi, n_z, g=g)
    # turn_rates is asked at gamma = 0, whose cosine is replaced by the mean over the interval
    d = rates - np.column_stack([chi_dot, gamma_dot + g / V_a * (1.0 - level)])
    return Mismatch(t=t[:-1], rates=rates, d=d, d_dot=np.diff(d, axis=0) / dt[:-1])
