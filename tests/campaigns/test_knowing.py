"""What autopilots know of their motion where a verb flies: a standard receiver along a route."""

import pytest

import flighttune as ft


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


@pytest.mark.parametrize(
    ("name", "navigation", "grade"),
    [
        ("circuit", None, "standard"),
        ("circuit", "rtk", "rtk"),
        ("circuit", "exact", None),
        ("circuit_in_wind", None, "standard"),
        ("level_turn", None, None),
        ("level_turn", "poor", "poor"),
    ],
)
def test_a_route_is_flown_by_a_standard_receiver_unless_it_is_said_otherwise(
    name, navigation, grade
):
    flights = ft.flights(name).knowing(navigation)

    for scenario in (flights.scenario, *([flights.campaign.central] if flights.campaign else [])):
        table = scenario.navigation
        assert (table and table.grade) == grade


def test_what_a_scenario_states_stays_and_another_grade_keeps_its_numbers():
    changes = {"navigation.grade": "poor", "navigation.position_sd_m": 7.0}
    stated = ft.flights("circuit", changes=changes)

    assert stated.knowing(None).scenario == stated.scenario
    other = stated.knowing("rtk").scenario.navigation
    assert (other.grade, other.position_sd_m) == ("rtk", 7.0)
    assert stated.knowing("exact").scenario.navigation is None


def test_a_path_through_the_air_cannot_be_known_by_a_grade():
    made = ft.load_scenario("paper").as_dict()
    made["disturbance"] = {"path": "air", "as_wind": True}

    with pytest.raises(ft.InputError, match="`navigation` must be exact with path"):
        ft.flights(ft.scenario_from(made)).knowing("rtk")
