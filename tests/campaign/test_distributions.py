"""Every distribution against the CDF that scipy gives for it."""

import math

import numpy as np
import pytest
from scipy import stats

from flighttune.campaign.planning.distributions import (
    LARGEST_POINT,
    SMALLEST_POINT,
    Choice,
    Grid,
    LogNormal,
    Normal,
    Uniform,
)

POINTS = 4000
CHANCE = 1e-3
"""Smallest p-value that a fixed seed may have."""
ROUNDING = 1e-12

CONTINUOUS = [
    (Normal(25.0, 1.5), stats.norm(25.0, 1.5)),
    (Normal(1.0, 0.1, lower=0.9, upper=1.3), stats.truncnorm(-1.0, 3.0, loc=1.0, scale=0.1)),
    (Normal(0.0, 2.0, lower=-1.0), stats.truncnorm(-0.5, math.inf, loc=0.0, scale=2.0)),
    (Normal(0.0, 2.0, lower=9.0), stats.truncnorm(4.5, math.inf, loc=0.0, scale=2.0)),
    (Normal(3.0, 2.0, upper=1.0), stats.truncnorm(-math.inf, -1.0, loc=3.0, scale=2.0)),
    (LogNormal(1.1, 0.2), stats.lognorm(0.2, scale=1.1)),
    (Uniform(-3.0, 5.0), stats.uniform(-3.0, 8.0)),
]
NAMES = [str(distribution) for distribution, _ in CONTINUOUS]


@pytest.mark.parametrize(("distribution", "known"), CONTINUOUS, ids=NAMES)
def test_draws_follow_the_cdf_of_scipy(distribution, known):
    u = np.random.default_rng(3).random(POINTS)

    assert stats.kstest(distribution.at(u), known.cdf).pvalue > CHANCE


@pytest.mark.parametrize(("distribution", "known"), CONTINUOUS, ids=NAMES)
def test_the_cdf_of_a_value_is_the_point_it_came_from(distribution, known):
    u = np.linspace(0.001, 0.999, 501)

    assert known.cdf(distribution.at(u)) == pytest.approx(u, abs=1e-9)


@pytest.mark.parametrize(("distribution", "known"), CONTINUOUS, ids=NAMES)
def test_what_a_campaign_is_checked_at_is_the_median(distribution, known):
    assert distribution.central == pytest.approx(known.median(), rel=1e-9)


@pytest.mark.parametrize(("distribution", "known"), CONTINUOUS, ids=NAMES)
def test_the_outermost_points_give_finite_values_inside_the_bounds(distribution, known):
    values = distribution.at(np.array([SMALLEST_POINT, LARGEST_POINT]))
    low, high = known.support()

    assert np.isfinite(values).all()
    assert (values >= low).all()
    assert (values <= high).all()


def test_choices_come_as_often_as_they_weigh():
    weights = (1.0, 0.0, 3.0, 4.0)
    u = np.random.default_rng(5).random(POINTS)
    values = Choice(("a", "b", "c", "d"), weights).at(u)
    counts = [int(np.sum(values == name)) for name in "abcd"]
    expected = [POINTS * weight / 8.0 for weight in weights if weight]

    assert counts[1] == 0
    assert stats.chisquare([counts[0], *counts[2:]], expected).pvalue > CHANCE


@pytest.mark.parametrize(
    ("values", "kind"),
    [((3, 4, 6), "i"), ((1, 2.5), "f"), ((True, False), "b"), (("light", "severe"), "O")],
)
def test_choices_keep_their_kind(values, kind):
    drawn = Choice(values, (1.0,) * len(values)).at(np.array([0.1, 0.9]))

    assert drawn.dtype.kind == kind
    assert drawn.tolist() == [values[0], values[-1]]


def test_a_poison_is_not_what_a_choice_is_checked_at():
    assert Choice((math.nan, 25.0, 26.0), (9.0, 1.0, 2.0)).central == 26.0
    assert math.isnan(Choice((math.nan,), (1.0,)).central)


def test_the_cells_of_a_grid_share_the_unit_interval():
    values = (18.0, 22.0, 30.0)

    assert Grid(values).at((np.arange(3) + 0.5) / 3).tolist() == list(values)
    assert Grid(values).at(np.array([SMALLEST_POINT, LARGEST_POINT])).tolist() == [18.0, 30.0]
    assert Grid(values).central == 22.0
