"""A climbing turn through the public API: tune, fly on both plants, compare, record."""

from flighttune import fly, record, scenario_from

scenario = scenario_from(
    {
        "title": "Climbing turn: 45 deg of course and 10 deg of climb, then level again",
        "verifies": "both channels at once, and back to where the climb began",
        "seed": 1,
        "gains": [
            "paper",
            "tuned",
            {"name": "gentle", "K_P": [[1, 0], [0, 1]], "K_I": [[0.2, 0], [0, 0.2]]},
        ],
        "flight": {"V_a_mps": 25.0, "h_m": 300.0, "duration_s": 30.0},
        "reference": {
            "chi_deg": [{"shape": "ramp", "start_s": 2.0, "duration_s": 6.0, "rate_dps": 7.5}],
            "gamma_deg": [
                {"shape": "step", "start_s": 2.0, "change_deg": 10.0},
                {"shape": "step", "start_s": 16.0, "change_deg": -10.0},
            ],
        },
        "limits": {
            "phi_deg": [-45.0, 45.0],
            "phi_rate_dps": 30.0,
            "n_z": [-2.1, 2.1],
            "n_z_rate_per_s": 1.0,
        },
        "controller": {"rate_hz": 50.0, "feed_forward": True},
        "plant": [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}],
    }
)

if __name__ == "__main__":
    flown = fly(scenario)
    print(flown.metrics[["ITAE", "ST_rad", "effort_rms", "saturation_s"]].round(4))
    print("open it with: flighttune view", record(flown, "runs/climbing_turn").recording)
