"""The fastest change of course and path angle that an aircraft can fly, with its commands."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.control.controller import FlightCondition
from flighttune.control.gains import COMMANDS
from flighttune.control.inner_loop import InnerLag
from flighttune.vehicles.plants.point_mass import FINEST, PointMassPlant

# Intervals of the planned commands: the paper's change takes 6.110 s with 24, 6.105 with 40.
KNOTS = 32

# Integration steps of an interval.
SUBSTEPS = 2

DIFFERENCE = 1e-6

# Seconds that a radian of missed course or path angle costs: far more than flying it takes.
PENALTY = 50.0

# Linear programs for the first plan, and for the plan after each correction.
MAX_STEPS, MORE_STEPS = 60, 25

# Improvement (s) below which no further linear program is solved.
MIN_IMPROVEMENT = 1e-4

# Trust region as a share of each range: from a first guess, near a plan, and the share below which
# the search ends.
FIRST_RADIUS, NEXT_RADIUS, SMALLEST_RADIUS = 0.25, 0.02, 1e-4

# Corrections of the end. Until the flight arrives, their sample time (s) is at least this.
MAX_CORRECTIONS, COARSE = 9, 0.01

# Error at the end of the lagged flight, rad, below which a plan is accepted. The second number is
# the error of end or rate that an uncorrected plan may have; the corrections remove it.
TOLERANCE, MAX_PLAN_ERROR = 1e-4, 0.01

# Longest change, in seconds and in samples or integration steps of up to 0.05 ms computing time.
MAX_DURATION, MAX_FLOWN = 200.0, 40_000

# The inner loop is at rest after this number of time constants.
TAIL = 12.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Manoeuvre:
    """A change of course and path angle, and the limits that it keeps."""

    # m/s and m/s^2: Airspeed, and acceleration of gravity
    V_a: float
    g: float
    # rad: Course and flight-path angle; the shorter way round is flown
    start: tuple[float, float]
    end: tuple[float, float]
    u_0: tuple[float, float]  # rad and 1: Roll and load factor at the start
    # rad and 1: Range of the commands
    lower: tuple[float, float]
    upper: tuple[float, float]
    # rad/s and 1/s: Range of their rates, which holds zero
    rate_lower: tuple[float, float]
    rate_upper: tuple[float, float]
    # Lags of roll and load factor; None where both follow at once
    lags: tuple[InnerLag, InnerLag] | None
    dt: float  # s: Sample time of the controller, over which commands are held

    @property
    def change(self) -> tuple[float, float]:
        """Change of course (the shorter way round) and of path angle, rad."""
        return math.remainder(self.end[0] - self.start[0], math.tau), self.end[1] - self.start[1]

    @property
    def longest(self) -> float:
        """Longest time that the change may take, s."""
        fastest = max((lag.natural_frequency for lag in self.lags or ()), default=1.0)
        return min(MAX_DURATION, MAX_FLOWN * min(self.dt, FINEST / fastest))

    @property
    def u_end(self) -> tuple[float, float]:
        """Roll and load factor at the end: flight is steady, wings level."""
        return 0.0, math.cos(self.end[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FeasibleReference:
    """A flight of the exact point mass behind the inner loop, as the reference of a real flight."""

    # s: Until the commands are steady; the inner loop is at rest a little later
    duration: float
    dt: float  # s: Sample time
    # (n,), rad: Course and flight-path angle at the samples, constant after the last one
    chi: FloatArray
    gamma: FloatArray
    # (n, 2), rad and 1: Commands of roll and load factor under which the point mass flies them,
    # each held until the next sample
    planned: FloatArray
    g: float  # m/s^2: acceleration of gravity

    @property
    def initial(self) -> tuple[float, float]:
        """Chi and gamma (rad) at t = 0."""
        return float(self.chi[0]), float(self.gamma[0])

    def sampled(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return chi and gamma (rad) at times `t` (s), each of the shape of `t`."""
        knots = self.dt * np.arange(len(self.chi))
        return np.interp(t, knots, self.chi), np.interp(t, knots, self.gamma)

    def rates(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean rates of chi and gamma (rad/s) over the sample of each time `t` (s)."""
        sample = self._sample(t, len(self.chi))
        chi, gamma = (np.append(np.diff(x), [0.0, 0.0])[sample] for x in (self.chi, self.gamma))
        return chi / self.dt, gamma / self.dt

    def commands(self, t: FloatArray) -> FloatArray:
        """Return the feed-forward of roll (rad) and load factor (1) at times `t` (s), (n, 2)."""
        return self.planned[self._sample(t, len(self.planned) - 1)]

    def _sample(self, t: FloatArray, last: int) -> npt.NDArray[np.intp]:
        """Index of the sample that contains each time, from 0 to the last sample."""
        return np.clip(np.floor(np.asarray(t) / self.dt + 1e-6).astype(np.intp), 0, last)


@lru_cache(maxsize=64)
def feasible_reference(manoeuvre: Manoeuvre) -> FeasibleReference:
    """The fastest reference that the commands of a manoeuvre can make an aircraft fly."""
    _check(manoeuvre)
    # The commands are piecewise linear between `KNOTS` intervals of equal length. Their values and
    # the duration minimise the duration under the exact point mass: a sequence of linear programs
    # in a trust region with an exact penalty (R. Fletcher, *Practical Methods of Optimization*, 2nd
    # ed., section 14.4). Behind the lag of the inner loop the same commands miss the end a little;
    # the target is corrected by this error until the flight ends where it should.
    aimed, plan, radius = manoeuvre, _first_plan(manoeuvre), FIRST_RADIUS
    steps, flown = MAX_STEPS, 0
    sampled = replace(manoeuvre, dt=max(manoeuvre.dt, COARSE))
    for _ in range(MAX_CORRECTIONS):
        plan, broken = _fastest(aimed, plan, radius, steps)
        radius, steps = NEXT_RADIUS, MORE_STEPS
        if broken > MAX_PLAN_ERROR or flown > MAX_FLOWN:
            break
        reference = _reference_of(sampled, plan)
        flown += len(reference.chi)
        arrived = reference.chi[-1] - manoeuvre.start[0], reference.gamma[-1] - manoeuvre.start[1]
        missed = [wanted - got for wanted, got in zip(manoeuvre.change, arrived, strict=True)]
        if max(map(abs, missed)) < TOLERANCE:
            if sampled == manoeuvre:
                return reference
            sampled = manoeuvre
        chi, gamma = (end + miss for end, miss in zip(aimed.end, missed, strict=True))
        aimed = replace(aimed, end=(chi, gamma))
    raise InputError(
        "`reference` of shape feasible must be one that the search plans within the limits in "
        f"{manoeuvre.longest:.3g} s, got none (which does not prove that there is none): widen a "
        "limit, or make the change or `margin` smaller."
    )


def _check(manoeuvre: Manoeuvre) -> None:
    limits = [*zip(COMMANDS, manoeuvre.lower, manoeuvre.upper, strict=True)]
    for end, commands in (("begin", manoeuvre.u_0), ("end", manoeuvre.u_end)):
        for (name, low, high), value in zip(limits, commands, strict=True):
            if not low <= value <= high:
                raise InputError(
                    f"`{name}` of a feasible reference must {end} in {low:.4g} to {high:.4g} (the "
                    f"limits without the margin), got {value:.4g}."
                )
    # A steady turn has the rate tan(phi) g / V_a at any path angle.
    turn, _ = manoeuvre.change
    least = math.atan(abs(turn) * manoeuvre.V_a / (manoeuvre.g * manoeuvre.longest))
    side, roll = ("right", manoeuvre.upper[0]) if turn > 0.0 else ("left", abs(manoeuvre.lower[0]))
    if roll < least:
        raise InputError(
            f"`phi` of a feasible reference must reach {math.degrees(least):.3g} deg to the "
            f"{side}, so that the turn of {math.degrees(turn):.4g} deg takes at most "
            f"{manoeuvre.longest:.3g} s, got {math.degrees(roll):.3g} deg (the limits without the "
            "margin)."
        )
    rest = max(map(_settling, manoeuvre.lags or ()), default=0.0)
    if rest > manoeuvre.longest:
        raise InputError(
            "The lag of the first plant must settle within "
            f"{manoeuvre.longest:.3g} s behind a feasible reference, got {rest:.3g} s."
        )


# A plan is a vector x of `2 KNOTS - 1` numbers: roll at the inner knots, load factor there, and the
# duration.


def _first_plan(manoeuvre: Manoeuvre) -> FloatArray:
    """A roll to one side and back, with the load factor interpolated from start to end."""
    share = np.arange(1, KNOTS) / KNOTS
    turn, climb = manoeuvre.change
    largest = 0.5 * (manoeuvre.upper[0] if turn > 0.0 else -manoeuvre.lower[0])
    rate = manoeuvre.g / manoeuvre.V_a
    duration = 2.0 + (abs(turn) / (rate * math.tan(largest)) if turn else 0.0) + abs(climb) / rate
    n_z = manoeuvre.u_0[1] + (manoeuvre.u_end[1] - manoeuvre.u_0[1]) * share
    phi = math.copysign(largest, turn) * np.sin(math.pi * share)
    return np.concatenate([phi, n_z, [min(duration, manoeuvre.longest)]])


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # away from the vertical
def _fastest(
    manoeuvre: Manoeuvre, x: FloatArray, radius: float, steps: int
) -> tuple[FloatArray, float]:
    """The plan of the shortest duration near `x`, and its error of end and rates."""
    from scipy.optimize import linprog

    # At most `steps` linear programs move the trust region, which begins with `radius`.
    size = 2 * KNOTS - 1
    rows, bounds = _rate_rows(manoeuvre)
    low = np.append(np.repeat(manoeuvre.lower, KNOTS - 1), 0.2)
    high = np.append(np.repeat(manoeuvre.upper, KNOTS - 1), manoeuvre.longest)
    scale = np.concatenate([high[:-1] - low[:-1], x[-1:]])
    # The penalty weighs the slack of both angles at the end, in both directions, and of all rates.
    cost = np.concatenate([np.zeros(size - 1), [1.0], np.full(5, PENALTY)])
    slack = np.array([[1.0, 0.0, -1.0, 0.0, 0.0], [0.0, 1.0, 0.0, -1.0, 0.0]])
    broken = np.hstack([np.zeros((len(rows), 4)), -np.ones((len(rows), 1))])

    def merit(x: FloatArray) -> float:
        rates = max(float(np.max(rows @ x - bounds)), 0.0)
        return float(x[-1] + PENALTY * (np.abs(_missed(manoeuvre, x[None])[0]).sum() + rates))

    best = merit(x)
    # Types are declared here and in `_missed`: Pyright needs seconds to infer them.
    for _ in range(steps):
        near: FloatArray = _missed(manoeuvre, np.vstack([x, x + DIFFERENCE * np.eye(size)]))
        slopes = (near[1:] - near[0]) / DIFFERENCE
        if not np.isfinite(slopes).all():
            break
        reach = radius * scale
        lowest = np.append(np.minimum(np.maximum(low - x, -reach), 0.0), np.zeros(5))
        highest = np.append(np.minimum(high - x, reach), np.full(5, np.inf))
        program = linprog(
            cost,
            A_ub=np.hstack([rows, broken]),
            b_ub=bounds - rows @ x,
            A_eq=np.hstack([slopes.T, slack]),
            b_eq=-near[0],
            bounds=np.column_stack([lowest, highest]),
        )
        if program.x is None:
            break
        expected = best - x[-1] - float(cost @ program.x)
        step: FloatArray = x + program.x[:size]
        reached = merit(step)
        better = best - reached
        if better > 0.1 * expected:
            x, best, radius = step, reached, min(1.6 * radius, 0.5)
        else:
            radius *= 0.4
        if expected < MIN_IMPROVEMENT or radius < SMALLEST_RADIUS or 0.0 < better < MIN_IMPROVEMENT:
            break
    return x, (best - float(x[-1])) / PENALTY if math.isfinite(best) else math.inf


def _rate_rows(manoeuvre: Manoeuvre) -> tuple[FloatArray, FloatArray]:
    """Rows and bounds of ``rows @ x <= bounds``: no command exceeds its rate limit."""
    difference, inner = np.diff(np.eye(KNOTS + 1), axis=0), KNOTS - 1
    rows, bounds = [], []
    for i in range(2):
        change = np.zeros((KNOTS, 2 * inner + 1))
        change[:, i * inner : (i + 1) * inner] = difference[:, 1:-1]
        outer = manoeuvre.u_0[i] * difference[:, 0] + manoeuvre.u_end[i] * difference[:, -1]
        for sign, rates in ((-1.0, manoeuvre.rate_lower), (1.0, manoeuvre.rate_upper)):
            row = sign * change
            row[:, -1] = -abs(rates[i]) / KNOTS
            rows.append(row)
            bounds.append(-sign * outer)
    return np.vstack(rows), np.concatenate(bounds)


def _at_knots(manoeuvre: Manoeuvre, x: FloatArray) -> FloatArray:
    """Roll and load factor of plans `x` (N, size) at all knots, (N, 2, KNOTS + 1)."""
    first, last = (
        np.broadcast_to(np.reshape(ends, (2, 1)), (len(x), 2, 1))
        for ends in (manoeuvre.u_0, manoeuvre.u_end)
    )
    return np.concatenate([first, x[:, :-1].reshape(-1, 2, KNOTS - 1), last], axis=2)


def _missed(manoeuvre: Manoeuvre, x: FloatArray) -> FloatArray:
    """Error of course and path angle at the end of plans `x` (N, size), (N, 2) rad."""
    commands = _at_knots(manoeuvre, x)
    step = np.maximum(x[:, -1], DIFFERENCE) / (KNOTS * SUBSTEPS)
    knot = np.arange(2 * KNOTS * SUBSTEPS + 1) / (2 * SUBSTEPS)
    before = np.minimum(knot.astype(np.intp), KNOTS - 1)
    share = knot - before
    fine = (1.0 - share) * commands[..., before] + share * commands[..., before + 1]
    # At ends and middles of the steps: both middle stages of Runge-Kutta read the same column.
    phi, n_z = fine.transpose(1, 2, 0)
    turning, lifting, g_over_v = n_z * np.sin(phi), n_z * np.cos(phi), manoeuvre.g / manoeuvre.V_a
    turned: FloatArray = np.zeros(len(x))
    gamma: FloatArray = np.full(len(x), manoeuvre.start[1])

    def rates(i: int, gamma: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rates equal to `turn_rates`, whose checks would take most of the time of a plan."""
        level = np.cos(gamma)
        return g_over_v * (turning[i] / level), g_over_v * (lifting[i] - level)

    for i in range(0, 2 * KNOTS * SUBSTEPS, 2):
        k1 = rates(i, gamma)
        k2 = rates(i + 1, gamma + 0.5 * step * k1[1])
        k3 = rates(i + 1, gamma + 0.5 * step * k2[1])
        k4 = rates(i + 2, gamma + step * k3[1])
        change = [
            step / 6.0 * (a + 2.0 * (b + c) + d) for a, b, c, d in zip(k1, k2, k3, k4, strict=True)
        ]
        turned, gamma = turned + change[0], gamma + change[1]
    turn, climb = manoeuvre.change
    return np.column_stack([turned - turn, gamma - manoeuvre.start[1] - climb])


def _reference_of(manoeuvre: Manoeuvre, x: FloatArray) -> FeasibleReference:
    """The flight of the exact point mass, behind the lag, under the sampled commands of a plan."""
    dt, duration = manoeuvre.dt, float(x[-1])
    knots = np.linspace(0.0, duration, KNOTS + 1)
    rest = max(map(_settling, manoeuvre.lags or ()), default=0.0)
    # The middle of each sample: held commands are half a sample late on average.
    middles = (np.arange(math.ceil((duration + rest) / dt) + 1) + 0.5) * dt
    (commands,) = _at_knots(manoeuvre, x[None])
    planned = np.column_stack([np.interp(middles, knots, command) for command in commands])
    plant = PointMassPlant(manoeuvre.lags, g=manoeuvre.g)
    (chi, gamma), (phi, n_z) = manoeuvre.start, manoeuvre.u_0
    plant.start(FlightCondition(V_a=manoeuvre.V_a, chi=chi, gamma=gamma, phi=phi, n_z=n_z))
    path = [plant.observe()[:2]]
    for phi, n_z in planned[:-1].tolist():
        plant.advance(phi, n_z, dt)
        path.append(plant.observe()[:2])
    chis, gammas = np.array(path).T
    return FeasibleReference(
        duration=duration, dt=dt, chi=chis, gamma=gammas, planned=planned, g=manoeuvre.g
    )


def _settling(lag: InnerLag) -> float:
    slowest = 1.0 / (lag.natural_frequency * min(lag.damping if lag.order > 1 else 1.0, 1.0))
    return lag.delay + TAIL * (slowest + (lag.lag if lag.order == 3 else 0.0))
