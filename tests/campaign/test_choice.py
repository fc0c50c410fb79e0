"""The choice among candidates, on draws whose truth is known."""

import numpy as np
import pytest

from flighttune.campaign.choice import resampled
from flighttune.campaign.statistics.paired import ordered_quantile


def track(shifts, seed, draws, *, noise=0.1, fail=None):
    """Scores: common luck of the draw, plus the candidate's shift, plus its own noise."""
    luck = np.random.default_rng([seed, 0]).exponential(size=draws)
    scores, good = [], []
    for name, shift in shifts.items():
        own = np.random.default_rng([seed, 1 + ord(name[0])])
        scores.append(luck + shift + noise * own.normal(size=draws))
        good.append(own.uniform(size=draws) >= (fail or {}).get(name, 0.0))
    return np.array(scores), np.array(good)


SHIFTS = {"a": 1.0, "b": 0.0, "c": 0.15, "d": 3.0}


def test_the_best_is_chosen_and_is_sure():
    choice = resampled(*track(SHIFTS, 1, 640), 4, q=0.95)

    assert choice.best == 1
    assert choice.wins[1] > 0.95


@pytest.mark.slow
def test_the_probability_to_be_best_is_as_often_right_as_it_says():
    """Three candidates a little apart: the sum of what is promised is the number of right ones."""
    shifts = {"a": 0.0, "b": 0.03, "c": 0.06}
    choices = [resampled(*track(shifts, seed, 80), 3, q=0.8) for seed in range(150)]
    promised = np.mean([choice.wins[choice.best] for choice in choices])
    right = np.mean([choice.best == 0 for choice in choices])

    assert 0.3 < promised < 0.95
    assert promised == pytest.approx(right, abs=0.12)


def test_equal_candidates_are_not_told_apart():
    choice = resampled(*track(dict.fromkeys("abcde", 0.0), 5, 300), 5, q=0.9)

    assert choice.wins.max() < 0.9
    assert choice.loss < 0.1
    assert choice.wins.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("score", [1.0, np.inf], ids=["same flights", "all lost"])
def test_of_the_same_flights_the_first_candidate_is_chosen_and_loses_nothing(score):
    choice = resampled(np.full((2, 100), score), np.isfinite(np.full((2, 100), score)), 2, q=0.5)

    assert choice.best == 0
    assert choice.wins.tolist() == [1.0, 0.0]
    assert choice.loss == 0.0


def test_a_candidate_that_succeeds_too_seldom_is_not_chosen():
    flown = track({"low": 0.0, "sure": 1.0}, 2, 200, fail={"low": 0.4})

    assert resampled(*flown, 2, q=0.95, least=0.9).best == 1
    assert resampled(*flown, 2, q=0.95).best == 0


def test_where_none_succeeds_often_enough_the_higher_rate_wins():
    flown = track({"low": 0.0, "high": 1.0}, 2, 100, fail={"low": 0.6, "high": 0.3})

    assert resampled(*flown, 2, q=0.5, least=0.99).best == 1


def test_lost_flights_count_as_worse_than_any_and_break_nothing():
    scores = np.ones((2, 100))
    scores[0, ::10] = np.inf

    choice = resampled(scores, np.isfinite(scores), 2, q=0.95)

    assert choice.best == 1
    assert choice.wins[1] > 0.9
    assert np.all(choice.behind[0] >= 0.0)


def test_baselines_are_compared_and_never_chosen():
    scores, good = track(SHIFTS, 3, 200)

    choice = resampled(scores[[0, 2, 1, 3]], good, 2, q=0.9)

    assert choice.best == 1
    assert len(choice.wins) == 2
    assert np.median(choice.behind[2]) < 0.0 < np.median(choice.behind[3])


def test_the_interval_of_a_difference_is_a_paired_one():
    """Luck of the draw is common: the difference is far surer than either percentile.

    The 90th percentile of 400 exponential numbers has the standard deviation
    sqrt(0.9 0.1 / 400) / 0.1 = 0.15.
    """
    choice = resampled(*track({"b": 0.0, "c": 0.15}, 4, 400, noise=0.02), 1, q=0.9)

    low, high = np.quantile(choice.behind[1], [0.025, 0.975])
    assert low < 0.15 < high
    assert high - low < 0.15


def test_draws_that_belong_together_are_resampled_together():
    """Ten cycles, in one of which all flights are bad: a resample has it k of ten times."""
    scores = np.ones((2, 250))
    scores[0, :25] = 2.0

    choice = resampled(scores, np.ones((2, 250), bool), 2, q=0.95, cycle=25)

    assert choice.best == 1
    assert np.mean(choice.behind[0] > 0.0) == pytest.approx(1.0 - 0.9**10, abs=0.05)


def test_the_order_statistic_is_the_one_that_numpy_calls_inverted_cdf():
    values = np.random.default_rng(0).normal(size=(3, 101))

    for q in (0.01, 0.05, 0.5, 0.95, 0.99):
        expected = np.quantile(values, q, axis=-1, method="inverted_cdf")
        assert ordered_quantile(values, q).tolist() == expected.tolist()
