"""The largest R_K for a bound on I_K: closed but for one root. docs/optimal.md derives it.

For C = I and plain units the optimum has equal channels, each of two numbers. No gains, coupled or
not, have a larger R_K: `flighttune.theory.rate_bound` proves it to any distance.
"""

import math
from functools import cache
from typing import NamedTuple

from flighttune.arrays import check_positive


class Channel(NamedTuple):
    """One channel ``A_K = [[-p, -q], [1, 0]]`` and its indicators."""

    R_K: float
    I_K: float
    p: float
    q: float


def least_radius(R_K: float) -> Channel:
    """The channel with the smallest I_K of all with this R_K, which is between 0 and 1.

    Notes
    -----
    With ``W = Q^-1`` and an angle theta, ``A = W (U - I)^-1`` for the rotation U by theta, so that
    ``W = [[a, cos(theta) - 1], [cos(theta) - 1, sin(theta)]]`` and ``sigma_min(A) = R_K / h`` with
    ``h = 2 sin(theta / 2)``. The eigenvalues of W are R_K and
    ``w = sin(theta) + h^4 / (4 (sin(theta) - R_K))``; ``I_K = w h / R_K^3``, ``p = (R_K + w) / 2``
    and ``q = R_K w / h^2``.
    """
    from scipy.optimize import minimize_scalar

    def parts(theta: float) -> tuple[float, float]:
        h = 2.0 * math.sin(theta / 2.0)
        return h, math.sin(theta) + h**4 / (4.0 * (math.sin(theta) - R_K))

    options = {"xatol": 1e-10}
    ends = math.asin(R_K), math.pi - math.asin(R_K)
    theta = minimize_scalar(
        lambda theta: math.prod(parts(theta)), bounds=ends, method="bounded", options=options
    ).x
    h, w = parts(theta)
    return Channel(R_K, w * h / R_K**3, (R_K + w) / 2.0, R_K * w / h**2)


@cache
def slowest_channel() -> Channel:
    """The channel with the smallest I_K of all: no smaller `I_star` can be met."""
    from scipy.optimize import minimize_scalar

    options = {"xatol": 1e-9}
    optimum = minimize_scalar(
        lambda R_K: least_radius(R_K).I_K, bounds=(0.2, 0.8), method="bounded", options=options
    )
    return least_radius(float(optimum.x))


def optimal_channel(I_star: float) -> Channel | None:
    """The channel with the largest R_K under ``I_K <= I_star``; None if no gains meet that."""
    from scipy.optimize import brentq

    check_positive(I_star=I_star)
    least = slowest_channel()
    if I_star < least.I_K:
        return None
    # I_K grows without bound towards R_K = 1: as (1 - R_K)^-1, so that the bracket is wide enough.
    fastest = 1.0 - 0.1 / max(I_star, 1.0)
    rate = brentq(
        lambda R_K: math.log(least_radius(R_K).I_K / I_star), least.R_K, fastest, xtol=1e-13
    )
    return least_radius(float(rate))
