"""The choice among candidates, on draws whose truth is known."""

import numpy as np
import pytest

from flighttune.campaign.choice.race import race
from flighttune.campaign.statistics.paired import ordered_quantile
from flighttune.errors import InputError


def track(shifts, seed, *, noise=0.1, fail=None, log=None):
    """Scores: common luck of the draw, plus the candidate's shift, plus its own noise."""
    fail = fail or {}

    def fly(names, first, end):
        if log is not None:
            log.append((tuple(names), first, end))
        luck = np.random.default_rng([seed, 0]).exponential(size=end)[first:end]
        rows, good = [], []
        for name in names:
            own = np.random.default_rng([seed, 1 + sum(map(ord, name))])
            rows.append(luck + shifts[name] + noise * own.normal(size=end)[first:end])
            good.append(own.uniform(size=end)[first:end] >= fail.get(name, 0.0))
        return np.array(rows), np.array(good)

    return fly


SHIFTS = {"a": 1.0, "b": 0.0, "c": 0.15, "d": 3.0}


def test_the_best_is_chosen_and_bad_ones_fly_the_first_draws_alone():
    log = []

    found = race(list(SHIFTS), track(SHIFTS, 1, log=log), draws=640, q=0.95)

    assert found.best == "b"
    assert found.p_best > 0.95
    assert found.finished
    assert set(found.dropped) >= {"a", "d"}
    assert [(first, end) for _, first, end in log] == [(0, 80), (80, 160), (160, 320), (320, 640)]
    assert len(found.scores["d"]) == 80
    assert len(found.scores["b"]) == 640


@pytest.mark.slow
def test_the_probability_to_be_best_is_as_often_right_as_it_says():
    """Three candidates a little apart: the sum of what is promised is the number of right ones."""
    shifts = {"a": 0.0, "b": 0.03, "c": 0.06}
    promised, right = [], []
    for seed in range(150):
        found = race(list(shifts), track(shifts, seed), draws=80, q=0.8)
        promised.append(found.p_best)
        right.append(found.best == "a")

    assert 0.3 < np.mean(promised) < 0.95
    assert np.mean(promised) == pytest.approx(np.mean(right), abs=0.12)


def test_equal_candidates_are_not_told_apart():
    shifts = dict.fromkeys("abcde", 0.0)

    found = race(list(shifts), track(shifts, 5), draws=300, q=0.9)

    assert found.p_best < 0.9
    assert len(found.dropped) <= 2
    assert found.loss < 0.1
    assert sum(found.wins.values()) == pytest.approx(1.0)


def test_of_the_same_flights_the_first_candidate_is_chosen_and_loses_nothing():
    shifts = {"x": 0.0, "y": 0.0}

    found = race(["x", "y"], track(shifts, 1, noise=0.0), draws=100, q=0.5)

    assert found.best == "x"
    assert found.wins == {"x": 1.0, "y": 0.0}
    assert found.loss == 0.0


def test_a_candidate_that_succeeds_too_seldom_is_not_chosen():
    shifts = {"low": 0.0, "sure": 1.0}

    found = race(
        list(shifts), track(shifts, 2, fail={"low": 0.4}), draws=200, q=0.95, least_success=0.9
    )

    assert found.best == "sure"
    assert found.dropped == {"low": 0.0}
    assert race(list(shifts), track(shifts, 2, fail={"low": 0.4}), draws=200, q=0.95).best == "low"


def test_where_none_succeeds_often_enough_the_one_is_chosen_that_lacks_least():
    shifts = {"low": 0.0, "high": 1.0}

    found = race(
        list(shifts), track(shifts, 2, fail={"low": 0.6, "high": 0.3}), draws=100, q=0.5,
        least_success=0.99,
    )  # fmt: skip

    assert found.best == "high"


def test_lost_flights_count_as_worse_than_any_and_break_nothing():
    def fly(names, first, end):
        scores = np.ones((len(names), end - first))
        scores[0, :: 10 if names[0] == "lost" else 1000] = np.inf
        return scores, np.isfinite(scores)

    found = race(["lost", "safe"], fly, draws=100, q=0.95)

    assert found.best == "safe"
    assert found.wins["safe"] > 0.9
    assert np.all(found.differences["lost"] >= 0.0)


def test_all_lost_is_a_tie():
    def fly(names, first, end):
        return np.full((len(names), end - first), np.inf), np.zeros((len(names), end - first), bool)

    found = race(["a", "b"], fly, draws=50, q=0.95)

    assert found.best == "a"
    assert found.loss == 0.0


def test_those_beside_fly_everything_and_are_never_chosen():
    found = race(["a", "c"], track(SHIFTS, 3), draws=200, q=0.9, baselines=["b", "d"])

    assert found.best == "c"
    assert set(found.wins) <= {"a", "c"}
    assert len(found.scores["b"]) == len(found.scores["d"]) == 200
    assert np.median(found.differences["b"]) < 0.0 < np.median(found.differences["d"])


def test_the_interval_of_a_difference_is_a_paired_one():
    """Luck of the draw is common: the difference is far surer than either percentile.

    The 90th percentile of 400 exponential numbers has the standard deviation
    sqrt(0.9 0.1 / 400) / 0.1 = 0.15.
    """
    found = race(["b"], track(SHIFTS, 4, noise=0.02), draws=400, q=0.9, baselines=["c"])

    low, high = np.quantile(found.differences["c"], [0.025, 0.975])
    assert low < 0.15 < high
    assert high - low < 0.15


def test_draws_that_belong_together_are_resampled_together():
    log = []
    found = race(["b", "c"], track(SHIFTS, 6, log=log), draws=250, q=0.9, cycle=25)

    assert all(first % 25 == 0 and end % 25 == 0 for _, first, end in log)
    assert found.best == "b"


def test_a_race_that_is_stopped_tells_what_it_knows():
    fly = track(SHIFTS, 1)

    def stopped(names, first, end):
        return None if first else fly(names, first, end)

    found = race(["a", "b"], stopped, draws=200, q=0.9)

    assert not found.finished
    assert found.best == "b"
    assert race(["a", "b"], lambda *_: None, draws=200, q=0.9) is None


def test_the_same_seed_gives_the_same_bits():
    one, two = (race(list(SHIFTS), track(SHIFTS, 9), draws=200, q=0.9, seed=4) for _ in range(2))

    assert one.wins == two.wins
    assert one.p_best == two.p_best


def test_the_order_statistic_is_the_one_that_numpy_calls_inverted_cdf():
    values = np.random.default_rng(0).normal(size=(3, 101))

    for q in (0.01, 0.05, 0.5, 0.95, 0.99):
        expected = np.quantile(values, q, axis=-1, method="inverted_cdf")
        assert ordered_quantile(values, q).tolist() == expected.tolist()


@pytest.mark.parametrize(
    ("names", "draws", "q"), [([], 10, 0.5), (["a"], 0, 0.5), (["a"], 10, 95.0)]
)
def test_a_race_must_have_runners_draws_and_a_quantile(names, draws, q):
    with pytest.raises(InputError, match="a race must have"):
        race(names, track(SHIFTS, 1), draws=draws, q=q)
