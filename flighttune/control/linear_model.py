"""Linear models of what the outer loop acts on, and the loops that gains close on them."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray, check_positive, check_upright, set_read_only
from flighttune.control.gains import (
    COMMANDS,
    ERRORS,
    ERRORS_WITH_AIRSPEED,
    WITH_AIRSPEED,
    PIGains,
)
from flighttune.errors import InputError, ShapeError

# States, inputs and errors of the chi/gamma law.
LAW_NAMES = ERRORS, COMMANDS, ERRORS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearModel:
    """``x' = A x + B u, e = C x`` in deviations from an equilibrium; the loop closes on e.

    Attributes
    ----------
    A, B, C : ndarray, shapes (n, n), (n, m), (p, n)
        Units follow from those of the states, inputs and errors (SI, rad) and seconds.
    states, inputs, errors : tuple of str, lengths n, m, p
        Names in order; an error is reference minus actual.

    Examples
    --------
    >>> names = {"states": ("v",), "inputs": ("u",), "errors": ("e",)}
    >>> model = ft.LinearModel(A=[[0.0]], B=[[1.0]], C=[[-1.0]], **names)
    >>> gains = ft.PIGains(K_P=[[2.0]], K_I=[[1.0]], inputs=("u",), errors=("e",))
    >>> ft.closed_loop(model, gains).tolist()
    [[-2.0, 1.0], [-1.0, 0.0]]
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    errors: tuple[str, ...]

    def __post_init__(self) -> None:
        n, m, p = len(self.states), len(self.inputs), len(self.errors)
        set_read_only(self, A=(n, n), B=(n, m), C=(p, n))

    @property
    def names(self) -> tuple[tuple[str, ...], ...]:
        """Names of the states, inputs and errors."""
        return self.states, self.inputs, self.errors

    def check_channels(self, gains: PIGains) -> None:
        """Refuse gains that do not act from the errors of this model on its inputs."""
        if (gains.inputs, gains.errors) != (self.inputs, self.errors):
            raise InputError(
                f"`gains` must act from {self.errors} on {self.inputs}, "
                f"got {gains.errors} on {gains.inputs}."
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of states, inputs and errors: n, m, p."""
        return len(self.states), len(self.inputs), len(self.errors)


def entry_model(entries: FloatArray) -> LinearModel:
    """The chi/gamma law's linear model of given entries (a, b1, b2, b3), 1/s."""
    a, b1, b2, b3 = entries
    return LinearModel(
        A=np.array([[0.0, 0.0], [0.0, a]]),
        B=np.array([[-b1, 0.0], [b2, -b3]]),
        C=np.eye(2),
        states=LAW_NAMES[0],
        inputs=LAW_NAMES[1],
        errors=LAW_NAMES[2],
    )


def kinematic_model(
    *,
    V_a: float,
    gamma: float,
    phi: float = 0.0,
    n_z: float | None = None,
    g: float,
    airspeed: bool = False,
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
    airspeed : bool
        Make the airspeed a third channel: its error is relative to `V_a`, its input n_x.

    Returns
    -------
    LinearModel
        States and errors (e_chi, e_gamma) = reference minus actual, inputs (phi, n_z), C = I; with
        `airspeed` (e_chi, e_gamma, e_V) and (phi, n_z, n_x).

    Raises
    ------
    InputError
        If `V_a` or `g` is not positive, or an angle is not inside +-pi/2.

    Notes
    -----
    The Jacobians of arXiv 2411.13140 below its Eq. (40). The paper prints n_z = cos(gamma_c)/g at
    the equilibrium; its own model gives cos(gamma_c)/cos(phi). With phi = 0 the value drops out.

    The paper holds the airspeed. With the longitudinal load factor n_x, thrust minus drag over
    weight, it obeys ``V' = g (n_x - sin(gamma))``: over its trim value it has the factor g/V of the
    other two channels. The path angle acts on it by the weight, -g/V cos(gamma).

    Examples
    --------
    >>> ft.kinematic_model(V_a=25.0, gamma=0.0, g=9.81).B.diagonal().round(4).tolist()
    [-0.3924, -0.3924]
    """
    check_positive(V_a=V_a, g=g)
    check_upright(gamma=gamma, phi=phi)
    if n_z is None:
        n_z = math.cos(gamma) / math.cos(phi)
    entries = math.sin(gamma), 1.0 / math.cos(phi) ** 2, n_z * math.sin(phi), math.cos(phi)
    model = entry_model(g / V_a * np.array(entries))
    if not airspeed:
        return model
    A, B = np.zeros((3, 3)), np.zeros((3, 3))
    A[:2, :2], B[:2, :2], B[2, 2] = model.A, model.B, -g / V_a
    # Turning and lifting fall with airspeed where they are not zero; the weight pulls back.
    A[:, 2] = -g / V_a * np.array([math.tan(phi), n_z * math.cos(phi) - math.cos(gamma), 0.0])
    A[2, 1] = -g / V_a * math.cos(gamma)
    return LinearModel(
        A=A,
        B=B,
        C=np.eye(3),
        states=ERRORS_WITH_AIRSPEED,
        inputs=WITH_AIRSPEED[COMMANDS],
        errors=ERRORS_WITH_AIRSPEED,
    )


def closed_loop(model: LinearModel, gains: PIGains) -> FloatArray:
    """A_K of the loop ``s' = A_K s + d_s`` with ``s = (x', e)``.

    Parameters
    ----------
    model : LinearModel
        n states, m inputs, p errors.
    gains : PIGains
        Gains whose channels are those of `model`.

    Returns
    -------
    ndarray, shape (n + p, n + p)
        ``[[A + B K_P C, B K_I], [C, 0]]``; the paper's A_K(0) where C = I.

    Raises
    ------
    InputError
        If the channels of `gains` are not those of `model`.

    Notes
    -----
    Theorem 2 of arXiv 2411.13140, with an output matrix C.

    Examples
    --------
    >>> model = ft.kinematic_model(V_a=25.0, gamma=0.0, g=9.81)
    >>> ft.closed_loop(model, ft.PAPER_GAINS).shape
    (4, 4)
    """
    model.check_channels(gains)
    return closed_loops(model, gains.K)


def closed_loops(model: LinearModel, K: npt.ArrayLike) -> FloatArray:
    """A_K of many stacked gains (K_P, K_I): shape (..., m, 2 p) to (..., n + p, n + p)."""
    n, m, p = model.shape
    K = np.asarray(K, dtype=float)
    if K.shape[-2:] != (m, 2 * p):
        raise ShapeError(f"`K` must have shape (..., {m}, {2 * p}), got {K.shape}.")
    A_K = np.zeros((*K.shape[:-2], n + p, n + p))
    A_K[..., :n, :n] = model.A + model.B @ K[..., :p] @ model.C
    A_K[..., :n, n:] = model.B @ K[..., p:]
    A_K[..., n:, :n] = model.C
    return A_K


def velocity_form(model: LinearModel) -> tuple[FloatArray, FloatArray]:
    """A and B of ``s' = A s + B u'`` with s = (x', e), shapes (n + p, n + p) and (n + p, m)."""
    n, m, p = model.shape
    A = np.block([[model.A, np.zeros((n, p))], [model.C, np.zeros((p, p))]])
    return A, np.vstack([model.B, np.zeros((p, m))])


def disturbance_entry(model: LinearModel) -> FloatArray:
    """E of ``d_s = E d'``: where the derivative of a state disturbance enters s = (x', e).

    ``[I; 0]``, shape (n + p, n): the disturbance reaches the velocity form only through its
    derivative.
    """
    n, _, p = model.shape
    return np.vstack([np.eye(n), np.zeros((p, n))])
