"""Claims from counts: the published sample sizes, and how often a claim is false."""

import numpy as np
import pytest
from scipy.stats import binomtest, hypergeom

import flighttune as ft
from flighttune.claims.count import (
    allowed_outside,
    chance_missed,
    counted_scale,
    flights_again,
    flights_needed,
    supported_epsilon,
)


def test_sample_sizes_are_the_published_ones():
    """Wilks' one-sided 95 % / 95 %, orders 1 to 5: table of A. Guba, M. Makai and L. Pal (2003)."""
    published = [59, 93, 124, 153, 181]

    assert [flights_needed(0.05, 0.95, outside) for outside in range(5)] == published
    assert [allowed_outside(flights, 0.05, 0.95) for flights in published] == list(range(5))
    assert [allowed_outside(flights - 1, 0.05, 0.95) for flights in published] == list(range(-1, 4))


def test_a_claim_is_false_no_more_often_than_its_confidence_says():
    """Scores are uniform, so that a scale s is exceeded with probability 1 - s."""
    scores = np.random.default_rng(0).random((20_000, 93))
    scales = np.array([counted_scale(own, 0.05, 0.95)[0] for own in scores])

    # 20,000 counts resolve the share to 0.0015, at one standard deviation
    assert np.mean(1.0 - scales > 0.05) == pytest.approx(0.05, abs=0.006)


def test_flights_that_were_not_completed_count():
    scores = np.linspace(0.0, 1.0, 93)

    scores[-1] = np.inf
    assert counted_scale(scores, 0.05, 0.95) == (scores[-2], 1)
    scores[-2] = np.inf
    assert counted_scale(scores, 0.05, 0.95) == (np.inf, 0)
    with pytest.raises(ft.InputError, match=r"at least 59 .*`epsilon`"):
        counted_scale(scores[:58], 0.05, 0.95)


@pytest.mark.parametrize(("outside", "flights"), [(0, 40), (3, 40), (5, 1640), (40, 40)])
def test_the_epsilon_that_a_count_supports_is_the_bound_of_clopper_and_pearson(outside, flights):
    exact = binomtest(outside, flights, alternative="less").proportion_ci(0.999, method="exact")

    epsilon = supported_epsilon(outside, flights, 0.999)
    assert epsilon == pytest.approx(exact.high, rel=1e-9)
    if epsilon < 1.0:  # as `allowed_outside` counts
        assert allowed_outside(flights, epsilon * 1.0001, 0.999) == outside
        assert allowed_outside(flights, epsilon * 0.9999, 0.999) == outside - 1


@pytest.mark.parametrize(("epsilon", "again"), [(0.05, 59), (0.01, 299), (0.3, 9)])
def test_a_forgery_that_doubles_epsilon_is_found_with_95_percent(epsilon, again):
    flights, forged = 1000, round(1000 * epsilon)

    assert flights_again(epsilon) == again
    missed = chance_missed(forged, flights, again)
    assert missed == pytest.approx(hypergeom.pmf(0, flights, forged, again))
    assert missed <= 0.05
    assert chance_missed(5, 10, 6) == 0.0
