"""Bands of small campaigns: what is learned, counted, added and flown again, and the command."""

from dataclasses import replace

import numpy as np
import pytest
from commands import answer, flighttune
from counted_turns import START, WITH_FIVE, count, small_plan
from dispersed import one_of, uniform
from flown_campaigns import flown_here, write_campaign

import flighttune as ft


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


def test_a_file_of_another_campaign_takes_no_options_of_a_source(counted, tmp_path):
    counted.save(tmp_path / "x")  # known by its content, whatever its name

    for option, value, name in (("gains", "soft", "gains"), ("start-deg", 1, "start_deg")):
        _, stderr = flighttune("band", tmp_path / "x", f"--{option}", value, status=2)
        assert f"`{name}` must be absent for a band file" in stderr


@pytest.mark.soak
def test_a_route_shorter_than_a_window_of_each_metre_is_counted():
    short = [{"north_m": n, "east_m": 0.0} for n in (0.0, 100.2)]
    changes = {"route.waypoint": short, "flight.duration_s": 60.0}
    band = count(ft.flights("circuit", changes=changes).starting(3.0).plan(plant="kinematic"))

    assert band.not_completed == 0
