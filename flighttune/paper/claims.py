"""Every checkable sentence of the abstract and of sections 2 to 5, with the verdict on it.

To add one, put the sentence into ``claims.toml`` and the function that checks it, under the same
name, into this module.
"""

import math
import operator
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import closed_loop
from flighttune.flight.gains import tune
from flighttune.paper import parameters as printed
from flighttune.paper.duffing import Duffing, DuffingCase
from flighttune.paper.flight import NEAR, decay_rate, largest_share, oscillations
from flighttune.paper.parameters import DURATION, STAR, printed_limits
from flighttune.paper.study import Study, rank_correlation
from flighttune.plants.point_mass import turn_rates
from flighttune.present.answer import number
from flighttune.theory.common import common_Q
from flighttune.theory.indicators import Indicators, indicators
from flighttune.theory.lyapunov import lyapunov_solution, paper_balls
from flighttune.theory.reachable import largest_outputs

Verdict: TypeAlias = Literal["reproduced", "partly", "not reproduced", "not checkable"]

VERDICTS: tuple[Verdict, ...] = ("reproduced", "partly", "not reproduced", "not checkable")

# In the order of the paper, by short name: the sentence, its place and how it is checked.
CLAIMS: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("claims.toml").read_text(encoding="utf-8")
)

# Where the paper gives words and no number, a verdict needs one. Each is the mildest that an
# engineer would still accept for the word, so that a claim fails for what comes out and not for a
# strict reading. The page prints them in the column “expected”.

# "A very small region": error left at the end, rad. 2 % of the first error in course, the usual
# band of a settling time.
VERY_SMALL = 0.02

# "Exponential stabilisation": share of the first state left after 20 s without disturbance.
SETTLED = 0.01

# "Assesses", "correlates": size of a rank correlation over the seven gain sets. Only 17 of the 5040
# orders of seven reach it, so that chance does so once in 300 times.
CORRELATED = 0.9

# "Linearity": R^2 of a straight line.
LINEAR = 0.95

# "Approximately inverse": correlation of a quantity with 1 / R_K.
INVERSE = 0.95

# "Of the order of 1e-3", "minor": anything below the next power of ten.
ORDER_OF_1E3 = 1e-2

# "No significant rise": relative rise up to which none is seen in the paper's figures.
NOT_SIGNIFICANT = 0.1

# "Pronounced upward trend": relative rise from here on.
PRONOUNCED = 0.5

# "Nearly all curves": of the nine disturbances.
NEARLY_ALL = 8

# "Optimal": relative distance from the best R_K. The printed gains have four decimals, which move
# R_K by less than 1e-4 of itself.
AS_GOOD = 1e-3

# Distance at which two Jacobians, or a rate and zero, are the same: the error of central
# differences with a step of 1e-6, where rounding and curvature are about equal.
DERIVATIVE, SMALL_STEP = 1e-8, 1e-6

# Random matrices on which a lemma is tried
SAMPLES = 200

# Excess of a limited command over its limit that is rounding.
ROUNDING = 1e-9

# The L_d for which the text speaks of ITAE over omega_d.
STATED_AMPLITUDES = (0.1, 0.3)

# The errors of the sentence on ITAE, MS and ST.
ERRORS = ("chi", "gamma", "chi_dot", "gamma_dot")

RELATIONS = {"≤": operator.le, "<": operator.lt, "≥": operator.ge}


@dataclass(frozen=True, slots=True)
class Check:
    """One comparison."""

    label: str  # what is compared, with its unit
    expected: str | float  # what the paper says
    computed: str | float  # what comes out
    holds: bool  # whether the two agree


Checks: TypeAlias = Iterator[Check]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A sentence of the paper with its comparisons made."""

    id: str
    text: str  # what the paper says, shortened
    where: str  # its place in the paper
    checks: tuple[Check, ...]
    missing: str = ""  # what would be needed where there are no comparisons

    @property
    def verdict(self) -> Verdict:
        """Reproduced where all comparisons agree, partly where some do."""
        if not self.checks:
            return "not checkable"
        agreeing = {check.holds for check in self.checks}
        return "partly" if len(agreeing) > 1 else "reproduced" if True in agreeing else VERDICTS[2]

    @property
    def expected(self) -> dict[str, str | float]:
        """Value of the paper for each comparison."""
        return {check.label: check.expected for check in self.checks}

    @property
    def computed(self) -> dict[str, str | float]:
        """Computed value for each comparison; without any the missing piece."""
        return {check.label: check.computed for check in self.checks} or {"missing": self.missing}


def judge(name: str, study: Study) -> Finding:
    """Make the comparisons of a claim with the numbers of a study.

    The function has the name of the claim if its entry has no ``check``; further keys of the entry
    are its arguments.
    """
    entry = dict(CLAIMS[name])
    claim = {key: entry.pop(key) for key in ("text", "where", "missing") if key in entry}
    checks: Iterable[Check] = ()
    if "missing" not in claim:
        function = entry.pop("check", name).replace("-", "_")
        checks = globals()[function](study, **entry)
    return Finding(id=name, checks=tuple(checks), **claim)


def text_of(value: str | float) -> str:
    """An expected or computed value for a table: a number with five digits."""
    return value if isinstance(value, str) else number(value, ".5g")


def _compare(label: str, value: float, relation: str, limit: float, symbol: str = "") -> Check:
    """`value` against a limit, which may be named by a symbol."""
    name = f"{symbol} = " if symbol else ""
    holds = RELATIONS[relation](value, limit)
    return Check(label, f"{relation} {name}{limit:.4g}", value, holds)


def _printed(label: str, value: float, number: float, last_digit: float) -> Check:
    """`value` must be a printed number to one unit of its last digit."""
    return Check(label, number, value, abs(value - number) <= last_digit)


def _all_rise(label: str, steps: FloatArray) -> Check:
    """Every step from one neighbour to the next must be a rise."""
    rising, count = int((steps > 0.0).sum()), steps.size
    return Check(label, f"{count} of {count} steps", f"{rising} of {count} steps", rising == count)


def _lower_with_higher_R_K(name: str, from_high_to_low: pd.Series) -> Check:
    """A measure must rise at every step from the highest R_K to the lowest."""
    return _all_rise(f"{name} lower with higher R_K", np.diff(from_high_to_low))


# The abstract


def exponential_stabilisation(study: Study) -> Checks:
    """Without disturbance the state decays exponentially, at the rate the theory says."""
    flight = study.undisturbed
    s = np.hypot(flight.channels["s_chi"], flight.channels["s_gamma"])
    late = flight.t >= 10.0  # the commands have left their ranges for the last time
    rate = decay_rate(flight.t[late], s[late])
    share = float(s[-1] / s[0])
    yield _compare("part of |s| left after 20 s, no disturbance", share, "≤", SETTLED)
    half = study.indicators[STAR].R_K / 2.0
    yield _compare("decay of |s| from 10 s on [1/s]", rate, "≥", half, "R_K/2")


def optimal_controller(study: Study) -> Checks:
    """No gains with the same I_K have a higher R_K."""
    best = study.optimum.R_K
    share = study.indicators[STAR].R_K / best if best else math.nan
    yield _compare("R_K over the best without input constraints [1]", share, "≥", 1.0 - AS_GOOD)


def assesses_performance(study: Study) -> Checks:
    """R_K orders the gain sets as each measure of performance does."""
    R_K = study.indicator("R_K")
    errors, sums = ("chi", "gamma"), ("s_chi", "s_gamma")
    for measure in ("ITAE", "MO_rad", "PT_s", "MS_rad", "ST_rad"):
        for channel in sums if measure in ("MS_rad", "ST_rad") else errors:
            correlation = rank_correlation(R_K, study.of_gains(channel, measure))
            label = f"rank correlation of R_K and {measure.split('_')[0]} of {channel}"
            yield _compare(label, correlation, "≤", -CORRELATED)


# Sections 2 to 4, the theory


def _random_matrices() -> FloatArray:
    """Square matrices of four states, shape (`SAMPLES`, 4, 4)."""
    return np.random.default_rng(0).standard_normal((SAMPLES, 4, 4))


def lemma_1(_: Study) -> Checks:
    """P exists for stable matrices; with an eigenvalue 0 the equation has no solution at all."""
    A = _random_matrices()
    A = A - (np.linalg.eigvals(A).real.max(axis=-1) + 0.1)[:, None, None] * np.eye(4)
    positive = int((np.linalg.eigvalsh(lyapunov_solution(A))[:, 0] > 0.0).sum())
    yield Check("stable matrices with a P > 0", SAMPLES, positive, positive == SAMPLES)
    # v' (P A + A' P + I) v = v' v > 0 where A v = 0, whatever P is.
    A = np.diag([0.0, -1.0])
    basis = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]])
    columns = (basis @ A + A.T @ basis).reshape(3, -1).T
    nearest = np.linalg.lstsq(columns, -np.eye(2).ravel())[0]
    norm = float(np.linalg.norm(columns @ nearest + np.eye(2).ravel()))
    yield _compare("smallest norm of P A + Aᵀ P + I, A = diag(0, -1)", norm, "≤", ROUNDING)


def lemma_2(_: Study) -> Checks:
    """Weyl's inequality for random matrices."""
    A, change = _random_matrices(), _random_matrices()[::-1]
    A, change = A + A.mT, change + change.mT
    moved = np.linalg.eigvalsh(A + change)[:, -1] - np.linalg.eigvalsh(A)[:, -1]
    ratio = float(np.max(np.abs(moved) / np.linalg.norm(change, 2, axis=(1, 2))))
    yield _compare("largest change of λ_max over ‖ΔA‖, 200 matrices [1]", ratio, "≤", 1.0)


def lemma_3(study: Study) -> Checks:
    """The Jacobian of the Duffing oscillator in the disc in which it has the smoothness stated."""
    model = study.duffing.model
    x1 = np.linspace(-1.0, 1.0, 201)
    J = model.jacobian(np.stack([x1, np.zeros(x1.size)], axis=-1))
    top = np.linalg.eigvalsh(J + J.mT)[:, -1]
    smoothness = model.smoothness(1.0)
    apart = np.abs(top - top[100])[x1 != 0.0] / (2.0 * smoothness * np.abs(x1[x1 != 0.0]))
    yield _compare(
        "largest change over 2 β_f |x|, Duffing, |x| ≤ 1 [1]", float(apart.max()), "≤", 1.0
    )


def lemma_4(study: Study) -> Checks:
    """Differences of the Duffing oscillator, which is A(x) x, at the origin."""
    model, step = study.duffing.model, SMALL_STEP * np.eye(2)
    differences = (model.rates(step) - model.rates(-step)).T / (2.0 * SMALL_STEP)
    off = float(np.max(np.abs(differences - model.jacobian(np.zeros(2)))))
    yield _compare("distance of the Jacobian at 0 from A(0), Duffing", off, "≤", DERIVATIVE)


def _slowest_decay(start: float) -> tuple[FloatArray, FloatArray]:
    """Time and √V of ``V' = -V + √V``, where Lemma 5 with α = β = 1 holds with equality."""
    from scipy.integrate import solve_ivp

    t = np.linspace(0.0, 10.0, 101)
    run = solve_ivp(
        lambda _, V: -V + np.sqrt(V), (0.0, 10.0), [start], t_eval=t, rtol=1e-10, atol=1e-13
    )
    return t, np.sqrt(run.y[0])


def lemma_5(_: Study) -> Checks:
    """The bound along the motion for which the inequality is an equality."""
    for start in (0.04, 9.0):
        t, root = _slowest_decay(start)
        bound = 1.0 + (math.sqrt(start) - 1.0) * np.exp(-0.5 * t)
        ratio = float(np.max(root / bound))
        yield _compare(f"largest √V over its bound, V_0 = {start:g}", ratio, "≤", 1.0 + DERIVATIVE)


def lemma_5_rate(_: Study) -> Checks:
    """The decay of √V - β/α along the same motion."""
    t, root = _slowest_decay(9.0)
    yield _compare("decay of √V − β/α over α [1]", decay_rate(t, root - 1.0), "≥", 1.0 - AS_GOOD)


def _stable_loops(study: Study) -> Iterator[tuple[FloatArray, Indicators, FloatArray]]:
    """A_K, indicators and eigenvalues of Q of each gain set that stabilises the loop."""
    for name, gains in study.gains.items():
        row = study.indicators[name]
        if row.Q is not None:
            values: FloatArray = np.asarray(np.linalg.eigvalsh(row.Q), dtype=float)
            yield closed_loop(study.model, gains), row, values


def theorem_1(study: Study) -> Checks:
    """The bound against the largest ``f = A_K s`` that disturbances of the linear loops cause."""
    ratios = []
    for A, _, values in _stable_loops(study):
        bound = 2.0 * np.linalg.norm(A, 2) * values[-1] ** 2 / values[0]
        ratios.append(float(largest_outputs(A[None], A, np.eye(len(A)))[0].max() / bound))
    worst = max(ratios, default=math.inf)
    yield _compare("largest |f_i| possible over the bound, 7 gain sets [1]", worst, "≤", 1.0)


def theorem_1_sufficient(study: Study) -> Checks:
    """One P for the Jacobians of the Duffing oscillator, which are all stable."""
    J = study.duffing.model.jacobian(np.array([[0.0, 0.0], [20.0, 0.0]]))
    stable = float(np.linalg.eigvals(J).real.max())
    yield _compare("largest real part of the Jacobians at x1 = 0 and 20 [1/s]", stable, "<", 0.0)
    common = common_Q(J)
    yield Check("rate of a P for both [1/s]", "> 0", common.R, common.R > 0.0)


def theorem_2(study: Study) -> Checks:
    """The largest error that disturbances cause, over the ball for each reading of L_f."""
    star = study.indicators[STAR]
    A_K = closed_loop(study.model, study.star)
    balls = paper_balls(A_K, study.model.A, I_K=star.I_K, L_d=1.0)
    names = "‖A_K‖", "‖∂f/∂x + ∂f/∂u K_P‖", "‖∂f/∂x‖"
    for name, ball in zip(names, balls.tolist(), strict=True):
        label = f"largest |e_i| of K* over the ball, L_f = {name} [1]"
        yield _compare(label, star.E_K / ball, "≤", 1.0)


def theorem_2_rate(study: Study) -> Checks:
    """The decay of the norm of s over R_K, for the slowest of the seven sets."""
    decays = (-row.spectral_abscissa / row.R_K for _, row, _ in _stable_loops(study))
    slowest = min(decays, default=0.0)
    yield _compare("smallest decay of |s| over R_K, 7 gain sets [1]", slowest, "≥", 1.0)


def global_stabilisation(study: Study) -> Checks:
    """The manoeuvre without any limits with K*, which stabilises the linearised loop."""
    status = study.readings["no limits"].status
    yield Check("manoeuvre without limits", "converges", status, status != "diverged")


def larger_attractor(study: Study) -> Checks:
    """Steps to a higher R_K at which the largest possible error grows."""
    order = study.indicator("R_K").sort_values().index
    errors = study.indicator("E_K").loc[order]
    steps = np.diff(errors)
    rising = int((steps > 0.0).sum())
    label = "steps to a higher R_K that raise the largest possible error"
    yield Check(label, f"≥ 1 of {len(steps)}", f"{rising} of {len(steps)}", rising > 0)


def three_factors(study: Study) -> Checks:
    """The printed R_K and I_K multiplied, against the other two factors of the printed gains."""
    digits = np.array(printed.LAST_DIGITS)
    off = []
    for name, pair in printed.TABLE_2.items():
        row = study.indicators[name]
        A = closed_loop(study.model, study.gains[name])
        sigma_min = np.linalg.svd(A, compute_uv=False)[-1]
        product = math.inf if row.Q is None else np.linalg.cond(np.array(row.Q)) / sigma_min
        off.append(abs(math.prod(pair) / product - 1.0) / (digits / pair).sum())
    text = "largest distance of τ(P) / σ_min from R_K I_K of Table 2, over that of a last digit [1]"
    yield _compare(text, float(max(off)), "≤", 1.0)


def eigenvalue_problem(study: Study) -> Checks:
    """R_K by semidefinite programming, over that of the Lyapunov equation."""
    off = [abs(common_Q(A[None]).R / row.R_K - 1.0) for A, row, _ in _stable_loops(study)]
    label = "largest relative difference from R_K of the Lyapunov equation"
    yield _compare(label, max(off, default=math.inf), "≤", AS_GOOD)


# Section 5.1, the Duffing oscillator


def _disturbed(study: Study) -> dict[str, DuffingCase]:
    """The printed oscillator under mild and hard disturbances, by name."""
    return {"noise": study.duffing.noisy, **study.duffing.hard}


def duffing_condition(_: Study) -> Checks:
    """The origin is stable exactly where alpha and delta are positive."""
    grid = list(product((-2.0, -0.5, 0.5, 1.0, 3.0), repeat=2))
    J = [Duffing(alpha=a, beta=0.0, delta=d).jacobian(np.zeros(2)) for a, d in grid]
    stable = np.linalg.eigvals(np.array(J)).real.max(axis=-1) < 0.0
    agreeing = int(np.sum(stable == (np.array(grid) > 0.0).all(axis=1)))
    yield Check("points of a grid that agree", len(grid), agreeing, agreeing == len(grid))


def duffing_bound(study: Study) -> Checks:
    """|f(x)| stays below the printed bound over time, under mild and hard disturbances."""
    for name, case in _disturbed(study).items():
        ratio = float(np.max(case.norm_f / case.bound_over_time[:, None]))
        yield _compare(f"largest |f| over its bound, {name} [1]", ratio, "≤", 1.0)


def duffing_attractor(study: Study) -> Checks:
    """The claim that |f(x)| is inside S(0) in the last quarter."""
    for name, case in _disturbed(study).items():
        late = case.norm_f[case.t >= 0.75 * case.t[-1]].max()
        _, I_f = case.theorem
        yield _compare(f"largest |f| in the last quarter, {name}", late, "≤", I_f)


def duffing_rate(study: Study) -> Checks:
    """|f(x)| decays at R(f) without disturbance: in (a), and for other alpha and delta."""
    case = study.duffing.undisturbed
    late = case.t >= 5.0  # the cubic stiffness has died away
    rate = decay_rate(case.t[late], case.norm_f[late, 0])
    R_f, _ = case.theorem
    yield _compare("decay of |f| in (a) [1/s]", rate, "≥", R_f, "R(f)")
    slowest = study.duffing.slowest_decay
    yield _compare("smallest decay over R(f), 30 oscillators [1]", slowest, "≥", 1.0)


def duffing_everywhere(study: Study) -> Checks:
    """Every state reached lies where the condition of the theorem holds for the chosen P."""
    for name, case in _disturbed(study).items():
        yield _compare(f"largest |x1|, {name}", case.farthest, "<", study.duffing.model.region)


# Sections 5.2 and 5.2.1, K*


def _error_rates(z: FloatArray) -> FloatArray:
    """f_e at z = (e_chi, e_gamma, phi, n_z)."""
    gamma = printed.GAMMA_C - z[1]
    return -np.array(turn_rates(printed.V_A, gamma, z[2], z[3], g=printed.G))


def jacobians(study: Study) -> Checks:
    """The printed Jacobians are those of the law, and the printed equilibrium is one."""
    steady = np.array([0.0, 0.0, 0.0, np.cos(printed.GAMMA_C)])
    differences = np.column_stack(
        [
            (_error_rates(steady + step) - _error_rates(steady - step)) / (2.0 * SMALL_STEP)
            for step in SMALL_STEP * np.eye(4)
        ]
    )
    off = float(np.max(np.abs(differences - np.hstack([study.model.A, study.model.B]))))
    yield _compare("largest distance of the Jacobians from differences", off, "≤", DERIVATIVE)
    n_z = np.cos(printed.GAMMA_C) / printed.G
    rate = float(np.linalg.norm(_error_rates(np.array([0.0, 0.0, 0.0, n_z]))))
    yield _compare("rate of the error at n_z = cos(γ_c)/g [rad/s]", rate, "≤", DERIVATIVE)


def star_indicators(study: Study) -> Checks:
    """R_K* and I_K* follow from the printed gains."""
    row, digit = study.indicators[STAR], printed.STAR_LAST_DIGIT
    yield _printed("R_K* [1/s]", row.R_K, printed.R_K_PRINTED, digit)
    yield _printed("I_K* [s²]", row.I_K, printed.I_K_PRINTED, digit)


def star_feasible(study: Study) -> Checks:
    """K* is a point of the optimisation model: every command and rate at t_0 in its range."""
    share = largest_share(study.star)
    yield _compare("largest command or rate at t_0 over its limit [1]", share, "≤", 1.0)


def star_optimal(study: Study) -> Checks:
    """K* has the highest R_K of all gains that meet the constraints."""
    result, bound = study.constrained, f"{printed.I_STAR:g}"
    label = f"smallest I_K within the input constraints [s²], I* = {bound}"
    yield Check(label, f"≤ {bound}", result.I_K, result.status == "optimal")
    best, R_K = study.optimum.R_K, study.indicators[STAR].R_K
    label = "R_K* against the best without input constraints [1/s]"
    yield Check(label, f"{best:.5g}", R_K, R_K >= (1.0 - AS_GOOD) * best)


def eigenvalues(study: Study) -> Checks:
    """All eigenvalues of A_K(0) have a negative real part."""
    yield _compare("largest real part [1/s]", study.indicators[STAR].spectral_abscissa, "<", 0.0)


def small_region(study: Study) -> Checks:
    """Both errors end in a very small region."""
    for channel in ("chi", "gamma"):
        error = study.flights[STAR].after(channel, DURATION)
        yield _compare(f"|e_{channel}| at 20 s [rad]", error, "≤", VERY_SMALL)


def overshoot(study: Study, channel: str) -> Checks:
    """Maximum overshoot of an error."""
    height, _ = study.flights[STAR].peak(channel)
    yield _compare(f"MO of e_{channel} [rad]", height, "≤", printed.LARGEST_OVERSHOOT[channel])


def peak_time(study: Study) -> Checks:
    """The later of both peaks, which is the maximum the sentence speaks of."""
    peaks = {channel: study.flights[STAR].peak(channel)[1] for channel in ("chi", "gamma")}
    channel, latest = max(peaks.items(), key=lambda peak: peak[1])
    label = f"largest PT, that of e_{channel} [s]"
    yield _compare(label, latest, "<", printed.LARGEST_PEAK_TIME)


def peak_time_gamma(study: Study) -> Checks:
    """The peak of the path-angle error alone."""
    _, t = study.flights[STAR].peak("gamma")
    yield _compare("PT of e_gamma [s]", t, "<", printed.LARGEST_PEAK_TIME)


def commands_in_range(study: Study) -> Checks:
    """Roll and load factor after the limits stay in their ranges: the simulation sees to that."""
    largest = np.max(np.abs(study.flights[STAR].u), axis=0)
    for name, value, limit in zip(("φ", "n_z"), largest, printed_limits().upper, strict=True):
        yield _compare(f"largest |{name}| flown", float(value), "≤", float(limit) + ROUNDING)


def commands_in_rate(study: Study) -> Checks:
    """Rates of roll and load factor after the limits stay in their ranges."""
    rates = np.max(np.abs(study.flights[STAR].command_rates), axis=0)
    for name, value, limit in zip(("φ", "n_z"), rates, printed_limits().rate_upper, strict=True):
        yield _compare(f"largest rate of {name} flown [1/s]", float(value), "≤", float(limit))


def converges_with_all_limits(study: Study) -> Checks:
    """With ranges and rate limits together, as Table 1 has them, the errors still converge."""
    flight = study.readings["ranges and rate limits"]
    for channel in ("chi", "gamma"):
        error = flight.after(channel, flight.t[-1] - 2.0)
        label = f"largest |e_{channel}| from 18 s on, rate limits too [rad]"
        yield _compare(label, error, "≤", NEAR)


# Section 5.2.2, K1 to K6


def table_2(study: Study) -> Checks:
    """R_K and I_K of every row."""
    digit_R, digit_I = printed.LAST_DIGITS
    for name, (R_K, I_K) in printed.TABLE_2.items():
        row = study.indicators[name]
        yield _printed(f"R_K of {name} [1/s]", row.R_K, R_K, digit_R)
        yield _printed(f"I_K of {name} [s²]", row.I_K, I_K, digit_I)


def faster_convergence(study: Study) -> Checks:
    """The slowest eigenvalue and the late errors of every channel follow R_K."""
    R_K = study.indicator("R_K")
    rated = {"the spectral abscissa": study.indicator("spectral_abscissa")}
    rated |= {f"ITAE of {channel}": study.of_gains(channel, "ITAE") for channel in ERRORS}
    for name, values in rated.items():
        label = f"rank correlation of R_K and {name}"
        yield _compare(label, rank_correlation(R_K, values), "≤", -CORRELATED)


def small_R_oscillates(study: Study) -> Checks:
    """The smallest R_K crosses zero more often than the largest, and ends farther away."""
    R_K = study.indicator("R_K")
    high, low = study.flights[str(R_K.idxmax())], study.flights[str(R_K.idxmin())]
    for channel in ("chi", "gamma"):
        few, many = (oscillations(flight.channels[channel]) for flight in (high, low))
        label = f"zero crossings of e_{channel}, lowest R_K"
        yield Check(label, f"> {few} of the highest", many, many > few)
        near, far = (float(f.measures.loc[channel, "ST_rad"]) for f in (high, low))
        label = f"ST of e_{channel}, lowest R_K [rad]"
        yield Check(label, f"> {near:.3g} of the highest", far, far > near)


def slower_oscillation(study: Study) -> Checks:
    """A larger R_K has smaller amplitudes and slower oscillation frequencies."""
    for channel in ("chi", "gamma"):
        yield _lower_with_higher_R_K(f"MO of e_{channel}", study.of_gains(channel, "MO_rad"))
    order = study.indicator("R_K").sort_values(ascending=False).index
    frequency = [float(np.max(study.indicators[str(name)].eigenvalues.imag)) for name in order]
    yield _lower_with_higher_R_K("eigenfrequency", pd.Series(frequency))


def R_more_than_I(study: Study) -> Checks:
    """R_K orders convergence and steady error better than I_K does."""
    R_K, I_K = study.indicator("R_K"), study.indicator("I_K")
    for measure, channels in (("ITAE", ("chi", "gamma")), ("ST_rad", ("s_chi", "s_gamma"))):
        for channel in channels:
            values = study.of_gains(channel, measure)
            by_R, by_I = (abs(rank_correlation(key, values)) for key in (R_K, I_K))
            label = f"|rank correlation| of R_K and {measure.split('_')[0]} of {channel}"
            yield Check(label, f"> {by_I:.3g} of I_K", by_R, by_R > by_I)


def lower_measure(study: Study, measure: str, name: str, channels: Sequence[str]) -> Checks:
    """The size of a measure falls with rising R_K at every step, in each channel."""
    for channel in channels:
        values = study.of_gains(channel, measure).abs()
        yield _lower_with_higher_R_K(f"{name} of {channel}", values)


def mostly_smaller_MO_PT(study: Study) -> Checks:
    """MO and PT fall with rising R_K at most steps."""
    for measure, name in (("MO_rad", "MO"), ("PT_s", "PT")):
        for channel in ("chi", "gamma"):
            steps = np.diff(study.of_gains(channel, measure))
            rising, count = int((steps > 0.0).sum()), steps.size
            label = f"{name} of e_{channel} lower with higher R_K"
            computed = f"{rising} of {count} steps"
            yield Check(label, f"most of {count} steps", computed, 2 * rising > count)


def minor_means(study: Study) -> Checks:
    """The mean rate of error differs by some 1e-3 over the gain sets."""
    for channel in ("chi_dot", "gamma_dot"):
        spread = float(np.ptp(study.of_gains(channel, "mean")))
        label = f"spread of the mean of {channel} over the gain sets [rad/s]"
        yield Check(label, "of the order of 1e-3", spread, spread < ORDER_OF_1E3)


def inverse_deviation(study: Study) -> Checks:
    """The deviation of the rates of error is proportional to 1 / R_K, about."""
    for channel in ("chi_dot", "gamma_dot"):
        values = study.of_gains(channel, "std")
        R_K = study.indicator("R_K").loc[values.index].to_numpy()
        correlation = float(np.corrcoef(1.0 / R_K, values)[0, 1])
        label = f"correlation of 1/R_K and the deviation of {channel}"
        yield _compare(label, correlation, "≥", INVERSE)
        yield _lower_with_higher_R_K(f"deviation of {channel}", values)


# Section 5.2.3, d1 to d9


def overall_enhancement(_: Study) -> Checks:
    """Behind an identified lag no gains decay faster or err less than those of the largest R_K."""
    loops = {}
    for objective in ("R_K", "decay", "E_K"):
        changes = {"tuning.model": "identified", "tuning.objective": objective}
        result = tune("mission", changes={"law": "paper", **changes})
        assert result.gains is not None  # those of the shipped aircraft
        loop = closed_loop(result.problem.model, result.gains)
        loops[objective] = indicators(loop, errors=len(result.gains.errors))
    R_K = loops["R_K"]
    share = R_K.spectral_abscissa / loops["decay"].spectral_abscissa
    yield _compare("rate of decay over the fastest, sensitivity at most 1.4", share, "≥", 1.0)
    share = loops["E_K"].E_K / R_K.E_K
    yield _compare("least E_K over its E_K, sensitivity at most 1.4", share, "≥", 1.0)


def near_origin(study: Study) -> Checks:
    """After 20 s the errors stay near the origin, for nearly all disturbances."""
    for channel in ("chi", "gamma"):
        late = study.of_disturbances(channel, "after")
        near = int((late < NEAR).to_numpy().sum())
        label = f"disturbances with |e_{channel}| < {NEAR:g} rad after 20 s"
        computed = f"{near} of 9, largest {late.to_numpy().max():.3g} rad"
        yield Check(label, f"≥ {NEARLY_ALL} of 9", computed, near >= NEARLY_ALL)


def steps_along(
    study: Study, measure: str, name: str, channels: Sequence[str], along: Sequence[str], way: str
) -> Checks:
    """A measure rises, or falls, at every step along L_d or omega_d."""
    for channel in channels:
        table = study.of_disturbances(channel, measure).to_numpy()
        for axis, symbol in enumerate(("L_d", "ω_d")):
            if symbol in along:
                steps = np.diff(table if way == "rises" else -table, axis=axis)
                yield _all_rise(f"{name.format(channel)} {way} with {symbol}", steps)


def insensitive_ITAE(study: Study) -> Checks:
    """For the stated L_d, ITAE does not rise significantly with omega_d."""
    for L_d in STATED_AMPLITUDES:
        for channel in ("chi", "gamma"):
            row = study.of_disturbances(channel, "ITAE").loc[L_d]
            rise = float(row.max() / row.iloc[0] - 1.0)
            label = f"largest relative rise of ITAE of e_{channel} with ω_d, L_d = {L_d:g}"
            yield _compare(label, rise, "≤", NOT_SIGNIFICANT)


def decreasing_ITAE(study: Study) -> Checks:
    """For the stated L_d, a straight line through ITAE over omega_d falls."""
    for L_d in STATED_AMPLITUDES:
        for channel in ("chi", "gamma"):
            row = study.of_disturbances(channel, "ITAE").loc[L_d]
            omega = row.index.to_numpy(dtype=float)
            slope = np.polyfit(omega, row.to_numpy(), 1)[0]
            change = float(slope * np.ptp(omega) / row.iloc[0])
            label = f"relative change of ITAE of e_{channel} along a line over ω_d, L_d = {L_d:g}"
            yield _compare(label, change, "<", 0.0)


def linear_MS(study: Study) -> Checks:
    """MS follows a straight line in L_d for each omega_d."""
    for channel in ("s_chi", "s_gamma"):
        table = study.of_disturbances(channel, "MS_rad")
        for omega in table.columns:
            R_squared = float(np.corrcoef(table.index.astype(float), table[omega])[0, 1] ** 2)
            label = f"R² of MS of {channel} over L_d, ω_d = {omega:g}"
            yield _compare(label, R_squared, "≥", LINEAR)


def minimal_ST(study: Study) -> Checks:
    """The growth of ST from the smallest to the largest L_d is of the order of 1e-3."""
    for channel in ("s_chi", "s_gamma"):
        growth = study.growth_of_ST(channel)
        label = f"largest growth of ST of {channel} from L_d = 0.1 to 0.3 [rad]"
        yield Check(label, "of the order of 1e-3", growth, growth < ORDER_OF_1E3)


def insensitive_ST(study: Study) -> Checks:
    """ST does not rise by half or more from the lowest omega_d to the highest, at any L_d."""
    for channel in ("s_chi", "s_gamma"):
        table = study.of_disturbances(channel, "ST_rad")
        rise = table.iloc[:, -1] / table.iloc[:, 0] - 1.0
        count = int((rise >= PRONOUNCED).sum())
        label = f"amplitudes at which ST of {channel} rises by half or more with ω_d"
        yield Check(label, "0 of 3", f"{count} of 3, largest {rise.max():+.0%}", count == 0)
