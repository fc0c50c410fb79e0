"""What an export says of the estimates that its law needs."""

import math
import re

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft

V_A, G, DT, LOOK_AHEAD = 25.0, 9.80665, 0.005, 3.0
"""rad/s: integrators have less than a hundredth of the gain there."""


WAYPOINTS = [{"north_m": north, "east_m": 0.0} for north in (0.0, 800.0)]


@pytest.mark.parametrize(
    ("feedback", "fed_back", "look_ahead"),
    [
        ((0.5, 0.0), "airspeed and roll", None),
        ((0.0, 0.25), "airspeed and load factor", None),
        ((0.0, 0.0), "ground and airspeed", None),
        ((0.5, 0.25), "airspeed, roll and load factor", LOOK_AHEAD),
    ],
)
def test_errors_of_estimates_move_commands_by_the_noise_gain_in_degrees(
    feedback, fed_back, look_ahead, tmp_path
):
    """The loops are ``(P s + I) / s^2``, whose crossing ``w^4 = P^2 w^2 + I^2`` has a margin."""
    P, P_gamma, I_both = 0.6, 0.4, 0.1
    gains = {"name": "mine", "law": "exact", "feedback": list(feedback)}
    gains |= {"K_P": np.diag([P, P_gamma]).tolist(), "K_I": np.diag([I_both, I_both]).tolist()}
    route = {"waypoint": WAYPOINTS, "wind_mps": 8.0, "look_ahead_s": look_ahead}
    limits = {"phi_deg": [-45.0, 45.0], "n_z": [-2.0, 2.0]}
    limits |= {"phi_rate_dps": 30.0, "n_z_rate_per_s": 1.0}
    along = {"route": route, "reference": None, "limits": limits} if look_ahead else {}
    tables = {
        "gains": [gains],
        "law": ["exact"],
        "flight": {"V_a_mps": V_A, "duration_s": 60.0},
        **along,
    }
    scenario = made_up_scenario(**tables)

    estimates, moves, delay = ft.export(scenario, "exact:mine", out=tmp_path, form="c").notes[:3]

    assert f"{fed_back}, by an inertial filter" in estimates
    per_rate, aim = V_A / scenario.flight.g_mps2, 1.0 / look_ahead if look_ahead else 0.0
    roll = (1.0 + feedback[0]) * per_rate * (P + aim)
    lift = (1.0 + feedback[1]) * per_rate * (P_gamma + aim)
    assert f"moves the roll command by {roll:.3g} deg" in moves
    assert f"moves the load factor by {math.radians(lift):.2g}." in moves
    w = math.sqrt((P**2 + math.sqrt(P**4 + 4.0 * I_both**2)) / 2.0)
    assert f"bears {math.atan(P * w / I_both) / w:.2g} s more delay" in delay


@pytest.mark.parametrize("aircraft", [True, False])
def test_a_route_in_c_is_ahead_by_the_lags_of_its_aircraft_and_half_a_sample(aircraft, tmp_path):
    """A ramp is followed late by the delay of slow waves; without an aircraft there is no lag."""
    limits = {"phi_deg": [-45.0, 45.0], "n_z": [-2.0, 2.0]}
    limits |= {"phi_rate_dps": 30.0, "n_z_rate_per_s": 1.0}
    plants = [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}]
    scenario = made_up_scenario(
        route={"waypoint": WAYPOINTS, "wind_mps": 8.0}, reference=None, limits=limits,
        law=["paper"], flight={"V_a_mps": V_A, "duration_s": 60.0}, controller={"rate_hz": 40.0},
        plant=[plants[aircraft]],
    )  # fmt: skip

    text = ft.export(scenario, "paper", out=tmp_path, form="c").source.read_text()

    slow = 1e-4  # rad/s
    lags = ft.loop.load_identified("aerosonde").nearest(V_A, 0.0).lags
    late = [-np.angle(lag.response(np.array([slow]))[0]) / slow for lag in lags]
    for name, lag in zip(("PHI", "N_Z"), late, strict=True):
        lead = float(re.search(rf"define FT_LEAD_{name} (\S+)", text)[1])
        assert lead == pytest.approx(lag * aircraft + 0.5 / 40.0, rel=1e-3)
    assert "FT_DT 0.025" in text
    assert f"FT_G {scenario.flight.g_mps2!r}" in text
