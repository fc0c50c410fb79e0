"""A flight of two hours goes through every command that reads a run."""

import pytest
from commands import flighttune

import flighttune as ft

HOURS = """
title = "Two hours"
seed = 1
gains = ["tuned"]
flight = { V_a_mps = 25.0, h_m = 1000.0, chi_deg = 0.0, gamma_deg = 0.0, duration_s = 7200.0 }
controller = { rate_hz = 2.0 }
reference = { chi_deg = 20.0, gamma_deg = 0.0 }
limits = { phi_deg = [-45.0, 45.0], n_z = [-2.1, 2.1] }
plant = [{ kind = "kinematic" }]
"""


@pytest.mark.soak
def test_a_flight_of_two_hours_is_read_and_drawn(tmp_path):
    """The proven bound falls below the smallest double within the first hour."""
    (tmp_path / "long.toml").write_text(HOURS)

    flighttune("fly", "long.toml", "--out", "run", cwd=tmp_path)

    (run,) = ft.load(tmp_path / "run").runs
    assert (run.status, len(run.signals)) == ("completed", 2 * 7200 + 1)
    for command in (
        ("report", "run", "--out", "run.html"),
        ("report", "long.toml", "--out", "scenario.html"),
        ("verify", "run"),
        ("compare", "run", "run", "--out", "both.html"),
    ):
        flighttune(*command, cwd=tmp_path)
    for page in ("run", "scenario", "both"):
        text = (tmp_path / f"{page}.html").read_text()
        assert "<svg" in text
        assert "NaN" not in text
