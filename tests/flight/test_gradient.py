"""Slopes of flights against central differences of flights by JSBSim."""

import pytest

import flighttune as ft

OSCILLATION = {
    "chi_amplitude": 0.03, "chi_omega_rad_s": 0.5,
    "gamma_amplitude": 0.02, "gamma_omega_rad_s": 0.4, "as_wind": True,
}  # fmt: skip


def scenario(aircraft="aerosonde", V_a_mps=25.0, h_m=1000.0, duration_s=6.0, **changes):
    """A turn into a climb that meets no limit."""
    made = ft.load_scenario("exact_law").as_dict()
    made["plant"] = [{"kind": "jsbsim", "aircraft": aircraft}]
    made["flight"] = {"V_a_mps": V_a_mps, "h_m": h_m, "duration_s": duration_s}
    made["reference"] = {"chi_deg": 3.0, "gamma_deg": 0.5}
    return ft.scenario_from(made | {"expect": []} | changes)


REFUSED = {
    "a measure that counts samples": ({}, {"measures": ["chi.settling_s"]}, "must have slopes"),
    "one of the linear loop": ({}, {"measures": ["loop.R_K"]}, "of the linear loop"),
    "an unknown measure": ({}, {"measures": ["chi.wobble"]}, "got chi.wobble"),
    "an unknown gain": ({}, {"by": ["K_P.phi.V"]}, "got K_P.phi.V"),
    "feedback that is zero": ({}, {"by": ["feedback"]}, "a gain that is not zero, got feedback"),
    "no number": ({}, {"by": ["title"]}, "title must be one number"),
    "a count": ({}, {"by": ["seed"]}, "and not a count, got 1"),
    "a key that is not there": ({}, {"by": ["flight.wings"]}, "got nothing"),
    "a time of samples": ({}, {"by": ["flight.duration_s"]}, "rounded to samples"),
    "an error of sensors": (
        {"sensors": {"chi_bias_deg": 0.2}},
        {"by": ["sensors.chi_bias_deg"]},
        "the errors that the law sees",
    ),
    "another plant": ({}, {"plant": "kinematic"}, "must be an aircraft"),
    "a third command": (
        {
            "reference": {"chi_deg": 3.0, "gamma_deg": 0.5, "V_mps": 25.0},
            "limits": {"n_x": [-0.3, 0.3]},
        },
        {},
        "must be compiled to have slopes",
    ),
    "a path through the air": (
        {"disturbance": OSCILLATION | {"path": "air"}},
        {},
        "must be compiled to have slopes",
    ),
    "a flight that ends early": (
        {"h_m": 60.0, "reference": {"chi_deg": 0.0, "gamma_deg": -30.0}},
        {},
        "must be completed, got ground contact",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_slope_is_refused(case):
    changes, asked, message = REFUSED[case]
    with pytest.raises(ft.InputError, match=message):
        ft.gradient(scenario(**changes), **asked)


def test_the_answer_has_a_table_for_each_measure():
    measures = ["chi.ITAE", "gamma.peak_rad"]
    gradient = ft.gradient(scenario(duration_s=2.0), by=["K_P"], measures=measures)

    answer = gradient.answer()

    assert [len(table.records) for table in answer.tables] == [2, 2]
    assert answer.values["values"].keys() == set(measures)
