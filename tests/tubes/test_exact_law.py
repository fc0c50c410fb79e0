"""The exact law in a tube, which is narrower than that of the paper's law."""

import math

import pytest

import flighttune as ft
from flighttune.flight.models import gain_set
from tests.tubes.test_soundness import made_up, tube

DEG = math.pi / 180.0

EXACT_PAPER = ft.rate_gains(ft.PAPER_GAINS, V_a=25.0)


def with_exact(scenario, plant):
    return ft.scenario_from(scenario.as_dict() | {"law": "exact", "plant": [plant]})


@pytest.mark.slow
def test_in_a_turn_its_tube_is_narrower_than_that_of_the_paper_s_law_and_is_proven(tmp_path):
    tables = made_up(chi_err_deg=0.0, gamma_deg=0.0, gamma_ref_deg=0.0, duration_s=2.5).as_dict()
    ramp = {"shape": "ramp", "start_s": 0.2, "rate_dps": 6.0, "duration_s": 4.0}
    tables["reference"]["chi_deg"] = [ramp]
    tables["limits"] = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 90.0}
    scenario = ft.scenario_from(tables | {"plant": [{"kind": "point_mass"}]})
    exact = with_exact(scenario, {"kind": "point_mass"})

    paper = tube(scenario, ft.PAPER_GAINS, disturbance=0.005)
    found = tube(exact, EXACT_PAPER, disturbance=0.005)

    assert found.status == "bounded"
    # The same gains and, at gamma = 0, the same loop; the turn is what the paper's law ignores.
    narrower = found.bounds.half_widths[:, :2].max(axis=0) / paper.bounds.half_widths[:, :2].max(
        axis=0
    )
    assert narrower[0] < 0.9
    assert narrower[1] < 1.05
    ft.save_tube(found, tmp_path / "tube.npz")
    assert ft.verify(tmp_path / "tube.npz").valid


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
"""Half of the last digit in docs/tube.md, deg."""


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "half_widths"),
    [("exact:tuned_identified", (0.111, 0.116)), ("tuned_identified", (0.185, 0.180))],
)
def test_the_level_turn_of_the_docs_has_the_half_widths_printed_there(name, half_widths):
    scenario = ft.load_scenario("exact_law", changes=LEVEL_TURN)
    law, _ = scenario.law_of(name)
    gains = gain_set(scenario, name)

    turn = tube(scenario, gains, disturbance=0.002, plant="point_mass", law=law)

    assert turn.bounds.half_widths[:, :2].max(axis=0) / DEG == pytest.approx(
        half_widths, abs=THREE_DIGITS
    )
