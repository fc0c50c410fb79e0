"""Eigenvalues of the loop along a flight: the law linearised where the aircraft is."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.closed_loop import closed_loop
from flighttune.control.linear_model import kinematic_model
from flighttune.errors import InputError
from flighttune.plants.kinematic import G_PAPER
from flighttune.recording.thinning import evenly
from flighttune.simulate.run import Run

MOST = 1500
"""Instants of a flight at which the loop is linearised."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrozenLoop:
    """The loop of a run, linearised about the flight condition of each instant.

    Attributes
    ----------
    t : ndarray, shape (k,), s
    eigenvalues : ndarray of complex, shape (k, 4), 1/s
        Of A_K with airspeed, path angle, roll and load factor as flown.
    trim : ndarray of complex, shape (4,), 1/s
        About wings-level flight on the first reference: what R_K and I_K are computed from.
    """

    t: FloatArray
    eigenvalues: npt.NDArray[np.complex128]
    trim: npt.NDArray[np.complex128]

    @property
    def abscissa(self) -> FloatArray:
        """Largest real part at each instant, shape (k,), 1/s."""
        return self.eigenvalues.real.max(axis=1)

    @property
    def damping(self) -> FloatArray:
        """Smallest damping ratio at each instant, shape (k,)."""
        size = np.maximum(np.abs(self.eigenvalues), 1e-12)
        return (-self.eigenvalues.real / size).min(axis=1)


def frozen_loop(run: Run) -> FrozenLoop | None:
    """Linearise the loop of a run along its flight.

    Parameters
    ----------
    run : Run
        A flight whose scenario says ``V_a_mps`` and ``g_mps2`` in its table ``flight``.

    Returns
    -------
    FrozenLoop or None
        None where there are no gains, no such table or no such condition.

    Notes
    -----
    The Jacobians of the chi/gamma law, see `kinematic_model`. Frozen eigenvalues are a picture of
    how the loop changes in flight; they prove nothing about it.
    """
    gains, signals = run.provenance.gains, run.signals
    flight = run.provenance.scenario.get("flight") or {}
    if gains is None or "V_a_mps" not in flight or "gamma_ref" not in signals:
        return None
    g = float(flight.get("g_mps2", G_PAPER))
    gamma = float(signals["gamma_ref"].iloc[0])
    try:
        model = kinematic_model(V_a=float(flight["V_a_mps"]), gamma=gamma, g=g)
        trim = np.linalg.eigvals(closed_loop(model, gains))
    except InputError:
        return None
    kept = evenly(len(signals), most=MOST)
    V_a, gamma, phi, n_z = (
        signals[name].to_numpy(dtype=float)[kept] for name in ("V_a", "gamma", "phi", "n_z")
    )
    usable = np.isfinite(V_a + gamma + phi + n_z) & (V_a > 0.0) & (np.cos(phi) > 1e-3)
    V_a, gamma, phi, n_z = V_a[usable], gamma[usable], phi[usable], n_z[usable]
    if not len(V_a):
        return None
    A_K = np.zeros((len(V_a), 4, 4))
    B = np.zeros((len(V_a), 2, 2))
    B[:, 0, 0], B[:, 1, 0], B[:, 1, 1] = -1.0 / np.cos(phi) ** 2, n_z * np.sin(phi), -np.cos(phi)
    B *= (g / V_a)[:, None, None]
    A_K[:, :2, :2], A_K[:, :2, 2:], A_K[:, 2:, :2] = B @ gains.K_P, B @ gains.K_I, np.eye(2)
    A_K[:, 1, 1] += g / V_a * np.sin(gamma)
    t = signals.index.to_numpy(dtype=float)[kept][usable]
    return FrozenLoop(
        t=t, eigenvalues=np.linalg.eigvals(A_K).astype(complex), trim=trim.astype(complex)
    )
