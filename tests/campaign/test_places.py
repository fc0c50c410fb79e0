"""Dotted paths into a scenario, and values put there."""

import pytest

from flighttune.scenario.places import places_of

TABLES = {
    "flight": {"V_a_mps": 25.0},
    "limits": {"phi_deg": [-45.0, 45.0]},
    "reference": {"chi_deg": [{"shape": "ramp", "rate_dps": 10.0, "duration_s": 3.0}]},
    "plant": [
        {"kind": "kinematic"},
        {"kind": "jsbsim", "aircraft": "aerosonde"},
        {"kind": "jsbsim", "aircraft": "./my.aircraft/x8.2"},
        {"kind": "point_mass_lag", "roll_lag_rad_s": 5.0, "n_z_lag_rad_s": 9.0},
    ],
}


@pytest.mark.parametrize(
    ("key", "value", "places"),
    [
        ("flight.V_a_mps", 20.0, [("flight", "V_a_mps")]),
        ("limits.phi_deg[1]", 20.0, [("limits", "phi_deg", 1)]),
        ("reference.chi_deg[0].rate_dps", 3.0, [("reference", "chi_deg", 0, "rate_dps")]),
        ("wind.speed_mps", 3.0, [("wind", "speed_mps")]),
        ("plant.throttle_max", 0.5, [("plant", 1, "throttle_max"), ("plant", 2, "throttle_max")]),
        ("plant.roll_lag_rad_s", 4.0, [("plant", 3, "roll_lag_rad_s")]),
        ("plant[1].throttle_max", 0.5, [("plant", 1, "throttle_max")]),
        ("plant[jsbsim:aerosonde].throttle_max", 0.5, [("plant", 1, "throttle_max")]),
        ("plant[jsbsim:x8.2].throttle_max", 0.5, [("plant", 2, "throttle_max")]),
        (
            "plant[1].airframe.coefficient_factors[aero/coefficient/CL.alpha]",
            1.1,
            [("plant", 1, "airframe", "coefficient_factors", "aero/coefficient/CL.alpha")],
        ),
    ],
)
def test_a_key_is_found_where_it_stands(key, value, places):
    assert list(places_of(key, TABLES, value)) == places
