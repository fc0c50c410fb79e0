"""Navigation: estimation errors of the motion that an autopilot sees."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_not_negative, check_positive
from flighttune.base.errors import InputError
from flighttune.base.units import DEG, G_0
from flighttune.vehicles.plants.weather import WIND

# Errors at a sample, seen minus true: airspeed (m/s), roll (rad), load factor, position and height
# (m), velocity over ground (m/s), input to the estimate of the wind (m/s), and acceleration along
# the path (m/s^2).
ERRORS = (
    *("V_a", "phi", "n_z", "north", "east", "h", "v_north", "v_east", "v_up"),
    *(*WIND, "acceleration"),
)

Complexes: TypeAlias = npt.NDArray[np.complex128]
Grade: TypeAlias = Literal["rtk", "standard", "poor"]

# Spawn key of the errors, and of the streams of random numbers: a new one is the last.
_STREAM = 0x4A71
_STREAMS = (
    *("filter_north", "filter_east", "filter_up", "constant", "V_a", "V_a_fast", "phi", "n_z"),
    *("acceleration", "wind_north", "wind_east"),
)

# Noise that PX4's EKF2 assumes for its inertial sensors (EKF2_ACC_NOISE, EKF2_GYR_NOISE) and the
# random walk of their biases (EKF2_GYR_B_NOISE, EKF2_ACC_B_NOISE); its prediction step, s; time
# constant of corrections at the output (EKF2_TAU_VEL, EKF2_TAU_POS), s: docs/navigation.md.
ACC_NOISE, GYR_NOISE, GYR_B_NOISE, ACC_B_NOISE = 0.35, 0.015, 1e-3, 3e-3
PREDICTION_S, OUTPUT_S = 0.01, 0.25

# A vertical accelerometer sees vibration of wing and engine, so its noise is twice as large. The
# slow error of climb is half the fast one.
VERTICAL, SLOW_CLIMB = 2.0, 0.5

# Time constants of the noise of roll and of airspeed, s.
FAST_ROLL_S, FAST_AIRSPEED_S = 0.05, 0.1


# Place of this state along a horizontal axis
GYRO_BIAS = 3


class Arithmetic(NamedTuple):
    """How rows of errors are computed: by NumPy and SciPy, or compiled, with the same bits."""

    # Writes a matrix times rows into the last argument. Products are summed one by one: the last
    # bit of NumPy's product may depend on the length.
    mapped: Callable[[FloatArray, FloatArray, FloatArray], object]
    # Adds to each value of a row the factor times the value before it, in place.
    decayed: Callable[[float, FloatArray], object]
    # Does so with complex numbers: factor and rows are given by their real and imaginary parts.
    turned: Callable[[float, float, FloatArray, FloatArray], object]


def _mapped_by_numpy(matrix: FloatArray, rows: FloatArray, out: FloatArray) -> None:
    for factors, row in zip(matrix.tolist(), out, strict=True):
        parts = [x * values for x, values in zip(factors, rows, strict=True) if x]
        row[:] = parts[0] if parts else 0.0
        for part in parts[1:]:
            row += part


def _decayed_by_scipy(factor: float, rows: FloatArray) -> None:
    from scipy.signal import lfilter

    rows[:] = lfilter([1.0], [1.0, -factor], rows)


def _turned_by_scipy(real: float, imag: float, x: FloatArray, y: FloatArray) -> None:
    from scipy.signal import lfilter

    if imag or y.any():
        turned = lfilter([1.0], [1.0, -complex(real, imag)], x + 1j * y)
        x[:], y[:] = turned.real, turned.imag
    else:  # real numbers take a third of the time
        _decayed_by_scipy(real, x)


NUMPY = Arithmetic(_mapped_by_numpy, _decayed_by_scipy, _turned_by_scipy)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverFault:
    """A failure of the receiver: its position jumps, or drifts away while fixes are missing."""

    start: float  # s
    course: float  # rad: direction of the error
    jump: float = 0.0  # m
    drift: float = 0.0  # m/s: growth of the error

    def errors(self, samples: int, dt: float) -> tuple[FloatArray, FloatArray]:
        """Errors of the position to north and east at each sample, m."""
        since = np.arange(samples, dtype=np.float64) * dt - self.start
        size = np.where(since >= 0.0, self.jump + self.drift * since, 0.0)
        return size * math.cos(self.course), size * math.sin(self.course)


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class Navigation:
    """Errors of an estimator of position, velocity and attitude.

    A slow error has a standard deviation (``_sd``) and a time constant (s); ``_noise`` is
    independent at every fix or sample. docs/navigation.md has the source of each number.

    Attributes
    ----------
    position_sd, position_time_constant, position_fast_sd, position_fast_time_constant : float
        Two slow errors of the receiver, m and s, in each horizontal axis.
    position_noise, velocity_noise, velocity_sd, velocity_time_constant : float
        Noise of the receiver, m and m/s, and the slow error of its velocity.
    height_sd, height_time_constant, height_noise : float
        Error of the barometer, m and s.
    height_of_q : float
        Standard deviation of the share of the dynamic pressure that the static port sees.
    climb_noise, climb_time_constant : float
        Noise of the receiver's vertical velocity, m/s, and time constant of its slow error, which
        has half the deviation.
    period : float, s
        Time between two fixes.
    accelerometer_noise, gyro_noise, gyro_walk : float
        Densities, (m/s^2, rad/s and rad/s^2) per root Hz.
    roll_bias_sd, roll_noise : float, rad
        Installation and accelerometer bias, and noise.
    n_z_bias_sd, n_z_noise : float, 1
        Load factor; the acceleration along the path has the same errors, in g.
    airspeed_scale_sd, airspeed_sd, airspeed_time_constant, airspeed_noise : float
        Scale error relative to the airspeed at the start, and errors in m/s.
    wind_sd, wind_time_constant, wind_lag : float
        Error and lag of the estimated horizontal wind, m/s and s.
    filter_position, filter_velocity, filter_height, filter_climb : float
        Noise of the fixes that the filter assumes, m and m/s, from which its gain follows.
    seed : int
        Seed of the errors, which depend on nothing else drawn from it.
    fault : ReceiverFault, optional
        Failure of the receiver in flight.
    inner_loop : bool
        Whether gyros and accelerometers of the inner loop err too (`inertial_errors`).

    Examples
    --------
    >>> ft.loop.Navigation.of("standard", seed=1).position_sd
    1.5
    """

    position_sd: float
    position_time_constant: float
    position_fast_sd: float
    position_fast_time_constant: float
    position_noise: float
    velocity_noise: float
    velocity_sd: float
    velocity_time_constant: float
    height_sd: float
    height_time_constant: float
    height_noise: float
    height_of_q: float
    climb_noise: float
    climb_time_constant: float
    period: float
    accelerometer_noise: float
    gyro_noise: float
    gyro_walk: float
    roll_bias_sd: float
    roll_noise: float
    n_z_bias_sd: float
    n_z_noise: float
    airspeed_scale_sd: float
    airspeed_sd: float
    airspeed_time_constant: float
    airspeed_noise: float
    wind_sd: float
    wind_time_constant: float
    wind_lag: float
    filter_position: float
    filter_velocity: float
    filter_height: float
    filter_climb: float
    seed: int = 0
    fault: ReceiverFault | None = None
    inner_loop: bool = False

    def __post_init__(self) -> None:
        check_not_negative(seed=self.seed)
        for name in GRADES["standard"]:
            check = check_positive if name in POSITIVE else check_not_negative
            check(**{name: getattr(self, name)})

    @classmethod
    def of(
        cls,
        grade: Grade,
        *,
        seed: int = 0,
        fault: ReceiverFault | None = None,
        inner_loop: bool = False,
        **numbers: float,
    ) -> "Navigation":
        """The errors of a grade, some of whose numbers are replaced by `numbers`."""
        if grade not in GRADES:
            raise InputError(f"`grade` must be one of {', '.join(GRADES)}, got {grade!r}.")
        drawn = {"seed": seed, "fault": fault, "inner_loop": inner_loop}
        return cls(**{**GRADES[grade], **numbers}, **drawn)

    def axes(self, dt: float) -> tuple["Axis", "Axis"]:
        """Errors of the filter along a horizontal and along the vertical axis."""
        return axes(replace(self, seed=0, fault=None, inner_loop=False), dt)

    def errors(
        self, samples: int, dt: float, V_a: float, by: Arithmetic | None = None
    ) -> FloatArray:
        """`ERRORS` at each of the samples, `dt` s apart, shape (samples, 13).

        `V_a` (m/s): the airspeed at the start. A seed gives the same bits; the errors of a longer
        flight begin with those of a shorter one. `by` is the arithmetic, by default that of NumPy
        and SciPy; compiled code gives the same bits.
        """
        n, (level, vertical), arithmetic = samples, self.axes(dt), by or NUMPY
        (north, v_north, _), (east, v_east, tilt) = level.drawn(
            n, self._rng("filter_north"), self._rng("filter_east"), by=arithmetic
        )
        ((h, v_up),) = vertical.drawn(n, self._rng("filter_up"), by=arithmetic)
        constant = self._rng("constant").standard_normal(5).tolist()
        scale, roll_bias, n_z_bias, along_bias, of_q = constant
        # A share of the dynamic pressure, taken for height: divided by the weight of the air.
        h += self.height_of_q * of_q * V_a * V_a / (2.0 * G_0)

        def wandering(stream: str, sd: float, tau: float = 0.0) -> FloatArray:
            decay = math.exp(-dt / tau) if tau else 0.0
            return wander(self._rng(stream).standard_normal(n), sd, decay, by=arithmetic)

        airspeed = self.airspeed_scale_sd * scale * V_a + wandering(
            "V_a", self.airspeed_sd, self.airspeed_time_constant
        )
        airspeed += wandering("V_a_fast", self.airspeed_noise, FAST_AIRSPEED_S)
        roll = tilt + self.roll_bias_sd * roll_bias
        roll += wandering("phi", self.roll_noise, FAST_ROLL_S)
        n_z = self.n_z_bias_sd * n_z_bias + wandering("n_z", self.n_z_noise)
        along = self.n_z_bias_sd * along_bias + wandering("acceleration", self.n_z_noise)
        wind = {"wind_down": np.zeros(n)}
        for axis in ("wind_north", "wind_east"):
            wind[axis] = x = wandering(axis, self.wind_sd, self.wind_time_constant)
            x[1:] -= (1.0 - self.wind_share(dt)) * x[:-1]
        if self.fault is not None:
            fault_north, fault_east = self.fault.errors(n, dt)
            north, east = north + fault_north, east + fault_east
        drawn = {"V_a": airspeed, "phi": roll, "n_z": n_z, "north": north, "east": east, "h": h}
        drawn |= {"v_north": v_north, "v_east": v_east, "v_up": v_up, **wind}
        drawn["acceleration"] = G_0 * along
        # Each column is contiguous, and written at once.
        return np.stack([drawn[name] for name in ERRORS]).T

    def path_sd(self, dt: float, V_a: float) -> tuple[float, float, float]:
        """Standard deviations of estimated course and path angle (rad), and of airspeed (relative).

        They hold just before a fix, at an airspeed of `V_a` (m/s), in the steady state.
        """
        level, vertical = axes(replace(self, seed=0), dt)
        across, up = (math.sqrt(axis.covariance[1, 1]) for axis in (level, vertical))
        airspeed = math.hypot(self.airspeed_scale_sd * V_a, self.airspeed_sd, self.airspeed_noise)
        return across / V_a, up / V_a, airspeed / V_a

    def densities(self, omega: FloatArray, dt: float, V_a: float) -> dict[str, FloatArray]:
        """Power spectral densities, shape (k,), whose integral over `omega` is the variance.

        `omega`: angular frequencies up to pi over `dt`, rad/s, shape (k,). ``chi`` and ``gamma``
        are those of course and path angle (rad^2 s) at an airspeed of `V_a` (m/s), ``V_a`` of the
        airspeed relative to it, ``phi`` of roll and ``n_z`` of the load factor. Constant errors,
        such as biases, are left out.
        """
        axis, vertical = self.axes(dt)
        per_s = dt / math.pi
        _, across, tilt = axis.spectrum(omega * dt) * per_s
        _, climb = vertical.spectrum(omega * dt) * per_s
        slow = _wander_density(omega, self.airspeed_sd, self.airspeed_time_constant)
        airspeed = slow + _wander_density(omega, self.airspeed_noise, FAST_AIRSPEED_S)
        return {
            "chi": across / V_a**2,
            "gamma": climb / V_a**2,
            "V_a": airspeed / V_a**2,
            "phi": tilt + _wander_density(omega, self.roll_noise, FAST_ROLL_S),
            "n_z": np.full(len(omega), self.n_z_noise**2 * per_s),
        }

    def wind_share(self, dt: float) -> float:
        """Share of the wind at a sample in its estimate."""
        return dt / (self.wind_lag + dt)

    def _rng(self, stream: str) -> np.random.Generator:
        key = _STREAM, _STREAMS.index(stream)
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=key))


# Numbers that must be positive: time constants, the period and the noise that the filter assumes.
POSITIVE = frozenset(
    field.name
    for field in fields(Navigation)
    if field.name.endswith("time_constant") or field.name.startswith(("period", "filter_"))
)

# Numbers of the grades, in the order of `Navigation`.
_GRADES = {
    "rtk": (
        *(0.01, 60.0, 0.0, 30.0, 0.005, 0.03, 0.01, 60.0),
        *(0.02, 60.0, 0.01, 0.0, 0.05, 60.0, 0.1),
        *(0.01, 0.01 * DEG, 3e-6, 0.2 * DEG, 0.01 * DEG, 0.004, 0.01),
        *(0.01, 0.1, 60.0, 0.1, 0.3, 30.0, 5.0, 0.05, 0.3, 0.1, 0.5),
    ),
    "standard": (
        *(1.5, 300.0, 0.3, 30.0, 0.1, 0.05, 0.03, 60.0),
        *(1.0, 600.0, 0.2, 0.02, 0.1, 60.0, 0.2),
        *(0.03, 0.05 * DEG, 1e-5, 0.55 * DEG, 0.04 * DEG, 0.011, 0.03),
        *(0.02, 0.3, 60.0, 0.2, 0.7, 30.0, 10.0, 0.5, 0.3, 3.5, 0.5),
    ),
    "poor": (
        *(4.0, 120.0, 1.0, 20.0, 0.5, 0.15, 0.1, 30.0),
        *(3.0, 600.0, 0.5, 0.05, 0.3, 60.0, 0.2),
        *(0.107, 0.5 * DEG, 3e-5, 1.4 * DEG, 0.1 * DEG, 0.032, 0.08),
        *(0.05, 0.8, 60.0, 0.5, 1.5, 30.0, 10.0, 0.5, 0.3, 3.5, 0.5),
    ),
}
GRADES: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        grade: MappingProxyType(
            {field.name: x for field, x in zip(fields(Navigation)[:-3], numbers, strict=True)}
        )
        for grade, numbers in _GRADES.items()
    }
)


@lru_cache(maxsize=64)
def axes(of: Navigation, dt: float) -> tuple["Axis", "Axis"]:
    """Errors along a horizontal axis (position, velocity, tilt) and along the vertical axis."""
    every = max(round(of.period / dt), 1)
    level = np.eye(1 + GYRO_BIAS)  # position, velocity, tilt, and bias of the gyro
    level[0, 1:3], level[1, 2], level[2, GYRO_BIAS] = (dt, 0.5 * G_0 * dt * dt), G_0 * dt, -dt
    up = np.eye(3)  # height, climb, and bias of the accelerometer
    up[0, 1:], up[1, 2] = (dt, 0.5 * dt * dt), dt
    root = math.sqrt(dt)
    return (
        _axis(
            level,
            (0.0, ACC_NOISE, GYR_NOISE, GYR_B_NOISE),
            (of.filter_position, of.filter_velocity),
            {1: of.accelerometer_noise * root, 2: of.gyro_noise * root, 3: of.gyro_walk * root},
            (of.position_noise, of.velocity_noise),
            (
                (0, of.position_sd, of.position_time_constant),
                (0, of.position_fast_sd, of.position_fast_time_constant),
                (1, of.velocity_sd, of.velocity_time_constant),
            ),
            (every, dt, 3),
        ),
        _axis(
            up,
            (0.0, ACC_NOISE, ACC_B_NOISE),
            (of.filter_height, of.filter_climb),
            {1: VERTICAL * of.accelerometer_noise * root},
            (of.height_noise, of.climb_noise),
            (
                (0, of.height_sd, of.height_time_constant),
                (1, SLOW_CLIMB * of.climb_noise, of.climb_time_constant),
            ),
            (every, dt, 2),
        ),
    )


def _axis(
    motion: FloatArray,
    assumed: Sequence[float],
    assumed_of_fix: Sequence[float],
    driven: Mapping[int, float],
    noise: Sequence[float],
    slow: Sequence[tuple[int, float, float]],
    numbers: tuple[int, float, int],
) -> "Axis":
    """The errors of a filter whose gain follows from the noise that it assumes.

    `driven` and `noise` are true deviations. `slow` has the fix, the deviation and the time
    constant of each slow error. `numbers` are the samples from fix to fix, the sample time (s), and
    the number of errors returned.
    """
    (every, dt, shown), m, q = numbers, len(motion), len(slow)
    gain = _gain(motion, np.square(assumed) * PREDICTION_S * dt, np.square(assumed_of_fix), every)
    share, of = min(dt / OUTPUT_S, 1.0), slice(m, 2 * m)
    before, fix, after = (np.eye(2 * m + q) for _ in range(3))
    before[:m, :m] = motion
    fix[of, :2] -= gain
    fix[of, m : m + 2] -= gain
    for j, (which, *_) in enumerate(slow, 2 * m):
        fix[of, j] = gain[:, which]
    after[:m, of], after[of, of] = share * np.eye(m), (1.0 - share) * np.eye(m)
    of_fix = np.zeros((2 * m + q, 2))
    of_fix[of] = gain * noise
    decays = tuple((sd, math.exp(-every * dt / tau)) for _, sd, tau in slow)
    return Axis(
        before=before,
        fix=fix,
        after=after,
        every=every,
        driven=dict(driven),
        noise=of_fix,
        slow=decays,
        shown=shown,
    )


def _gain(motion: FloatArray, q: FloatArray, r: FloatArray, every: int) -> FloatArray:
    """Steady gain of the Kalman filter that a fix of the first two states corrects."""
    from scipy.linalg import solve_discrete_are

    H, Q = np.eye(2, len(motion)), np.zeros_like(motion)
    for _ in range(every):
        Q = motion @ Q @ motion.T + np.diag(q)
    A = np.linalg.matrix_power(motion, every)
    P = solve_discrete_are(A.T, H.T, Q, np.diag(r))
    return P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(r))


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """Errors of a filter along an axis, which a fix corrects every few samples.

    The state has m errors of the filter's output, m corrections that have not reached the output
    yet, and q slow errors of the fixes.
    """

    before: FloatArray  # map of the state by the motion in a sample
    fix: FloatArray  # map of the state by a fix
    after: FloatArray  # map of the state as corrections reach the output in a sample
    every: int  # samples from fix to fix
    driven: dict[int, float]  # deviation of the noise of a sample, by the state that it drives
    noise: FloatArray  # effect of each noise of a fix on the state, in columns
    slow: tuple[tuple[float, float], ...]  # deviation of each slow error, and its decay in a period
    shown: int  # number of output errors returned

    @cached_property
    def maps(self) -> list[FloatArray]:
        """Maps from the state before a fix to the state after each sample of its period."""
        maps, step = [self.after @ self.fix @ self.before], self.after @ self.before
        while len(maps) < self.every:
            maps.append(step @ maps[-1])
        return maps

    @cached_property
    def covariance(self) -> FloatArray:
        """Steady-state covariance of the state before a fix."""
        from scipy.linalg import solve_discrete_lyapunov

        n, q = len(self.before), len(self.slow)
        total = np.zeros((n, n))
        for i in range(self.every):
            total = self.before @ total @ self.before.T
            for j, sd in self.driven.items():
                total[j, j] += sd * sd
            if i == 0:
                total = self.fix @ total @ self.fix.T + self.noise @ self.noise.T
            total = self.after @ total @ self.after.T
        decays = np.diag([1.0] * (n - q) + [decay for _, decay in self.slow])
        total = decays @ total @ decays
        for j, (sd, decay) in enumerate(self.slow, n - q):
            total[j, j] += sd * sd * (1.0 - decay * decay)
        return solve_discrete_lyapunov(decays @ self.maps[-1], total)

    @cached_property
    def start(self) -> FloatArray:
        """A square root of `covariance`."""
        values, vectors = np.linalg.eigh(self.covariance)
        return vectors * np.sqrt(np.maximum(values, 0.0))

    @cached_property
    def modes(self) -> tuple[Complexes, ...]:
        """Eigenvalues, eigenvectors and inverse eigenvectors of the map from fix to fix."""
        m = len(self.before) - len(self.slow)
        factors, errors = np.linalg.eig(self.maps[-1][:m, :m])
        of_modes = factors, errors, np.linalg.inv(errors)
        return tuple(np.asarray(x, dtype=np.complex128) for x in of_modes)

    def spectrum(self, omega: FloatArray) -> FloatArray:
        """Power spectral densities of the output errors, shape (shown, k).

        `omega`: angular frequencies from 0 to pi, rad per sample, shape (k,). The integral of a
        density over them is pi times the variance of its error, averaged over a period.
        """
        n, L, identity = len(self.before), self.every, np.eye(len(self.before))
        m = n - len(self.slow)
        decays = np.diag([1.0] * m + [decay for _, decay in self.slow])
        fresh = identity[:, m:] * [sd * math.sqrt(1.0 - decay**2) for sd, decay in self.slow]
        driven = identity[:, [*self.driven]] * [*self.driven.values()]
        # The state to which each noise of unit variance leads after the sample in which it enters
        first = np.hstack([self.noise, self.fix @ driven, self.fix @ fresh])
        entries = [self.after @ x for x in (first, *[driven] * (L - 1))]
        back = np.exp(-1j * np.outer(omega, np.arange(L)))
        whole = np.exp(1j * L * omega)[:, None, None] * identity - decays @ self.maps[-1]
        of_periods = np.tensordot(back, self.maps, 1) @ np.linalg.solve(whole, decays + 0j)
        total = np.zeros((self.shown, len(omega)))
        for i, entry in enumerate(entries):
            states = [entry]
            while len(states) < L - i:
                states.append(self.after @ self.before @ states[-1])
            shown = np.tensordot(back[:, i:], states, 1) + of_periods @ states[-1]
            total += np.sum(np.abs(shown[:, : self.shown]) ** 2, axis=2).T
        return total / L

    def drawn(self, samples: int, *rngs: np.random.Generator, by: Arithmetic = NUMPY) -> FloatArray:
        """Errors of the output at each sample, by generator, shape (rngs, shown, samples)."""
        n, q, r, w = len(self.before), len(self.slow), self.noise.shape[1], len(self.driven)
        m, shape = n - q, (len(rngs), -(-samples // self.every))
        first = _mapped(by, self.start, np.stack([rng.standard_normal(n) for rng in rngs], axis=1))
        white = np.empty((q + r + self.every * w, *shape))  # in rows, because each is used whole
        for i, rng in enumerate(rngs):
            white[:, i] = rng.standard_normal((shape[1], len(white))).T
        slow = [
            wander(noise, sd, decay, at, by=by)
            for noise, (sd, decay), at in zip(white[:q], self.slow, first[m:], strict=True)
        ]
        rows = white.reshape(len(white), -1)
        begun = np.concatenate([np.zeros((m, rows.shape[1])), np.reshape(slow, (q, -1))])
        parts = self._periods(begun, rows[q : q + r], rows[q + r :], by)
        factors, errors, inverse = self.modes
        pushed = (_mapped(by, x, parts[-1]) for x in (inverse.real, inverse.imag))
        real, imag = (x.reshape(m, *shape) for x in pushed)
        at_start = np.array([inverse @ one for one in np.ascontiguousarray(first[:m].T)]).T
        for x, start in ((real, np.real(at_start)), (imag, np.imag(at_start))):
            x[..., 1:] = x[..., :-1].copy()
            x[..., 0] = start
        for factor, *mode in zip(factors.tolist(), real, imag, strict=True):
            by.turned(factor.real, factor.imag, *mode)
        out = np.empty((shape[0], self.shown, shape[1], self.every))
        real, imag = real.reshape(m, -1), imag.reshape(m, -1)
        for i, part in enumerate(parts):
            of_modes = self.maps[i][: self.shown, :m] @ errors
            free = _mapped(by, of_modes.real, real) - _mapped(by, of_modes.imag, imag)
            for j, row in enumerate(part[: self.shown] + free):
                out[:, j, :, i] = row.reshape(shape)
        return out.reshape(len(rngs), self.shown, -1)[:, :, :samples]

    def _periods(
        self, z: FloatArray, of_fix: FloatArray, of_steps: FloatArray, by: Arithmetic
    ) -> list[FloatArray]:
        """Errors after each sample of a period that begins with zero errors, for all periods."""
        parts, drives = [], iter(of_steps)
        for i in range(self.every):
            z = _mapped(by, self.before, z)
            # Each sample takes the next of the rows, as many as there are driven errors.
            for (j, sd), noise in zip(self.driven.items(), drives, strict=False):
                z[j] += sd * noise
            if i == 0:
                z = _mapped(by, self.fix, z) + _mapped(by, self.noise, of_fix)
            z = _mapped(by, self.after, z)
            parts.append(z[: len(self.before) - len(self.slow)])
        return parts


def _mapped(by: Arithmetic, matrix: FloatArray, rows: FloatArray) -> FloatArray:
    """A matrix times rows."""
    out = np.empty((len(matrix), rows.shape[1]))
    by.mapped(np.ascontiguousarray(matrix), rows, out)
    return out


def _wander_density(omega: FloatArray, sd: float, tau: float) -> FloatArray:
    """Density of a first-order Gauss-Markov process over angular frequencies (rad/s)."""
    return 2.0 / math.pi * sd**2 * tau / (1.0 + (omega * tau) ** 2)


def wander(
    white: FloatArray, sd: float, decay: float, start: Any = None, *, by: Arithmetic = NUMPY
) -> FloatArray:
    """First-order Gauss-Markov sequences driven by white noise; stationary without a `start`."""
    fresh = white * (sd * math.sqrt(1.0 - decay * decay))
    fresh[..., 0] = sd * white[..., 0] if start is None else start
    if decay:
        by.decayed(decay, np.atleast_2d(fresh))
    return fresh
