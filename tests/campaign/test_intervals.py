"""Intervals against scipy, against published values, and by how often they cover."""

from functools import partial

import numpy as np
import pytest
from scipy import stats

from flighttune.campaign.statistics.intervals import (
    quantile_interval,
    rate_interval,
)
from flighttune.errors import InputError

ROUNDING = 1e-9
"""Absolute; both sides compute the same closed form."""

COUNTS = [(0, 1), (1, 1), (0, 20), (1, 20), (10, 20), (20, 20), (81, 263), (999, 1000)]
METHODS = {
    "wilson": rate_interval,
    "exact": partial(rate_interval, method="clopper-pearson"),
}
"""By the name that scipy gives each."""


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.95, 0.999])
@pytest.mark.parametrize("method", METHODS)
def test_intervals_of_a_share_are_those_of_scipy(method, confidence):
    k, n = np.array(COUNTS).T

    lo, hi = METHODS[method](k, n, confidence)

    for i, (successes, trials) in enumerate(COUNTS):
        expected = stats.binomtest(successes, trials).proportion_ci(confidence, method=method)
        assert lo[i] == pytest.approx(expected.low, abs=ROUNDING)
        assert hi[i] == pytest.approx(expected.high, abs=ROUNDING)


@pytest.mark.parametrize(
    ("method", "k", "n", "lo", "hi"),
    [
        ("wilson", 81, 263, 0.2553, 0.3662),
        ("exact", 81, 263, 0.2527, 0.3676),
        ("wilson", 15, 148, 0.0624, 0.1605),
        ("exact", 15, 148, 0.0578, 0.1617),
        ("wilson", 0, 20, 0.0, 0.1611),
        ("exact", 0, 20, 0.0, 0.1684),
        ("wilson", 1, 29, 0.0061, 0.1718),
        ("exact", 1, 29, 0.0009, 0.1776),
    ],
)
def test_intervals_of_a_share_are_those_of_newcombe(method, k, n, lo, hi):
    """Table I of R. G. Newcombe, Stat. Med. 17 (1998) 857-872, four decimals."""
    assert METHODS[method](k, n) == pytest.approx((lo, hi), abs=0.5e-4 + ROUNDING)


@pytest.mark.parametrize("interval", METHODS.values())
def test_no_trials_tell_nothing(interval):
    assert interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize("interval", METHODS.values())
@pytest.mark.parametrize(("k", "n"), [(-1, 3), (4, 3), (float("nan"), 3)])
def test_counts_that_cannot_be_are_refused(interval, k, n):
    with pytest.raises(InputError, match=r"`successes` .* `n`"):
        interval(k, n)


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0, float("nan")])
def test_a_confidence_is_a_probability(confidence):
    with pytest.raises(InputError, match=r"`confidence` .*0 and 1"):
        rate_interval(1, 2, confidence)


def test_wilson_covers_as_often_as_it_says_and_clopper_pearson_at_least():
    n, rng = 60, np.random.default_rng(1)
    truths = rng.uniform(0.05, 0.95, 20_000)
    k = rng.binomial(n, truths)

    covered = {}
    for name, interval in METHODS.items():
        lo, hi = interval(k, n)
        covered[name] = np.mean((lo <= truths) & (truths <= hi))

    assert covered["wilson"] == pytest.approx(0.95, abs=0.006)
    assert 0.95 <= covered["exact"] < 0.98


@pytest.mark.parametrize("q", [0.05, 0.5, 0.95])
@pytest.mark.parametrize("n", [7, 80, 500])
def test_intervals_of_a_quantile_are_those_of_scipy(n, q):
    values = np.random.default_rng(n).lognormal(size=n)

    found = quantile_interval(values, q)

    tails = [
        stats.quantile_test(values, p=q, alternative=side).confidence_interval(0.975)
        for side in ("greater", "less")
    ]
    expected = [tails[0].low, tails[1].high]
    expected = [e if np.isfinite(e) else s * np.inf for e, s in zip(expected, (-1, 1), strict=True)]
    assert found == tuple(expected)


def test_the_interval_of_a_quantile_covers_at_least_as_often_as_it_says():
    rng, q = np.random.default_rng(2), 0.95
    truth = stats.expon.ppf(q)

    intervals = [quantile_interval(rng.exponential(size=200), q) for _ in range(2000)]

    share = np.mean([lo <= truth <= hi for lo, hi in intervals])
    assert 0.945 <= share < 0.98


def test_no_values_bound_no_quantile():
    assert quantile_interval([], 0.5) == (-np.inf, np.inf)
