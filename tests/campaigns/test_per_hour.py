"""Exits per flight hour: the bound against own arithmetic, and against 5,000 simulated cases."""

import numpy as np
import pytest
from scipy.stats import beta

import flighttune as ft
from flighttune.campaigns.statistics import per_hour

ROUNDING = 1e-9

# Cases that may miss a confidence of 0.9 by chance alone once in 10^4: 5,000 draws, 3.7 sigma.
CASES, CONFIDENCE, MOST_MISSED = 5000, 0.9, 0.1 + 3.7 * np.sqrt(0.1 * 0.9 / 5000)


def clopper_pearson(outside, flights, alpha):
    return beta.ppf(1.0 - alpha, outside + 1, flights - outside)


def test_the_bound_is_rates_times_shares_over_hours():
    exposure = per_hour.Exposure(shortest_s=1800.0, window_s=2160.0, cap_s=3600.0, flights=500)
    faults = [
        (1e-3, per_hour.Count(outside=4, flights=100)),
        (2e-4, per_hour.Count(outside=0, flights=60)),
    ]

    bound = per_hour.hourly_bound(
        per_hour.Count(outside=1, flights=500), faults, exposure, confidence=0.95
    )

    alpha = 0.05 / 5  # healthy flights, shortest, longest, two faults
    odd = clopper_pearson(0, 500, alpha)
    # Half an hour, or until the first fault: the mean of min(0.5, t) over an exponential t.
    hours = (1.0 - odd) * (1.0 - np.exp(-0.5 * 1.2e-3)) / 1.2e-3
    terms = [
        rate * (0.6 * clopper_pearson(k, n, alpha) + odd) / hours
        for rate, k, n in [(1e-3, 4, 100), (2e-4, 0, 60)]
    ]
    # The first fault within 0.6 h, or 1 h of few flights, and the second within 1 h.
    several = 1.2e-3**2 * (0.6 * (1.0 - 0.3) + odd * 0.5) / hours
    assert bound.faults == pytest.approx(terms, rel=ROUNDING)
    assert bound.healthy == pytest.approx(clopper_pearson(1, 500, alpha) / hours, rel=ROUNDING)
    assert bound.several == pytest.approx(several, rel=ROUNDING)
    assert bound.total == pytest.approx(
        bound.healthy + sum(bound.faults) + bound.several, rel=ROUNDING
    )


def exits_per_hour(p_0, rates, shares, durations_h):
    """True rate of an aircraft that leaves with every second fault, over drawn durations."""
    expected = sum(rates) * durations_h
    none, one = np.exp(-expected), np.exp(-expected) * durations_h
    leaves = none * p_0 + one * np.dot(rates, shares) + (1.0 - none * (1.0 + expected))
    return leaves.mean() / durations_h.mean()


@pytest.mark.counts
def test_5000_made_up_aircraft_exceed_the_bound_no_more_often_than_the_confidence_allows():
    rng, missed = np.random.default_rng(5), 0
    for _ in range(CASES):
        shares, rates = rng.uniform(0.0, 0.6, 2), 10.0 ** rng.uniform(-2.0, -0.5, 2)
        p_0 = 10.0 ** rng.uniform(-3.0, -1.0)
        low, high = np.sort(rng.uniform(0.2, 1.0, 2)).tolist()
        durations = rng.uniform(low, high, 200)
        healthy = per_hour.Count(outside=int(rng.binomial(200, p_0)), flights=200)
        window, cap = durations.max(), high
        # A fault later than the end of a flight changes nothing.
        counts = []
        for share in shares:
            struck = rng.uniform(0.0, window, 60) < rng.uniform(low, high, 60)
            counts.append(
                per_hour.Count(outside=int(np.sum(struck & (rng.random(60) < share))), flights=60)
            )
        exposure = per_hour.Exposure(
            shortest_s=3600.0 * durations.min(),
            window_s=3600.0 * window,
            cap_s=3600.0 * cap,
            flights=200,
        )
        bound = per_hour.hourly_bound(
            healthy, list(zip(rates, counts, strict=True)), exposure, confidence=CONFIDENCE
        )
        true = exits_per_hour(p_0, rates, shares, np.linspace(low, high, 200))
        missed += bound.total < true
    assert missed / CASES <= MOST_MISSED


def test_every_count_for_a_later_ending_costs_confidence():
    exposure = per_hour.Exposure(shortest_s=1800.0, window_s=1900.0, cap_s=3600.0, flights=500)
    few, more = (
        per_hour.hourly_bound(
            per_hour.Count(outside=0, flights=500),
            [(1e-3, per_hour.Count(outside=0, flights=60))],
            exposure,
            confidence=0.95,
            more=n,
        )
        for n in (0, 1)
    )
    assert few.each < more.each
    assert few.total < more.total


def test_durations_must_be_in_order():
    exposure = per_hour.Exposure(shortest_s=2000.0, window_s=1900.0, cap_s=3600.0, flights=500)
    with pytest.raises(ft.InputError, match=r"`shortest_s` must be positive and at most 1900 s"):
        per_hour.hourly_bound(per_hour.Count(outside=0, flights=500), [], exposure, confidence=0.95)
