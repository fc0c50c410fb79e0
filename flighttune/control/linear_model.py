"""Linear models of what the outer loop acts on."""

import math
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray, read_only_matrix
from flighttune.errors import InputError, ShapeError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearModel:
    """``x' = A x + B u, e = C x`` in deviations from an equilibrium; the loop closes on e.

    Attributes
    ----------
    A, B, C : ndarray, shapes (n, n), (n, m), (p, n)
        Units follow from those of the states, inputs and errors (SI, rad) and seconds.
    states, inputs, errors : tuple of str, lengths n, m, p
        Names in order; an error is reference minus actual.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    errors: tuple[str, ...]

    def __post_init__(self) -> None:
        n, m, p = len(self.states), len(self.inputs), len(self.errors)
        for name, shape in (("A", (n, n)), ("B", (n, m)), ("C", (p, n))):
            matrix = read_only_matrix(name, getattr(self, name))
            if matrix.shape != shape:
                raise ShapeError(f"`{name}` must have shape {shape}, got {matrix.shape}.")
            object.__setattr__(self, name, matrix)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of states, inputs and errors: n, m, p."""
        return len(self.states), len(self.inputs), len(self.errors)


def kinematic_model(
    *, V_a: float, gamma: float, phi: float = 0.0, n_z: float | None = None, g: float
) -> LinearModel:
    r"""Error dynamics of the chi/gamma law, linearised about a flight condition.

    Parameters
    ----------
    V_a : float, m/s
        Airspeed, positive.
    gamma, phi : float, rad
        Flight-path angle, climb positive; roll angle, right wing down positive.
    n_z : float, optional, 1
        Load factor; by default the steady value cos(gamma)/cos(phi).
    g : float, m/s^2
        Acceleration of gravity, positive.

    Returns
    -------
    LinearModel
        States and errors (e_chi, e_gamma) = reference minus actual, inputs (phi, n_z), C = I.

    Raises
    ------
    InputError
        If `V_a` or `g` is not positive, or an angle is not inside +-pi/2.

    Notes
    -----
    The Jacobians of arXiv 2411.13140 below its Eq. (40). The paper prints n_z = cos(gamma_c)/g at
    the equilibrium; its own model gives cos(gamma_c)/cos(phi). With phi = 0 the value drops out.
    """
    for name, value in (("V_a", V_a), ("g", g)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"`{name}` must be positive, got {value}.")
    for name, value in (("gamma", gamma), ("phi", phi)):
        if not abs(value) < math.pi / 2:
            raise InputError(f"`{name}` must lie inside +-pi/2, got {value} rad.")
    if n_z is None:
        n_z = math.cos(gamma) / math.cos(phi)
    g_over_v = g / V_a
    return LinearModel(
        A=np.array([[0.0, 0.0], [0.0, g_over_v * math.sin(gamma)]]),
        B=g_over_v
        * np.array([[-1.0 / math.cos(phi) ** 2, 0.0], [n_z * math.sin(phi), -math.cos(phi)]]),
        C=np.eye(2),
        states=("chi", "gamma"),
        inputs=("phi", "n_z"),
        errors=("chi", "gamma"),
    )
