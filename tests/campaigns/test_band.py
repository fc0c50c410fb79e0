"""Bands of small campaigns: what is learned, counted, added and flown again, and the command."""

import math
from dataclasses import replace

import numpy as np
import pytest
from commands import answer, flighttune
from counted_turns import ALONE, START, WITH_FIVE, count, small_plan
from dispersed import AEROSONDE, KINEMATIC, SOFT, WIND, one_of, plan_of, tables_of, uniform
from flown_campaigns import Notes, flown_here, write_campaign

import flighttune as ft
from flighttune.campaigns.flying import rows as flying
from flighttune.claims import counting
from flighttune.claims.band import RecordedSignals
from flighttune.claims.counted_flights import flights_of
from flighttune.claims.counted_flights import plan_of as plan_of_band
from flighttune.claims.residual import ResidualSignals
from flighttune.claims.turn_back import TurnBack
from flighttune.flight import conditions
from flighttune.flight.loop.run import with_claims
from flighttune.gaps.residual import residuals_of


def test_fresh_flights_are_counted_and_none_is_flown_twice():
    flown = []

    def rows(plan, runs, probes):
        flown.append((plan.campaign.design, list(runs)))
        return flying.rows_flown(plan, runs, probes=probes)

    counted = count(small_plan(design="sobol"), rows)

    parts = list(range(10)), list(range(10, 10 + WITH_FIVE))
    assert flown == [("random", part) for part in parts]
    assert counted.outside == 5
    assert f": 5 of {WITH_FIVE} fresh flights did. All are flights of " in counted.sentence
    assert "in calm air; drawn at random: initial course -5 to 5 deg and" in counted.sentence


def test_the_flights_inside_are_those_whose_errors_are(counted):
    plan = plan_of_band(counted)
    (group,) = plan.groups
    bounds = counted.bounds(np.arange(26) / 50.0)

    runs = [
        flying.fly_group(plan, plan.scenario_of(draw), group) for draw in range(10, 10 + WITH_FIVE)
    ]

    inside = [bounds.contain(run.signals) for run in runs]
    assert inside == (counted.scores <= counted.scale).tolist()


def test_more_flights_are_added_to_the_count(counted):
    with flown_here() as pool:
        more = counting.count_more(counted, 2 * WITH_FIVE, pool)
        for other in (WITH_FIVE, 40, 3 * WITH_FIVE):
            with pytest.raises(ft.InputError, match=r"`flights` .*58, 116, 232"):
                counting.count_more(counted, other, pool)
        pool.observer = Notes()
        assert counting.count_more(more, 2 * WITH_FIVE, pool) is more
        assert pool.observer.heard == ["its 58 flights are counted already: none is flown"]
    # the draws of this one begin with the second half of that: a draw between them is left out
    after = count(flights=WITH_FIVE, learn=10 + WITH_FIVE + 1)

    assert np.array_equal(more.extremes, np.concatenate([counted.extremes, after.extremes]))
    assert more.readings == (WITH_FIVE, 2 * WITH_FIVE)
    assert more.confidence == pytest.approx(0.8)


def test_a_recount_finds_a_flight_that_differs(counted):
    extremes = counted.extremes.copy()
    extremes[4] = np.nextafter(extremes[4], np.inf)

    with flown_here() as pool:
        draws = counting.some_draws(counted, WITH_FIVE)
        assert counting.differing(counted, draws, pool) == []
        assert counting.differing(replace(counted, extremes=extremes), draws, pool) == [14]
        with pytest.raises(ft.InputError, match="`count` must be 1 to"):
            ft.verify(counted, count=WITH_FIVE + 1)


def test_a_recount_finds_a_flight_that_had_another_wind():
    drawn = uniform("wind.speed_mps", 0.0, 8.0), uniform("wind.from_deg", 0.0, 360.0)
    plan = small_plan(*drawn, plants=[AEROSONDE], wind=WIND)
    counted = count(plan, predicted_from="wind", flights=ALONE)
    wind = counted.wind.copy()
    wind[3, 1] += 1e-3

    with flown_here() as pool:
        for band, found in ((counted, []), (replace(counted, wind=wind), [10 + 3])):
            assert counting.differing(band, band.draws.tolist(), pool) == found


def test_the_page_of_a_band_says_why_flights_did_not_complete(counted, tmp_path):
    extremes = counted.extremes.copy()
    extremes[3] = np.float32([-np.inf, np.inf])
    lost = {"run": int(counted.draws[3]), "status": "no_trim", "reason": "too slow"}
    replace(counted, extremes=extremes, endings=[lost]).save(tmp_path / "band.npz")

    page = ft.report(tmp_path / "band.npz", tmp_path / "band.html")

    (table,) = [table for table in page.tables if table.name == "endings"]
    assert [(x["ended"], x["reason"]) for x in table.records] == [("no trim", "too slow")]
    assert "too slow" in (tmp_path / "band.html").read_text()


def test_any_recorded_signal_has_a_band():
    counted = count(signals=["n_z", "phi_cmd", "n_z"], seed=8)

    assert counted.about.signals == {"n_z": "1", "phi_cmd": "rad"}
    assert counted.about.plan["campaign"]["seed"] == 8
    assert np.isfinite(counted.half_widths).all()


@pytest.mark.soak
def test_a_band_that_is_given_the_wind_is_narrower():
    wind = uniform("wind.speed_mps", 0.0, 8.0), uniform("wind.from_deg", 0.0, 360.0)
    plan = small_plan(*wind, plants=[AEROSONDE], wind=WIND)

    blind, knowing = (count(plan, learn=20, predicted_from=wind) for wind in (None, "wind"))

    assert knowing.half_widths.max() < 0.5 * blind.half_widths.max()
    assert "around the middle that its wind predicts" in knowing.sentence
    drawn = plan_of_band(knowing).values_of(20)
    speed, origin = drawn["wind.speed_mps"], np.deg2rad(drawn["wind.from_deg"])
    # air moves away from where it blows from
    blown = -speed * np.cos(origin), -speed * np.sin(origin)
    assert knowing.wind[0] == pytest.approx(blown)


@pytest.mark.parametrize(
    ("plan", "settings", "message"),
    [
        (None, {"epsilon": 1.0}, "`epsilon` must be between 0 and 1, got 1.0"),
        (None, {"flights": 6}, "`flights` must be at least 7 for .* got 6"),
        (None, {"learn": 9}, "`learn` must be at least 10, got 9"),
        (None, {"signals": ["chi", "mood"]}, "`signal` must be one of chi, .*, got 'mood'"),
        (None, {"predicted_from": "wind"}, "t: the wind must be drawn"),
        ([one_of("flight.chi_deg", 3.0)], {}, "t: `start_deg` must be given"),
        ([uniform("flight.duration_s", 1.0, 2.0)], {}, "`flight.duration_s` must be the same"),
        (None, {"kind": ft.residual}, "`plant` must be an aircraft"),
    ],
)
def test_what_cannot_be_counted_is_refused_in_one_line(plan, settings, message):
    with pytest.raises(ft.InputError, match=message) as caught:
        count(plan and small_plan(*plan), **settings)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_flight_that_cannot_start_is_the_reason_why_its_signals_cannot_be_counted():
    dive = ft.load_scenario("level_turn", changes={"flight.gamma_deg": -30.0})
    flights = ft.flights(dive).starting(1.0)

    with pytest.raises(ft.InputError, match=r"must start: .* no steady .*[^.]\.$"):
        ft.band(flights, plant="jsbsim:aerosonde", gains="paper", signals=["h"])


@pytest.mark.soak
def test_the_command_counts_reads_adds_and_verifies(tmp_path):
    campaign = write_campaign(tmp_path, aircraft=(), wind="", disperse=START)
    file = tmp_path / "band.npz"
    claim = "--epsilon", 0.3, "--confidence", 0.9, "--gains", "soft"

    with flown_here():
        made = answer("band", campaign, *claim, "--learn", 10, "--out", file)
        other = answer("band", file, "--epsilon", 0.5)
        more = answer("band", file, "--flights", 58, "--out", tmp_path / "other.npz")
        again = answer("verify", file, "--count", 5)
        valid = answer("verify", file)

    band = ft.load(file)
    assert (made["status"], made["flights"], made["outside"]) == ("claimed", WITH_FIVE, 5)
    assert other["scale"] < made["scale"]
    assert [row["unit"] for row in made["half_widths"]] == ["deg", "deg"]
    assert (more["readings"], more["confidence"]) == ([29, 58], pytest.approx(0.8))
    assert again["valid"]
    assert valid["valid"]
    assert "All 10 flights learned from were flown again" in valid["notes"][0]
    assert f"flighttune verify {file} --run {band.nearest}" in valid["notes"][-1]
    assert valid["claim"]["sentence"] == more["sentence"] == band.sentence
    widths = np.rad2deg(band.half_widths)
    assert valid["half_widths"][1]["largest"] == pytest.approx(widths[:, 1].max())
    assert valid["half_widths"][0]["end"] == pytest.approx(widths[-1, 0])


def test_a_band_of_an_aircraft_that_has_changed_is_refused(counted, tmp_path):
    plan = {**counted.about.plan, "aircraft": {"aerosonde": 64 * "0"}}
    changed = replace(counted, about=replace(counted.about, plan=plan))
    changed.save(tmp_path / "x.npz")

    with pytest.raises(ft.InputError, match="`aerosonde` must have the files"):
        plan_of_band(changed)
    _, stderr = flighttune("verify", tmp_path / "x.npz", status=1)
    assert "`aerosonde` must have the files" in stderr


def test_a_file_of_another_campaign_takes_no_options_of_a_source(counted, tmp_path):
    counted.save(tmp_path / "x")  # known by its content, whatever its name

    for option, value, name in (("gains", "soft", "gains"), ("start-deg", 1, "start_deg")):
        _, stderr = flighttune("band", tmp_path / "x", f"--{option}", value, status=2)
        assert f"`{name}` must be absent for a band file" in stderr


@pytest.mark.soak
def test_a_band_on_a_route_follows_the_distance_along_it():
    corner = [{"north_m": n, "east_m": e} for n, e in ((0.0, 0.0), (300.0, 0.0), (300.0, 300.0))]
    changes = {"route.waypoint": corner, "flight.duration_s": 60.0}
    plan = ft.flights("circuit", changes=changes).starting(3.0).plan(plant="kinematic")
    band = count(plan)
    path = conditions.reference_of(plan.scenario).path

    assert band.about.signals == {"cross_track": "m", "height_err": "m"}
    assert (band.flights.over, band.flights.edges[-1]) == ("along", math.ceil(path.length))
    ranks = np.argsort(band.scores)
    for i in ranks[[0, -7, -6, -5, -1]]:  # the five of the highest scores are outside
        scenario = plan_of_band(band).scenario_of(band.about.learned + int(i))
        signals = flying.fly_group(plan, scenario, plan.groups[0]).signals
        inside = band.bounds(signals["along"].to_numpy()).contain(signals)
        assert inside == (i not in ranks[-5:]) == (band.scores[i] <= band.scale)


@pytest.mark.soak
def test_a_route_shorter_than_a_window_of_each_metre_is_counted():
    short = [{"north_m": n, "east_m": 0.0} for n in (0.0, 100.2)]
    changes = {"route.waypoint": short, "flight.duration_s": 60.0}
    band = count(ft.flights("circuit", changes=changes).starting(3.0).plan(plant="kinematic"))

    assert band.not_completed == 0


@pytest.mark.soak
def test_a_band_is_not_drawn_around_a_run_of_another_airframe_or_with_sensors():
    counted = count(small_plan(plants=(AEROSONDE,)))
    plan = plan_of_band(counted)
    tables = flying.scenario_of_run(plan, counted.nearest).as_dict()
    label = plan.groups[0].plant

    def flown(**changes):
        made = ft.scenario_from({**tables, **changes})
        return [run for run in ft.fly(made).runs if run.provenance.plant == label]

    (run, *_) = with_claims(flown(), [counted])
    assert run.claims[0].sentence == counted.sentence
    heavy = [plant | {"airframe": {"mass_factor": 1.3}} for plant in tables["plant"]]
    for differs, changes in (
        ("plant.airframe.mass_factor is 1.3, counted on 1", {"plant": heavy}),
        ("sensors.chi_bias_deg is 1, counted on 0", {"sensors": {"chi_bias_deg": 1.0}}),
        ("turbulence is light, counted on none", {"turbulence": {"intensity": "light"}}),
    ):
        with pytest.raises(ft.InputError, match=rf"no claim about this flight: {differs}"):
            with_claims(flown(**changes), [counted])


@pytest.mark.soak
def test_residual_signals_of_an_aircraft_are_counted_like_any_other():
    counted = count(small_plan(plants=(KINEMATIC, AEROSONDE)), kind=ft.residual, flights=ALONE)
    plan, model = plan_of_band(counted), counted.model
    bounds = counted.bounds(np.arange(25) / 50.0)

    for run, score in enumerate(counted.scores, start=counted.about.learned):
        flown = flying.fly_group(plan, plan.scenario_of(run), plan.groups[0])
        signals = residuals_of(
            model, flown.signals, conditions.start_condition(plan.scenario_of(run))
        )
        residuals = dict(zip(counted.about.signals, signals.T, strict=True))
        assert bounds.contain(residuals) == (score <= counted.scale)
    units = [row["unit"] for row in counted.answer().tables[0].records]
    assert units == ["deg/s", "deg/s", "deg", "deg"]
    with pytest.raises(ft.InputError, match="got a Residual"):
        ft.fly(plan.scenario).within(counted)


def test_residual_signals_have_shorter_windows_than_recorded_ones():
    """The boxes of a tube add up over time: windows of 7.5 samples had 1.5 times those of 1.5."""
    tables = tables_of((AEROSONDE,), gains=[SOFT])
    tables["flight"]["duration_s"] = 20.0
    plan = plan_of(tables, *START, runs=12)

    residuals = ResidualSignals.chosen(plan, None)
    four = RecordedSignals(units=residuals.units)
    recorded, residual = (flights_of(plan, x, 1640) for x in (four, residuals))

    assert np.diff(recorded.edges) == pytest.approx(0.1)
    assert np.diff(residual.edges) == pytest.approx(0.04)


def test_a_count_of_one_kind_is_not_taken_for_another(counted, tmp_path):
    """A band is no boxes of a tube; a file says what it is, and a class takes no other's values."""
    counted.save(tmp_path / "x.npz")
    with pytest.raises(ft.InputError, match=r"`boxes` must be a Residual or None, got a Band"):
        ft.tube("paper", "paper", counted)
    said = flighttune("tube", "paper", "--boxes", tmp_path / "x.npz", status=2)[1]
    assert "x.npz: `boxes` must be of residual signals" in said
    values = {name: getattr(counted, name) for name in ("about", "flights", "extremes", "wind")}
    for kind in (ft.Residual, TurnBack):
        with pytest.raises(ft.InputError, match=r"`about\.of` must be"):
            kind(**values)
