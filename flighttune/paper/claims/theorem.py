"""Claims of section 5.1: Theorem 1 on the Duffing oscillator."""

from collections.abc import Iterator

import numpy as np

from flighttune.paper import parameters as printed
from flighttune.paper.claims.base import Check, Claim, at_most, nothing
from flighttune.paper.flight import decay_rate
from flighttune.paper.study import Study


def stable_where_said(_: Study) -> Iterator[Check]:
    """The origin is stable exactly where alpha and delta are positive."""
    values = np.array([-2.0, -0.5, 0.5, 1.0, 3.0])
    alpha, delta = map(np.ravel, np.meshgrid(values, values))
    J = np.zeros((alpha.size, 2, 2))
    J[:, 0, 1], J[:, 1, 0], J[:, 1, 1] = 1.0, -alpha, -delta
    stable = np.linalg.eigvals(J).real.max(axis=-1) < 0.0
    agreeing = int(np.sum(stable == ((alpha > 0.0) & (delta > 0.0))))
    yield Check("points of a grid that agree", alpha.size, agreeing, agreeing == alpha.size)


def stays_below_bound(study: Study) -> Iterator[Check]:
    """|f(x)| stays below the printed bound over time, under mild and hard disturbances."""
    cases = {"noise": study.duffing.noisy, **study.duffing.hard}
    for name, case in cases.items():
        ratio = float(np.max(case.norm_f / case.bound_over_time[:, None]))
        yield at_most(f"largest |f| over its bound, {name} [1]", ratio, 1.0)


def reaches_attractor(study: Study) -> Iterator[Check]:
    """In the last quarter |f(x)| is inside S(0)."""
    cases = {"noise": study.duffing.noisy, **study.duffing.hard}
    for name, case in cases.items():
        late = case.norm_f[case.t >= 0.75 * case.t[-1]]
        yield at_most(f"largest |f| in the last quarter, {name}", late.max(), case.theorem.radius)


def decays_at_rate(study: Study) -> Iterator[Check]:
    """|f(x)| decays at R(f) without disturbance: in (a), and for other alpha and delta."""
    case = study.duffing.undisturbed
    late = case.t >= 5.0
    rate = decay_rate(case.t[late], case.norm_f[late, 0])
    R_f = case.theorem.rate
    yield Check("decay of |f| in (a) [1/s]", f"≥ R(f) = {R_f:.4g}", rate, rate >= R_f)
    table = study.duffing.rates
    worst = float(np.min(table["decay"].to_numpy() / table["R_f"].to_numpy()))
    yield Check("smallest decay over R(f), 30 oscillators [1]", "≥ 1", worst, worst >= 1.0)


def holds_everywhere(study: Study) -> Iterator[Check]:
    """The states met lie where the condition of the theorem holds for the chosen P."""
    c = study.duffing.model.region
    for name, case in {"noise": study.duffing.noisy, **study.duffing.hard}.items():
        yield Check(f"largest |x1|, {name}", f"< {c:.4g}", case.farthest, case.farthest < c)


WHERE = "section 5.1"

CLAIMS = (
    Claim(
        id="duffing-condition",
        text="alpha > 0 and delta > 0 is the condition for a stable origin",
        where=f"{WHERE}, above the set S(0)",
        checks=stable_where_said,
    ),
    Claim(
        id="duffing-bound",
        text="the norm of f(x) stays below its exponential upper bound",
        where=f"{WHERE}, Fig. 3 (a)",
        checks=stays_below_bound,
    ),
    Claim(
        id="duffing-attractor",
        text="x(t) converges to S(0)",
        where=WHERE,
        checks=reaches_attractor,
    ),
    Claim(
        id="duffing-rate",
        text="at least the rate of ε(0)/λ_max(P(0))",
        where=WHERE,
        checks=decays_at_rate,
    ),
    Claim(
        id="duffing-everywhere",
        text="for any initial value, with the condition checked at the origin only",
        where="Theorem 1 and the remark after it, as used in section 5.1",
        checks=holds_everywhere,
    ),
    Claim(
        id="duffing-influence",
        text="R(f) and I(f) influence mean and deviation of |f(x)|",
        where=f"{WHERE}, Fig. 3 (b) to (d)",
        checks=nothing,
        missing=f"neither the sets of alpha and beta nor the noise nor a direction is printed; "
        f"{len(printed.DUFFING_ALPHAS)} oscillators of an assumed set are drawn",
    ),
)
