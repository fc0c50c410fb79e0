"""Every checkable sentence of the abstract and of sections 2 to 5, with the verdict on it.

``claims.toml`` has the sentences with the required numbers. To add a sentence, put it there, and
put the function that computes its number, with the same name, into this module.
"""

import math
import operator
import tomllib
from collections.abc import Callable, Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray
from flighttune.base.words import number
from flighttune.control.linear_model import closed_loop
from flighttune.control.theory.indicators import Indicators, indicators
from flighttune.control.theory.lyapunov import common_Q, lyapunov_solution, paper_balls
from flighttune.control.theory.reachable import largest_outputs
from flighttune.flight.gains import tune
from flighttune.studies.paper import parameters as printed
from flighttune.studies.paper.duffing import Duffing
from flighttune.studies.paper.flight import NEAR, decay_rate, largest_share, oscillations
from flighttune.studies.paper.study import Study, rank_correlation
from flighttune.vehicles.plants.point_mass import turn_rates

Verdict: TypeAlias = Literal["reproduced", "partly", "not reproduced", "not checkable"]

VERDICTS: tuple[Verdict, ...] = ("reproduced", "partly", "not reproduced", "not checkable")

# In the order of the paper, by short name: the sentence, its place and its check.
CLAIMS: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("claims.toml").read_text(encoding="utf-8")
)

# Numbers assumed for words of the paper, each with its reason.
WORDS: dict[str, float] = {"near": NEAR, **CLAIMS.pop("words")}

# Jacobians, or a rate and zero, within this distance count as equal: the error of central
# differences with a step of 1e-6, for which rounding and curvature are about equal.
DERIVATIVE, SMALL_STEP = 1e-8, 1e-6

# Number of random matrices to test a lemma
SAMPLES = 200

# A smaller excess of a limited command over its limit counts as rounding.
ROUNDING = 1e-9

RELATIONS = {"≤": operator.le, "<": operator.lt, "≥": operator.ge, ">": operator.gt}

# Columns of measures by their names in the paper.
MEASURES = {"MO": "MO_rad", "PT": "PT_s", "MS": "MS_rad", "|MS|": "MS_rad", "ST": "ST_rad"}


class Check(NamedTuple):
    """One comparison."""

    label: str  # compared quantity, with its unit
    expected: str | float  # what the paper says
    computed: str | float  # computed value
    holds: bool  # whether the two agree


Checks: TypeAlias = Iterator[Check]


class Finding(NamedTuple):
    """A sentence of the paper with its comparisons."""

    id: str
    text: str  # the sentence, shortened
    where: str  # its place in the paper
    checks: tuple[Check, ...]
    missing: str = ""  # the missing piece if there are no comparisons

    @property
    def verdict(self) -> Verdict:
        """Reproduced if all comparisons agree, partly if some do."""
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
    """Make the comparisons of a claim with the numbers of a study."""
    entry = dict(CLAIMS[name])
    claim = {key: entry.pop(key) for key in ("text", "where", "missing") if key in entry}
    checks: list[Check] = []
    if "missing" not in claim:
        function = globals()[entry.pop("check", name).replace("-", "_")]
        label, must, expected = (entry.pop(key, "") for key in ("label", "must", "expected"))
        lists = {key: values for key, values in entry.items() if isinstance(values, list)}
        for values in product(*lists.values()):
            arguments = entry | dict(zip(lists, values, strict=True))
            result = function(study, **arguments)
            if must.endswith(" rise"):
                checks.append(_rise(label.format(**arguments), result, must))
            elif must:
                relation, limit = must.format(study=study, printed=printed, **WORDS).split()
                named = label.format(**arguments)
                checks.append(_compare(named, float(result), relation, float(limit), expected))
            else:
                checks += result
    return Finding(id=name, checks=tuple(checks), **claim)


def text_of(value: str | float) -> str:
    """An expected or computed value for a table: a number with five digits."""
    return value if isinstance(value, str) else number(value, ".5g")


def _compare(label: str, value: float, relation: str, limit: float, expected: str = "") -> Check:
    """`value` against a limit; `expected`: words of the paper, by default the limit."""
    said = expected or f"{relation} {limit:.4g}"
    return Check(label, said, float(value), bool(RELATIONS[relation](value, limit)))


def _rise(label: str, steps: FloatArray, must: str) -> Check:
    """Steps between neighbours, all or most of which must rise."""
    rising, count = int((steps > 0.0).sum()), steps.size
    holds = rising == count if must == "all rise" else 2 * rising > count
    asked = count if must == "all rise" else "most"
    return Check(label, f"{asked} of {count} steps", f"{rising} of {count} steps", holds)


# The abstract


def exponential_stabilisation(study: Study) -> Checks:
    """Without disturbance the state decays exponentially, at the theoretical rate."""
    flight, half = study.undisturbed, study.indicators[printed.STAR].R_K / 2.0
    s = np.hypot(flight.channels["s_chi"], flight.channels["s_gamma"])
    late = flight.t >= 10.0  # the commands have left their ranges for the last time
    rate = decay_rate(flight.t[late], s[late])
    label = "part of |s| left after 20 s, no disturbance"
    yield _compare(label, s[-1] / s[0], "≤", WORDS["settled"])
    yield _compare("decay of |s| from 10 s on [1/s]", rate, "≥", half, f"≥ R_K/2 = {half:.4g}")


def optimal_controller(study: Study) -> float:
    """R_K relative to the highest R_K of all gains with the same I_K."""
    best = study.optimum.R_K
    return study.indicators[printed.STAR].R_K / best if best else math.nan


def _eigenfrequencies(study: Study) -> pd.Series:
    """The largest imaginary part of the eigenvalues of each gain set."""
    eigenvalues = (study.indicators[name].eigenvalues for name in study.from_high_to_low)
    return pd.Series([float(np.max(values.imag)) for values in eigenvalues])


# Quantities of the loop of a gain set; all others are measures of its flight.
OF_LOOP: Mapping[str, Callable[[Study], pd.Series]] = {
    "the spectral abscissa": lambda study: study.indicator("spectral_abscissa"),
    "eigenfrequency": _eigenfrequencies,
}


def _of_gain_sets(study: Study, of: str) -> pd.Series:
    """A quantity of the gain sets, from the highest R_K to the lowest, such as ``ITAE of chi``."""
    if of_loop := OF_LOOP.get(of):
        return of_loop(study)
    measure, _, channel = of.partition(" of ")
    return study.of_gains(channel.removeprefix("e_"), MEASURES.get(measure, measure)).abs()


def rank_with_R_K(study: Study, of: str) -> float:
    """Rank correlation of R_K and a quantity over the gain sets."""
    return rank_correlation(study.indicator("R_K"), _of_gain_sets(study, of))


def lower_with_higher_R_K(study: Study, of: str) -> FloatArray:
    """Steps of a quantity from one gain set to the next, from the highest R_K to the lowest."""
    return np.diff(_of_gain_sets(study, of))


# Sections 2 to 4, the theory


def _random_matrices() -> FloatArray:
    """Square matrices of four states, shape (`SAMPLES`, 4, 4)."""
    return np.random.default_rng(0).standard_normal((SAMPLES, 4, 4))


def lemma_1(_: Study) -> Checks:
    """P exists for stable matrices; with an eigenvalue 0 the equation has no solution."""
    A = _random_matrices()
    A = A - (np.linalg.eigvals(A).real.max(axis=-1) + 0.1)[:, None, None] * np.eye(4)
    positive = int((np.linalg.eigvalsh(lyapunov_solution(A))[:, 0] > 0.0).sum())
    yield Check("stable matrices with a P > 0", SAMPLES, positive, positive == SAMPLES)
    # v' (P A + A' P + I) v = v' v > 0 if A v = 0, for any P.
    A = np.diag([0.0, -1.0])
    basis = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]])
    columns = (basis @ A + A.T @ basis).reshape(3, -1).T
    nearest = np.linalg.lstsq(columns, -np.eye(2).ravel())[0]
    norm = np.linalg.norm(columns @ nearest + np.eye(2).ravel())
    yield _compare("smallest norm of P A + Aᵀ P + I, A = diag(0, -1)", float(norm), "≤", ROUNDING)


def lemma_2(_: Study) -> float:
    """Weyl's inequality for random matrices."""
    A, change = _random_matrices(), _random_matrices()[::-1]
    A, change = A + A.mT, change + change.mT
    moved = np.linalg.eigvalsh(A + change)[:, -1] - np.linalg.eigvalsh(A)[:, -1]
    return np.max(np.abs(moved) / np.linalg.norm(change, 2, axis=(1, 2)))


def lemma_3(study: Study) -> float:
    """The Jacobian of the Duffing oscillator in the disc of the stated smoothness."""
    model = study.duffing.model
    x1 = np.linspace(-1.0, 1.0, 201)
    J = model.jacobian(np.stack([x1, np.zeros(x1.size)], axis=-1))
    top = np.linalg.eigvalsh(J + J.mT)[:, -1]
    away = x1 != 0.0
    return (np.abs(top - top[100])[away] / (2.0 * model.smoothness(1.0) * np.abs(x1[away]))).max()


def lemma_4(study: Study) -> float:
    """Differences of the Duffing oscillator, which is A(x) x, at the origin."""
    model, step = study.duffing.model, SMALL_STEP * np.eye(2)
    differences = (model.rates(step) - model.rates(-step)).T / (2.0 * SMALL_STEP)
    return np.max(np.abs(differences - model.jacobian(np.zeros(2))))


def _slowest_decay(start: float) -> tuple[FloatArray, FloatArray]:
    """Time and √V of ``V' = -V + √V``, for which Lemma 5 with α = β = 1 is an equality."""
    from scipy.integrate import solve_ivp

    t = np.linspace(0.0, 10.0, 101)
    run = solve_ivp(
        lambda _, V: -V + np.sqrt(V), (0.0, 10.0), [start], t_eval=t, rtol=1e-10, atol=1e-13
    )
    return t, np.sqrt(run.y[0])


def lemma_5(_: Study, V_0: float) -> float:
    """The bound along the motion that makes the inequality an equality."""
    t, root = _slowest_decay(V_0)
    return np.max(root / (1.0 + (math.sqrt(V_0) - 1.0) * np.exp(-0.5 * t)))


def lemma_5_rate(_: Study) -> float:
    """The decay of √V - β/α along the same motion."""
    t, root = _slowest_decay(9.0)
    return decay_rate(t, root - 1.0)


def _stable_loops(study: Study) -> Iterator[tuple[FloatArray, Indicators, FloatArray]]:
    """A_K, indicators and eigenvalues of Q for each stabilising gain set."""
    for name, gains in study.gains.items():
        row = study.indicators[name]
        if row.Q is not None:
            values: FloatArray = np.asarray(np.linalg.eigvalsh(row.Q), dtype=float)
            yield closed_loop(study.model, gains), row, values


def theorem_1(study: Study) -> float:
    """The bound against the largest ``f = A_K s`` under disturbances of the linear loops."""
    ratios = []
    for A, _, values in _stable_loops(study):
        bound = 2.0 * np.linalg.norm(A, 2) * values[-1] ** 2 / values[0]
        ratios.append(float(largest_outputs(A[None], A, np.eye(len(A)))[0].max() / bound))
    return max(ratios, default=math.inf)


def theorem_1_sufficient(study: Study) -> Checks:
    """One P for the Jacobians of the Duffing oscillator, which are all stable."""
    J = study.duffing.model.jacobian(np.array([[0.0, 0.0], [20.0, 0.0]]))
    stable = np.linalg.eigvals(J).real.max()
    yield _compare("largest real part of the Jacobians at x1 = 0 and 20 [1/s]", stable, "<", 0.0)
    yield _compare("rate of a P for both [1/s]", common_Q(J).R, ">", 0.0)


def theorem_2(study: Study) -> Checks:
    """The largest error under disturbances, relative to the ball for each reading of L_f."""
    star, A_K = study.indicators[printed.STAR], closed_loop(study.model, study.star)
    balls = paper_balls(A_K, study.model.A, I_K=star.I_K, L_d=1.0)
    names = "‖A_K‖", "‖∂f/∂x + ∂f/∂u K_P‖", "‖∂f/∂x‖"
    for name, ball in zip(names, balls.tolist(), strict=True):
        label = f"largest |e_i| of K* over the ball, L_f = {name} [1]"
        yield _compare(label, star.E_K / ball, "≤", 1.0)


def theorem_2_rate(study: Study) -> float:
    """The decay of the norm of s relative to R_K, for the slowest of the seven sets."""
    decays = (-row.spectral_abscissa / row.R_K for _, row, _ in _stable_loops(study))
    return min(decays, default=0.0)


def global_stabilisation(study: Study) -> Checks:
    """The manoeuvre without any limits with K*, which stabilises the linearised loop."""
    status = study.readings["no limits"].status
    yield Check("manoeuvre without limits", "converges", status, status != "diverged")


def larger_attractor(study: Study) -> Checks:
    """Steps to a higher R_K at which the largest possible error grows."""
    steps = -np.diff(study.indicator("E_K").loc[study.from_high_to_low])
    rising, count = int((steps > 0.0).sum()), len(steps)
    label = "steps to a higher R_K that raise the largest possible error"
    yield Check(label, f"≥ 1 of {count}", f"{rising} of {count}", rising > 0)


def three_factors(study: Study) -> float:
    """The printed R_K and I_K multiplied, against the other two factors of the printed gains."""
    off = []
    for name, pair in printed.TABLE_2.items():
        row = study.indicators[name]
        sigma_min = np.linalg.svd(closed_loop(study.model, study.gains[name]), compute_uv=False)[-1]
        product = math.inf if row.Q is None else np.linalg.cond(np.array(row.Q)) / sigma_min
        off.append(abs(math.prod(pair) / product - 1.0) / (printed.last_digits(name) / pair).sum())
    return max(off)


def eigenvalue_problem(study: Study) -> float:
    """R_K by semidefinite programming, relative to R_K by the Lyapunov equation."""
    off = [abs(common_Q(A[None]).R / row.R_K - 1.0) for A, row, _ in _stable_loops(study)]
    return max(off, default=math.inf)


# Section 5.1, the Duffing oscillator


def duffing_condition(_: Study) -> Checks:
    """The origin is stable if and only if alpha and delta are positive."""
    grid = list(product((-2.0, -0.5, 0.5, 1.0, 3.0), repeat=2))
    J = [Duffing(alpha=a, beta=0.0, delta=d).jacobian(np.zeros(2)) for a, d in grid]
    stable = np.linalg.eigvals(np.array(J)).real.max(axis=-1) < 0.0
    agreeing = int(np.sum(stable == (np.array(grid) > 0.0).all(axis=1)))
    yield Check("points of a grid that agree", len(grid), agreeing, agreeing == len(grid))


def duffing_bound(study: Study, under: str) -> float:
    """|f(x)| relative to its printed bound over time, under mild and hard disturbances."""
    case = study.duffing.disturbed[under]
    return np.max(case.norm_f / case.bound_over_time[:, None])


def duffing_attractor(study: Study, under: str) -> float:
    """|f(x)| in the last quarter, which must be inside S(0)."""
    case = study.duffing.disturbed[under]
    return case.norm_f[case.t >= 0.75 * case.t[-1]].max()


def duffing_rate(study: Study) -> Checks:
    """|f(x)| decays at R(f) without disturbance: in (a), and for other alpha and delta."""
    case = study.duffing.undisturbed
    late = case.t >= 5.0  # the cubic stiffness has died away
    rate, (R_f, _) = decay_rate(case.t[late], case.norm_f[late, 0]), case.theorem
    yield _compare("decay of |f| in (a) [1/s]", rate, "≥", R_f, f"≥ R(f) = {R_f:.4g}")
    slowest = study.duffing.slowest_decay
    yield _compare("smallest decay over R(f), 30 oscillators [1]", slowest, "≥", 1.0)


def duffing_everywhere(study: Study, under: str) -> float:
    """Every reached state satisfies the condition of the theorem for the chosen P."""
    return study.duffing.disturbed[under].farthest


# Sections 5.2 and 5.2.1, K*


def _error_rates(z: FloatArray) -> FloatArray:
    """f_e at z = (e_chi, e_gamma, phi, n_z)."""
    return -np.array(turn_rates(printed.V_A, printed.GAMMA_C - z[1], z[2], z[3], g=printed.G))


def jacobians(study: Study) -> Checks:
    """The printed Jacobians belong to the law, and the printed equilibrium is an equilibrium."""
    steady = np.array([0.0, 0.0, 0.0, np.cos(printed.GAMMA_C)])
    differences = np.column_stack(
        [
            (_error_rates(steady + step) - _error_rates(steady - step)) / (2.0 * SMALL_STEP)
            for step in SMALL_STEP * np.eye(4)
        ]
    )
    off = np.max(np.abs(differences - np.hstack([study.model.A, study.model.B])))
    yield _compare("largest distance of the Jacobians from differences", off, "≤", DERIVATIVE)
    rate = np.linalg.norm(_error_rates(steady / printed.G))
    yield _compare("rate of the error at n_z = cos(γ_c)/g [rad/s]", float(rate), "≤", DERIVATIVE)


def printed_indicators(study: Study, name: str) -> Checks:
    """R_K and I_K follow from the printed gains, to one unit of the last printed digit."""
    row, pair, digits = study.indicators[name], printed.INDICATORS[name], printed.last_digits(name)
    of = "*" if name == printed.STAR else f" of {name}"
    for key, unit, says, digit in zip(("R_K", "I_K"), ("1/s", "s²"), pair, digits, strict=True):
        value = getattr(row, key)
        yield Check(f"{key}{of} [{unit}]", says, value, bool(abs(value - says) <= digit))


def star_feasible(study: Study) -> float:
    """K* is feasible in the optimisation model: every command and rate at t_0 is in its range."""
    return largest_share(study.star)


def star_optimal(study: Study) -> Checks:
    """K* has the highest R_K of all gains that meet the constraints."""
    result, bound = study.constrained, f"{printed.I_STAR:g}"
    label = f"smallest I_K within the input constraints [s²], I* = {bound}"
    yield Check(label, f"≤ {bound}", result.I_K, result.status == "optimal")
    best, R_K = study.optimum.R_K, study.indicators[printed.STAR].R_K
    label = "R_K* against the best without input constraints [1/s]"
    yield Check(label, f"{best:.5g}", R_K, R_K >= WORDS["as_good"] * best)


def eigenvalues(study: Study) -> float:
    """All eigenvalues of A_K(0) have a negative real part."""
    return study.indicators[printed.STAR].spectral_abscissa


def small_region(study: Study, channel: str) -> float:
    """Both errors end in a very small region."""
    return study.flights[printed.STAR].after(channel, printed.DURATION)


def overshoot(study: Study, channel: str) -> float:
    """Maximum overshoot of an error."""
    return study.flights[printed.STAR].peak(channel)[0]


def peak_time(study: Study) -> Checks:
    """The later of both peaks, which is the maximum in the sentence."""
    peaks = {channel: study.flights[printed.STAR].peak(channel)[1] for channel in ("chi", "gamma")}
    channel, latest = max(peaks.items(), key=lambda peak: peak[1])
    yield _compare(f"largest PT, that of e_{channel} [s]", latest, "<", printed.LARGEST_PEAK_TIME)


def peak_time_gamma(study: Study) -> float:
    """The peak of the path-angle error alone."""
    return study.flights[printed.STAR].peak("gamma")[1]


def commands(study: Study, signal: str, limit: str, of: str) -> Checks:
    """Limited roll and load factor stay in their ranges, by construction of the simulation."""
    largest = np.max(np.abs(getattr(study.flights[printed.STAR], signal)), axis=0)
    limits = getattr(printed.printed_limits(), limit) + ROUNDING
    for name, value, most in zip(("φ", "n_z"), largest, limits, strict=True):
        yield _compare(of.format(name), value, "≤", most)


def converges_with_all_limits(study: Study, channel: str) -> float:
    """With both ranges and rate limits, as in Table 1, the errors still converge."""
    flight = study.readings["ranges and rate limits"]
    return flight.after(channel, flight.t[-1] - 2.0)


# Section 5.2.2, K1 to K6


def small_R_oscillates(study: Study, channel: str) -> Checks:
    """The smallest R_K crosses zero more often than the largest, and ends farther away."""
    high, *_, low = (study.flights[name] for name in study.from_high_to_low)
    few, many = (oscillations(flight.channels[channel]) for flight in (high, low))
    yield Check(
        f"zero crossings of e_{channel}, lowest R_K", f"> {few} of the highest", many, many > few
    )
    near, far = (float(flight.measures.loc[channel, "ST_rad"]) for flight in (high, low))
    label = f"ST of e_{channel}, lowest R_K [rad]"
    yield Check(label, f"> {near:.3g} of the highest", far, far > near)


def R_more_than_I(study: Study, of: str) -> Checks:
    """R_K orders convergence and steady error better than I_K does."""
    values = _of_gain_sets(study, of)
    by_R, by_I = (abs(rank_correlation(study.indicator(key), values)) for key in ("R_K", "I_K"))
    yield Check(f"|rank correlation| of R_K and {of}", f"> {by_I:.3g} of I_K", by_R, by_R > by_I)


def minor_means(study: Study, channel: str) -> float:
    """The mean rate of error differs by some 1e-3 over the gain sets."""
    return np.ptp(study.of_gains(channel, "mean"))


def inverse_deviation(study: Study, channel: str) -> Checks:
    """The deviation of the rates of error is roughly proportional to 1 / R_K."""
    values = study.of_gains(channel, "std")
    R_K = study.indicator("R_K").loc[values.index].to_numpy()
    label = f"correlation of 1/R_K and the deviation of {channel}"
    yield _compare(label, np.corrcoef(1.0 / R_K, values)[0, 1], "≥", WORDS["inverse"])
    yield _rise(f"deviation of {channel} lower with higher R_K", np.diff(values), "all rise")


def overall_enhancement(_: Study) -> Checks:
    """Behind an identified lag the gains of the largest R_K decay fastest and err least."""
    loops = {}
    for objective in ("R_K", "decay", "E_K"):
        changes = {"tuning.model": "identified", "tuning.objective": objective}
        result = tune("mission", changes={"law": "paper", **changes})
        assert result.gains is not None  # lags of the shipped aircraft
        loop = closed_loop(result.problem.model, result.gains)
        loops[objective] = indicators(loop, errors=len(result.gains.errors))
    R_K = loops["R_K"]
    share = R_K.spectral_abscissa / loops["decay"].spectral_abscissa
    yield _compare("rate of decay over the fastest, sensitivity at most 1.4", share, "≥", 1.0)
    share = loops["E_K"].E_K / R_K.E_K
    yield _compare("least E_K over its E_K, sensitivity at most 1.4", share, "≥", 1.0)


# Section 5.2.3, d1 to d9


def near_origin(study: Study, channel: str) -> Checks:
    """After 20 s the errors stay near the origin, for nearly all disturbances."""
    late, least = study.of_disturbances(channel, "after").to_numpy(), WORDS["nearly_all"]
    near = int((late < NEAR).sum())
    label = f"disturbances with |e_{channel}| < {NEAR:g} rad after 20 s"
    computed = f"{near} of 9, largest {late.max():.3g} rad"
    yield Check(label, f"≥ {least} of 9", computed, near >= least)


def steps_along(study: Study, measure: str, channel: str, way: str, along: str) -> FloatArray:
    """Steps of a measure along L_d or omega_d, signed so that steps in this `way` are positive."""
    table = study.of_disturbances(channel, measure).to_numpy()
    return np.diff(table if way == "rises" else -table, axis=("L_d", "ω_d").index(along))


def insensitive_ITAE(study: Study, L_d: float, channel: str) -> float:
    """For the stated L_d, ITAE does not rise significantly with omega_d."""
    row = study.of_disturbances(channel, "ITAE").loc[L_d]
    return row.max() / row.iloc[0] - 1.0


def decreasing_ITAE(study: Study, L_d: float, channel: str) -> float:
    """For the stated L_d, a straight line through ITAE over omega_d falls."""
    row = study.of_disturbances(channel, "ITAE").loc[L_d]
    omega = row.index.to_numpy(dtype=float)
    return np.polyfit(omega, row.to_numpy(), 1)[0] * np.ptp(omega) / row.iloc[0]


def linear_MS(study: Study, channel: str, omega_d: float) -> float:
    """MS follows a straight line in L_d for each omega_d."""
    column = study.of_disturbances(channel, "MS_rad")[omega_d]
    return np.corrcoef(column.index.astype(float), column)[0, 1] ** 2


def minimal_ST(study: Study, channel: str) -> float:
    """The growth of ST from the smallest to the largest L_d is of the order of 1e-3."""
    return study.growth_of_ST(channel)


def insensitive_ST(study: Study, channel: str) -> Checks:
    """ST does not rise by half or more from the lowest omega_d to the highest, at any L_d."""
    table = study.of_disturbances(channel, "ST_rad")
    rise = table.iloc[:, -1] / table.iloc[:, 0] - 1.0
    count = int((rise >= WORDS["pronounced"]).sum())
    label = f"amplitudes at which ST of {channel} rises by half or more with ω_d"
    yield Check(label, "0 of 3", f"{count} of 3, largest {rise.max():+.0%}", count == 0)
