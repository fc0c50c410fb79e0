"""What autopilots know of their motion where a verb flies: a standard receiver along a route."""

import numpy as np
import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.campaigns.planning.knowing import knowing
from flighttune.claims import known

SHORT = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 250.0)]}
FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7, "workers": 1}


@pytest.mark.parametrize(
    ("name", "navigation", "grade"),
    [
        ("circuit", None, "standard"),
        ("circuit", "rtk", "rtk"),
        ("circuit", "exact", None),
        ("level_turn", None, None),
        ("level_turn", "poor", "poor"),
    ],
)
def test_a_route_is_flown_by_a_standard_receiver_unless_it_is_said_otherwise(
    name, navigation, grade
):
    table = knowing(ft.load_scenario(name), navigation).navigation

    assert (table and table.grade) == grade


def test_what_a_scenario_states_stays_and_another_grade_keeps_its_numbers():
    stated = ft.load_scenario(
        "circuit", changes={"navigation.grade": "poor", "navigation.position_sd_m": 7.0}
    )

    assert knowing(stated, None) is stated
    other = knowing(stated, "rtk").navigation
    assert (other.grade, other.position_sd_m) == ("rtk", 7.0)
    assert knowing(stated, "exact").navigation is None


@pytest.mark.slow
def test_numbers_of_navigation_can_be_drawn(tmp_path):
    file = tmp_path / "drawn.toml"
    file.write_text(
        'title = "drawn"\nscenario = "circuit"\nruns = 5\nseed = 1\ndesign = "random"\n'
        '[[disperse]]\nkey = "navigation.position_sd_m"\n'
        'distribution = "uniform"\nlower = 1.0\nupper = 3.0\n'
    )

    plan = ft.flights(file).knowing("poor").plan()

    drawn = [plan.scenario_of(draw).navigation for draw in range(plan.draws)]
    assert all(1.0 <= table.position_sd_m <= 3.0 for table in drawn)
    assert {table.grade for table in drawn} == {"poor"}
    with pytest.raises(ft.InputError, match=r"grade where `navigation.position_sd_m` is drawn"):
        ft.flights(file).knowing("exact")


def test_a_path_through_the_air_cannot_be_known_by_a_grade():
    made = ft.load_scenario("paper").as_dict()
    made["disturbance"] = {"path": "air", "as_wind": True}

    with pytest.raises(ft.InputError, match="`navigation` must be exact with path"):
        knowing(ft.scenario_from(made), "rtk")


def seen_of(off, t):
    """A run that sees itself so far off its route, m, its place 3 m off."""
    off_true = {"cross_track": off - 3.0, "height_err": 2.0 * off - 1.0}
    return made_up_run(off_true | {"cross_track_seen": off, "height_err_seen": 2.0 * off}, t)


def test_flying_is_what_the_autopilot_sees_for_most_of_the_time():
    # 4 m off in 4 % of the time, else 0.2 m
    t = np.arange(1000.0)

    errors = known.navigation_errors_of(seen_of(np.where(t >= 960.0, 4.0, 0.2), t), 3.0)

    assert errors == pytest.approx([3.0, 1.0, 0.2, 0.4])


@pytest.mark.parametrize(
    ("most", "seen"), [(60.0, 0.25), (10.0, 3.0 * np.exp(-5.25 / 3.0))], ids=["route", "short"]
)
def test_joining_the_path_is_no_error_of_flying(most, seen):
    # from 3 m off along exp(-t / T) in front of an error of 0.25 m, T being 3 s: five times T, or
    # half of a flight that is shorter, are left out; 95 % of the last 5 s begin after 5.25 s
    t = np.linspace(0.0, most, 10_001)

    *reach, beside, above = known.navigation_errors_of(
        seen_of(np.maximum(3.0 * np.exp(-t / 3.0), 0.25), t), 3.0
    )

    assert reach == pytest.approx([3.0, 1.0])
    assert (beside, above) == pytest.approx((seen, 2.0 * seen), rel=1e-3)


@pytest.mark.soak
def test_a_claim_names_what_its_autopilots_knew_and_its_corridor_is_as_wide(tmp_path):
    by_receiver = ft.band("circuit_in_wind", changes=SHORT, **FEW)
    exact = ft.band("circuit_in_wind", changes=SHORT, navigation="exact", **FEW)

    assert "knows its place by a standard receiver and inertial unit" in by_receiver.sentence
    assert "where the aircraft knows its place exactly" in exact.sentence
    both = by_receiver, exact
    sides = [abs(band.extremes[:, :, 0]).max() for band in both]
    errors = known.navigation_errors(by_receiver)
    assert sides[0] > 2.0 * sides[1]
    # At most the error of its place moves an aircraft: the triangle inequality.
    assert sides[0] < errors.beside + 3.0
    flying = f"errors of at most {errors.seen_beside:.2g} m and {errors.seen_above:.2g} m"
    assert flying in str(by_receiver.answer().summary)
    said = "the distance that the autopilot sees plus"
    told = [said in str(band.answer().notes) for band in both]
    assert told == [True, False]
    file = tmp_path / "counted.npz"
    by_receiver.save(file)
    assert known.navigation_errors(exact) is None
    with pytest.raises(ft.InputError, match="`navigation` must be absent for a band file"):
        ft.band(file, navigation="rtk")
