"""Claims of section 5.1: Theorem 1 on the Duffing oscillator."""

import numpy as np

from flighttune.paper.claims.base import (
    Check,
    Checks,
    at_least,
    at_most,
    below,
)
from flighttune.paper.duffing import DuffingCase
from flighttune.paper.flight import decay_rate
from flighttune.paper.study import Study


def _disturbed(study: Study) -> dict[str, DuffingCase]:
    """The printed oscillator under mild and hard disturbances, by name."""
    return {"noise": study.duffing.noisy, **study.duffing.hard}


def duffing_condition(_: Study) -> Checks:
    """The origin is stable exactly where alpha and delta are positive."""
    values = np.array([-2.0, -0.5, 0.5, 1.0, 3.0])
    alpha, delta = map(np.ravel, np.meshgrid(values, values))
    # Not `Duffing.jacobian`: an oscillator with an unstable origin is refused there.
    J = np.zeros((alpha.size, 2, 2))
    J[:, 0, 1], J[:, 1, 0], J[:, 1, 1] = 1.0, -alpha, -delta
    stable = np.linalg.eigvals(J).real.max(axis=-1) < 0.0
    agreeing = int(np.sum(stable == ((alpha > 0.0) & (delta > 0.0))))
    yield Check("points of a grid that agree", alpha.size, agreeing, agreeing == alpha.size)


def duffing_bound(study: Study) -> Checks:
    """|f(x)| stays below the printed bound over time, under mild and hard disturbances."""
    for name, case in _disturbed(study).items():
        ratio = float(np.max(case.norm_f / case.bound_over_time[:, None]))
        yield at_most(f"largest |f| over its bound, {name} [1]", ratio, 1.0)


def duffing_attractor(study: Study) -> Checks:
    """The claim that |f(x)| is inside S(0) in the last quarter."""
    for name, case in _disturbed(study).items():
        late = case.norm_f[case.t >= 0.75 * case.t[-1]]
        yield at_most(f"largest |f| in the last quarter, {name}", late.max(), case.theorem.radius)


def duffing_rate(study: Study) -> Checks:
    """|f(x)| decays at R(f) without disturbance: in (a), and for other alpha and delta."""
    case = study.duffing.undisturbed
    late = case.t >= 5.0  # the cubic stiffness has died away
    rate = decay_rate(case.t[late], case.norm_f[late, 0])
    yield at_least("decay of |f| in (a) [1/s]", rate, case.theorem.rate, symbol="R(f)")
    slowest = study.duffing.slowest_decay
    yield at_least("smallest decay over R(f), 30 oscillators [1]", slowest, 1.0)


def duffing_everywhere(study: Study) -> Checks:
    """Every state reached lies where the condition of the theorem holds for the chosen P."""
    region = study.duffing.model.region
    for name, case in _disturbed(study).items():
        yield below(f"largest |x1|, {name}", case.farthest, region)
