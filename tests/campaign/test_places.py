"""Dotted paths into a scenario, and values put there."""

import pytest

from flighttune.errors import InputError
from flighttune.scenario.places import places_of, value_at, with_values

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


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("", "must be names joined by dots"),
        ("flight..V_a_mps", "must be names joined by dots"),
        ("limits.phi_deg[2]", r"must be a position, 0 to 1, of `limits.phi_deg`, got \[2\]"),
        ("reference.chi_deg.rate_dps", "must say which of `reference.chi_deg`"),
        ("flight.V_a_mps.x", "must be a key of a table, but `flight.V_a_mps` is 25.0"),
        ("plant", "must be a key of a plant, got the plants themselves"),
        (
            "plant[b747].throttle_max",
            r"0 to 3, or a label \(kinematic, .*\) of `plant`, got \[b747",
        ),
        ("plant.wings", "must be a key of a plant that flies: `wings` is not a known key"),
    ],
)
def test_a_key_that_is_nowhere_is_refused(key, says):
    with pytest.raises(InputError, match=says):
        places_of(key, TABLES, 0.5)


def test_values_put_in_leave_the_tables_as_they_were():
    put = [
        (("flight", "V_a_mps"), 20.0),
        (("flight", "h_m"), 300.0),
        (("limits", "phi_deg", 0), -30.0),
        (("plant", 1, "airframe", "mass_factor"), 1.1),
        (("plant", 1, "airframe", "cg_aft_m"), 0.01),
    ]
    changed = with_values(TABLES, put)

    assert [value_at(changed, place) for place, _ in put] == [value for _, value in put]
    assert changed["plant"][1] == {
        "kind": "jsbsim",
        "aircraft": "aerosonde",
        "airframe": {"mass_factor": 1.1, "cg_aft_m": 0.01},
    }
    assert TABLES["flight"] == {"V_a_mps": 25.0}
    assert TABLES["limits"]["phi_deg"] == [-45.0, 45.0]
    assert "airframe" not in TABLES["plant"][1]
