"""Intervals against those of scipy."""

from functools import partial

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.integrate import quad

import flighttune as ft
from flighttune.campaigns.statistics import intervals

ROUNDING = 1e-9
"""Absolute; both sides compute the same closed form."""

COUNTS = [(0, 1), (1, 1), (0, 20), (1, 20), (10, 20), (20, 20), (81, 263), (999, 1000)]
METHODS = {
    "wilson": intervals.rate_interval,
    "exact": partial(intervals.rate_interval, method="clopper-pearson"),
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


@pytest.mark.parametrize(("successes", "trials"), [(38, 40), (3, 9), (50, 50)])
def test_an_interval_at_any_time_ends_where_the_evidence_against_it_is_40(successes, trials):
    """Evidence is the mean likelihood ratio over chances of a failure below or above the end."""
    failures = trials - successes

    def mean_ratio(end, low, high):
        def ratio(q):
            return (q / end) ** failures * ((1.0 - q) / (1.0 - end)) ** successes

        return quad(ratio, low, high, epsabs=0.0, epsrel=1e-9)[0] / (high - low)

    lo, hi = intervals.rate_interval(successes, trials, method="any-time")

    most, least = 1.0 - float(lo), 1.0 - float(hi)
    never = (1.0 - most) ** -trials if failures == 0 else 0.0
    assert 0.5 * (never + mean_ratio(most, 0.0, most)) == pytest.approx(40.0, rel=1e-5)
    if failures:
        above = mean_ratio(least, least, min(1.0, 20.0 * least))
        assert above == pytest.approx(40.0, rel=1e-5)
    else:
        assert least == 0.0


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
        for lo, hi in [intervals.rate_interval(k, n, method=method)]
    }
    # more than this have a probability of 0.1 % at 5 %, which an interval of one look exceeds
    most = stats.binom.ppf(0.999, campaigns, 0.05)
    assert 0 < wrong["any-time"] <= most < wrong["wilson"]
    # 0.95^-n / 2 and a share of it exceed 2 / 0.05 from 82 on: a lower end of 0.95
    assert (
        intervals.rate_interval(82, 82, method="any-time")[0]
        > 0.95
        > intervals.rate_interval(81, 81, method="any-time")[0]
    )
    assert intervals.rate_interval(0, 0, method="any-time") == (0.0, 1.0)


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0, float("nan")])
def test_a_confidence_is_a_probability(confidence):
    with pytest.raises(ft.InputError, match=r"`confidence` .*0 and 1"):
        intervals.rate_interval(1, 2, confidence)


# An effective number is rounded down, and lies between one and all.
@pytest.mark.parametrize(
    ("n", "effective", "whole"), [(300, 220.0, 220), (40, 1000.0, 40), (40, 7.9, 7), (40, 0.3, 1)]
)
@pytest.mark.parametrize("q", [0.05, 0.5, 0.95])
def test_fewer_effective_values_widen_an_interval_of_a_quantile_outwards(q, n, effective, whole):
    lo, hi = intervals.quantile_interval(np.arange(1.0, n + 1.0), q, effective=effective)

    low, high = (
        stats.quantile_test(np.arange(1.0, whole + 1.0), p=q, alternative=side)
        for side in ("greater", "less")
    )
    low, high = low.confidence_interval(0.975).low, high.confidence_interval(0.975).high
    assert lo == (np.floor(low * n / whole) if np.isfinite(low) else -np.inf)
    assert hi == (np.ceil(high * n / whole) if np.isfinite(high) else np.inf)


def test_pairs_of_gains_are_compared_as_scipy_does():
    """Draws that both gains fly, on each plant; of lost flights the error is infinite."""
    random, n = np.random.default_rng(3), 40
    errors = {"a": random.normal(1.0, 0.3, n), "b": random.normal(1.1, 0.3, n)}
    lost = {"a": {2, 5, 9}, "b": {5, 9, 11, 30}}
    success = {
        x: np.array([random.random() < p for _ in range(n)]) for x, p in (("a", 0.9), ("b", 0.6))
    }
    rows = pd.DataFrame([
        {"plant": "p", "draw": i, "gains": x, "success": success[x][i], "chi.ITAE": errors[x][i],
         "status": "left_envelope" if i in lost[x] else "completed"}
        for i in range(n) for x in "ab" if (i, x) != (20, "b")
    ])  # fmt: skip

    (pair,) = intervals.paired(rows, "chi.ITAE", confidence=0.9)

    for x in "ab":
        errors[x][[*lost[x]]] = np.inf
    kept = np.arange(n) != 20
    a, b, ok_a, ok_b = errors["a"][kept], errors["b"][kept], success["a"][kept], success["b"][kept]
    wins = int(np.sum(a < b)), int(np.sum(b < a))
    assert (pair["n"], pair["wins_a"], pair["wins_b"]) == (n - 1, *wins)
    assert pair["win_rate"] == pytest.approx(wins[0] / sum(wins))
    interval = stats.binomtest(wins[0], sum(wins)).proportion_ci(0.9, method="wilson")
    assert (pair["lo"], pair["hi"]) == pytest.approx((interval.low, interval.high), abs=1e-9)
    apart = np.where(a == b, 0.0, a - np.where(a == b, 0.0, b))
    assert pair["median"] == pytest.approx(np.sort(apart)[19])
    assert pair["median_lo"] <= pair["median"] <= pair["median_hi"]
    only = int(np.sum(ok_a & ~ok_b)), int(np.sum(~ok_a & ok_b))
    assert (pair["only_a"], pair["only_b"]) == only
    assert pair["p_success"] == pytest.approx(stats.binomtest(only[0], sum(only)).pvalue, rel=1e-9)
    # the other way round the signs are others
    (turned,) = intervals.paired(rows.iloc[::-1], "chi.ITAE", confidence=0.9)
    assert (turned["a"], turned["wins_a"], turned["only_a"]) == ("b", wins[1], only[1])
    assert turned["p_success"] == pytest.approx(pair["p_success"])


def test_of_no_flights_nothing_is_known():
    assert intervals.quantile_interval(np.array([]), 0.5) == (-np.inf, np.inf)
    none = intervals.share(np.zeros(0, dtype=bool), np.zeros(0))
    assert (none.lo, none.hi, none.n) == (0.0, 1.0, 0)
    assert np.isnan(none.value)


def test_gains_without_a_draw_that_both_fly_are_not_compared():
    rows = pd.DataFrame({
        "plant": "p", "draw": [0, 1], "gains": ["a", "b"], "success": True, "chi.ITAE": [1.0, 2.0],
        "status": "completed",
    })  # fmt: skip

    assert intervals.paired(rows, "chi.ITAE") == []
