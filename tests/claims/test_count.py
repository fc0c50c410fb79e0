"""Claims from counts: the published sample sizes, and how often a claim is false."""

import re

import numpy as np
import pytest
from fuzzing import slow
from scipy.integrate import quad
from scipy.stats import binom, binomtest, hypergeom

import flighttune as ft
from flighttune.campaigns.statistics import count
from flighttune.claims import mission
from flighttune.claims.ending import Fixed


def test_sample_sizes_are_the_published_ones():
    """Wilks' one-sided 95 % / 95 %, orders 1 to 5: table of A. Guba, M. Makai and L. Pal (2003)."""
    published = [59, 93, 124, 153, 181]

    assert [count.flights_needed(0.05, 0.95, outside) for outside in range(5)] == published
    assert [count.allowed_outside(flights, 0.05, 0.95) for flights in published] == list(range(5))
    assert [count.allowed_outside(flights - 1, 0.05, 0.95) for flights in published] == list(
        range(-1, 4)
    )


def test_as_few_flights_as_there_are_may_be_enough():
    # One flight is inside with probability 1/2. One of two is, or both are, with 1 - 0.9^2 = 0.19.
    assert count.flights_needed(0.5, 0.5) == 1
    assert count.flights_needed(0.9, 0.8, outside=1) == 2


@pytest.mark.parametrize(("claims", "flights"), [(1, 628), *slow((2, 720), (3, 773))])
def test_a_mission_counts_the_fewest_flights_of_which_two_may_be_outside(claims, flights):
    """1 % at 0.95 for all claims: own sums of the binomial distribution, also printed as help."""
    share = 0.05 / claims
    ending = Fixed.enough(None, mission.EPSILON, 1.0 - share, outside=mission.OUTSIDE)

    assert (mission.EPSILON, mission.CONFIDENCE, ending.flights) == (0.01, 0.95, flights)
    assert binom.cdf(2, flights, 0.01) <= share < binom.cdf(2, flights - 1, 0.01)
    assert ending.allowed(flights) == 2
    for outside in range(3):
        supported = ending.supported(outside, flights).epsilon
        assert binom.cdf(outside, flights, supported) == pytest.approx(share, rel=1e-6)
    # Scores are uniform: of many counts as few are false as their share of the confidence says.
    scores = np.random.default_rng(claims).random((4000, flights))
    false = np.mean([1.0 - ending.scale(own) > 0.01 for own in scores])
    assert false == pytest.approx(share, abs=4.0 * np.sqrt(share / 4000))


def test_flights_that_were_not_completed_count():
    scores = np.linspace(0.0, 1.0, 93)

    scores[-1] = np.inf
    assert count.counted_scale(scores, 0.05, 0.95) == (scores[-2], 1)
    scores[-2] = np.inf
    assert count.counted_scale(scores, 0.05, 0.95) == (np.inf, 0)
    with pytest.raises(ft.InputError, match=r"at least 59 .*`epsilon`"):
        count.counted_scale(scores[:58], 0.05, 0.95)


@pytest.mark.parametrize(("outside", "flights"), [(0, 40), (3, 40), (5, 1640), (40, 40)])
def test_the_epsilon_that_a_count_supports_is_the_bound_of_clopper_and_pearson(outside, flights):
    exact = binomtest(outside, flights, alternative="less").proportion_ci(0.999, method="exact")

    epsilon = count.supported_epsilon(outside, flights, 0.999)
    assert epsilon == pytest.approx(exact.high, rel=1e-9)
    if epsilon < 1.0:  # as `allowed_outside` counts
        assert count.allowed_outside(flights, epsilon * 1.0001, 0.999) == outside
        assert count.allowed_outside(flights, epsilon * 0.9999, 0.999) == outside - 1


@pytest.mark.parametrize(("epsilon", "again"), [(0.05, 59), (0.01, 299), (0.3, 9)])
def test_a_forgery_that_doubles_epsilon_is_found_with_95_percent(epsilon, again):
    flights, forged = 1000, round(1000 * epsilon)

    assert count.flights_again(epsilon) == again
    missed = count.chance_missed(forged, flights, again)
    assert missed == pytest.approx(hypergeom.pmf(0, flights, forged, again))
    assert missed <= 0.05
    assert count.chance_missed(5, 10, 6) == 0.0


def spread(terms, confidence):
    """Chance to miss the forgery that doubles a sum of bounds and is missed most often.

    It has any number of forged flights in each term: a weight, its flights outside, and all.
    """
    totals = {0.0: 1.0}  # chance to miss, by what the bounds have gained
    claimed = sum(w * count.supported_epsilon(k, n, confidence) for w, k, n in terms)
    for weight, outside, flights in terms:
        _, again = count.forged_and_again(outside, flights, confidence)
        bound = count.supported_epsilon(outside, flights, confidence)
        gains = [
            (
                weight * (count.supported_epsilon(outside + m, flights, confidence) - bound),
                count.chance_missed(m, flights, again),
            )
            for m in range(min(flights - outside, 40) + 1)
        ]
        gained = [(x + y, p * q) for x, p in totals.items() for y, q in gains if p * q > 1e-4]
        totals = {x: max(p for y, p in gained if y == x) for x in {y for y, _ in gained}}
    return max((p for x, p in totals.items() if x >= claimed), default=0.0)


@pytest.mark.parametrize(
    "terms",
    [
        [(1.0, 0, 500)],
        [(1.0, 1, 500)],
        [(1.0, 7, 300)],
        [(1.0, 0, 300), (1.0, 0, 300)],
        [(0.7, 0, 200), (0.3, 3, 100)],
        [(0.4, 2, 100), (0.4, 0, 60), (0.2, 5, 60)],
    ],
)
def test_a_claim_that_was_doubled_by_forgeries_in_any_terms_is_found_in_19_of_20(terms):
    assert 0.0 < spread(terms, 0.98) <= 0.05
    forged, again = count.forged_and_again(0, 500, 0.98)
    bounds = [count.supported_epsilon(k, 500, 0.98) for k in (0, forged - 1, forged)]
    assert bounds[1] < 2.0 * bounds[0] <= bounds[2]
    assert count.chance_missed(forged, 500, again - 1) > 0.05


@pytest.mark.parametrize(("epsilon", "confidence"), [(0.01, 0.95), (0.05, 0.95), (0.3, 0.9)])
def test_evidence_is_the_integral_of_likelihood_ratios(epsilon, confidence):
    for outside, flights in ((0, 12), (2, 40), (9, 30)):

        def ratio(q, k=outside, n=flights):
            return (q / epsilon) ** k * ((1.0 - q) / (1.0 - epsilon)) ** (n - k)

        top = min(1.0, 20.0 * epsilon)
        never = 0.5 * ratio(0.0) if outside == 0 else 0.0
        below = never + 0.5 * quad(ratio, 0.0, epsilon)[0] / epsilon
        above = quad(ratio, epsilon, top)[0] / (top - epsilon)

        assert np.exp(count.log_evidence(outside, flights, epsilon)) == pytest.approx(
            [below, above]
        )
        needed = 2.0 / (1.0 - confidence)
        answer = "yes" if below >= needed else "no" if above >= needed else ""
        assert count.sure(outside, flights, epsilon, confidence) == answer


# Times at which campaigns end that are looked at after each flight, as shares of the number
# planned with five outside, 208: of 200 campaigns of a search of its own, on a grid of q.
MEANS = {0.0: 0.39, 0.005: 0.62, 0.0125: 0.98, 0.1: 1.34, 0.25: 0.12}


@pytest.mark.soak
def test_an_answer_is_false_no_more_often_than_stated_however_often_it_is_looked_at():
    epsilon, confidence, planned = 0.05, 0.95, count.flights_needed(0.05, 0.95, 5)
    rng, n, campaigns = np.random.default_rng(6), np.arange(1, 4 * planned + 1), 2000

    def ends(p, campaigns):
        """When each answer is sure first, and which; after all flights where it never is."""
        k = np.cumsum(rng.random((campaigns, len(n))) < p, axis=1)
        surely = np.stack(count.log_evidence(k, n, epsilon)) > np.log(2.0 / (1.0 - confidence))
        return np.where(
            surely.any(axis=0).any(axis=1), surely.any(axis=0).argmax(axis=1) + 1, n[-1]
        ), surely.any(axis=2)

    _, both = ends(epsilon, campaigns)  # then each of both answers is false
    # more false answers than this have a probability of 0.1 % at the rate stated
    most = binom.ppf(0.999, campaigns, (1.0 - confidence) / 2.0)
    assert 0 < both[0].sum() <= most
    assert 0 < both[1].sum() <= most
    for p, share in MEANS.items():
        took, answers = ends(p, 200)
        spread = np.std(took) / planned * np.sqrt(2.0 / 200)  # of the difference of two means
        assert took.mean() / planned == pytest.approx(share, abs=4.0 * spread + 0.005)
        assert answers[0 if p > epsilon else 1].mean() <= 0.05


@pytest.mark.parametrize(("share", "answer"), [(0, "yes"), (1, "no")])
@pytest.mark.parametrize(("verb", "epsilon"), [(ft.mission, 0.01), (ft.meet, 0.05)])
def test_verbs_that_count_until_sure_say_after_how_many_looks_a_clear_answer_comes(
    verb, epsilon, share, answer
):
    """Own likelihood ratios at every 12th flight, against the bound of Ville, 2 / 0.05."""
    q = np.linspace(0.0, 1.0, 200_001)[1:]
    for n in range(12, 600, 12):
        ratio = ((q / epsilon) if share else (1.0 - q) / (1.0 - epsilon)) ** n
        at_zero = 0.5 * (1.0 - epsilon) ** -n
        within = (q > epsilon) if share else (q <= epsilon)
        evidence = ratio[within].mean() if share else at_zero + 0.5 * ratio[within].mean()
        if evidence > 2.0 / 0.05:
            break

    said = " ".join(verb.__doc__.split())
    assert re.search(rf"clear {answer}( takes)? {n}\b", said)


def test_too_few_flights_are_refused_with_two_digits_of_what_the_confidence_leaves():
    with pytest.raises(ft.InputError, match=r"at least 408 .* `confidence` 0\.983, got 60"):
        count.check_enough(60, 0.01, 1.0 - 0.05 / 3.0)


def test_looks_are_a_dozen_flights_apart_and_later_an_eighth():
    """From 108 on they are 108 // 8 = 13 flights apart; the last is after all draws."""
    dozens = [*range(12, 109, 12)]

    assert count.looks(5) == [5]
    assert count.looks(12) == [12]
    assert count.looks(100) == [*dozens[:-1], 100]
    assert count.looks(121) == [*dozens, 121]
    assert count.looks(140) == [*dozens, 121, 136, 140]
