"""Rigid-body linearisation of a trimmed JSBSim aircraft, and its modes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray, read_only_matrix
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.aircraft import AircraftConfig

LONGITUDINAL = "Vt", "Alpha", "Theta", "Q"
LATERAL = "Beta", "Phi", "P", "R"
RATE_HZ = 200.0
OSCILLATES = 1e-9
"""Share of its size from which an eigenvalue's imaginary part counts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mode:
    """A natural motion of the aircraft, controls fixed.

    Attributes
    ----------
    name : str
        ``short period``, ``phugoid``, ``dutch roll``, ``roll``, ``spiral``, or what fits best.
    eigenvalue : complex, 1/s
        The one with the positive imaginary part of a pair.
    """

    name: str
    eigenvalue: complex

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
    """``x' = A x + B u`` of the airframe about a trim, inner loop off, without actuator lags.

    Attributes
    ----------
    A, B : ndarray, shapes (n, n), (n, m)
        In the units named.
    states, state_units, inputs, input_units : tuple of str
        Names, as JSBSim gives them, and units.
    modes : tuple of Mode
        Longitudinal ones first, the fastest of each plane first.
    """

    A: FloatArray
    B: FloatArray
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    inputs: tuple[str, ...]
    input_units: tuple[str, ...]
    modes: tuple[Mode, ...]

    def __post_init__(self) -> None:
        for name in ("A", "B"):
            object.__setattr__(self, name, read_only_matrix(name, getattr(self, name)))


def linearize(config: AircraftConfig, condition: FlightCondition) -> RigidBodyModel:
    """Linearise the airframe of an aircraft about steady flight at `condition`.

    Parameters
    ----------
    config : AircraftConfig
    condition : FlightCondition

    Returns
    -------
    RigidBodyModel

    Raises
    ------
    InputError
        If `condition` lies outside the aircraft's envelope.
    PlantError
        If the aircraft cannot be built, or has no engine: JSBSim's linearisation ends the process
        without one.
    TrimError
        If there is no steady flight at `condition`.

    Notes
    -----
    JSBSim's ``FGLinearization``: differences about the trimmed state. The trim leaves the inner
    loop disengaged, so that the surfaces stay where they are. JSBSim looks for a steady engine
    without end where it takes its time to settle; for such aircraft the differences are taken by
    `flighttune.plants.jsbsim.differences`.
    """
    from flighttune.plants.jsbsim.differences import (
        CONTROL_UNITS,
        CONTROLS,
        STATE_UNITS,
        STATES,
        differences,
    )
    from flighttune.plants.jsbsim.fdm import Fdm
    from flighttune.plants.jsbsim.trim import trim

    fdm = Fdm(config, RATE_HZ)
    if fdm.engine_settles:
        A, B = differences(fdm, condition)
        return _model(A, B, STATES, STATE_UNITS, inputs=CONTROLS, input_units=CONTROL_UNITS)
    trim(fdm, condition)
    found = fdm.linearization()
    return _model(
        np.array(found.system_matrix, dtype=float),
        np.array(found.input_matrix, dtype=float),
        tuple(found.x_names),
        tuple(found.x_units),
        inputs=tuple(found.u_names),
        input_units=tuple(found.u_units),
    )


def _model(
    A: FloatArray,
    B: FloatArray,
    states: tuple[str, ...],
    state_units: tuple[str, ...],
    *,
    inputs: tuple[str, ...],
    input_units: tuple[str, ...],
) -> RigidBodyModel:
    return RigidBodyModel(
        A=A,
        B=B,
        states=states,
        state_units=state_units,
        inputs=inputs,
        input_units=input_units,
        modes=(
            *longitudinal_modes(_plane(A, states, LONGITUDINAL)),
            *lateral_modes(_plane(A, states, LATERAL)),
        ),
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


def _plane(A: FloatArray, states: tuple[str, ...], kept: tuple[str, ...]) -> FloatArray:
    rows = [states.index(name) for name in kept]
    return A[np.ix_(rows, rows)]
