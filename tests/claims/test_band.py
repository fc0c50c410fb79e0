"""Bands: windows, learned shapes, claims, files, and how often a claim is false."""

import json
from dataclasses import replace

import numpy as np
import pytest
from counted_turns import forged
from made_up_band import about_of, band_flights
from scipy.stats import binom

import flighttune as ft
from flighttune.base.files.array import write_sealed
from flighttune.base.files.table import tables_of
from flighttune.campaigns.statistics.count import allowed_outside, flights_needed
from flighttune.claims import shape
from flighttune.claims.counted_file import read_counted

# s and samples of the made-up flights, and their signals
DT, SAMPLES, SIGNALS = 0.1, 41, {"chi_err": "rad", "h": "m"}
EDGES = shape.window_edges(SAMPLES, 1, 2)
MOST_ABOVE = 250  # more of the flights of `worst_chance` are too wide with no probability
SINGLE = 1e-6  # relative rounding of single precision, both ways


def random_flights(count, rng, wind=None):
    """Random walks of two signals of unlike size; the first drifts with the square of the wind."""
    walks = np.cumsum(rng.normal(size=(count, SAMPLES, 2)) * [1e-3, 2.0], axis=1)
    if wind is not None:
        walks[..., 0] += 0.02 * wind[:, :1] * wind[:, 1:] - 0.1 * wind[:, :1]
    return walks


def extremes_of(flights):
    return np.stack([shape.window_extremes(flight, EDGES) for flight in flights])


def band_of(learned, counted, epsilon=0.05, confidence=0.95, winds=None):
    """A band learned from some flights and counted on others, which are values over time."""
    kept = winds or (np.zeros((len(learned), 0)), np.zeros((len(counted), 0)))
    coefficients, half = shape.learned_shape(extremes_of(learned), kept[0], epsilon)
    extremes = extremes_of(counted)
    about = about_of(
        signals=SIGNALS, coefficients=coefficients, half=half,
        predicted_from="wind" if winds else None, plan={"runs": len(learned) + len(counted)},
        learned=len(learned), epsilon=epsilon, confidence=confidence,
    )  # fmt: skip
    return ft.Band(about=about, flights=walks_flights(about), extremes=extremes, wind=kept[1])


def walks_flights(_):
    return band_flights(EDGES * DT)


def load_walks(path):
    return read_counted(path, walks_flights)


@pytest.fixture(scope="module")
def walks():
    rng = np.random.default_rng(5)
    return random_flights(60, rng), random_flights(93, rng)


@pytest.fixture(scope="module")
def counted(walks):
    return band_of(*walks)


def test_windows_include_both_of_their_edges_and_are_rounded_outwards():
    values = np.array([0.0, 1.0, 2.0, 5.0, 4.0, 3.0, -7.0])[:, None] + 0.1
    edges = np.array([0, 3, 6])

    low, high = np.moveaxis(shape.window_extremes(values, edges)[:, 0].astype(float), -1, 0)

    assert low == pytest.approx([0.1, -6.9], rel=SINGLE)
    assert high == pytest.approx([5.1, 5.1], rel=SINGLE)
    assert (low < [0.1, -6.9]).all()
    assert (high > 5.1).all()


def test_windows_of_values_that_last_to_the_next_sample_share_no_edge():
    values = np.array([0.0, 1.0, 2.0, 5.0, 4.0, 3.0])[:, None]

    low, high = np.moveaxis(shape.window_extremes(values, np.array([0, 3, 6]))[:, 0], -1, 0)

    assert low == pytest.approx([0.0, 3.0], rel=SINGLE)
    assert high == pytest.approx([2.0, 5.0], rel=SINGLE)


def test_a_signal_without_a_value_in_a_whole_window_may_have_had_any():
    values = np.array([0.0, 1.0, np.nan, np.nan, np.nan, 3.0])[:, None]

    low, high = np.moveaxis(shape.window_extremes(values, np.array([0, 2, 4, 5]))[:, 0], -1, 0)

    assert low == pytest.approx([0.0, -np.inf, 3.0], rel=SINGLE)
    assert high == pytest.approx([1.0, np.inf, 3.0], rel=SINGLE)


def test_windows_are_few_enough_for_memory():
    assert len(shape.window_edges(1001, 1640, 2)) == shape.MAX_WINDOWS + 1
    assert 2 * 2 * 1_000_000 * (len(shape.window_edges(1001, 1_000_000, 2)) - 1) <= 2**27
    assert shape.window_edges(3, 10, 1).tolist() == [0, 1, 2]


def test_the_flights_outside_are_those_that_leave_the_bounds(walks, counted):
    """`Bounds.contain` compares every sample with the bounds; the score uses extremes."""
    bounds = counted.bounds(np.arange(SAMPLES) * DT)
    inside = [
        bounds.contain({name: flight[:, i] for i, name in enumerate(SIGNALS)})
        for flight in walks[1]
    ]

    # of 93 flights one may lie outside: table of Guba, Makai and Pal (2003)
    assert inside.count(False) == counted.outside == 1
    assert inside == (counted.scores <= counted.scale).tolist()
    nearest = counted.nearest - counted.about.learned
    assert counted.scores[nearest] == counted.scale
    assert bounds.half_widths[0] == pytest.approx(counted.half_widths[0])


def test_a_peak_that_all_flights_share_is_not_spread_over_its_neighbours():
    flights = 1e-3 * np.random.default_rng(8).normal(size=(60, 1)) * np.ones(40)
    flights[:, 20] *= 1e3
    extremes = np.repeat(flights.astype(np.float32)[:, :, None, None], 2, axis=-1)

    _, half = shape.learned_shape(extremes, np.zeros((60, 0)), 0.05)

    assert half[[19, 21], 0].max() < 0.01 * half[20, 0]


@pytest.mark.slow
def test_signals_of_unlike_size_are_left_about_equally_often():
    rng = np.random.default_rng(6)
    counted = band_of(random_flights(200, rng), random_flights(2000, rng))
    middle = counted.about.coefficients[0]

    away = np.abs(counted.extremes - middle[..., None]).max(axis=-1) > counted.half_widths
    left = away.any(axis=1).sum(axis=0)

    # 2000 flights leave the band of both 81 times at most; the signals share them
    assert left.sum() >= counted.outside
    assert left.min() > 0.25 * left.max()


@pytest.mark.parametrize("winds", [True, False])
def test_a_band_around_what_the_wind_predicts_says_so_and_another_does_not(winds):
    rng = np.random.default_rng(7)
    drawn = rng.uniform(-4.0, 4.0, (60, 2)), rng.uniform(-4.0, 4.0, (93, 2))
    flights = [random_flights(len(wind), rng, wind) for wind in drawn]

    sentence = band_of(*flights, winds=drawn if winds else None).sentence

    assert ("leaves the band, around the middle that its wind predicts," in sentence) == winds


@pytest.mark.slow
def test_a_band_that_is_given_the_wind_is_as_narrow_as_without_any():
    rng = np.random.default_rng(7)
    winds = rng.uniform(-4.0, 4.0, (200, 2)), rng.uniform(-4.0, 4.0, (300, 2))
    flights = [random_flights(len(wind), rng, wind) for wind in winds]

    blind, knowing = (band_of(*flights, winds=both).half_widths[0, 0] for both in (None, winds))
    calm = band_of(random_flights(200, rng), random_flights(300, rng)).half_widths[0, 0]

    assert blind > 20.0 * calm
    assert knowing < 1.3 * calm
    with pytest.raises(ft.InputError, match="`wind`"):
        band_of(*flights, winds=winds).bounds(np.zeros(1))


def test_another_claim_of_the_same_count_costs_no_flight(counted):
    wider, narrower = counted.claiming(0.04, 0.95), counted.claiming(0.2, 0.5)

    # each of the two claims, that planned at 0.95 too, may be false
    assert [band.confidence for band in (wider, narrower)] == pytest.approx([0.90, 0.45])

    assert wider.scale == counted.scores.max()
    assert narrower.scale < counted.scale < wider.scale
    with pytest.raises(ft.InputError, match=r"`flights` .*688.* 93"):
        counted.claiming(0.01, 0.999)


def test_a_file_keeps_why_flights_did_not_complete_and_no_other_draws(counted, tmp_path):
    file, extremes, draws = tmp_path / "band.npz", counted.extremes.copy(), counted.draws[:3]
    extremes[:2] = np.float32([-np.inf, np.inf])
    endings = [
        {"run": draw, "status": "ground_contact", "reason": f"t = {t} s: hit the ground."}
        for draw, t in zip(draws.tolist(), (2.5, 11, 3), strict=True)
    ]

    replace(counted, extremes=extremes, endings=endings[:2]).save(file)
    (row,) = next(x for x in load_walks(file).answer().tables if x.name == "endings").records
    assert (row["count"], row["run"], row["ended"]) == (2, draws[0], "ground contact")
    assert row["reason"] == "t = 2.5 to 11 s: hit the ground."

    replace(counted, extremes=extremes, endings=endings).save(file)
    with pytest.raises(ft.InputError, match="`endings` must be of draws"):
        load_walks(file)


def test_flights_that_did_not_complete_count(walks, counted):
    lost = np.broadcast_to(np.float32([-np.inf, np.inf]), (2, *counted.extremes.shape[1:]))

    once = counted.with_flights(lost[:1], *[np.zeros((1, 0))] * 2)
    none = counted.with_flights(lost, *[np.zeros((2, 0))] * 2)

    assert once.scale < np.inf
    assert (once.outside, once.not_completed) == (1, 1)
    assert not none.claims
    assert "fresh flights 2 did not complete, and at most 1 may." in none.sentence
    learned = extremes_of(walks[0])
    learned[shape.MIN_LEARNED - 1 :] = lost[0]
    with pytest.raises(ft.InputError, match=r"`learn` .*10.* 9"):
        shape.learned_shape(learned, np.zeros((60, 0)), 0.05)


def test_each_reading_of_a_growing_count_spends_its_part_of_the_confidence(walks, counted):
    more = extremes_of(random_flights(93, np.random.default_rng(7)))

    twice = counted.with_flights(more, *[np.zeros((93, 0))] * 2)
    fenced = twice.with_fence({"some": "fence"})

    confidences = [band.confidence for band in (counted, twice, fenced)]
    assert confidences == pytest.approx([0.95, 0.90, 0.80])
    assert twice.readings == (93, 186)
    assert "confidence 0.9 (shared by 2 numbers of flights)" in twice.sentence
    assert "0.8 (shared by the band and its fence at 2 numbers of flights)" in fenced.sentence
    assert fenced.with_fence({"some": "fence"}).confidence == fenced.confidence
    with pytest.raises(ft.InputError, match="`confidence`"):
        twice.claiming(0.05, 0.5)


def worst_chance(numbers, epsilon, confidence):
    """Largest probability that a band is false at the number of flights where its reader stops.

    After each reading he may stop, or go on to any of the `numbers` of the next one, and knows how
    many flights are above the true width: so many that a band which leaves out fewer is false.
    """

    def value(k, n, above):
        """Best chances from the k-th reading of n flights on, of which `above` are too wide."""
        false = (above <= allowed_outside(n, epsilon, confidence)).astype(float)
        if k + 1 == len(numbers):
            return false
        for other in numbers[k + 1](n):
            more = np.arange(MOST_ABOVE)
            later = value(k + 1, other, np.arange(above[-1] + MOST_ABOVE))
            chances = binom.pmf(more, other - n, epsilon)
            false = np.maximum(false, [chances @ later[s : s + MOST_ABOVE] for s in above])
        return false

    (first,) = numbers[0](0)
    above = np.arange(MOST_ABOVE)
    return binom.pmf(above, first, epsilon) @ value(0, first, above)


CLAIMS = [(0.01, 0.999, 1640), (0.01, 0.999, 688), (0.05, 0.99, 90), (0.05, 0.95, 59)]


def test_a_number_of_flights_chosen_after_looking_makes_the_confidence_false():
    """Two readings of 688 flights on: another program's exact probability is 0.00304, not 0.002."""
    # the best numbers are the least of which one more may lie outside
    best = [flights_needed(0.01, 0.999, outside) for outside in range(1, 120)]
    free = worst_chance([lambda _: [688], lambda _: best], 0.01, 0.999)

    assert free == pytest.approx(0.00304, abs=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("epsilon", "confidence", "first"), CLAIMS)
def test_no_choice_of_when_to_stop_makes_a_continued_count_false_more_often_than_stated(
    epsilon, confidence, first
):
    about = about_of(plan={"runs": 10 + first}, epsilon=epsilon, confidence=confidence)
    over = band_flights(np.array([0.0, 1.0]))
    numbers = [lambda _: [first], *3 * [lambda n: [2 * n]]]
    for k in range(1, 5):
        flights = np.zeros((first * 2 ** (k - 1), 1, 1, 2))
        band = ft.Band(
            about=about, flights=over, extremes=flights, wind=np.zeros((len(flights), 0))
        )
        worst = worst_chance(numbers[:k], epsilon, confidence)

        assert band.readings[-1] == len(flights)
        assert 0.5 * (1.0 - confidence) < worst <= 1.0 - band.confidence


def test_a_continued_count_has_other_draws_than_one_planned_so_long(counted):
    """One draw is left out at each number at which the count may be read."""
    draws = counted.draws_of(4 * 93)

    assert draws[:93].tolist() == list(range(60, 153))
    assert draws[93:186].tolist() == list(range(154, 247))
    assert draws[186:].tolist() == list(range(248, 434))


def values_of(band):
    kept = [array.tobytes() for array in (band.extremes, band.wind)]
    return json.dumps(tables_of(band.about)), kept


def test_a_file_comes_back_as_it_was_written(counted, tmp_path):
    counted.save(tmp_path / "x.npz")

    assert values_of(load_walks(tmp_path / "x.npz")) == values_of(counted)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda band: {"extremes": band.extremes.astype(float)}, "`extremes.npy` must be of type"),
        (lambda band: {"extremes": np.nan * band.extremes}, "`extremes` must be lowest"),
        (lambda band: {"wind": np.ones((93, 2))}, r"`wind` must have shape \(93, 0\)"),
        (lambda _: {"more": np.zeros(1)}, "`more.npy` must not be in the file of a band"),
        (lambda _: {"about": {"scale": 1.0}}, "`scale`"),
        (lambda _: {"about": {"plan": {"runs": 152}}}, "`extremes` must be of as many flights as"),
        (lambda _: {"about": {"epsilon": 0.001}}, "`flights` must be at least 2995"),
        (lambda _: {"about": {"predicted_from": "wind"}}, r"`coefficients` must have shape \(10,"),
        (lambda _: {"about": {"format": "flighttune band 0"}}, "`format`"),
        (lambda _: {"about": {"early": 93}}, "`early` must be below the 93 flights planned"),
        (lambda band: {"extremes": band.extremes[..., ::-1]}, "`extremes` must be lowest"),
        (lambda band: {"extremes": band.extremes[[*range(93), 0]], "wind": np.zeros((94, 0))},
         "`extremes` must be of as many flights as were planned, or of 2, 4.* got 94 for 93"),
        (lambda band: {"about": {"half": (0.0 * band.about.half).tolist()}}, "`half` must be pos"),
        (lambda band: {"about": {"signals": dict.fromkeys(band.about.signals, "ft")}},
         r"`signals`: \w+ must be in \w+, got .ft"),
        (lambda _: {"navigation": np.ones((93, 4))}, r"`navigation` must have shape \(93, 0\)"),
        (lambda _: {"by_rtk": np.ones((2, 3))}, r"`by_rtk` must have shape \(2, 2\)"),
        (lambda _: {"by_rtk": np.full((2, 2), np.nan)}, r"`by_rtk\.npy` must be finite"),
        (lambda _: {"endings": np.array('{"60": "stall: it did"}')}, "`endings` must be of draws"),
        (lambda _: {"endings": np.array('{"a": "stall"}')}, "`endings` must have a sentence"),
        (lambda _: {"endings": np.array('{"60": 3}')}, "`endings` must have a sentence"),
    ],
)  # fmt: skip
def test_a_forged_file_is_refused_in_one_line(counted, tmp_path, change, message):
    path = forged(counted, tmp_path / "x.npz", **change(counted))

    with pytest.raises(ft.InputError, match=f"x.npz: {message}") as caught:
        load_walks(path)
    assert "\n" not in str(caught.value)


def test_a_file_of_twice_as_many_flights_as_were_planned_is_read(counted, tmp_path):
    twice = {"extremes": np.concatenate([counted.extremes] * 2), "wind": np.zeros((186, 0))}

    assert load_walks(forged(counted, tmp_path / "x.npz", **twice)).readings == (93, 186)


@pytest.mark.parametrize("lost", ["extremes", "wind"])
def test_a_file_without_an_array_is_refused_by_its_name(counted, tmp_path, lost):
    counted.save(tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as file:
        write_sealed(tmp_path / "x.npz", {key: file[key] for key in file.files if key != lost})

    with pytest.raises(ft.InputError, match=rf"x.npz: `{lost}\.npy` must be in the file"):
        load_walks(tmp_path / "x.npz")


def test_a_count_is_decided_by_one_flight_more_than_may_be_outside(counted):
    """Of 93 flights 1 may be outside at 95 % / 95 % (Wilks)."""
    for lost, decided in ((1, False), (2, True)):
        extremes = counted.extremes.copy()
        extremes[:lost] = [-np.inf, np.inf]
        assert replace(counted, extremes=extremes).decided == decided


@pytest.mark.parametrize(
    ("samples", "most", "edges"),
    [
        (5, 200, [0, 1, 2, 3, 4]),
        (11, 3, [0, 3, 7, 10]),
        (2, 200, [0, 1]),
        (101, 4, [0, 25, 50, 75, 100]),
    ],
)
def test_windows_share_the_samples_of_a_flight(samples, most, edges):
    assert shape.window_edges(samples, 100, 2, most=most).tolist() == edges


def test_there_are_fewer_windows_for_more_flights_and_signals():
    """Of numbers of all flights no more than MAX_NUMBERS are kept, two of a window and signal."""
    flights, signals = 10**6, 3
    windows = shape.MAX_NUMBERS // (2 * flights * signals)
    assert len(shape.window_edges(10**6, flights, signals, most=10**6)) == windows + 1
    assert shape.window_edges(50, 10**12, 1).tolist() == [0, 49]


def test_the_middle_of_a_shape_is_between_its_ends_however_many_flights_come_to_each():
    """Of 40 flights ten come to 3 and 5 half-widths, the others to -1 and 1: between are 2 +- 3."""
    width = np.array([1.0, 2.0, 0.5])
    ends = np.array([[3.0, 5.0] if i % 4 == 0 else [-1.0, 1.0] for i in range(40)])
    extremes = ends[:, None, None, :] * width[:, None, None]

    coefficients, half = shape.learned_shape(extremes, np.zeros((40, 0)), 0.05)

    assert coefficients[:, :, 0] == pytest.approx(2.0 * width[None])
    assert half[:, 0] == pytest.approx(3.0 * width, rel=shape.LEAST_SHARE)


def test_a_mirrored_band_is_learned_from_mirrored_flights():
    rng = np.random.default_rng(5)
    middle = rng.exponential(1.0, (30, 8, 2)) * np.array([1.0, 3.0])
    extremes = np.stack([middle - rng.uniform(0.1, 0.2, middle.shape), middle + 0.3], axis=-1)

    coefficients, half = shape.learned_shape(extremes, np.zeros((30, 0)), 0.1)
    mirrored, as_wide = shape.learned_shape(-extremes[..., ::-1], np.zeros((30, 0)), 0.1)

    assert mirrored == pytest.approx(-coefficients)
    assert as_wide == pytest.approx(half)


def test_each_of_many_flights_has_a_score():
    extremes = np.zeros((shape.PART + 3, 1, 1, 2))
    extremes[shape.PART] = [-7.0, 2.0]

    scores = shape.scores_of(
        extremes, np.zeros((len(extremes), 0)), np.zeros((1, 1, 1)), np.ones((1, 1))
    )

    assert (len(scores), scores.argmax(), scores.max()) == (len(extremes), shape.PART, 7.0)
