"""Numbers that the help of counts states are those that they use, and SciPy's."""

import re

import numpy as np
import pytest
from scipy.stats import binom
from small_claims import STRAIGHT, folder

import flighttune as ft


def least(epsilon, confidence, outside):
    """Fewest flights of which so many may be outside, by sums of the binomial distribution."""
    n = np.arange(outside + 1, 3000)
    return int(n[np.argmax(binom.cdf(outside, n, epsilon) <= 1.0 - confidence)])


def said(verb, words):
    """A number of the help."""
    (found,) = re.findall(words, " ".join(verb.__doc__.split()))
    return float(found)


def count_one(verb):
    """The refusal of a count of one flight, which names the claim that is made by default."""
    source = "circuit_in_wind" if verb is ft.mission else folder() / "turn.toml"
    start = {"changes": STRAIGHT} if verb is ft.mission else {"start_deg": 2.0}
    with pytest.raises(ft.InputError) as refused:
        verb(source, flights=1, **start)
    return [float(x.rstrip(".,")) for x in re.findall(r"[\d.]+", str(refused.value))]


@pytest.mark.parametrize(
    ("verb", "epsilon", "confidence", "flights", "outside"),
    [
        (ft.band, "leaving the band, by default ([0-9.]+),", "0 to 1, by default ([0-9.]+),",
         r"five of them outside \((\d+)\)", 5),
        (ft.monitor, r"in a flight, by default ([0-9.]*[0-9])", "0 to 1, by default ([0-9.]*[0-9])",
         r"five alarms \((\d+)\)", 5),
    ],
)  # fmt: skip
def test_as_many_flights_are_counted_as_the_help_says(verb, epsilon, confidence, flights, outside):
    of = said(verb, epsilon), said(verb, confidence)

    assert said(verb, flights) == least(*of, outside)
    stated = count_one(verb)
    assert {*of, float(least(*of, 0))} <= {*stated}


def test_a_mission_states_the_flights_of_the_claims_that_share_its_confidence():
    epsilon = said(ft.mission, "of each claim, by default ([0-9.]+),")
    confidence = said(ft.mission, "0 to 1, by default ([0-9.]+),")

    shared = 1.0 - 0.5 * (1.0 - confidence)
    assert said(ft.mission, r"outside \((\d+) with a fence\)") == least(epsilon, shared, 2)
    assert {epsilon, confidence, float(least(epsilon, confidence, 0))} <= {*count_one(ft.mission)}


def test_a_check_repeats_as_many_flights_as_find_a_doubled_epsilon_with_95_percent():
    for share in (0.05, 0.01):
        number = said(ft.verify, rf"(\d+) (?:flights )?at {100 * share:g} %")
        assert (1.0 - share) ** number <= 0.05 < (1.0 - share) ** (number - 1)
