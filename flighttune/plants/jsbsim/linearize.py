"""Rigid-body linearisation of a trimmed JSBSim aircraft, and its modes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.arrays import FloatArray, read_only_matrix
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.bench import CONTROLS, AirframeState, Bench, slopes
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.trim import trim

STATES = ("V_a", "alpha", "theta", "q", "beta", "phi", "p", "r")
"""States of the longitudinal motion, then of the lateral one."""

OSCILLATES = 1e-9
"""Share of its size from which an eigenvalue's imaginary part counts: below it is rounding."""

_HALF_WIDTHS = {
    **dict.fromkeys((*STATES[1:], *CONTROLS[:-1]), 1e-3),
    "V_a": 0.1,
    "throttle": 0.01,
}
"""Half widths of the central differences: rad, rad/s, m/s and 1. Airspeed and throttle come
last, because the engine settles anew for them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mode:
    """A natural motion of the aircraft, controls fixed."""

    # ``short period``, ``phugoid``, ``dutch roll``, ``roll``, ``spiral``, or what fits best
    name: str
    eigenvalue: complex  # 1/s: of a pair the eigenvalue with positive imaginary part

    @property
    def natural_frequency(self) -> float:
        """Size of the eigenvalue, rad/s."""
        return abs(self.eigenvalue)

    @property
    def damping(self) -> float:
        """Damping ratio; +-1 for a motion without oscillation, 0 for none at all."""
        size = abs(self.eigenvalue)
        return -self.eigenvalue.real / size if size else 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidBodyModel:
    """``x' = A x + B u`` of the airframe about a trim, inner loop off, without actuator lags."""

    # `A` and `B` (shapes (8, 8), (8, 4)): states `STATES`, inputs `CONTROLS`, SI and rad
    A: FloatArray
    B: FloatArray
    modes: tuple[Mode, ...]  # longitudinal ones first, the fastest of each plane first

    def __post_init__(self) -> None:
        for name in ("A", "B"):
            object.__setattr__(self, name, read_only_matrix(name, getattr(self, name)))


def linearize(config: AircraftConfig, condition: FlightCondition) -> RigidBodyModel:
    """Linearise the airframe of an aircraft about steady flight at `condition`.

    Central differences are taken on the bench, actuators and engine settled. Raises InputError if
    `condition` lies outside the aircraft's envelope. Raises PlantError if the aircraft cannot be
    built. Raises TrimError if there is no steady flight at `condition`.
    """
    fdm = Fdm(config)
    at = trim(fdm, condition)
    bench = Bench(fdm, condition.h)
    # Not JSBSim's FGLinearization: it never returns where an engine takes its time to settle, and
    # ends the process for an aircraft without engine. Where it works it agrees.
    by = slopes(lambda state: _state_rates(state, bench.accelerations(state)), at, _HALF_WIDTHS)
    A, B = (np.column_stack([by[name] for name in names]) for names in (STATES, CONTROLS))
    modes = (
        *longitudinal_modes(A[:4, :4]),
        *lateral_modes(A[4:, 4:]),
    )
    return RigidBodyModel(A=A, B=B, modes=modes)


def _state_rates(state: AirframeState, measured: dict[str, float]) -> FloatArray:
    """Rates of `STATES` from the accelerations measured in `state`."""
    u, v, w = state.velocity
    u_dot, v_dot, w_dot = (measured[name] for name in ("u_dot", "v_dot", "w_dot"))
    # Derivatives of V_a = |(u, v, w)|, alpha = atan2(w, u) and beta = asin(v / V_a).
    V_dot = (u * u_dot + v * v_dot + w * w_dot) / state.V_a
    ahead = math.hypot(u, w)
    sin_phi, cos_phi = math.sin(state.phi), math.cos(state.phi)
    turning = state.q * sin_phi + state.r * cos_phi
    return np.array(
        [
            V_dot,
            (u * w_dot - w * u_dot) / ahead**2,
            state.q * cos_phi - state.r * sin_phi,
            measured["q_dot"],
            (v_dot - v * V_dot / state.V_a) / ahead,
            state.p + math.tan(state.theta) * turning,
            measured["p_dot"],
            measured["r_dot"],
        ]
    )


def longitudinal_modes(A: FloatArray) -> tuple[Mode, ...]:
    """Modes of speed, angle of attack, attitude and pitch rate, A of shape (4, 4).

    The two largest eigenvalues are the short period, the others the phugoid; either may be two
    motions without oscillation.
    """
    eigenvalues = sorted(np.linalg.eigvals(A).tolist(), key=abs, reverse=True)
    names = ("short period", "short period", "phugoid", "phugoid")
    return _once_a_pair(names, eigenvalues)


def lateral_modes(A: FloatArray) -> tuple[Mode, ...]:
    """Modes of sideslip, roll, roll rate and yaw rate, A of shape (4, 4).

    The faster pair is the dutch roll; the largest real eigenvalue is the roll mode, the smallest
    one the spiral.
    """
    eigenvalues = sorted(np.linalg.eigvals(A).tolist(), key=abs, reverse=True)
    pairs = [value for value in eigenvalues if _oscillates(value)]
    real = [value for value in eigenvalues if not _oscillates(value)]
    pair_names = ("dutch roll", "dutch roll", "roll-spiral", "roll-spiral")
    real_names = ("roll", *["lateral"] * (len(real) - 2), "spiral")
    return (*_once_a_pair(pair_names, pairs), *_once_a_pair(real_names, real))


def _once_a_pair(names: Sequence[str], eigenvalues: list[complex]) -> tuple[Mode, ...]:
    return tuple(
        Mode(name=name, eigenvalue=complex(value))
        for name, value in zip(names, eigenvalues, strict=False)
        if not (_oscillates(value) and value.imag < 0.0)
    )


def _oscillates(eigenvalue: complex) -> bool:
    return abs(complex(eigenvalue).imag) > OSCILLATES * abs(eigenvalue)
