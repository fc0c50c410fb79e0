"""Steady flight of a JSBSim aircraft: straight or turning, climbing or descending."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, PlantError, TrimError
from flighttune.base.units import DEG, DEG_PER_RAD, FT, G_0
from flighttune.base.words import listed
from flighttune.vehicles.aircraft.aircraft import AircraftConfig, start_faults
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim.bench import AirframeState, Bench
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.model_files import Unchanged

# Share by which a step must reduce the residual, and share to which it must for its slopes to be
# used again.
_MIN_GAIN, _FAST_GAIN = 0.5, 0.1

# Share of the way to a bound that a step takes which would pass it.
_ROOM_USED = 0.9

# Residual below which a step that gains nothing more has met rounding.
_ROUNDING = 1e-9

# The same where an engine settles: the thrust of a governed one never comes quite to rest.
_UNSTEADY = 5e-6

# Number of times that a step with too little gain is halved.
_HALVINGS = 3

_NEWTON_STEPS = 12

# Share of its length that a step must have room for. Two steps in a row with less, before the same
# bound, end the search: the root lies behind the bound, or the slopes mislead.
_MIN_ROOM = 0.25


def interior_root(
    residuals: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    *,
    widths: FloatArray,
    enough: float = 0.0,
    rounding: float = _ROUNDING,
) -> FloatArray | None:
    """Return the root that Newton's method finds from `start`, strictly inside the bounds, or None.

    `residuals` maps n unknowns to n residuals of order 1; `start`, `bounds` (lowest and highest
    values) and `widths` (one-sided differences for the slopes, kept up to date by Broyden's
    formula) have shape (n,). The search ends at a residual of `enough`, or where a step from below
    `rounding` gains nothing. Another step that gains too little fails, as where the root is beyond
    the bounds.
    """
    x, r, slopes, wall = start, residuals(start), None, None
    for _ in range(_NEWTON_STEPS):
        norm, fresh = _norm(r), slopes is None
        if slopes is None:
            slopes = slopes_within(residuals, x, r, widths, bounds[1])
        try:
            step: FloatArray = np.asarray(np.linalg.solve(slopes, -r), dtype=float)
        except np.linalg.LinAlgError:  # an unknown without effect, as a surface behind its limit
            return None
        nearest, room = _first_bound(x, step, bounds)
        part = 1.0 if room > 1.0 else _ROOM_USED * room
        wall_before, wall = wall, (nearest, step[nearest] > 0.0) if room < _MIN_ROOM else None
        if wall is not None and wall == wall_before:
            return None
        # Only slopes that are fresh are worth a shorter step: old ones are replaced first.
        for _ in range(1 + (_HALVINGS if fresh and norm > rounding else 0)):
            moved: FloatArray = part * step
            residual = residuals(x + moved)
            now = _norm(residual)
            if now < (1.0 - _MIN_GAIN * part) * norm:
                break
            part *= 0.5
        else:
            if norm < rounding or fresh:
                return x if norm < rounding else None
            slopes = None
            continue
        fast = now < _FAST_GAIN * norm
        slopes = _corrected(slopes, residual, moved) if fast else None
        x, r = x + moved, residual
        if now < enough:
            return x
    return None


# With these lines in its loops, pyright takes ten times as long over the search.
def _norm(residual: FloatArray) -> float:
    return float(np.abs(residual).max())


def _first_bound(
    x: FloatArray, step: FloatArray, bounds: tuple[FloatArray, FloatArray]
) -> tuple[int, float]:
    """The bound that a step meets first, and the share of the step that reaches it."""
    lower, upper = bounds
    with np.errstate(divide="ignore"):
        ways = np.where(step > 0.0, upper - x, x - lower) / np.abs(step)
    nearest = int(np.argmin(ways))
    return nearest, float(ways[nearest])


def _corrected(slopes: FloatArray, residual: FloatArray, moved: FloatArray) -> FloatArray:
    """Slopes by Broyden's formula, in which a whole step of Newton leaves the residual alone."""
    return slopes + np.outer(residual, moved) / (moved @ moved)


def slopes_within(
    residuals: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    r: FloatArray,
    widths: FloatArray,
    upper: FloatArray,
) -> FloatArray:
    """Slopes of `residuals`, `r` at `x`, by one-sided differences that do not pass `upper`."""
    columns = []
    for i, width in enumerate(np.where(x + widths < upper, widths, -widths).tolist()):
        moved = x.copy()
        moved[i] += width
        columns.append((residuals(moved) - r) / (moved[i] - x[i]))
    return np.array(columns).T


# Airspeeds of a table over the envelope, where none are given.
SPEEDS = 6

CLIMBS = (-10.0 * DEG, -5.0 * DEG, 0.0, 5.0 * DEG, 10.0 * DEG, 20.0 * DEG, 45.0 * DEG)

_SIDESLIP_SEARCHED = 10.0 * DEG

# Largest unbalanced acceleration of a trim, in units of g or rad/s^2, and that with an engine which
# settles: the thrust of a governed one never comes quite to rest.
_RESIDUAL_ALLOWED, _RESIDUAL_SETTLED = 1e-6, 2e-5

# Difference of an unknown, as a share of its range, where nothing but rounding is in the way.
_DIFFERENCE = 2.0**-26

# Residual that an engine which is still settling leaves.
_SETTLED = 1e-7

# Differences of the unknowns (rad, rad/s, throttle) where an engine settles: to within 1e-6 g, and
# its thrust has kinks. The unknown that the engine follows comes last.
_STEPS = (1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 3e-4)

# Further starts of the search, as shares of the way from the closed throttle to the open one.
_THROTTLES = (0.6, 0.85, 0.45, 0.15)

# Throttles from full to that of a flight, and change of the acceleration, in g, that they may make.
_SWEEP, _HISTORY = 12, 1e-2

# Halvings of the range of the throttle.
_BISECTIONS = 12

# Steps of least squares.
_MAX_EVALUATIONS = 60

# Path angles searched where there is no engine, and how far a condition may be off the glide found.
_GLIDES, _OFF_GLIDE = (-60.0 * DEG, 0.0), 0.1 * DEG

# Resolution of the steepest path, rad.
_SLOPES = 0.1 * DEG

_TOO_LITTLE = "full throttle has too little thrust"

# Units and senses of the residuals: three linear and three angular accelerations, and lateral load.
_SENSES = (
    *(("g", "backward", "forward"), ("g", "to the left", "to the right"), ("g", "up", "down")),
    *(("rad/s2", f"of {motion}", f"of {motion}") for motion in ("roll", "pitch", "yaw")),
    ("g", "to the left", "to the right"),
)

# Share of its interval within which a trim variable counts as lying at the end of it.
_AT_STOP = 0.01


def trim(fdm: Fdm, condition: FlightCondition) -> AirframeState:
    """Put `fdm`, its inner loop disengaged, into steady coordinated flight at `condition`.

    Seven unknowns (angle of attack, sideslip, three surfaces, turn rate, throttle) bring six body
    accelerations and the lateral load factor to zero: by Newton's method, and where that gets
    stuck, by bounded least squares. Without a rudder it is held at 0 in place of the lateral load
    factor. Without an engine the flight-path angle takes the place of the
    throttle, and must come out as that of `condition`. Where an engine settles, the answer is
    remembered in this process while the files stay the same.

    `condition`: airspeed, height, course, flight-path angle and roll; `n_z` follows from them.
    Returns the steady flight the aircraft is left in. Raises InputError if `condition` lies outside
    the aircraft's envelope or command limits. Raises TrimError if there is no steady flight; the
    message says what stands against it.
    """
    config = fdm.config
    for name, fault in start_faults(config, condition, fdm.ground):
        raise InputError(f"`{name}` {fault}.")
    problem = _TrimProblem(fdm, condition)
    if not fdm.engine_settles:
        return problem.state(problem.steady())
    # The search is on an aircraft of its own, and only its answer is set here: the last digits of a
    # thrust depend on the throttles before it, and must not depend on whether a search was needed.
    stated, place = _stated_in(config), (fdm.steps, fdm.ground)
    x = np.array(_found(fdm.files, stated, condition, *place, fdm.another))
    problem.check(x)
    return problem.state(x)


@lru_cache(maxsize=64)
def _found(
    files: Unchanged,
    _stated: tuple[str, str],
    condition: FlightCondition,
    steps: int,
    ground: float,
    another: Callable[..., Fdm],
) -> tuple[float, ...]:
    config, near = files.config, None
    if config.off_nominal is not None:  # the engine then settles a third as often
        nominal = config.with_off_nominal(None)
        of_nominal = Unchanged(nominal, files.key), _stated_in(nominal)
        with suppress(InputError, PlantError):
            near = np.array(
                _found(*of_nominal, replace(condition, chi=0.0), steps, ground, another)
            )
    fdm = another(files, steps, ground)
    return tuple(_TrimProblem(fdm, condition).steady(near=near).tolist())


def _stated_in(config: AircraftConfig) -> tuple[str, str]:
    """All that a trim depends on beside the files of the model."""
    return config.model_dump_json(), repr(config.off_nominal)


def level(config: AircraftConfig, V_a: float, h: float) -> FlightCondition:
    """Level flight at V_a (m/s) and h (m), or the steady glide of an aircraft without an engine."""
    condition = FlightCondition(V_a=V_a, h=h)
    if config.engines.count:
        return condition
    problem = _TrimProblem(Fdm(config), condition)
    if (x := problem.root(problem.start)) is None:
        raise TrimError(f"{config.file}: no steady glide at V_a {V_a:.4g} m/s, h {h:.0f} m.")
    return replace(condition, gamma=problem.gamma(x))


def steepest(config: AircraftConfig, condition: FlightCondition) -> tuple[float, str] | None:
    """Path angle (rad) nearest to that of `condition` that can be held, and what limits it."""

    def against(gamma: float) -> str:
        flight = replace(condition, gamma=gamma, phi=0.0)
        return _trimmed(Fdm(config), flight, thrust_short=False, near=None)[-1]

    # It lies between level flight and that of `condition`, to 0.1 deg, wings level at its airspeed.
    # There is none if the aircraft can hold that of `condition`, or has no level flight.
    reason, steady, lost = against(condition.gamma), 0.0, condition.gamma
    if not reason or against(0.0):
        return None
    while abs(lost - steady) > _SLOPES:
        middle = 0.5 * (lost + steady)
        if why := against(middle):
            lost, reason = middle, why
        else:
            steady = middle
    return steady, reason


class _TrimProblem:
    """Accelerations of the aircraft as a function of the seven unknowns."""

    def __init__(self, fdm: Fdm, condition: FlightCondition) -> None:
        self._bench = Bench(fdm, condition.h)
        self._condition = c = condition
        self._failure = (
            f"{fdm.config.file}: no steady flight at V_a {c.V_a:.4g} m/s, h {c.h:.0f} m, "
            f"gamma {c.gamma / DEG:.4g} deg, phi {c.phi / DEG:.4g} deg"
        )
        envelope, surfaces = fdm.config.envelope, fdm.config.surfaces
        self._rudderless = surfaces.rudder is None
        self._glides = not fdm.config.engines.count
        # Twice the coordinated turn rate, and something for straight flight.
        turn_rate = 2.0 * G_0 / condition.V_a * (0.1 + abs(math.tan(condition.phi)))
        intervals = (
            envelope.alpha,
            (-_SIDESLIP_SEARCHED, _SIDESLIP_SEARCHED),
            *(surface.travel for _, surface in surfaces.named()),
            *([(-1.0, 1.0)] if self._rudderless else ()),  # about the position 0 of none
            (-turn_rate, turn_rate),
            _GLIDES if self._glides else fdm.config.engines.throttle,
        )
        self.lower, self.upper = np.array(intervals).T
        self.settles = settles = bool(fdm.engine_settles)
        self.limits = {"enough": _SETTLED, "rounding": _UNSTEADY} if settles else {}
        span = self.upper - self.lower
        self.widths = np.array(_STEPS) if settles else _DIFFERENCE * span
        # A guess that suits any aeroplane: 3 deg of angle of attack in level flight.
        alpha = 0.05 * math.cos(condition.gamma) / math.cos(condition.phi)
        psi_dot = G_0 / condition.V_a * math.tan(condition.phi)
        guess = np.array([alpha, 0.0, 0.0, 0.0, 0.0, psi_dot, -0.05 if self._glides else 0.3])
        self.start: FloatArray = np.clip(guess, self.lower + 0.02 * span, self.upper - 0.02 * span)

    def steady(self, *, thrust_short: bool = False, near: FloatArray | None = None) -> FloatArray:
        """Return the unknowns of steady flight, or raise TrimError as `trim` does."""
        x = None
        # Where thrust is known to be too little for a shallower climb, the throttle is tried at its
        # stop at once. A search that begins at a steady flight `near` has the same answer.
        if not thrust_short:
            x = None if near is None else self.root(near)
            x = self.root(self.start) if x is None else x
        if x is None:
            try:
                x = self.best_compromise(self.start)
            except ValueError as error:  # SciPy's, of forces that are not finite
                raise TrimError(
                    f"{self._failure}: the forces on the aircraft must be finite: {error}"
                ) from error
        self.check(x)
        return x

    def check(self, x: FloatArray) -> None:
        """Raise TrimError unless `x` is steady flight at the condition."""
        left_over = self.residuals(x)
        worst, gamma = float(np.max(np.abs(left_over))), self.gamma(x)
        if not worst < (_RESIDUAL_SETTLED if self.settles else _RESIDUAL_ALLOWED):
            obstacle = self.obstacle(x, left_over)
            raise TrimError(f"{self._failure}: {obstacle} (left over: {_largest(left_over)}).")
        if abs(gamma - self._condition.gamma) > _OFF_GLIDE:
            raise TrimError(
                f"{self._failure}: it has no engine and glides at {gamma / DEG:.4g} deg."
            )

    def state(self, x: FloatArray) -> AirframeState:
        """Return the steady turn that the unknowns `x` stand for."""
        alpha, beta, aileron, elevator, rudder, psi_dot, throttle = x.tolist()
        gamma, phi = self.gamma(x), self._condition.phi
        theta = pitch_attitude(gamma, phi, alpha, beta)
        turning = psi_dot * math.cos(theta)
        return AirframeState(
            V_a=self._condition.V_a,
            alpha=alpha,
            beta=beta,
            phi=phi,
            theta=theta,
            psi=self._condition.chi - _drift_angle(theta, phi, alpha, beta),
            p=-psi_dot * math.sin(theta),
            q=turning * math.sin(phi),
            r=turning * math.cos(phi),
            aileron=aileron,
            elevator=elevator,
            rudder=rudder,
            throttle=0.0 if self._glides else throttle,
        )

    def gamma(self, x: FloatArray) -> float:
        """Return the flight-path angle at `x`: of the condition, or of the glide."""
        return float(x[-1]) if self._glides else self._condition.gamma

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return what is left of six accelerations and the lateral load factor at `x`."""
        measured = self._bench.accelerations(self.state(x))
        linear = [measured[name] / G_0 for name in ("u_dot", "v_dot", "w_dot")]
        angular = [measured[name] for name in ("p_dot", "q_dot", "r_dot")]
        # Without a rudder, sideslip brings the yaw moment to zero, and n_y is what it is then.
        lateral = float(x[4]) if self._rudderless else measured["n_y"]
        return np.array([*linear, *angular, lateral])

    def root(self, start: FloatArray) -> FloatArray | None:
        """Return the steady flight that Newton's method finds from `start`, if it does."""
        bounds = self.lower, self.upper
        return interior_root(self.residuals, start, bounds, widths=self.widths, **self.limits)

    def best_compromise(self, start: FloatArray) -> FloatArray:
        """Return the least squares of `residuals` within the bounds."""
        # Most flights that cannot be trimmed lack thrust or have too much of it, so that the
        # throttle is tried at its stops first. An engine that takes its time then settles once
        # only. In between the root is looked for from other throttles: thrust may fall with the
        # throttle before it grows.
        span = self.upper - self.lower
        # Residual 0 is u_dot: what is negative at full throttle lacks thrust.
        opened = self.best_at(self.upper[-1], start)
        if self.residuals(opened)[0] < -_RESIDUAL_ALLOWED:
            return opened
        closed = self.best_at(self.lower[-1], start)
        speeds_up = self.residuals(closed)[0] > _RESIDUAL_ALLOWED
        for share in _THROTTLES:
            throttle = self.lower[-1] + share * span[-1]
            if speeds_up and self.residuals(np.append(closed[:-1], throttle))[0] > 0.0:
                continue  # no less thrust than with the throttle closed
            if (root := self.root(np.append(start[:-1], throttle))) is not None:
                return root
        if speeds_up:
            return closed
        low, high = float(self.lower[-1]), float(self.upper[-1])
        if self.residuals(opened)[0] > 0.0:  # thrust is too little at the one end only
            six = opened
            for _ in range(_BISECTIONS):
                six = self.best_at(0.5 * (low + high), six)
                low, high = (low, six[-1]) if self.residuals(six)[0] > 0.0 else (six[-1], high)
            if (root := self.root(six)) is not None:
                return root

        def slopes(x: FloatArray) -> FloatArray:
            return slopes_within(self.residuals, x, self.residuals(x), self.widths, self.upper)

        tight = {"jac": slopes, "xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
        return _least_squares(self.residuals, start, (self.lower, self.upper), **tight)

    def best_at(self, throttle: float, start: FloatArray) -> FloatArray:
        """Return the flight at a fixed throttle: balanced but for u_dot, else the least squares."""
        bounds = self.lower[:-1], self.upper[:-1]

        def left_over(six: FloatArray) -> FloatArray:
            return self.residuals(np.append(six, throttle))

        guess, widths = start[:-1], self.widths[:-1]
        six = interior_root(lambda x: left_over(x)[1:], guess, bounds, widths=widths, **self.limits)
        if six is None:
            six = _least_squares(left_over, guess, bounds)
        return np.append(six, throttle)

    def obstacle(self, x: FloatArray, residual: FloatArray) -> str:
        """Say which bounds the best compromise `x`, which leaves `residual`, lies at."""
        share = (x - self.lower) / (self.upper - self.lower)
        low, high = share < _AT_STOP, share > 1.0 - _AT_STOP
        alpha = f"alpha is at {x[0] / DEG:.1f} deg"
        reasons = (
            (high[6] and residual[0] < 0.0 and not self._glides, _TOO_LITTLE),
            (low[6] and residual[0] > 0.0, "the aircraft speeds up with the throttle closed"),
            (high[0], f"it would stall, {alpha}"),
            (low[0], f"negative stall, {alpha}"),
            (low[3] or high[3], "the elevator is at its stop"),
            (low[2] or high[2], "the aileron is at its stop"),
            (low[4] or high[4], "the rudder is at its stop"),
        )
        text = ", ".join(text for holds, text in reasons if holds)
        return text or self._history(x) or f"the search did not converge{self._forces(x)}"

    def _forces(self, x: FloatArray) -> str:
        """Thrust and drag at `x` and other throttles, as the end of a sentence."""
        if self._glides:
            return ""
        fdm, said = self._bench.fdm, []
        weight = fdm.reader("inertia/mass-slugs")() * G_0 / FT
        drag = fdm.reader("forces/fwx-aero-lbs")
        for throttle in dict.fromkeys((x[-1], self.lower[-1], self.upper[-1])):
            self.residuals(np.append(x[:-1], throttle))
            thrust = sum(read() for read in fdm.thrusts) / weight
            said.append(f"{thrust:.2g} at the throttle {throttle:.2g}")
        return f", its thrust over its weight is {listed(said)}, its drag {drag() / weight:.2g}"

    def _history(self, x: FloatArray) -> str:
        """Say that the thrust at `x` depends on the throttles before it; empty if it does not."""
        if not self.settles:
            return ""
        fast, slowly = (
            [self.residuals(np.append(x[:-1], throttle))[0] for throttle in throttles][-1]
            for throttles in (np.linspace(self.upper[-1], x[-1], n).tolist() for n in (2, _SWEEP))
        )
        if not abs(slowly - fast) > _HISTORY:
            return ""
        return (
            f"its thrust depends on its history, at the throttle {x[-1]:.3f} it is "
            f"{slowly - fast:.2g} weights larger where that is closed slowly from full"
        )


def _largest(residual: FloatArray) -> str:
    """The largest of the residuals of a trim, with its unit and sense."""
    k = int(np.argmax(np.abs(residual)))
    unit, below, above = _SENSES[k]
    return f"{abs(residual[k]):.2g} {unit} {below if residual[k] < 0.0 else above}"


def _least_squares(
    residuals: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    **options: Any,
) -> FloatArray:
    from scipy.optimize import least_squares  # takes as long to import as all the rest

    options |= {"x_scale": bounds[1] - bounds[0], "max_nfev": _MAX_EVALUATIONS}
    return least_squares(residuals, start, bounds=bounds, **options).x


def pitch_attitude(gamma: float, phi: float, alpha: float, beta: float) -> float:
    """Return theta (rad) of flight at `gamma` with `phi`, `alpha`, `beta` (rad), in still air."""
    # The rate-of-climb constraint, eq. (3.6-19) ff. of B. L. Stevens, F. L. Lewis and E. N.
    # Johnson, *Aircraft Control and Simulation*, Wiley.
    a = math.cos(alpha) * math.cos(beta)
    b = math.sin(phi) * math.sin(beta) + math.cos(phi) * math.sin(alpha) * math.cos(beta)
    climb = math.sin(gamma)
    # Negative where no attitude has this climb: steep, with sideslip. The search leaves that again.
    root = math.sqrt(max(0.0, a * a - climb * climb + b * b))
    return math.atan2(a * b + climb * root, a * a - climb * climb)


def _drift_angle(theta: float, phi: float, alpha: float, beta: float) -> float:
    """Return course minus heading (rad) in still air."""
    u = math.cos(alpha) * math.cos(beta)
    v = math.sin(beta)
    w = math.sin(alpha) * math.cos(beta)
    ahead = u * math.cos(theta) + (v * math.sin(phi) + w * math.cos(phi)) * math.sin(theta)
    return math.atan2(v * math.cos(phi) - w * math.sin(phi), ahead)


def trim_table(
    config: AircraftConfig,
    *,
    V_a: Sequence[float] | None = None,
    gamma: Sequence[float] | None = None,
    phi: float = 0.0,
    h: float = 1000.0,
) -> list[dict[str, Any]]:
    """Return the steady flights of an aircraft at every airspeed with every flight-path angle.

    `V_a` (m/s) are by default `SPEEDS` airspeeds over the envelope, `gamma` (rad) `CLIMBS`; `phi`
    (rad) and `h` (m) are those of all. A record has the condition, angles in degrees, and in
    ``trim`` the steady flight or None, for which ``reason`` tells why.
    """
    speeds = np.linspace(*config.envelope.V_a, SPEEDS).tolist() if V_a is None else V_a
    turn, records = {"phi_deg": phi * DEG_PER_RAD, "h_m": h}, []
    fdm: Fdm | None = None  # of the condition before: its engine has settled close to the next one
    if gamma is None and config.engines.count:
        gamma = CLIMBS
    for speed in speeds:
        lowest_short = math.inf  # shallowest climb for which thrust is too little
        near: FloatArray | None = None  # the steady flight before
        try:
            climbs = (level(config, speed, h).gamma,) if gamma is None else gamma
        except TrimError as error:
            row = {"V_a_mps": speed, "gamma_deg": None, **turn}
            records.append({**row, "trim": None, "reason": _obstacle(error)})
            continue
        for climb in climbs:
            condition = FlightCondition(V_a=speed, h=h, gamma=climb, phi=phi)
            short = climb > lowest_short
            if fdm is None or near is None or not config.engines.settle:
                fdm, near = Fdm(config), None
            near, point, reason = _trimmed(fdm, condition, thrust_short=short, near=near)
            if _TOO_LITTLE in reason:
                lowest_short = min(lowest_short, climb)
            row = {"V_a_mps": speed, "gamma_deg": climb * DEG_PER_RAD, **turn}
            records.append({**row, "trim": point, "reason": reason})
    return records


def _trimmed(
    fdm: Fdm, condition: FlightCondition, *, thrust_short: bool, near: FloatArray | None
) -> tuple[FloatArray | None, dict[str, float] | None, str]:
    """Steady flight as unknowns and as numbers of a file, or what stands against it."""
    faults = (f"`{name}` {fault}" for name, fault in start_faults(fdm.config, condition, 0.0))
    if outside := "; ".join(faults).replace(f" ({fdm.config.file})", ""):
        return None, None, f"outside the envelope: {outside}"
    problem = _TrimProblem(fdm, condition)
    try:
        x = problem.steady(thrust_short=thrust_short, near=near)
    except TrimError as error:
        return None, None, _obstacle(error)
    state = problem.state(x)
    names = ("alpha", "beta", "theta", "aileron", "elevator", "rudder")
    angles = {f"{name}_deg": getattr(state, name) * DEG_PER_RAD for name in names}
    return x, {**angles, "throttle": state.throttle}, ""


def _obstacle(error: TrimError) -> str:
    """The end of the message, without file and condition."""
    return str(error).split(" (left over")[0].rsplit(": ", 1)[-1].removesuffix(".")
