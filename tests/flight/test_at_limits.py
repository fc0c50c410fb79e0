"""What a command does at its limits to the end is said, and judged where it swings between them."""

from made_up import made_up_scenario

import flighttune as ft

WANTED = [{"at_most": {"chi": {"peak_deg": 90.0}, "gamma": {"peak_deg": 90.0}}}]
LIMITS = {"phi_deg": [-40.0, 40.0], "phi_rate_dps": 40.0, "n_z": [0.5, 2.0], "n_z_rate_per_s": 1.0}
TURN = {"reference": {"chi_deg": 10.0, "gamma_deg": 0.0}, "flight": {"duration_s": 20.0}}


def test_gains_that_make_a_command_swing_meet_nothing(tmp_path):
    """Beyond K_P dt = 2 the sampled loop of a plant without lag is unstable: limits end it."""
    scenario = made_up_scenario(
        law=["exact"], expect=WANTED, limits=LIMITS, tuning={"model": "kinematic"}, **TURN
    )
    steep = ft.PIGains.from_lists([[1.0, 0.0], [0.0, 150.0]], [[0.1, 0.0], [0.0, 0.1]], law="exact")

    found = ft.meet(scenario, start=steep, budget=1)

    assert found.status == "missed"
    assert any("n_z_cmd swings" in row["why"] for row in found.requirements)
