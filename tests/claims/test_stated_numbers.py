"""Numbers that the help and the docs of counts and searches state are those that they use."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

import flighttune as ft
from flighttune.campaigns.statistics import count
from flighttune.claims import mission, per_hour, rates_keys, verbs
from flighttune.studies import beside, meet, retune
from flighttune.studies.adoption import adopt

DOCS = Path(__file__).parents[2] / "docs"


def least(epsilon, confidence, outside):
    """Fewest flights of which so many may be outside, by sums of the binomial distribution."""
    n = np.arange(outside + 1, 3000)
    return int(n[np.argmax(binom.cdf(outside, n, epsilon) <= 1.0 - confidence)])


@pytest.mark.parametrize(
    ("verb", "words", "value"),
    [
        (ft.band, "leaving the band, by default (.*?), or", verbs.EPSILON),
        (ft.band, "0 to 1, by default (.*?), or", verbs.CONFIDENCE),
        (ft.band, "learn the shape from, by default (.*?)[. ]", verbs.LEARN),
        (ft.band, r"five of them outside \((\d+)\)", least(verbs.EPSILON, verbs.CONFIDENCE, 5)),
        (ft.band, "By default (.*?) flights are flown",
         verbs.LEARN + least(verbs.EPSILON, verbs.CONFIDENCE, 5)),
        (ft.monitor, "in a flight, by default ([0-9.]*[0-9])", verbs.MONITOR_EPSILON),
        (ft.monitor, "0 to 1, by default ([0-9.]*[0-9])", verbs.MONITOR_CONFIDENCE),
        (ft.monitor, "other for the limits, by default (.*?)[. ]", verbs.MONITOR_LEARN),
        (ft.monitor, r"five alarms \((\d+)\)",
         least(verbs.MONITOR_EPSILON, verbs.MONITOR_CONFIDENCE, count.OUTSIDE)),
        (ft.mission, "of each claim, by default (.*?), or", mission.EPSILON),
        (ft.mission, "0 to 1, by default (.*?), or", mission.CONFIDENCE),
        (ft.mission, r"outside \((\d+) with a fence\)",
         least(mission.EPSILON, 1.0 - 0.5 * (1.0 - mission.CONFIDENCE), mission.OUTSIDE)),
        (ft.meet, "draws, by default (.*?), or 6000", meet.BUDGET),
        (ft.meet, "by default 600, or (.*?) with a campaign", meet.CAMPAIGN_BUDGET),
        (ft.meet, r"an aircraft \((\d+) flights\)", retune.BUDGET),
        (ft.meet, "all requirements, by default ([0-9.]*[0-9])", meet.SUCCESS),
        (ft.meet, "are met by (.*?) % of their bounds", 100.0 * meet.WANTED),
        (ft.meet, "those found are counted, by default (.*?)[. ]", least(0.05, 0.95, 1)),
        (ft.compare, "to fly with both, by default (.*?)[. ]",
         least(beside.EPSILON, beside.CONFIDENCE, 1)),
        (ft.adopt, "above sea level, by default (.*?), or", adopt.HEIGHT),
        (ft.verify, "(.*?) flights at 5 % and", count.flights_again(0.05)),
        (ft.verify, "at 5 % and (.*?) at 1 %", count.flights_again(0.01)),
    ],
)  # fmt: skip
def test_defaults_are_those_of_the_help(verb, words, value):
    said = re.search(words, " ".join(verb.__doc__.split()))

    assert said is not None
    assert float(said[1].split()[-1]) == pytest.approx(value)


def test_flights_of_a_claim_per_hour_are_those_of_the_page():
    page = " ".join((DOCS / "per_hour.md").read_text(encoding="utf-8").split())

    assert f"flights = {rates_keys.HEALTHY} # without a fault" in page
    assert f"none of {rates_keys.HEALTHY} healthy flights" in page
    assert f"of {rates_keys.FAULTY} with a stuck aileron" in page
    # of the first times of ending and the last
    first, second, *_, last = per_hour.LATER_S
    assert f"{first:g}, {second:g}, ... {last:g} s" in page
    assert f"{100 * per_hour.SHORTER:g} % quantile" in page
    assert f"({100 * per_hour.SHORTER_BY_ALARMS:g} % with a monitor)" in page
