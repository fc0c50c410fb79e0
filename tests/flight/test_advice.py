"""What is said to try next where a requirement is missed: only what would help."""

import pytest
from made_up import made_up_scenario

from flighttune.flight.advice import advice
from flighttune.flight.fly import fly

TURN = {"chi_deg": 60.0, "gamma_deg": 0.0}
RAMP = {"chi_deg": [{"shape": "ramp", "duration_s": 2.0, "rate_dps": 20.0}], "gamma_deg": 0.0}
BOTH = [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}]
FEASIBLE, SLOWER, MEET = '`shape = "feasible"`', "`rate_dps`", "`flighttune tune x.toml --meet`"
IDENTIFIED, SCHEDULE = "`tuned_identified` in `gains`", "`schedule = true`"


@pytest.mark.parametrize(
    ("change", "bound", "said"),
    [
        ({"reference": TURN}, {"MO_deg": 1.0}, {FEASIBLE}),
        ({"reference": RAMP}, {"MO_deg": 0.1}, {SLOWER}),
        ({"plant": BOTH}, {"MO_deg": 2.5}, {MEET}),
        ({"flight": {"V_a_mps": 50.0, "duration_s": 20.0}}, {"MO_deg": 0.1}, {IDENTIFIED}),
        ({}, {"MO_deg": 0.1}, set()),
        ({"reference": TURN}, {"MO_deg": 90.0}, set()),
    ],
    ids=["step", "ramp", "aircraft", "airspeed", "unknown", "met"],
)
def test_what_may_help_is_said_and_nothing_else(change, bound, said):
    tables = {
        "gains": ["paper"],
        "flight": {"V_a_mps": 25.0, "duration_s": 20.0},
        "reference": {"chi_deg": 5.0, "gamma_deg": 0.0},
        "limits": {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 30.0},
        "controller": {"feed_forward": True},
        "expect": [{"at_most": {"chi": bound}}],
    }
    scenario = made_up_scenario(**(tables | change))

    line = advice(scenario, fly(scenario).runs, "x.toml")

    ways = (FEASIBLE, SLOWER, MEET, IDENTIFIED, SCHEDULE)
    assert {way for way in ways if way in line} == said
    assert line.count("\n") == 0
    assert bool(line) == bool(said)
