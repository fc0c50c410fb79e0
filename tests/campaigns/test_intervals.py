"""Intervals against those of scipy."""

from functools import partial

import numpy as np
import pytest
from scipy import stats

import flighttune as ft
from flighttune.campaigns.statistics.intervals import quantile_interval, rate_interval

ROUNDING = 1e-9
"""Absolute; both sides compute the same closed form."""

COUNTS = [(0, 1), (1, 1), (0, 20), (1, 20), (10, 20), (20, 20), (81, 263), (999, 1000)]
METHODS = {"wilson": rate_interval, "exact": partial(rate_interval, method="clopper-pearson")}
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


@pytest.mark.soak
def test_an_interval_at_any_time_holds_however_often_a_campaign_is_looked_at():
    # 2000 simulated campaigns that are looked at after every 12 flights, up to 240
    p, looks, campaigns = 0.9, np.arange(12, 241, 12), 2000
    flown = np.random.default_rng(62).random((campaigns, 240)) < p
    k = flown.cumsum(axis=1)[:, looks - 1]
    n = np.broadcast_to(looks, k.shape)
    wrong = {
        method: int(((lo > p) | (hi < p)).any(axis=1).sum())
        for method in ("wilson", "any-time")
        for lo, hi in [rate_interval(k, n, method=method)]
    }
    # more than this have a probability of 0.1 % at 5 %, which an interval of one look exceeds
    most = stats.binom.ppf(0.999, campaigns, 0.05)
    assert 0 < wrong["any-time"] <= most < wrong["wilson"]
    # 0.95^-n / 2 and a share of it exceed 2 / 0.05 from 82 on: a lower end of 0.95
    assert (
        rate_interval(82, 82, method="any-time")[0]
        > 0.95
        > rate_interval(81, 81, method="any-time")[0]
    )
    assert rate_interval(0, 0, method="any-time") == (0.0, 1.0)


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0, float("nan")])
def test_a_confidence_is_a_probability(confidence):
    with pytest.raises(ft.InputError, match=r"`confidence` .*0 and 1"):
        rate_interval(1, 2, confidence)


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


@pytest.mark.parametrize("q", [0.05, 0.5, 0.95])
def test_fewer_effective_values_widen_an_interval_of_a_quantile_outwards(q):
    n, effective = 300, 220
    of_effective = np.arange(1.0, effective + 1.0)

    lo, hi = quantile_interval(np.arange(1.0, n + 1.0), q, effective=effective)

    ranks = [
        stats.quantile_test(of_effective, p=q, alternative=side).confidence_interval(0.975)
        for side in ("greater", "less")
    ]
    assert lo == np.floor(ranks[0].low * n / effective)
    assert hi == np.ceil(ranks[1].high * n / effective)
