"""What the kinematic law does not know: rates flown minus rates of the law under the commands."""

from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.plants.kinematic import turn_rates
from flighttune.simulate.run import Run

CHANNELS = ("chi", "gamma")


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


def mismatch(run: Run, *, V_a: float, g: float) -> Mismatch:
    r"""The mismatch d(t) of a run against the kinematic law.

    Parameters
    ----------
    run : Run
        A flight of at least four samples, evenly spaced; with courses that run on through +-pi.
    V_a : float, m/s
        Airspeed of the law.
    g : float, m/s^2
        Gravity of the law.

    Returns
    -------
    Mismatch

    Raises
    ------
    InputError
        If the run is too short.

    Notes
    -----
    Nothing is smoothed and no derivative of a sampled signal is taken: commands are held over a
    sample interval, so that the law's mean rates over it are those of the held commands, and the
    mean rates flown are the exact increments ``(x[k + 1] - x[k]) / dt``. The one term of the law
    that moves inside an interval, ``cos(gamma)``, is averaged over its two ends, which errs by
    ``dt^2 / 12 g / V_a |d^2 cos(gamma) / dt^2|``: less than 1e-5 rad/s at 50 Hz and 0.5 rad/s.
    """
    signals = run.signals
    if len(signals) < 4:
        raise InputError(f"`run` must have at least 4 samples, got {len(signals)}.")
    t = signals.index.to_numpy(dtype=float)
    dt = np.diff(t)[:, None]
    rates = np.diff(signals[list(CHANNELS)].to_numpy(), axis=0) / dt
    phi, n_z = (signals[name].to_numpy()[:-1] for name in ("phi_cmd", "n_z_cmd"))
    chi_dot, gamma_dot = turn_rates(V_a, 0.0, phi, n_z, g=g)
    level = np.cos(signals["gamma"].to_numpy())
    level = 0.5 * (level[:-1] + level[1:])
    d = rates - np.column_stack([chi_dot, gamma_dot + g / V_a * (1.0 - level)])
    return Mismatch(t=t[:-1], rates=rates, d=d, d_dot=np.diff(d, axis=0) / dt[:-1])
