"""The worst flight: against closed forms, and on small campaigns of the law."""

from dataclasses import replace

import numpy as np
import pytest
from dispersed import plan_of, tables_of, uniform
from made_up_tubes import tube as tube_of
from made_up_tubes import tube_scenario
from scipy import stats

import flighttune as ft

pytestmark = pytest.mark.slow


TURNED = tube_scenario(chi_err_deg=15.0, gamma_deg=5.0, duration_s=0.3)


@pytest.fixture(scope="module")
def proven(tmp_path_factory):
    """A tube of 0.3 s of the law from a box of starts, disturbed, and its file."""
    proven = tube_of(TURNED, ft.PAPER_GAINS, for_ever=False, start=0.01, disturbance=0.02)
    file = tmp_path_factory.mktemp("tube") / "proof"  # no ending: it is known by its content
    proven.save(file)
    return proven, file


@pytest.mark.soak
def test_a_flight_outside_of_a_tube_contradicts_its_proof(proven):
    tube, _ = proven
    bounds = tube.bounds
    middle, half = 0.5 * (bounds.low + bounds.high), 0.1 * bounds.half_widths
    wrong = replace(tube, bounds=replace(bounds, low=middle - half, high=middle + half))

    worst = ft.worst(wrong, budget=32, workers=1)

    assert worst.value > 1.0
    assert worst.contradicts
    assert worst.answer().status == 1
    assert "contradicts its proof" in worst.answer().failure

    away = ft.worst(TURNED, claim=tube, start_deg=5.0, gains="paper", budget=32, workers=1)
    assert away.value > 1.0  # from a start that the tube says nothing of
    assert tube.why_not(ft.fly(away.scenario).runs[0])
    assert not away.contradicts


@pytest.mark.parametrize(
    ("options", "words"),
    [({"metric": "margin"}, "must be absent for a tube"), ({"budget": 1}, "`budget` must be")],
)
def test_a_tube_has_flights_and_metric_of_its_own(proven, options, words):
    with pytest.raises(ft.InputError, match=words):
        ft.worst(proven[0], workers=1, **options)


def test_a_tube_without_bounds_has_no_worst(proven):
    open_tube = replace(proven[0], status="unbounded", reason="too wide")

    with pytest.raises(ft.InputError, match=r"must be bounded, got one that is not: too wide\."):
        ft.worst(open_tube, workers=1)


def test_a_tube_of_one_flight_has_no_worst():
    of_one = tube_of(tube_scenario(duration_s=0.1), ft.PAPER_GAINS, for_ever=False)

    with pytest.raises(ft.InputError, match="starts or a disturbance"):
        ft.worst(of_one, workers=1)


# ---------------------------------------------------------------- of drawn flights
START = uniform("flight.chi_deg", 0.0, 30.0)
NOISE = {"sensors": {"chi_noise_sd_deg": 1.0}}


def short(**tables):
    made = tables_of(gains=["paper"], **tables)
    made["flight"] = {"V_a_mps": 25.0, "chi_deg": 20.0, "duration_s": 0.5}
    return made


def plan(*disperse, **tables):
    return plan_of(short(**tables), *disperse, runs=4)


def flown_value(scenario, metric):
    """What `fly` says of the measure of a row."""
    flown = ft.fly(scenario)
    (run,) = flown.runs
    subject, name = metric.split(".")
    if name == "peak_rad":
        return np.abs(run.signals[f"{subject}_err"]).max()
    return flown.metrics_of(run)[subject][name]


@pytest.mark.parametrize("metric", ["chi.ITAE", "chi.peak_rad", "gamma.ITAE", "flight.n_z_max"])
def test_the_worst_flight_is_one_that_flies_to_its_value(tmp_path, metric):
    rolled = uniform("flight.phi_deg", -40.0, 40.0)

    worst = ft.worst(plan(START, rolled), budget=64, metric=metric, workers=1)
    worst.save(tmp_path / "worst.toml")

    assert worst.value == pytest.approx(flown_value(worst.scenario, metric), rel=1e-9)
    assert ft.load_scenario(tmp_path / "worst.toml").flight == worst.scenario.flight
    assert (worst.flights, worst.family, worst.status) == (64, None, "completed")
    assert worst.distance <= worst.radius * (1.0 + 1e-12)
    assert worst.radius == pytest.approx(np.sqrt(stats.chi2.ppf(0.999, 2)))
    assert worst.scenario.flight.chi_deg == worst.drawn["flight.chi_deg"]
    assert (worst.plant, worst.gains, worst.metric) == ("kinematic", "paper", metric)


def test_the_first_generation_is_drawn_from_the_distribution():
    """Normal scores of NumPy, put onto the ball of 0.999, by the quantiles of the distribution."""
    worst = ft.worst(plan(START), budget=32, metric="chi.peak_rad", seed=3, workers=1)
    z = np.random.default_rng(3).standard_normal((32, 1))
    z = np.clip(z, -worst.radius, worst.radius)

    assert worst.value == worst.first
    assert worst.drawn["flight.chi_deg"] == pytest.approx(30.0 * stats.norm.cdf(z.max()))
    assert worst.distance == pytest.approx(z.max())
    assert worst.value == pytest.approx(np.deg2rad(worst.drawn["flight.chi_deg"]), rel=1e-9)


@pytest.mark.parametrize(
    ("key", "lower", "upper", "at"),
    [("flight.chi_deg", 0.0, 30.0, 1.0), ("flight.chi_deg", -30.0, -1.0, -1.0)],
)
def test_a_search_comes_to_the_edge_of_its_region_where_the_worst_is(key, lower, upper, at):
    """The largest error of course is the initial one; the edge is the quantile of the radius."""
    worst = ft.worst(
        plan(uniform(key, lower, upper)), budget=32 * 6, metric="chi.peak_rad", workers=1
    )
    share = stats.norm.cdf(at * worst.radius)

    edge = lower + share * (upper - lower)
    assert worst.drawn[key] == pytest.approx(edge, abs=1e-3)
    assert worst.value == pytest.approx(np.deg2rad(abs(edge)), rel=1e-4)
    assert worst.value > worst.first
    assert worst.distance == pytest.approx(worst.radius, rel=1e-3)


def test_correlated_keys_are_searched_as_they_are_drawn():
    """At rank 0.95 both are far out only together: the sum of two scores is on the ball's axis."""
    both = uniform("flight.chi_deg", 0.0, 30.0), uniform("flight.phi_deg", 0.0, 30.0)
    tables = {"correlation": [{"keys": ["flight.chi_deg", "flight.phi_deg"], "rank": 0.95}]}
    worst = ft.worst(
        plan_of(short(), *both, runs=4, **tables), budget=96, metric="chi.peak_rad", workers=1
    )

    assert worst.drawn["flight.chi_deg"] > 29.0
    assert worst.drawn["flight.phi_deg"] > 20.0


def test_more_flights_find_no_better_flight_and_another_seed_other_flights():
    few, more, other = (
        ft.worst(plan(START, **NOISE), budget=budget, metric="chi.ITAE", seed=seed, workers=1)
        for budget, seed in ((40, 1), (300, 1), (40, 2))
    )
    again = ft.worst(plan(START, **NOISE), budget=300, metric="chi.ITAE", seed=1, workers=1)

    assert few.flights == other.flights == 32  # whole generations
    assert more.flights == 288
    assert few.first == more.first == few.value < more.value
    assert other.first != few.first
    assert (again.value, again.drawn) == (more.value, more.drawn)
    assert more.value == pytest.approx(flown_value(more.scenario, "chi.ITAE"), rel=1e-9)
    assert more.scenario.seed == more.drawn["seed"]


BOUNDED = [
    ({"at_most": {"chi": {"peak_deg": 10.0}}}, lambda peak, itae: peak / 10.0 - 1.0),
    ({"at_most": {"chi": {"peak_deg": 50.0}}}, lambda peak, itae: peak / 50.0 - 1.0),
    ({"at_least": {"chi": {"ITAE": 5.0}}}, lambda peak, itae: 1.0 - itae / 5.0),
    (
        {"at_most": {"chi": {"peak_deg": 40.0, "ITAE": 1e3}}},
        lambda peak, itae: max(peak / 40.0, itae / 1e3) - 1.0,
    ),
    # nothing is commanded of gamma from which it could settle
    (
        {"at_most": {"chi": {"peak_deg": 40.0}, "gamma": {"settling_s": 0.1}}},
        lambda peak, itae: peak / 40.0 - 1.0,
    ),
]


@pytest.mark.parametrize(("bounds", "excess"), BOUNDED)
def test_a_margin_is_the_largest_excess_over_a_bound(bounds, excess):
    worst = ft.worst(plan(START, expect=[bounds]), budget=32, workers=1)
    peak = np.rad2deg(flown_value(worst.scenario, "chi.peak_rad"))
    itae = flown_value(worst.scenario, "chi.ITAE")

    assert worst.metric == "margin"
    assert worst.value == pytest.approx(excess(peak, itae), rel=1e-6, abs=1e-9)
    assert worst.missed or worst.value <= 0.0


@pytest.mark.parametrize("completed", [False, True])
def test_flights_that_do_not_complete_are_the_worst_unless_they_are_left_out(completed):
    """More than 90 deg of roll end a flight of the law."""
    free = {"limits": {}, "disturbance": {"chi_omega_rad_s": 1.0}}
    turned = uniform("disturbance.chi_amplitude", 0.0, 3.0), uniform("flight.chi_deg", 0.0, 120.0)
    made = short(**free)
    made["flight"]["duration_s"] = 3.0
    flights = plan_of(made, *turned, runs=4)
    worst = ft.worst(flights, budget=32, metric="chi.ITAE", completed=completed, workers=1)

    assert (worst.status == "completed") is completed
    assert bool(np.isinf(worst.value)) is not completed
    assert worst.endings
    assert all(x["status"] in ("diverged", "invalid") for x in worst.endings)


REFUSED = [
    (START, {"metric": "mood"}, r"`metric` must be margin or one of chi.ITAE, .*got 'mood'"),
    (START, {"budget": 31}, "`budget` must be at least 32, got 31"),
    (START, {"gains": "K9"}, "`gains`.*K9|K9"),
    (START, {"plant": "other"}, "`plant` must be one of kinematic, got other"),
    (START, {"start_deg": 2.0}, "`start_deg` must be absent for what is no scenario"),
    (START, {"disturbance": 0.1}, "`disturbance` must be absent for what is no scenario"),
    (None, {}, "`disperse` must name a key to search"),
]


@pytest.mark.parametrize(("drawn", "options", "words"), REFUSED)
def test_what_cannot_be_searched_is_refused_in_a_line(drawn, options, words):
    with pytest.raises(ft.FlightTuneError, match=words) as caught:
        ft.worst(plan(*([drawn] if drawn else [])), workers=1, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.soak
def test_flights_of_a_tube_stay_inside_and_tell_how_much_wider_it_is(proven):
    """The search reaches nearly all of a tube of 0.3 s, and never leaves it."""
    tube, file = proven

    worst = ft.worst(file, budget=400, workers=1)

    assert 0.5 < worst.value <= 1.0 + 1e-9
    assert not worst.contradicts
    assert worst.family in ("bang_bang", "square_wave")
    assert worst.flights <= 400
    for channel in ("chi", "gamma"):
        assert worst.ratio[channel] >= worst.ratio_of_search[channel] * (1.0 - 1e-9)
        assert worst.ratio_of_search[channel] >= 1.0 - 1e-9
    (run,) = ft.fly(worst.scenario).runs
    bounds = tube.bounds.of(["chi_err", "gamma_err"])
    assert bounds.share(run.signals) == pytest.approx(worst.value, rel=1e-6)


@pytest.mark.soak
def test_a_band_is_searched_for_the_flight_nearest_to_its_edge(tmp_path):
    turn = ft.scenario_from(short())
    few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 29, "gains": "paper"}
    band = ft.band(turn, start_deg=2.0, plant="kinematic", workers=1, out=tmp_path / "b.npz", **few)

    worst = ft.worst(tmp_path / "b.npz", budget=64, workers=1)

    assert worst.metric == "band"
    assert worst.first > 0.5
    assert worst.value >= worst.first
    assert (worst.value > 1.0) == (
        not band.bounds(np.arange(26) / 50.0).contain(ft.fly(worst.scenario).runs[0].signals)
    )
    for options in ({"metric": "margin"}, {"gains": "paper"}, {"start_deg": 1.0}):
        with pytest.raises(ft.InputError, match="must be absent for a tube or band file"):
            ft.worst(tmp_path / "b.npz", **options)


def test_claims_that_are_of_no_flights_are_refused(tmp_path):
    ft.certify("paper", "paper").certificate.save(tmp_path / "c.json")

    with pytest.raises(ft.InputError, match="must be of flights, to be searched"):
        ft.worst(tmp_path / "c.json")
