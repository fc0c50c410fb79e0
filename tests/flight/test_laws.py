"""Scenarios that fly more than the paper's law: names, gains, files, and what is held of them."""

from made_up import made_up_scenario

import flighttune as ft


def scenario(**tables):
    turn = {"shape": "ramp", "start_s": 0.5, "duration_s": 1.0, "rate_dps": 8.0}
    made = {
        "law": ["paper", "exact"],
        "flight": {"duration_s": 3.0},
        "reference": {"chi_deg": [turn], "gamma_deg": 4.0},
        "plant": [{"kind": "kinematic"}, {"kind": "point_mass"}],
    }
    return made_up_scenario(**made | tables)


def test_a_scenario_of_the_papers_law_alone_has_the_same_hash_as_ever():
    tables = scenario().as_dict()
    without = {key: value for key, value in tables.items() if key != "law"}

    assert "law" not in ft.scenario_from(without).as_dict()


def test_a_run_of_the_exact_law_is_read_and_flown_again_to_the_bit(tmp_path):
    tables = [{"name": "slow", "kind": "exact", "lift_floor": 0.3, "priority": "chi"}]
    flown = ft.fly(scenario(law=tables))
    again = ft.load(ft.record(flown, tmp_path).recording).runs

    assert again[0].label == "kinematic / slow:paper"
    assert again[0].provenance.gains == flown.runs[0].provenance.gains
    assert ft.refly(again[:1]).equal
