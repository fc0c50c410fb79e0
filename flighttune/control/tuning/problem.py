"""The tuning problem, one for every optimiser: its free gains, and its quadratic cost."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_not_negative, read_only_vector
from flighttune.base.errors import InputError, ShapeError
from flighttune.control.gains import NO_FEEDBACK, PIGains
from flighttune.control.limits import Limits
from flighttune.control.linear_model import LinearModel, closed_loops
from flighttune.control.theory import indicators, lyapunov, reachable
from flighttune.control.tuning.noise import Noise

# Default bound on the size of every gain: the problem has no optimum among unbounded gains
LARGEST_GAIN = 1e3


class LimitRows(NamedTuple):
    """The finite input limits of a problem, rows ``G k + offset <= bound`` over its free gains."""

    names: tuple[str, ...]  # length r: ``<input>_max``, ``_min``, ``_rate_max``, ``_rate_min``
    G: FloatArray  # shape (r, f)
    offset: FloatArray  # shape (r,): contribution of the fixed gains
    bound: FloatArray  # shape (r,)


@checked_class
@dataclass(frozen=True, kw_only=True, eq=False)
class TuningProblem:
    """Maximise R_K over the gains under bounds on I_K and E_K, input limits and a structure.

    Attributes
    ----------
    model : LinearModel
        n states, m inputs, p errors; any model, also with output feedback and lag states.
    I_star : float, s^2
        Largest allowed I_K; inf for no bound.
    E_star : float, s^2
        Largest allowed E_K, of the model in plain units; inf for no bound.
    limits : Limits, optional
        Ranges of the m commands and rates at the first instant, from the error `x_0`.
    x_0 : ndarray, shape (p,), optional
        Error at the first instant; needed with `limits` or `weights`.
    dt : float, s
        Sample time over which the first error is integrated.
    scaling : ndarray, shape (n + p,), optional
        Units of the state s = (x', e) in which R_K and I_K are measured; ones by default.
    K_min, K_max : ndarray, shape (m, 2 p), optional
        Bounds on the stacked gains (K_P, K_I); +-`LARGEST_GAIN` by default.
    K_fixed : ndarray, shape (m, 2 p), optional
        Values of fixed gains; NaN for a free gain. All free by default.
    seed : int
        Seed of the random numbers of an optimiser.
    objective : "R_K", "decay", "E_K" or "rms"
        Goal without `weights`; the last three only for identified loops. "rms": rms errors in gusts
        of the corner frequencies `gusts`, relative to the gusts' angle, among gains that decay at
        least half as fast as the gains of the largest R_K.
    sensitivity_max : float
        With the last three: largest sensitivity, above 1, of each uncoupled channel of commands.
    feedback : bool
        With "decay" and "rms": seek the gains' inner feedback too.
    gusts : ndarray, shape (p,), optional, rad/s
        Airspeed divided by the scale of the Dryden gusts for each error; needed with "rms".
    noise : Noise, optional
        With "rms": gusts and estimation errors whose rms tracking error is minimised under bounds
        on the rates of the commands, instead of `gusts` alone.
    weights : tuple of ndarray, shapes (p,) and (m,), optional
        Weights of errors and commands: minimise the quadratic cost from `x_0` instead of maximising
        R_K.
    R_min : float, 1/s
        Smallest allowed R_K with `weights`.

    Notes
    -----
    The optimisation model of arXiv 2411.13140, section 4.4, with ``u(t_0) = K (x_0; x_0 dt)`` and
    ``u'(t_0) = K (0; x_0)``: linear in K, so that the limits are a polytope of gains.

    Examples
    --------
    >>> from dataclasses import replace
    >>> problem = ft.loop.tuning_problem(ft.load_scenario("paper"))
    >>> wider = replace(problem, I_star=8.0)
    >>> ft.tune(wider).R_K > ft.tune(problem).R_K
    True
    """

    model: LinearModel
    I_star: float = math.inf
    E_star: float = math.inf
    limits: Limits | None = None
    x_0: FloatArray | None = None
    dt: float = 0.1
    scaling: FloatArray | None = None
    K_min: FloatArray | None = None
    K_max: FloatArray | None = None
    K_fixed: FloatArray | None = None
    seed: int = 0
    objective: Literal["R_K", "decay", "E_K", "rms"] = "R_K"
    sensitivity_max: float = math.inf
    feedback: bool = False
    gusts: FloatArray | None = None
    noise: Noise | None = None
    weights: tuple[FloatArray, FloatArray] | None = None
    R_min: float = 0.0

    def __post_init__(self) -> None:
        n, m, p = self.model.shape
        for name in ("I_star", "E_star", "dt"):
            if not (value := getattr(self, name)) > 0.0:
                raise InputError(f"`{name}` must be positive, got {value}.")
        check_not_negative(seed=self.seed, R_min=self.R_min)
        if self.limits is not None and self.limits.lower.shape != (m,):
            raise ShapeError(f"`limits` must have {m} channels, got {self.limits.lower.size}.")
        if self.limits is not None or self.weights is not None:
            if self.x_0 is None:
                raise InputError("`x_0` must be given with `limits` or `weights`.")
            object.__setattr__(self, "x_0", read_only_vector("x_0", self.x_0, (p,)))
        if self.weights is not None:
            self._check_weights(*self.weights)
        elif self.R_min:
            raise InputError(f"`R_min` must be 0 without `weights`, got {self.R_min:g}.")
        object.__setattr__(self, "scaling", indicators.state_scaling(self.scaling, n + p))
        defaults = {"K_min": -LARGEST_GAIN, "K_max": LARGEST_GAIN, "K_fixed": math.nan}
        for name, default in defaults.items():
            bound = getattr(self, name)
            value = np.array(np.full((m, 2 * p), default) if bound is None else bound, dtype=float)
            if value.shape != (m, 2 * p):
                raise ShapeError(f"`{name}` must have shape {(m, 2 * p)}, got {value.shape}.")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if not np.all(self.gain_bounds[0] <= self.gain_bounds[1]):
            raise InputError("`K_min` must not be above `K_max`, and neither may be NaN.")

    def _check_weights(self, error: FloatArray, command: FloatArray) -> None:
        _, m, p = self.model.shape
        weights = tuple(
            read_only_vector("weights", part, (size,)) for part, size in ((error, p), (command, m))
        )
        if not min(map(np.min, weights)) > 0.0:
            raise InputError(f"`weights` must be positive, got {[*weights]}.")
        if not np.any(self.x_0):
            raise InputError(
                "`x_0` must not be zero with `weights`: the cost is that of its decay."
            )
        object.__setattr__(self, "weights", weights)

    @cached_property
    def gain_bounds(self) -> FloatArray:
        """Bounds of the stacked gains, shape (2, m, 2 p); equal for a fixed gain."""
        K_min, K_max, K_fixed = map(np.asarray, (self.K_min, self.K_max, self.K_fixed))
        return np.where(np.isnan(K_fixed), [K_min, K_max], K_fixed)

    @cached_property
    def free(self) -> npt.NDArray[np.bool_]:
        """Whether each stacked gain is free, shape (m, 2 p); k lists the free gains row by row."""
        lower, upper = self.gain_bounds
        return lower < upper

    @cached_property
    def k_bounds(self) -> FloatArray:
        """Bounds of the free gains, shape (2, f)."""
        return self.gain_bounds[:, self.free]

    def K(self, k: FloatArray) -> FloatArray:
        """Stacked gains, shape (..., m, 2 p), of free gains of shape (..., f)."""
        fixed = self.gain_bounds[0]
        K = np.broadcast_to(fixed, (*k.shape[:-1], *fixed.shape)).copy()
        K[..., self.free] = k
        return K

    @cached_property
    def limit_rows(self) -> LimitRows:
        """The finite input limits."""
        _, m, p = self.model.shape
        finite = []
        if self.limits is not None and self.x_0 is not None:
            at_start = np.concatenate([self.x_0, self.x_0 * self.dt])
            rate_at_start = np.concatenate([np.zeros(p), self.x_0])
            ends = {
                "max": (at_start, self.limits.upper),
                "min": (-at_start, -self.limits.lower),
                "rate_max": (rate_at_start, self.limits.rate_upper),
                "rate_min": (-rate_at_start, -self.limits.rate_lower),
            }
            finite = [
                (f"{channel}_{end}", np.outer(np.eye(m)[i], direction), bounds[i])
                for i, channel in enumerate(self.model.inputs)
                for end, (direction, bounds) in ends.items()
                if np.isfinite(bounds[i])
            ]
        names, rows, bound = zip(*finite, strict=True) if finite else ((), (), ())
        rows = np.array(rows).reshape(-1, m, 2 * p)
        fixed = np.where(self.free, 0.0, self.gain_bounds[0])
        return LimitRows(
            names, rows[:, self.free], (rows * fixed).sum(axis=(1, 2)), np.array(bound)
        )

    def slack(self, k: FloatArray) -> FloatArray:
        """Slack of the input limits, shape (..., r); negative if a limit is exceeded."""
        _, G, offset, bound = self.limit_rows
        return bound - offset - k @ G.T

    @property
    def gain_names(self) -> npt.NDArray[Any]:
        """Names of the stacked gains, such as ``K_P[phi,chi]``, shape (m, 2 p)."""
        return np.array(
            [
                [f"{part}[{i},{e}]" for part in ("K_P", "K_I") for e in self.model.errors]
                for i in self.model.inputs
            ]
        )

    def gains(self, K: FloatArray, feedback: tuple[float, float] = NO_FEEDBACK) -> PIGains:
        """The stacked gains (K_P, K_I), shape (m, 2 p), with the model's channel names."""
        p = len(self.model.errors)
        return PIGains(
            K_P=K[:, :p],
            K_I=K[:, p:],
            inputs=self.model.inputs,
            errors=self.model.errors,
            feedback=feedback,
        )

    def largest_errors(self, K: FloatArray) -> FloatArray:
        """`largest_errors` of the loops that gains K (shape (..., m, 2p)) close, shape (..., p)."""
        return reachable.largest_errors(closed_loops(self.model, K), errors=len(self.model.errors))


def decoupled(model: LinearModel) -> FloatArray:
    """`K_fixed` in which only error i acts on input i, shape (m, 2 p): NaN there, else 0."""
    _, m, p = model.shape
    diagonal = np.eye(m, p, dtype=bool)
    return np.where(np.hstack([diagonal, diagonal]), math.nan, 0.0)


def quadratic_cost(problem: TuningProblem, K: FloatArray) -> tuple[float, FloatArray]:
    """J of stacked gains K, shape (m, 2 p), and its slope in K; inf for an unstable loop.

    Notes
    -----
    With e the errors, u the commands and weights w, ``J = int sum w_e e^2 + w_u (u - u_end)^2 dt``.
    The deviations z = (x, int e) from their end values obey ``z' = A_K z``, and
    ``u - u_end = K H z`` with ``H = diag(C, I)``. So ``J = z_0' P z_0`` with
    ``A_K' P + P A_K + H_e' w_e H_e + (K H)' w_u K H = 0``; with ``A_K X + X A_K' + z_0 z_0' = 0``
    the slope is ``2 (B' P + w_u K H) X H'``.
    """
    model, weights, x_0 = problem.model, problem.weights, problem.x_0
    if weights is None or x_0 is None:
        raise InputError("`weights` and `x_0` must be given for a quadratic cost.")
    n, m, p = model.shape
    A = closed_loops(model, K)
    if not np.isfinite(A).all() or np.linalg.eigvals(A).real.max() >= 0.0:
        return math.inf, np.zeros(K.shape)
    H = np.block([[model.C, np.zeros((p, p))], [np.zeros((p, n)), np.eye(p)]])
    commands, errors = K @ H, H[:p]
    z_0 = np.concatenate([np.linalg.pinv(model.C) @ x_0, np.zeros(p)])
    load = errors.T * weights[0] @ errors + commands.T * weights[1] @ commands
    try:
        P = lyapunov.solution_of_checked(A, (load + load.T) / 2.0)
        X = lyapunov.solution_of_checked(A.T, np.outer(z_0, z_0))
    except np.linalg.LinAlgError:  # so close to instability that rounding decides
        return math.inf, np.zeros(K.shape)
    B = np.vstack([model.B, np.zeros((p, m))])
    return float(z_0 @ P @ z_0), 2.0 * (B.T @ P + weights[1][:, None] * commands) @ X @ H.T
