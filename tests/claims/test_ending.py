"""When counts end: what they support then, against binomial sums, and who shares the confidence."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom
from small_claims import OLD

import flighttune as ft

EPSILON, CONFIDENCE = 0.05, 0.95
ROUNDING = 1e-9  # relative
KEPT = ft.load(OLD / "band.npz")


def about_ending(flights, learned=10, **fields):
    """What a file states of a count of so many flights that ends so."""
    stated = {"epsilon": EPSILON, "confidence": CONFIDENCE, "early": 0, "until_sure": False}
    plan = {"runs": learned + flights}
    return replace(KEPT.about, plan=plan, learned=learned, **{**stated, **fields})


RULES = {
    "fixed": (93, {}),
    "two steps": (105, {"early": 66}),
    "any time": (208, {"until_sure": True}),
}
ABOUT = {name: about_ending(flights, **fields) for name, (flights, fields) in RULES.items()}
ENDINGS = {name: KEPT.ending.of(about) for name, about in ABOUT.items()}
FIXED, TWO, ANY = ENDINGS.values()


@pytest.mark.parametrize(
    ("ending", "flights", "outside", "chance"),
    [
        # of as many as planned, and of twice as many
        (FIXED, 93, 1, lambda p: binom.cdf(1, 93, p)),
        (FIXED, 186, 4, lambda p: binom.cdf(4, 186, p)),
        (TWO, 66, 0, lambda p: binom.pmf(0, 66, p)),
        (TWO, 105, 1, lambda p: binom.cdf(1, 105, p) + binom.pmf(0, 66, p) * binom.sf(1, 39, p)),
    ],
)
def test_what_is_supported_has_the_chance_of_an_error_that_is_stated(
    ending, flights, outside, chance
):
    supported = ending.supported(outside, flights)

    assert ending.allowed(flights) >= outside
    assert supported.epsilon <= EPSILON
    assert chance(supported.epsilon) == pytest.approx(1.0 - CONFIDENCE, rel=1e-6)
    stated = re.fullmatch("leaves the fence with probability at most (.*)", supported.claim)
    assert stated is not None
    assert supported.epsilon <= float(stated[1]) < 1.01 * supported.epsilon


@pytest.mark.parametrize(
    ("ending", "flights", "outside"),
    [(FIXED, 92, 0), (TWO, 66, 1), (TWO, 65, 0), (TWO, 67, 0), (TWO, 104, 0)],
)
def test_flights_that_were_not_flown_count_as_outside(ending, flights, outside):
    supported = ending.supported(outside, flights)

    assert (supported.claim, supported.lacks[:5]) == ("", ", of ")
    missing = ending.flights - flights + outside
    chance = binom.cdf(missing, ending.flights, supported.epsilon)
    assert chance <= (1.0 - CONFIDENCE) * (1.0 + ROUNDING)


@pytest.mark.parametrize(
    ("flights", "outside", "epsilon", "says"),
    [
        (82, 0, EPSILON, "leaves the fence with probability at most 0.05"),
        (81, 0, 1.0, ""),
        # of 12 flights all are outside
        (12, 12, 1.0, "is not certainly inside the fence with probability above 0.05"),
    ],
)
def test_what_is_sure_at_any_time_is_a_yes_a_no_or_nothing(flights, outside, epsilon, says):
    supported = ANY.supported(outside, flights)

    assert (supported.epsilon, supported.claim) == (epsilon, says)
    assert bool(supported.lacks) != bool(says)


@pytest.mark.parametrize(
    ("ending", "flights", "outside", "decided", "complete"),
    [
        (FIXED, 24, 1, False, False),
        (FIXED, 24, 2, True, False),  # of 93 one may be outside
        (FIXED, 93, 1, False, True),
        (TWO, 66, 0, True, True),
        (TWO, 66, 1, False, True),
        (TWO, 65, 0, False, False),
        (TWO, 105, 1, False, True),
        (TWO, 105, 2, True, True),
        (ANY, 72, 0, False, False),
        (ANY, 84, 0, True, False),  # a yes with none outside takes 82
        (ANY, 12, 12, True, False),
        (ANY, 208, 9, False, True),
    ],
)
def test_a_count_is_decided_where_the_answer_is_certain(
    ending, flights, outside, decided, complete
):
    assert ending.decided([outside], flights) == decided
    assert ending.complete(flights) == complete


@pytest.mark.parametrize(
    ("ending", "looks"),
    [(FIXED, [24, 48]), (TWO, [24, 48, 66, 96]), (ANY, [*range(12, 208, 12)])],
    ids=ENDINGS,
)
def test_an_answer_is_looked_for_at_numbers_that_are_fixed_beforehand(ending, looks):
    assert ending.looks() == looks


def test_a_count_that_may_end_early_is_expected_to():
    assert [TWO.expected(n) for n in (0, 48, 66, 96)] == [66, 66, 105, 105]
    assert FIXED.expected(24) == 93


FENCES = {0: "", 1: "the band and its fence", 2: "the band and 2 fences"}
ALONE = {0: "", 1: "", 2: "2 fences"}


@pytest.mark.parametrize("ending", ENDINGS.values(), ids=ENDINGS)
@pytest.mark.parametrize(("fences", "times"), [*itertools.product(FENCES, (1, 2, 4))])
def test_the_confidence_is_that_of_as_many_claims_as_its_words_name(ending, fences, times):
    """Bonferroni: errors add up over claims and readings, but not over those valid at any time."""
    (about,) = (ABOUT[name] for name, x in ENDINGS.items() if x is ending)
    about = replace(about, fences=({"fence": 1},) * fences, planned=(0.1, 0.99))
    shared = ending.shared(about, times * ending.flights)

    claims = fences if ending is ANY else 1 + fences
    readings = 1 if ending is ANY else {1: 1, 2: 2, 4: 3}[times]
    words = ALONE[fences] if ending is ANY else FENCES[fences]
    spent = 0.05 + 0.01
    assert shared.confidence == pytest.approx(1.0 - max(1, claims) * readings * spent)
    assert words in shared.words
    assert ("fence" in shared.words) == bool(words)
    assert (f"{readings} numbers of flights" in shared.words) == (readings > 1)
    assert "with the claim planned, 0.1 at 0.99" in shared.words


def test_a_single_claim_shares_its_confidence_with_none():
    shared = FIXED.shared(ABOUT["fixed"], 93)

    assert (shared.confidence, shared.words) == (pytest.approx(0.95), "")


@pytest.mark.parametrize(
    ("flights", "allowed"), [(12, 5), (208, 5), (207, 5), (233, 5), (234, 6), (416, 13)]
)
def test_of_fewer_flights_than_planned_as_many_may_be_outside_as_of_all(flights, allowed):
    assert (ANY.allowed(flights), ANY.expected(flights)) == (allowed, 208)
    n = max(flights, 208)
    assert binom.cdf(allowed, n, EPSILON) <= 0.05 < binom.cdf(allowed + 1, n, EPSILON)


def test_the_scale_is_the_largest_score_that_is_counted_inside_once_the_count_is_complete():
    scores = np.random.default_rng(3).permutation(np.arange(1.0, 106.0))

    assert FIXED.scale(scores[:92]) == ANY.scale(scores) == np.inf
    assert FIXED.scale(scores[:93]) == np.sort(scores[:93])[-2]  # one of 93 may be outside
    assert TWO.scale(scores[:66]) == scores[:66].max()
    assert TWO.scale(scores[:67]) == np.inf
    assert TWO.scale(scores) == 104.0
