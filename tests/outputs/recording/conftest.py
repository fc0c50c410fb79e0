"""A climbing turn, flown by the law and by the aircraft with two gain sets."""

import flighttune as ft

TUNED = {"name": "tuned", "K_P": [[3.1, 0.0], [0.0, 2.9]], "K_I": [[1.1, 0.0], [0.0, 0.9]]}
LAW = {"kind": "kinematic"}
SCENARIO = {
    "title": "Climbing turn, made up",
    "verifies": "that a recording shows what was flown",
    "seed": 7,
    "gains": ["paper", TUNED],
    "flight": {
        "V_a_mps": 25.0, "h_m": 1000.0, "chi_deg": 0.0, "gamma_deg": 0.0, "duration_s": 20.0,
    },
    "reference": {"chi_deg": 60.0, "gamma_deg": 30.0},
    "limits": {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 60.0, "n_z": [0.0, 2.0]},
    "controller": {"feed_forward": True},
    "plant": [LAW, {"kind": "jsbsim", "aircraft": "aerosonde"}],
}  # fmt: skip


def flown(**changes):
    """Runs of the scenario, with other tables in it."""
    return ft.fly(ft.scenario_from(SCENARIO | changes)).runs
