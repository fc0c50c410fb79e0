"""Claims of the abstract."""

import math

import numpy as np

from flighttune.paper.claims.base import Checks, at_least, at_most
from flighttune.paper.claims.thresholds import AS_GOOD, CORRELATED, SETTLED
from flighttune.paper.flight import decay_rate
from flighttune.paper.parameters import STAR
from flighttune.paper.study import Study, rank_correlation


def exponential_stabilisation(study: Study) -> Checks:
    """Without disturbance the state decays exponentially, at the rate the theory says."""
    flight = study.undisturbed
    s = np.hypot(flight.channels["s_chi"], flight.channels["s_gamma"])
    late = flight.t >= 10.0  # the commands have left their ranges for the last time
    rate = decay_rate(flight.t[late], s[late])
    yield at_most("part of |s| left after 20 s, no disturbance", float(s[-1] / s[0]), SETTLED)
    half = study.indicators[STAR].R_K / 2.0
    yield at_least("decay of |s| from 10 s on [1/s]", rate, half, symbol="R_K/2")


def optimal_controller(study: Study) -> Checks:
    """No gains with the same I_K have a higher R_K."""
    best = study.optimum.R_K
    share = study.indicators[STAR].R_K / best if best else math.nan
    yield at_least("R_K over the best without input constraints [1]", share, 1.0 - AS_GOOD)


def assesses_performance(study: Study) -> Checks:
    """R_K orders the gain sets as each measure of performance does."""
    R_K = study.indicator("R_K")
    errors, sums = ("chi", "gamma"), ("s_chi", "s_gamma")
    for measure, channels in (
        ("ITAE", errors),
        ("MO_rad", errors),
        ("PT_s", errors),
        ("MS_rad", sums),
        ("ST_rad", sums),
    ):
        for channel in channels:
            correlation = rank_correlation(R_K, study.of_gains(channel, measure))
            what = f"rank correlation of R_K and {measure.split('_')[0]} of {channel}"
            yield at_most(what, correlation, -CORRELATED)
