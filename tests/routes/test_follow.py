"""Flights along a route, on every plant: where they are, and how they come back to it."""

import json
import math

import numpy as np
import pytest
from commands import flighttune

import flighttune as ft
from flighttune.errors import ScenarioError
from flighttune.shipped import scenario_files

DEG = math.pi / 180.0
ROUTE = {
    "wind_mps": 8.0,
    "waypoint": [
        {"north_m": 0.0, "east_m": 0.0},
        {"north_m": 600.0, "east_m": 0.0},
        {"north_m": 600.0, "east_m": 600.0, "up_m": 20.0},
        {"north_m": 0.0, "east_m": 900.0, "up_m": 20.0},
    ],
}


def scenario(plants, **tables):
    tables = {"limits": {}, **tables}
    flight = {"V_a_mps": 25.0, "duration_s": 120.0, **tables.pop("flight", {})}
    made = ft.load_scenario("paper_identified").as_dict()
    for key in ("reference", "expect", "verifies", "source"):
        del made[key]
    made |= {"gains": ["tuned_identified"], "flight": flight, "plant": plants}
    return ft.scenario_from(made | {"route": ROUTE} | {k: v for k, v in tables.items() if v})


@pytest.mark.parametrize(
    ("plant", "most"),
    [
        ({"kind": "kinematic"}, 1.0),
        ({"kind": "point_mass"}, 1.0),
        ({"kind": "jsbsim", "aircraft": "aerosonde"}, 1.0),
    ],
)
def test_a_flight_stays_on_its_route_in_still_air(plant, most):
    """Distance to the side by the plant's own position: to the leg between two waypoints."""
    (run,) = ft.fly(scenario([plant])).runs
    signals = run.signals

    assert run.status == "completed"
    assert np.abs(signals["cross_track"]).max() < most
    assert np.abs(signals["height_err"]).max() < 1.0
    first = signals[signals["along"] < 400]
    assert first["cross_track"].to_numpy() == pytest.approx(first["east"].to_numpy(), abs=1e-6)
    last = signals.iloc[-1]
    assert math.hypot(last["north"], last["east"] - 900.0) < 2.0
    assert -last["down"] == pytest.approx(20.0, abs=1.0)


def test_an_error_of_position_is_flown_off_in_the_look_ahead():
    """A point that moves as asked: its distance to a straight leg shrinks like exp(-t / T)."""
    straight = {
        "look_ahead_s": 4.0,
        "waypoint": [{"north_m": 0.0, "east_m": 0.0}, {"north_m": 2000.0, "east_m": 0.0}],
    }
    reference = scenario([{"kind": "kinematic"}], route=straight).followed()
    dt, V = 0.01, 25.0
    follow, north, east, chi = reference.follower(dt, 1000.0), 0.0, 5.0, 0.0
    aside = []
    for _ in range(2000):
        seen = ft.Measured(chi, 0.0, V, 0.0, 1.0, 1000.0, (north, east, 0.0), None)
        asked, (_, beside, below) = follow(seen)
        assert (beside, below) == pytest.approx((east, 0.0), abs=1e-6)
        aside.append(east)
        chi = asked.chi
        north, east = north + V * dt * math.cos(chi), east + V * dt * math.sin(chi)

    assert math.log(aside[800] / aside[1800]) / 10.0 == pytest.approx(1.0 / 4.0, rel=0.01)


def test_a_flight_that_does_not_arrive_says_what_is_left():
    made = scenario([{"kind": "kinematic"}], flight={"duration_s": 20.0})
    (run,) = ft.fly(made).runs

    assert run.status == "not_arrived"
    left = float(run.reason.split(": ")[1].split(" m")[0])
    assert left == pytest.approx(made.followed().path.length - 20.0 * 25.0, abs=2.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reference": {"chi_deg": 0.0, "gamma_deg": 0.0}}, "`reference` or `route`"),
        ({"route": {"waypoint": ROUTE["waypoint"][:1]}}, "waypoint"),
        ({"route": {"waypoint": [{"north_m": 0.0}] * 2}}, "`north_m` and `east_m`"),
        ({"route": {"waypoint": [{"north_m": math.nan, "east_m": 0.0}] * 2}}, "north_m"),
    ],
)
def test_a_route_that_cannot_be_read_is_refused(change, message):
    with pytest.raises(ScenarioError, match=message):
        scenario([{"kind": "kinematic"}], **change)


@pytest.mark.parametrize("command", ["tube", "export", "conform"])
def test_what_needs_a_reference_over_time_refuses_a_route_by_name(command, tmp_path):
    options = {"export": ("--out", tmp_path / "out"), "conform": ("--out", tmp_path / "out.json")}
    _, said = flighttune(command, "circuit", *options.get(command, ()), status=2)

    assert "`route` must be absent" in said


def test_the_worst_start_of_a_route_is_searched(tmp_path):
    made = ["--start-deg", 3, "--budget", 32, "--plant", "kinematic", "--set"]
    made += ["flight.duration_s=20", "--metric", "flight.cross_track_m"]
    printed, _ = flighttune("worst", "circuit", *made, "--out", tmp_path / "w.toml", "--json")

    assert json.loads(printed)["metric"] == "flight.cross_track_m"


def test_a_route_below_the_ground_is_refused_by_its_height(tmp_path):
    text = scenario_files()["circuit"].read_text()
    file = tmp_path / "low.toml"
    file.write_text(text.replace("up_m    = 10.0", "up_m    = -10.0"))

    assert ft.load_scenario(file, changes={"flight.ground_m": 980.0}).route is not None
    with pytest.raises(ScenarioError, match=r"low.toml.*: `up_m` .* `ground_m` 995 m .* 990 m"):
        ft.load_scenario(file, changes={"flight.ground_m": 995.0})


def test_a_route_that_cannot_be_flown_in_wind_is_refused_by_its_waypoint(tmp_path):
    points = [(0.0, 0.0), (99.0, 0.0), (99.0, 99.0)]
    sharp = ", ".join(f"{{north_m = {north}, east_m = {east}}}" for north, east in points)
    values = f"route.waypoint=[{sharp}]", "wind.speed_mps=8", "wind.from_deg=90"
    made = [word for value in values for word in ("--set", value)]
    _, said = flighttune("fly", "circuit", *made, "--out", tmp_path, status=2)

    assert "leg to waypoint 2" in said
    assert "[wind]" not in said
