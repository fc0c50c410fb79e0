"""Flights whose errors and paths are known on paper: exponential errors on straight lines."""

import numpy as np
import pytest
from made_up import made_up_run

SCENARIO = {
    "title": "Straight lines",
    "seed": 3,
    "gains": ["paper"],
    "flight": {"V_a_mps": 25.0, "h_m": 500.0, "chi_deg": 0.0, "gamma_deg": 0.0, "duration_s": 20.0},
    "reference": {"chi_deg": 60.0, "gamma_deg": 15.0},
    "limits": {"phi_deg": [-45.0, 45.0]},
    "plant": [{"kind": "kinematic"}],
}


def line(
    *, rate=1.0, offset=(0.0, 0.0, 0.0), drift=(0.0, 0.0, 0.0), plant="kinematic", gains="paper",
    scenario=SCENARIO, seconds=20.0, dt=0.02, status="completed",
):  # fmt: skip
    """A run with error ``exp(-rate t)`` in both channels, north at 25 m/s plus offset and drift."""
    t = np.arange(round(seconds / dt) + 1) * dt
    path = np.array([25.0, 0.0, 0.0])[:, None] * t + np.array(offset)[:, None]
    north, east, down = path + np.array(drift)[:, None] * t
    error = np.exp(-rate * t)
    still = np.zeros_like(t)
    columns = {
        "chi": 1.0 - error, "gamma": 1.0 - error, "chi_ref": still + 1.0, "gamma_ref": still + 1.0,
        "chi_err": error, "gamma_err": error, "phi": still, "n_z": still + 1.0,
        "phi_cmd": still, "n_z_cmd": still + 1.0, "phi_limited": still, "n_z_limited": still,
        "V_a": still + 25.0, "north": north, "east": east, "down": down,
    }  # fmt: skip
    reason = "" if status == "completed" else "alpha above 16 deg"
    return made_up_run(
        columns, t, plant=plant, gains_name=gains, scenario=scenario, status=status, reason=reason
    )


@pytest.fixture
def fly_line():
    """The maker of such flights."""
    return line
