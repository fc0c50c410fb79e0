"""Every distribution against the CDF that scipy gives for it."""

import math

import numpy as np
import pytest
from scipy import stats

from flighttune.campaigns.planning import draws
from flighttune.campaigns.planning.schema import DISTRIBUTIONS, truncated_quantiles

POINTS = 4000
CHANCE = 1e-3
"""Smallest p-value that a fixed seed may have."""


def drawn(kind, **keys):
    return DISTRIBUTIONS[kind](key="flight.h_m", **keys)


def normal(mean, sd, **bounds):
    return drawn("normal", mean=mean, sd=sd, **bounds)


CONTINUOUS = [
    (normal(25.0, 1.5), stats.norm(25.0, 1.5)),
    (normal(1.0, 0.1, lower=0.9, upper=1.3), stats.truncnorm(-1.0, 3.0, loc=1.0, scale=0.1)),
    (normal(0.0, 2.0, lower=-1.0), stats.truncnorm(-0.5, math.inf, loc=0.0, scale=2.0)),
    (normal(0.0, 2.0, lower=9.0), stats.truncnorm(4.5, math.inf, loc=0.0, scale=2.0)),
    (normal(3.0, 2.0, upper=1.0), stats.truncnorm(-math.inf, -1.0, loc=3.0, scale=2.0)),
    (drawn("log_normal", median=1.1, sd_log=0.2), stats.lognorm(0.2, scale=1.1)),
    (drawn("uniform", lower=-3.0, upper=5.0), stats.uniform(-3.0, 8.0)),
]
NAMES = [str(distribution) for distribution, _ in CONTINUOUS]


@pytest.mark.parametrize(("distribution", "known"), CONTINUOUS, ids=NAMES)
def test_values_are_those_of_scipy_and_a_campaign_is_checked_at_the_median(distribution, known):
    u = np.linspace(0.001, 0.999, 501)
    outermost = distribution.at(np.array([draws.SMALLEST_POINT, draws.LARGEST_POINT]))
    low, high = known.support()

    assert known.cdf(distribution.at(u)) == pytest.approx(u, abs=1e-9)
    assert distribution.central == pytest.approx(known.median(), rel=1e-9)
    assert np.isfinite(outermost).all()
    assert ((low <= outermost) & (outermost <= high)).all()


def test_choices_come_as_often_as_they_weigh():
    weights = [1.0, 0.0, 3.0, 4.0]
    u = np.random.default_rng(5).random(POINTS)
    values = drawn("choice", values=["a", "b", "c", "d"], weights=weights).at(u)
    counts = [int(np.sum(values == name)) for name in "abcd"]
    expected = [POINTS * weight / 8.0 for weight in weights if weight]

    assert counts[1] == 0
    assert stats.chisquare([counts[0], *counts[2:]], expected).pvalue > CHANCE


@pytest.mark.parametrize(
    ("values", "kind"),
    [([3, 4, 6], "i"), ([1, 2.5], "f"), ([True, False], "b"), (["light", "severe"], "O")],
)
def test_choices_keep_their_kind(values, kind):
    chosen = drawn("choice", values=values).at(np.array([0.1, 0.9]))

    assert chosen.dtype.kind == kind
    assert chosen.tolist() == [values[0], values[-1]]


def test_a_poison_is_not_what_a_choice_is_checked_at():
    assert drawn("choice", values=[math.nan, 25.0, 26.0], weights=[9.0, 1.0, 2.0]).central == 26.0
    assert math.isnan(drawn("choice", values=[math.nan]).central)


def test_the_cells_of_a_grid_share_the_unit_interval():
    grid = drawn("grid", values=[18.0, 22.0, 30.0])

    assert grid.at((np.arange(3) + 0.5) / 3).tolist() == grid.values
    assert grid.at(np.array([draws.SMALLEST_POINT, draws.LARGEST_POINT])).tolist() == [18.0, 30.0]
    assert grid.central == 22.0


@pytest.mark.parametrize("a", [-math.inf, -3.0, -0.5, 0.0, 4.0])
@pytest.mark.parametrize("width", [0.4, 2.0, 8.0, math.inf])
def test_truncated_draws_are_those_of_scipy_to_the_bit(a, width):
    u, b = np.linspace(0.0, 1.0, 101)[1:-1], (-1.0 if a == -math.inf else a) + width

    assert (truncated_quantiles(u, a, b) == stats.truncnorm.ppf(u, a, b)).all()
