"""Claims of the abstract."""

import math
from collections.abc import Iterator

import numpy as np

from flighttune.paper.claims.base import Check, Claim, at_least, at_most, nothing
from flighttune.paper.flight import decay_rate
from flighttune.paper.parameters import STAR
from flighttune.paper.study import Study, rank_correlation

SETTLED = 0.01
"""Part of the first state that may be left of it without disturbance after 20 s."""

STRONG = 0.9
"""A rank correlation of this size over the seven gain sets is called an assessment."""

AS_GOOD = 1e-3
"""Relative distance from the best R_K within which gains count as the optimum."""


def stabilises(study: Study) -> Iterator[Check]:
    """Without disturbance the state decays exponentially, at the rate the theory says."""
    flight = study.undisturbed
    s = np.hypot(flight.channels["s_chi"], flight.channels["s_gamma"])
    late = flight.t >= 10.0
    rate = decay_rate(flight.t[late], s[late])
    yield at_most("part of |s| left after 20 s, no disturbance", float(s[-1] / s[0]), SETTLED)
    half = study.indicators[STAR].R_K / 2.0
    yield Check("decay of |s| from 10 s on [1/s]", f"≥ R_K/2 = {half:.4g}", rate, rate >= half)


def assesses(study: Study) -> Iterator[Check]:
    """R_K orders the gain sets as each measure of performance does."""
    R_K = study.indicator("R_K")
    for measure, channels in (
        ("ITAE", ("chi", "gamma")),
        ("MO_rad", ("chi", "gamma")),
        ("PT_s", ("chi", "gamma")),
        ("MS_rad", ("s_chi", "s_gamma")),
        ("ST_rad", ("s_chi", "s_gamma")),
    ):
        for channel in channels:
            found = rank_correlation(R_K, study.of_gains(channel, measure))
            name = f"rank correlation of R_K and {measure.split('_')[0]} of {channel}"
            yield Check(name, f"≤ {-STRONG:g}", found, found <= -STRONG)


def is_optimal(study: Study) -> Iterator[Check]:
    """No gains with the same I_K have a higher R_K."""
    best = study.optimum.R_K
    yield at_least(
        "R_K over the best without input constraints [1]",
        study.indicators[STAR].R_K / best if best else math.nan,
        1.0 - AS_GOOD,
    )


CLAIMS = (
    Claim(
        id="exponential-stabilisation",
        text="the controller achieves effective exponential stabilisation",
        where="abstract",
        checks=stabilises,
    ),
    Claim(
        id="exceptional-robustness",
        text="it exhibits exceptional robustness",
        where="abstract",
        checks=nothing,
        missing="no measure of robustness and no other controller is given to compare with",
    ),
    Claim(
        id="optimal-controller",
        text="an optimal robust MIMO-PI controller is developed",
        where="abstract; contributions, third item",
        checks=is_optimal,
    ),
    Claim(
        id="assesses-performance",
        text="the indicator can effectively assess comprehensive performance",
        where="abstract",
        checks=assesses,
    ),
)
