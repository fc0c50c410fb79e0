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
