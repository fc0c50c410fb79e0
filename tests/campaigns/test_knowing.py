"""What autopilots know of their motion where a verb flies: a standard receiver along a route."""

import pytest

import flighttune as ft
from flighttune.campaigns.planning.knowing import knowing
from flighttune.claims.known import navigation_errors

SHORT = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 400.0)]}
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


@pytest.mark.slow
def test_a_claim_names_what_its_autopilots_knew_and_its_corridor_is_as_wide(tmp_path):
    by_receiver = ft.band("circuit_in_wind", changes=SHORT, **FEW)
    exact = ft.band("circuit_in_wind", changes=SHORT, navigation="exact", **FEW)

    assert "knows its place by a standard receiver and inertial unit" in by_receiver.sentence
    assert "where the aircraft knows its place exactly" in exact.sentence
    both = by_receiver, exact
    sides = [abs(band.extremes[:, :, 0]).max() for band in both]
    errors = navigation_errors(by_receiver)
    assert sides[0] > 2.0 * sides[1]
    # At most the error of its place moves an aircraft: the triangle inequality.
    assert sides[0] < errors.beside + 3.0
    said = "the distance that the autopilot sees plus"
    told = [said in str(band.answer().notes) for band in both]
    assert told == [True, False]
    file = tmp_path / "counted.npz"
    by_receiver.save(file)
    assert navigation_errors(exact) is None
    with pytest.raises(ft.InputError, match="`navigation` must be absent for a band file"):
        ft.band(file, navigation="rtk")
