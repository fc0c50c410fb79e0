"""The exact law in a tube, which is narrower than that of the paper's law."""

import math

import pytest
from fuzzing import first_or_all

import flighttune as ft
from flighttune.flight.models import gain_set
from tests.tubes.test_soundness import made_up, tube

DEG = math.pi / 180.0

EXACT_PAPER = ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0)


def with_exact(scenario, plant):
    return ft.scenario_from(scenario.as_dict() | {"law": "exact", "plant": [plant]})


@pytest.mark.slow
def test_where_it_does_not_invert_the_reason_says_why():
    scenario = with_exact(made_up(gamma_deg=45.0), {"kind": "point_mass"})

    found = tube(scenario, EXACT_PAPER)

    assert found.status == "unbounded"
    assert "the vertical lift wanted can be at its floor" in found.reason


def test_an_aircraft_is_refused_by_name():
    scenario = with_exact(made_up(), {"kind": "jsbsim", "aircraft": "aerosonde"})

    with pytest.raises(ft.InputError, match=r"exact law.*airspeed"):
        tube(scenario, EXACT_PAPER, plant="jsbsim:aerosonde")


LEVEL_TURN = {
    "plant[0].kind": "point_mass",
    "reference.shape": "feasible",
    "flight.gamma_deg": 0.0,
    "reference.gamma_deg": 0.0,
}

THREE_DIGITS = 5e-4
"""Half of the last digit in docs/exact_law.md, deg."""


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "half_widths"),
    first_or_all(
        [
            ("exact:tuned_fed_back", (0.083, 0.080)),
            ("tuned_identified", (0.185, 0.180)),
            ("exact:tuned_identified", (0.111, 0.116)),
        ]
    ),
)
def test_the_level_turn_of_the_docs_has_the_half_widths_printed_there(name, half_widths):
    scenario = ft.load_scenario("exact_law", changes=LEVEL_TURN)
    law, _ = scenario.law_of(name)
    gains = gain_set(scenario, name)

    turn = tube(scenario, gains, disturbance=0.002, plant="point_mass", law=law)

    assert turn.bounds.half_widths[:, :2].max(axis=0) / DEG == pytest.approx(
        half_widths, abs=THREE_DIGITS
    )
