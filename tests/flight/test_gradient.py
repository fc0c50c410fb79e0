"""Slopes of flights against central differences of flights by JSBSim."""

import numpy as np
import pytest

import flighttune as ft

OSCILLATION = {
    "chi_amplitude": 0.03, "chi_omega_rad_s": 0.5,
    "gamma_amplitude": 0.02, "gamma_omega_rad_s": 0.4, "as_wind": True,
}  # fmt: skip


def scenario(aircraft="aerosonde", V_a_mps=25.0, h_m=1000.0, duration_s=2.0, **changes):
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
        {"h_m": 60.0, "duration_s": 6.0, "reference": {"chi_deg": 0.0, "gamma_deg": -30.0}},
        {},
        "must be completed, got ground contact",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_slope_is_refused(case):
    changes, asked, message = REFUSED[case]
    with pytest.raises(ft.InputError, match=message):
        ft.gradient(scenario(**changes), **asked)


K_P, K_I, FED = np.array([[1.5, 0.1], [-0.05, 1.3]]), np.diag([0.8, 0.6]), np.array([0.3, 0.2])
MEASURES = ["chi.ITAE", "gamma.ITAE", "chi.MS_deg"]


def moved(gains, x, *place):
    gains = gains.copy()
    gains[place] += x
    return gains


# Parameters, and how each changes the flight below by a step.
STEPS = {
    "K_P.chi_dot.chi": lambda x: {"K_P": moved(K_P, x, 0, 0)},
    "K_P.chi_dot.gamma": lambda x: {"K_P": moved(K_P, x, 0, 1)},
    "K_P.gamma_dot.chi": lambda x: {"K_P": moved(K_P, x, 1, 0)},
    "K_P.gamma_dot.gamma": lambda x: {"K_P": moved(K_P, x, 1, 1)},
    "K_I.gamma_dot.gamma": lambda x: {"K_I": moved(K_I, x, 1, 1)},
    "feedback.phi": lambda x: {"fed": moved(FED, x, 0)},
    "feedback.n_z": lambda x: {"fed": moved(FED, x, 1)},
    "flight.V_a_mps": lambda x: {"V_a": 25.0 + x},
    "plant.airframe.drag_factor": lambda x: {"drag": 1.0 + x},
}


def turn(*, K_P=K_P, K_I=K_I, fed=FED, V_a=25.0, drag=1.0, law="exact"):
    """A small turn and climb with feedback of roll and load factor."""
    own = {"name": "own", "law": law, "K_P": K_P.tolist(), "K_I": K_I.tolist()}
    own |= {"feedback": fed.tolist()} if law == "exact" else {}
    plant = {"kind": "jsbsim", "aircraft": "aerosonde", "airframe": {"drag_factor": drag}}
    reference = {"chi_deg": 0.5, "gamma_deg": 0.1}
    flight = {"V_a_mps": V_a, "duration_s": 3.0}
    return scenario(law=[law], gains=[own], plant=[plant], flight=flight, reference=reference)


@pytest.mark.parametrize("law", ["exact", "paper"])
def test_slopes_are_the_differences_of_flights(law):
    steps = {name: by for name, by in STEPS.items() if law == "exact" or "feedback" not in name}
    names = {name: name for name in steps}
    if law == "paper":
        names = {x: x.replace("chi_dot", "phi").replace("gamma_dot", "n_z") for x in steps}

    gradient = ft.gradient(turn(law=law), by=[*names.values()], measures=MEASURES)

    def measured(**changed):
        flown = ft.fly(turn(law=law, **changed))
        found = flown.metrics_of(flown.runs[0])
        return [found["chi"]["ITAE"], found["gamma"]["ITAE"], np.degrees(found["chi"]["MS_rad"])]

    assert [*gradient.values.values()] == pytest.approx(measured(), rel=1e-12)
    found = {(row["parameter"], row["measure"]): row["slope"] for row in gradient.slopes}
    for name, by in steps.items():
        step = 1e-2 if name.startswith(("flight", "plant")) else 1e-3
        after, before = (np.array(measured(**by(x))) for x in (step, -step))
        expected = (after - before) / (2.0 * step)
        slopes = [found[names[name], measure] for measure in MEASURES]
        assert slopes == pytest.approx(expected, rel=1e-3, abs=1e-8), name
    assert [len(table.records) for table in gradient.answer().tables] == [len(steps)] * 3
    assert 0.0 < gradient.at_limits_s < 0.5
