"""What counts of all kinds have in common: whose flights they are of, and what they spend."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from flown_campaigns import flown_here
from made_up import made_up_run, made_up_scenario
from made_up_band import (
    CONFIDENCE,
    FLIGHTS,
    LEARNED,
    about_of,
    band_flights,
    count_of,
    plan_of_paper,
    scores_of,
)

import flighttune as ft
from flighttune.campaigns.flying.compiled import COMPILED, CompiledFlights
from flighttune.claims import counting, unfinished
from flighttune.claims.band import RecordedSignals
from flighttune.claims.counted import axis_of, wind_at_start
from flighttune.claims.monitor import Monitor, WatchedSignals
from flighttune.gaps.watch import SignalModel

GAINS = ft.PAPER_GAINS


def scaled(factor):
    return replace(GAINS, K_I=GAINS.K_I * factor)


@pytest.fixture(scope="module")
def counted():
    """A band of half-width 1 that five of its flights leave, one of them infinitely."""
    measured = RecordedSignals(units={"chi_err": "rad"})
    return count_of(ft.Band, plan_of_paper(made_up_scenario()), measured, 1.0, scores_of(1.0))


def test_a_count_names_gains_that_were_tuned_for_another_aircraft():
    of = {"aircraft": ["c172p"], "V_a_mps": [50.0]}
    K = {"K_P": GAINS.K_P.tolist(), "K_I": GAINS.K_I.tolist()}
    made = made_up_scenario(gains=["paper", {"name": "other", **K, "tuned_for": of}])
    flights = replace(band_flights(np.array([0.0, 1.0])), scenario=made)

    assert flights.gains_notes == ()
    (note,) = replace(flights, gains_name="other").gains_notes
    assert note.startswith("The gains other were tuned for the c172p at 50 m/s; here they fly on")


@pytest.mark.parametrize(
    ("plant", "name", "gains", "says"),
    [
        ("kinematic", "paper", GAINS, ""),
        ("kinematic", "paper:mine", GAINS, ""),
        ("kinematic", "paper", scaled(1.0 + 5e-7), ""),
        ("kinematic", "paper", scaled(1.0 - 2e-5), "its gains are not those counted on, paper"),
        ("kinematic", "paper", None, "its gains are not those counted on, paper"),
        ("point_mass", "paper", GAINS, "plant is point_mass, counted on kinematic"),
        ("kinematic", "exact:paper", GAINS, "law is exact, counted on paper"),
    ],
)
def test_a_count_is_of_its_plant_law_and_gains(plant, name, gains, says):
    assert band_flights(np.array([0.0, 1.0])).flown_otherwise(plant, name, gains) == says


def test_flights_of_files_that_have_changed_are_of_another_aircraft():
    flights = replace(band_flights(np.array([0.0, 1.0])), aircraft={"aerosonde": "0" * 64})

    said = "the files of aerosonde are not those counted on"
    assert flights.not_counted(made_up_scenario(), "kinematic", "paper") == said
    with pytest.raises(ft.InputError, match="`aerosonde` must have the files"):
        _ = flights.route


def test_the_score_of_a_run_is_its_largest_distance_in_half_widths_of_its_window():
    edges, measured = np.array([0.0, 1.0, 2.0]), RecordedSignals(units={"chi_err": "rad"})
    kept = counting.Kept(measured=measured, edges=edges, windy=False)
    about = about_of(
        plan={},
        signals={"chi_err": "rad"},
        half=np.array([[0.1], [0.4]]),
        coefficients=np.array([[[0.05], [0.0]]]),
    )
    t = np.arange(9) / 4.0
    run = made_up_run({"chi_err": np.where(t < 0.9, -0.25, 0.5)}, t)

    # 0.45 and 0.30 in the first window, which ends with the first sample of the second
    assert counting.score(kept, about, run, made_up_scenario()) == pytest.approx(4.5)
    later = made_up_run({"chi_err": np.where(t < 1.1, 0.05, 0.5)}, t)
    assert counting.score(kept, about, later, made_up_scenario()) == pytest.approx(1.25)


@pytest.mark.parametrize(("speed", "from_deg"), [(None, 0.0), (3.0, 250.0), (5.0, 0.0)])
def test_the_wind_at_the_start_blows_from_where_it_comes(speed, from_deg):
    wind = {} if speed is None else {"wind": {"speed_mps": speed, "from_deg": from_deg}}
    scenario = made_up_scenario(**wind)

    away = -(speed or 0.0) * np.exp(1j * np.deg2rad(from_deg))
    expected = (away.real, away.imag)
    assert tuple(wind_at_start(scenario)) == pytest.approx(expected, abs=1e-12)


def test_the_wind_at_the_start_is_that_of_its_height():
    """The height is halfway between winds of 2 m/s and 8 m/s from the south, which blow north."""
    level = [{"h_m": h, "speed_mps": V, "from_deg": 180.0} for h, V in ((0.0, 2.0), (600.0, 8.0))]
    plant = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    flight = {"V_a_mps": 25.0, "h_m": 300.0}
    scenario = made_up_scenario(wind={"level": level}, flight=flight, plant=plant)

    assert tuple(wind_at_start(scenario)) == pytest.approx((5.0, 0.0), abs=1e-12)


def test_bounds_in_a_wind_are_about_the_middle_that_it_predicts(counted):
    """The middle grows by 0.3 per m/s from the south and by 0.01 per m/s from west and south."""
    shape = counted.about.half.shape
    coefficients = np.zeros((10, *shape))
    # products of at most three components: powers of the wind to the east, then of that north
    coefficients[[0, 4, 5]] = np.array([0.5, 0.3, 0.01])[:, None, None]
    about = replace(counted.about, predicted_from="wind", coefficients=coefficients)
    given = replace(counted, about=about, wind=np.zeros((FLIGHTS, 2)))

    bounds = given.bounds(np.zeros(1), np.array([2.0, -3.0]))

    middle = 0.5 + 0.3 * 2.0 - 0.01 * 6.0
    assert 0.5 * (bounds.low + bounds.high)[0, 0] == pytest.approx(middle)
    assert 0.5 * (bounds.high - bounds.low)[0, 0] == pytest.approx(given.scale)


def test_the_hash_of_a_count_is_of_all_its_numbers(counted):
    others = [
        replace(counted, extremes=counted.extremes * 0.5),
        replace(counted, navigation=np.zeros((FLIGHTS, 4))),
        replace(counted, navigation=np.ones((FLIGHTS, 4))),
        replace(counted, wind=np.ones((FLIGHTS, 2))),
        replace(counted, about=replace(counted.about, confidence=0.98)),
    ]
    assert len({counted.sha256, *(other.sha256 for other in others)}) == 1 + len(others)


def test_a_flight_of_a_route_is_judged_by_its_farthest_place_so_far():
    run = made_up_run({"along": [0.0, 3.0, 2.0, 5.0]}, [0.0, 0.1, 0.2, 0.3])

    assert axis_of(run).tolist() == [0.0, 3.0, 3.0, 5.0]


def test_boxes_are_for_tubes_alone(counted):
    with pytest.raises(ft.InputError, match="`boxes` must be given for the tube of an aircraft"):
        ft.verify(counted, boxes="boxes.npz")


def run_of(scenario=None, status="completed", gains=GAINS):
    tables = (scenario or made_up_scenario()).as_dict()
    signals = {"chi": [0.0, 0.0], "gamma": [0.0, 0.0]}
    return made_up_run(signals, [0.0, 0.02], status=status, gains=gains, scenario=tables)


@pytest.mark.parametrize(
    ("run", "says"),
    [
        (run_of(), ""),
        (run_of(status="diverged"), "status is diverged, counted on completed"),
        (run_of(gains=scaled(1.1)), "its gains are not those counted on, paper"),
        (run_of(made_up_scenario(flight={"V_a_mps": 26.0})), "flight.V_a_mps is 26, counted on 25"),
    ],
)
def test_a_count_says_nothing_of_other_flights(counted, run, says):
    assert counted.why_not(run).startswith(says)
    assert bool(counted.why_not(run)) == bool(says)


def test_a_count_that_claims_nothing_says_nothing_of_any_flight(counted):
    lost = np.full_like(counted.extremes, np.inf)

    assert "nothing is claimed" in replace(counted, extremes=lost).why_not(run_of())


def test_each_number_of_flights_at_which_it_is_read_doubles_the_last(counted):
    assert counted.first == FLIGHTS
    longer = replace(
        counted, extremes=np.concatenate([counted.extremes] * 4), wind=np.zeros((4 * FLIGHTS, 0))
    )

    assert counted.readings == (259,)
    assert longer.readings == (259, 518, 1036)
    # after each, a draw is left out
    draws = longer.draws
    assert draws[0] == LEARNED
    assert [draws[i] - draws[i - 1] for i in (258, 259, 260, 518, 777)] == [1, 2, 1, 2, 1]


@pytest.mark.parametrize(
    ("changes", "times", "spent"),
    [
        ({}, 1, 1.0 - CONFIDENCE),
        ({}, 2, 2.0 * (1.0 - CONFIDENCE)),
        ({"fences": ({}, {})}, 1, 3.0 * (1.0 - CONFIDENCE)),
        ({"fences": ({}, {})}, 2, 6.0 * (1.0 - CONFIDENCE)),
        # a count until it is sure claims no bounds, and is read at any number of flights
        ({"fences": ({}, {}), "until_sure": True}, 2, 2.0 * (1.0 - CONFIDENCE)),
        ({"planned": (0.05, 0.98)}, 1, (1.0 - CONFIDENCE) + 0.02),
        ({"planned": (0.05, 0.98), "fences": ({},)}, 2, 4.0 * ((1.0 - CONFIDENCE) + 0.02)),
    ],
)
def test_each_claim_and_reading_spends_its_part(counted, changes, times, spent):
    count = replace(
        counted,
        about=replace(counted.about, **changes),
        extremes=np.concatenate([counted.extremes] * times),
        wind=np.zeros((times * FLIGHTS, 0)),
    )
    assert count.confidence == pytest.approx(1.0 - spent, abs=1e-12)


def test_the_flight_nearest_to_leaving_is_inside_and_counts_are_of_both_sides(counted):
    """One of 259 has the score 1 of the band; five are outside, one of them infinitely."""
    assert counted.scale == pytest.approx(1.0, rel=1e-6)
    assert (counted.outside, counted.not_completed) == (5, 1)
    assert counted.nearest == LEARNED + FLIGHTS - 6


WATCHED = (
    SignalModel(name="turn", target="r", terms=("sin_phi/V_g",), weights=(9.81,)),
    SignalModel(name="roll", target="p", terms=("d(phi)",), weights=(1.0,)),
)


def test_a_counted_monitor_watches_by_its_middle_and_its_scaled_limits():
    """Of 259 flights the largest scores that count as inside are 0.8 of what the shape has."""
    units, plan = {"turn": "rad/s", "roll": "rad/s"}, plan_of_paper(made_up_scenario())
    middle, half = np.array([0.01, -0.02]), np.array([0.1, 0.4])
    measured = WatchedSignals(units=units, models=WATCHED)
    monitor = count_of(Monitor, plan, measured, half, scores_of(0.8), middle, models=WATCHED)

    watch = monitor.watch

    assert monitor.scale == pytest.approx(0.8, rel=1e-5)
    assert watch.middle == pytest.approx(middle, rel=1e-5)
    assert watch.half == pytest.approx(0.8 * half, rel=1e-5)
    assert watch.models == WATCHED
    assert (monitor.outside, monitor.not_completed) == (5, 1)


def test_a_count_is_decided_by_the_flights_nearest_to_leaving_and_two_more(counted):
    """Of 259 with five outside the sixth is one too many, or sets the scale."""
    order = np.random.default_rng(2).permutation(FLIGHTS)
    shuffled = replace(counted, extremes=counted.extremes[order])

    nearest = np.flatnonzero(order >= FLIGHTS - (5 + 1 + 2))
    assert counting.deciding(shuffled) == (LEARNED + nearest).tolist()


def test_a_count_is_written_after_250_flights_and_each_eighth_more():
    """250 + 32 = 282, + 36 = 318, + 40 = 358: eighths rounded up."""
    assert unfinished.written_at(250) == unfinished.written_at(100) == []
    assert unfinished.written_at(283) == [250, 282]
    assert unfinished.written_at(358) == [250, 282, 318]


def test_bounds_hold_from_the_edge_of_their_window_on_and_the_last_to_the_end():
    measured = RecordedSignals(units={"chi_err": "rad"})
    half, middle = np.array([[1.0], [2.0], [3.0], [0.5]]), np.array([[0.0], [1.0], [0.0], [5.0]])
    flights = band_flights(np.array([0.0, 1.0, 2.0, 3.0, 4.0]))
    count = count_of(
        ft.Band, plan_of_paper(made_up_scenario()), measured, half, scores_of(1.0), middle,
        replace(flights, measured=measured),
    )  # fmt: skip

    bounds = count.bounds(np.array([-1.0, 0.0, 0.999, 1.0, 2.5, 4.0, 9.0]))

    assert bounds.high[:, 0] == pytest.approx([1.0, 1.0, 1.0, 3.0, 3.0, 5.5, 5.5], rel=1e-6)
    assert bounds.low[:, 0] == pytest.approx([-1.0, -1.0, -1.0, -1.0, -3.0, 4.5, 4.5], rel=1e-6)
    # the last quarter of 4 s begins at 3 s
    (row,) = count.sizes()
    sizes = {"largest": 3.0, "last_quarter": 0.5, "end": 0.5, "low": -3.0, "high": 5.5}
    assert row == pytest.approx(sizes, rel=1e-6)
    with pytest.raises(ft.InputError, match="`wind` must be there for a band that is given it"):
        count.bounds(np.zeros(1), np.zeros(2))


def test_another_claim_of_a_count_stands_beside_that_which_was_planned(counted):
    other = counted.claiming(0.1, 0.98)
    back = other.claiming(0.05, CONFIDENCE)

    assert (other.about.epsilon, other.about.confidence) == (0.1, 0.98)
    assert other.about.planned == (0.05, CONFIDENCE)
    assert other.claiming(0.2, 0.97).about.planned == (0.05, CONFIDENCE)
    assert counted.claiming(0.05, 0.98).about.planned == (0.05, CONFIDENCE)
    assert (back.about.epsilon, back.about.planned) == (0.05, None)


def test_flights_that_were_lost_on_a_route_may_have_flown_back(counted):
    along = replace(counted, flights=replace(counted.flights, over="along"))

    assert counted.lost == "1 did not complete"
    assert along.lost == ("1 did not complete or flew behind their start or back along the route")


@pytest.mark.parametrize(("confidence", "fences", "claims"), [(0.7, 2, True), (0.66, 2, False)])
def test_claims_that_leave_no_confidence_are_refused(counted, confidence, fences, claims):
    """Three claims spend 0.9 of the probability, or more than all of it."""
    about = replace(counted.about, confidence=confidence, fences=({},) * fences)

    if claims:
        assert replace(counted, about=about).confidence == pytest.approx(0.1)
    else:
        with pytest.raises(ft.InputError, match="`confidence`"):
            replace(counted, about=about)


def test_compiled_flights_that_decide_a_count_are_those_that_jsbsim_flies_again(counted):
    """The made-up flights that are new come half as far as the band."""
    own, seen = dict(zip(counted.draws.tolist(), counted.extremes, strict=True)), []
    begun = replace(counted, compiled=CompiledFlights(flights=FLIGHTS))

    def rows(plan, runs, again=False, compiled=True, **_):
        seen.append((again, [*runs]))
        for run in runs:
            ends = own.get(run, 0.5 * own[LEARNED + FLIGHTS - 6])
            flown = CompiledFlights(flights=int(compiled), flown_again=int(compiled and again))
            yield {"run": run, "extremes": ends.ravel().tolist(), COMPILED: flown}

    with flown_here(rows) as pool:
        more = counting.count_more(begun, 2 * FLIGHTS, pool)
    decide = counting.deciding(more)
    assert [again for again, _ in seen] == [False, True]
    assert seen[1][1] == decide
    assert more.compiled == CompiledFlights(flights=2 * FLIGHTS, flown_again=len(decide))

    seen.clear()
    with flown_here(partial(rows, compiled=False)) as pool:
        assert counting.count_more(begun, 2 * FLIGHTS, pool).compiled == begun.compiled
    assert [again for again, _ in seen] == [False]


@pytest.mark.parametrize(
    ("navigation", "changes", "flown"),
    [
        ("standard", {}, True),
        ("rtk", {}, False),
        ("standard", {"navigation.position_sd_m": 4.0}, False),
    ],
)
def test_learning_flights_of_a_route_are_flown_by_rtk_too_and_keep_their_largest_distances(
    navigation, changes, flown
):
    """A made-up flight by RTK is 1 m or more to the left, and at most 0.25 m below or above."""

    def rows(plan, runs, probes, **_):
        shape, known = probes["extremes"].shape, plan.campaign.central.navigation
        by_rtk = flown and known.grade == "rtk"
        for run in runs:
            ends = np.zeros(shape)
            ends[...] = 0.0 if by_rtk else np.array([-1.0, 1.0]) * (1.0 + 0.01 * run)
            if by_rtk:
                ends[3, 0], ends[5, 1] = (-1.0 - run, 0.5), (-0.25, 0.0625 * run)
            others = [0.0] * 4 if known else []
            lost = by_rtk and run == 4
            yield {"run": run} if lost else {"run": run, "extremes": [*ends.ravel(), *others]}

    short = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 300.0)]}
    few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7, "navigation": navigation}
    changes = {**short, "gains": ["paper"], **changes}
    with flown_here(rows):
        band = ft.band("circuit_in_wind", changes=changes, **few)

    largest = [(1.0 + run, max(0.25, 0.0625 * run)) for run in range(10) if run != 4]
    assert band.by_rtk.tolist() == ([[*pair] for pair in largest] if flown else [])
