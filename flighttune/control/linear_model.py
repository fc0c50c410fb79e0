"""Linear models for the outer loop, at one condition or over ranges of flight.

The law's Jacobians depend on the flight condition through four numbers only (arXiv 2411.13140,
below Eq. (40)): ``a = (g/V) sin(gamma)``, ``b1 = (g/V) / cos(phi)^2``, ``b2 = (g n_z/V) sin(phi)``
and ``b3 = (g/V) cos(phi)``. A_K is affine in them, so that the box of their ranges, 16 vertices,
contains every Jacobian of the envelope. The corners of (V, gamma, phi, n_z) alone do not: the
extremes of a product or of a cosine need not lie there. The four numbers share the factor g/V. Kept
as a separate range (32 vertices), the polytope still contains every Jacobian and is never larger;
this module does so.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import numpy.typing as npt

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import (
    FloatArray,
    check_positive,
    check_upright,
    read_only_matrix,
    set_read_only,
)
from flighttune.base.errors import InputError, ShapeError
from flighttune.base.units import DEG
from flighttune.control.gains import (
    COMMANDS,
    ERRORS,
    ERRORS_WITH_AIRSPEED,
    WITH_AIRSPEED,
    PIGains,
    channel_names,
)

# States, inputs and errors of the chi/gamma law.
LAW_NAMES = ERRORS, COMMANDS, ERRORS


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearModel:
    """``x' = A x + B u, e = C x`` in deviations from an equilibrium; the loop closes on e.

    Attributes
    ----------
    A, B, C : ndarray, shapes (n, n), (n, m), (p, n)
        Units follow from the states, inputs and errors (SI, rad) and seconds.
    states, inputs, errors : tuple of str, lengths n, m, p
        Names in order; an error is reference minus actual. By default states are ``x1, x2, ...``,
        inputs and errors those of `PIGains`.

    Examples
    --------
    >>> model = ft.loop.LinearModel(A=[[0.0]], B=[[1.0]], C=[[-1.0]])
    >>> gains = ft.PIGains(K_P=[[2.0]], K_I=[[1.0]])
    >>> ft.loop.closed_loop(model, gains).tolist()
    [[-2.0, 1.0], [-1.0, 0.0]]
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        (n, m), p = read_only_matrix("B", self.B).shape, len(read_only_matrix("C", self.C))
        states = self.states or tuple(f"x{i + 1}" for i in range(n))
        inputs = channel_names(self.inputs, m, COMMANDS)
        errors = channel_names(self.errors, p, ERRORS)
        for name, names in (("states", states), ("inputs", inputs), ("errors", errors)):
            object.__setattr__(self, name, names)
        n, m, p = self.shape
        set_read_only(self, A=(n, n), B=(n, m), C=(p, n))

    @property
    def names(self) -> tuple[tuple[str, ...], ...]:
        """Names of the states, inputs and errors."""
        return self.states, self.inputs, self.errors

    def check_channels(self, gains: PIGains) -> None:
        """Refuse gains whose channels are not the errors and inputs of this model."""
        if (got := gains.K_P.shape) != (shape := (len(self.inputs), len(self.errors))):
            raise ShapeError(f"`gains` must have shape {shape} (inputs, errors), got {got}.")
        if (gains.inputs, gains.errors) != (self.inputs, self.errors):
            raise InputError(
                f"`gains` must act from {self.errors} on {self.inputs}, "
                f"got {gains.errors} on {gains.inputs}."
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of states, inputs and errors: n, m, p."""
        return len(self.states), len(self.inputs), len(self.errors)


def law_model(A: FloatArray, B: FloatArray, inputs: tuple[str, str] = COMMANDS) -> LinearModel:
    """A model of the errors of course and path angle, and of airspeed if there are three."""
    n = len(A)
    names, inputs_of_n = ERRORS_WITH_AIRSPEED[:n], WITH_AIRSPEED[inputs][:n]
    return LinearModel(A=A, B=B, C=np.eye(n), states=names, inputs=inputs_of_n, errors=names)


def entry_model(entries: FloatArray) -> LinearModel:
    """The chi/gamma law's linear model with given entries (a, b1, b2, b3), 1/s."""
    a, b1, b2, b3 = entries
    return law_model(np.array([[0.0, 0.0], [0.0, a]]), np.array([[-b1, 0.0], [b2, -b3]]))


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
        Make the airspeed a third channel; its error is relative to `V_a`, and its input is n_x.

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
    weight, it obeys ``V' = g (n_x - sin(gamma))``. Divided by its trim value it has the factor g/V
    of the other two channels. The path angle acts on it by the weight, -g/V cos(gamma).

    Examples
    --------
    >>> ft.loop.kinematic_model(V_a=25.0, gamma=0.0, g=9.81).B.diagonal().round(4).tolist()
    [-0.3924, -0.3924]
    """
    check_positive(V_a=V_a, g=g)
    check_upright(gamma=gamma, phi=phi)
    n_z = math.cos(gamma) / math.cos(phi) if n_z is None else n_z
    entries = math.sin(gamma), 1.0 / math.cos(phi) ** 2, n_z * math.sin(phi), math.cos(phi)
    model = entry_model(g / V_a * np.array(entries))
    if not airspeed:
        return model
    A, B = np.zeros((3, 3)), np.zeros((3, 3))
    A[:2, :2], B[:2, :2], B[2, 2] = model.A, model.B, -g / V_a
    # Rates of turn and climb, if not zero, fall with airspeed; the weight decelerates a climb.
    A[:, 2] = -g / V_a * np.array([math.tan(phi), n_z * math.cos(phi) - math.cos(gamma), 0.0])
    A[2, 1] = -g / V_a * math.cos(gamma)
    return law_model(A, B)


def closed_loop(model: LinearModel, gains: PIGains) -> FloatArray:
    """A_K of the loop ``s' = A_K s + d_s`` with ``s = (x', e)``.

    Parameters
    ----------
    model : LinearModel
        n states, m inputs, p errors.
    gains : PIGains
        Gains with the channels of `model`.

    Returns
    -------
    ndarray, shape (n + p, n + p)
        ``[[A + B K_P C, B K_I], [C, 0]]``; the paper's A_K(0) if C = I. A and B contain the inner
        feedback of the gains, if any (`fed_by`).

    Raises
    ------
    InputError
        If `gains` and `model` have different channels.

    Notes
    -----
    Theorem 2 of arXiv 2411.13140, with an output matrix C.

    Examples
    --------
    >>> model = ft.loop.kinematic_model(V_a=25.0, gamma=0.0, g=9.81)
    >>> ft.loop.closed_loop(model, ft.PAPER_GAINS).shape
    (4, 4)
    """
    model.check_channels(gains)
    return closed_loops(fed_by(model, gains.feedback), gains.K)


def fed_by(model: LinearModel, feedback: Sequence[float] | FloatArray) -> LinearModel:
    """The model with the inner feedback ``u + k (u - M x)``: ``A - B k M`` and ``B (1 + k)``."""
    if not any(feedback):
        return model
    k, k_M = inner_feedback(model, feedback)
    return replace(model, A=model.A - model.B @ k_M, B=model.B * (1.0 + k))


def inner_feedback(
    model: LinearModel, feedback: Sequence[float] | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Inner feedback k of each input, shape (m,), from k of the first inputs, and k M, (m, n)."""
    M, k = measured_rows(model), np.zeros(len(model.inputs))
    k[: len(feedback)] = feedback[: len(k)]
    # A model without the measured state responds at once, so there is nothing to feed back.
    k *= M.any(axis=1)
    return k, k[:, None] * M


def measured_rows(model: LinearModel) -> FloatArray:
    """Measurement matrix M, shape (m, n): the first state with the name of each input, or zeros."""
    rows = [
        [float(name in model.states and i == model.states.index(name)) for i in range(len(model.A))]
        for name in model.inputs
    ]
    return np.array(rows)


def closed_loops(model: LinearModel, K: npt.ArrayLike) -> FloatArray:
    """A_K of many stacked gains (K_P, K_I): shape (..., m, 2 p) to (..., n + p, n + p)."""
    _, m, p = model.shape
    K = np.asarray(K, dtype=float)
    if K.shape[-2:] != (m, 2 * p):
        raise ShapeError(f"`K` must have shape (..., {m}, {2 * p}), got {K.shape}.")
    return _loops(model.A, model.B, model.C, K)


def loops_of(models: Sequence[LinearModel], gains: PIGains) -> FloatArray:
    """`closed_loop` of N models with the same names under one gain set, (N, n + p, n + p)."""
    for model in models:
        model.check_channels(gains)
    fed = [fed_by(model, gains.feedback) for model in models]
    A, B, C = (np.array([getattr(model, name) for model in fed]) for name in ("A", "B", "C"))
    return _loops(A, B, C, gains.K)


def _loops(A: FloatArray, B: FloatArray, C: FloatArray, K: FloatArray) -> FloatArray:
    """A_K of stacked models and gains; either may be a single one."""
    n, p = A.shape[-1], C.shape[-2]
    upper_left = A + B @ K[..., :p] @ C
    A_K = np.zeros((*upper_left.shape[:-2], n + p, n + p))
    A_K[..., :n, :n] = upper_left
    A_K[..., :n, n:] = B @ K[..., p:]
    A_K[..., n:, :n] = C
    return A_K


def velocity_form(model: LinearModel) -> tuple[FloatArray, FloatArray]:
    """A and B of ``s' = A s + B u'`` with s = (x', e), shapes (n + p, n + p) and (n + p, m)."""
    n, m, p = model.shape
    A = np.block([[model.A, np.zeros((n, p))], [model.C, np.zeros((p, p))]])
    return A, np.vstack([model.B, np.zeros((p, m))])


def disturbance_entry(model: LinearModel) -> FloatArray:
    """E of ``d_s = E d'``, (n + p, n): a disturbance enters s = (x', e) by its derivative alone."""
    n, _, p = model.shape
    return np.vstack([np.eye(n), np.zeros((p, n))])


RANGES = ("V_a", "gamma", "phi", "n_z")
ENTRIES = ("a", "b1", "b2", "b3")

# Relative widening of each range: about 50 times the rounding of the formulas.
OUTWARD = 1e-14

Range = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """Ranges of flight conditions, each independent of the others."""

    V_a: Range  # m/s
    gamma: Range  # rad
    phi: Range  # rad
    n_z: Range

    def __post_init__(self) -> None:
        for name in RANGES:
            ends = getattr(self, name)
            low, high = map(float, ends)
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise InputError(f"`{name}` must be a range (low, high), got {ends}.")
            object.__setattr__(self, name, (low, high))
        if not self.V_a[0] > 0.0:
            raise InputError(f"`V_a` must be positive, got {self.V_a[0]:g} m/s.")
        for ends in zip(self.gamma, self.phi, strict=True):
            check_upright(gamma=ends[0], phi=ends[1])

    def __str__(self) -> str:
        units = ((1.0, " m/s"), (DEG, " deg"), (DEG, " deg"), (1.0, ""))
        return ", ".join(
            f"{name} {low / unit:g}..{high / unit:g}{symbol}"
            for name, (low, high), (unit, symbol) in zip(RANGES, self.ranges, units, strict=True)
        )

    @property
    def ranges(self) -> FloatArray:
        """Low and high end of each range, shape (4, 2)."""
        return np.array([getattr(self, name) for name in RANGES])

    @classmethod
    def at(cls, *, V_a: float, gamma: float) -> "Envelope":
        """The envelope of steady wings-level flight alone."""
        n_z = math.cos(gamma)
        return cls(V_a=(V_a, V_a), gamma=(gamma, gamma), phi=(0.0, 0.0), n_z=(n_z, n_z))

    def scaled(self, trim: "Envelope", factor: float) -> "Envelope":
        """Every end moved to ``trim + factor (end - trim)``; InputError if `factor` is negative."""
        if not factor >= 0.0:
            raise InputError(f"`factor` must not be negative, got {factor}.")
        ranges = trim.ranges + factor * (self.ranges - trim.ranges)
        return Envelope(**dict(zip(RANGES, ranges.tolist(), strict=True)))

    def contains(self, other: "Envelope") -> bool:
        """Whether every range of `other` lies inside the same range here."""
        low, high = self.ranges.T
        return bool((low <= other.ranges[:, 0]).all() and (other.ranges[:, 1] <= high).all())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JacobianHull:
    """A polytope of entries (a, b1, b2, b3): a range of factors times a box."""

    factor: Range  # 1/s: range of g/V
    # Shape (4,): the box of the entries over g/V
    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        set_read_only(self, lower=(len(ENTRIES),), upper=(len(ENTRIES),))
        if not (self.lower <= self.upper).all():
            raise InputError(
                f"`lower` must not exceed `upper`, got {self.lower.tolist()} "
                f"and {self.upper.tolist()}."
            )
        if not 0.0 < self.factor[0] <= self.factor[1] < math.inf:
            raise InputError(f"`factor` must be a positive range, got {self.factor}.")

    @property
    def corners(self) -> FloatArray:
        """Entries at the vertices, shape (k, 4); a range without width counts once."""
        box = product(*(sorted(set(ends)) for ends in zip(self.lower, self.upper, strict=True)))
        corners = np.array(list(box))
        return np.concatenate([factor * corners for factor in sorted(set(self.factor))])

    def models(self) -> tuple[LinearModel, ...]:
        """The linear model of each vertex."""
        return tuple(entry_model(corner) for corner in self.corners)


def jacobian_hull(envelope: Envelope, *, g: float) -> JacobianHull:
    """A polytope, rounded outward, with the law's Jacobian at every condition of an envelope."""
    check_positive("m/s^2", g=g)
    # Interval arithmetic: the sine grows over +-pi/2, the cosine has its maximum where roll is
    # zero, and a product is extreme at ends of its factors. A function that is affine in each of
    # several numbers lies, over a box of them, in the convex hull of its corner values.
    factor = (g / envelope.V_a[1], g / envelope.V_a[0])
    cosines = sorted(map(math.cos, envelope.phi))
    cosine = (cosines[0], 1.0 if envelope.phi[0] <= 0.0 <= envelope.phi[1] else cosines[1])
    sine_gamma = [math.sin(end) for end in envelope.gamma]
    lifts = [n_z * math.sin(phi) for n_z in envelope.n_z for phi in envelope.phi]
    squares = (cosine[1] ** -2, cosine[0] ** -2)
    ends = np.array([factor, sine_gamma, squares, (min(lifts), max(lifts)), cosine])
    lower, upper = (ends + OUTWARD * np.abs(ends) * [-1.0, 1.0]).T
    factor = float(lower[0]), float(upper[0])
    return JacobianHull(factor=factor, lower=lower[1:], upper=upper[1:])
