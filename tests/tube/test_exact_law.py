"""The exact law in a tube: no flight leaves it, and it is narrower than that of the paper's law."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flighttune.control.exact_law import rate_gains
from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.errors import InputError
from flighttune.scenario import scenario_from
from flighttune.tube.proof import save_tube, verify_tube
from flighttune.units import DEG
from tests.tube.test_soundness import made_up, tube
from tests.tube.test_soundness_lagged import check_point_mass, lagged_plants

RATE = st.floats(0.3, 2.0)
CROSS = st.floats(-0.2, 0.2)
EXACT_PAPER = rate_gains(PAPER_GAINS, V_a=25.0)


def with_exact(scenario, plant):
    return scenario_from(scenario.as_dict() | {"law": "exact", "plant": [plant]})


@st.composite
def exact_problems(draw):
    scenario = made_up(
        chi_err_deg=draw(st.floats(-8.0, 8.0)),
        gamma_deg=draw(st.floats(-20.0, 30.0)),
        gamma_ref_deg=draw(st.floats(-20.0, 30.0)),
        roll_deg=draw(st.floats(5.0, 60.0)),
        roll_dps=draw(st.floats(10.0, 200.0)),
        n_z_max=draw(st.floats(1.3, 3.0)),
        n_z_per_s=draw(st.floats(0.3, 20.0)),
        anti_windup=draw(st.sampled_from(["conditional", "none"])),
        ramp_dps=draw(st.one_of(st.none(), st.floats(-8.0, 8.0))),
    )
    # So that the law brakes for larger errors only.
    law = {"name": "exact", "kind": "exact", "braking": 100.0}
    plant = draw(st.one_of(st.just({"kind": "kinematic"}), lagged_plants()))
    scenario = scenario_from(scenario.as_dict() | {"law": [law], "plant": [plant]})
    gains = PIGains(
        K_P=np.array([[draw(RATE), draw(CROSS)], [draw(CROSS), draw(RATE)]]),
        K_I=np.array([[draw(RATE), draw(CROSS)], [draw(CROSS), draw(RATE)]]),
        inputs=EXACT_PAPER.inputs,
    )
    start, disturbance = draw(st.sampled_from([0.0, 0.5])), draw(st.sampled_from([0.0, 0.01]))
    return scenario, gains, start * DEG, disturbance


@pytest.mark.slow
@settings(max_examples=8, deadline=None, derandomize=True)
@given(case=exact_problems(), seed=st.integers(0, 2**32 - 1))
def test_no_flight_of_the_exact_law_leaves_its_tube(case, seed):
    check_point_mass(case, seed)


@pytest.mark.soak
@settings(max_examples=150, deadline=None)
@given(case=exact_problems(), seed=st.integers(0, 2**32 - 1))
def test_no_flight_of_the_exact_law_leaves_its_tube_in_many_cases(case, seed):
    check_point_mass(case, seed)


@pytest.mark.slow
def test_in_a_turn_its_tube_is_narrower_than_that_of_the_paper_s_law_and_is_proven(
    tmp_path,
):
    tables = made_up(chi_err_deg=0.0, gamma_deg=0.0, gamma_ref_deg=0.0, duration_s=4.0).as_dict()
    ramp = {"shape": "ramp", "start_s": 0.2, "rate_dps": 6.0, "duration_s": 4.0}
    tables["reference"]["chi_deg"] = [ramp]
    tables["limits"] = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 90.0}
    scenario = scenario_from(tables | {"plant": [{"kind": "point_mass"}]})
    exact = with_exact(scenario, {"kind": "point_mass"})

    paper = tube(scenario, PAPER_GAINS, disturbance=0.005)
    found = tube(exact, EXACT_PAPER, disturbance=0.005)

    assert found.status == "bounded"
    # The same gains and, at gamma = 0, the same loop; the turn is what the paper's law ignores.
    narrower = found.bounds.half_widths[:, :2].max(axis=0) / paper.bounds.half_widths[:, :2].max(
        axis=0
    )
    assert narrower[0] < 0.9
    assert narrower[1] < 1.05
    save_tube(found, tmp_path / "tube.npz")
    assert verify_tube(tmp_path / "tube.npz").valid


@pytest.mark.slow
def test_where_it_does_not_invert_the_reason_says_why():
    scenario = with_exact(made_up(gamma_deg=45.0), {"kind": "point_mass"})

    found = tube(scenario, EXACT_PAPER)

    assert found.status == "unbounded"
    assert "the vertical lift wanted can be at its floor" in found.reason


def test_an_aircraft_is_refused_by_name():
    scenario = with_exact(made_up(), {"kind": "jsbsim", "aircraft": "aerosonde"})

    with pytest.raises(InputError, match=r"exact law.*airspeed"):
        tube(scenario, EXACT_PAPER, plant="jsbsim:aerosonde")
