"""`fly` says no where a scenario's expectation is missed, and yes to an end that was expected."""

import json

import pytest
from commands import flighttune

from flighttune.shipped import scenario_files


def fly(scenario, out, *, status):
    """Fly a scenario; return the JSON object and what stands on stderr."""
    shown, err = flighttune("fly", scenario, "--out", out, "--json", status=status)
    return json.loads(shown), err


@pytest.mark.slow
def test_an_expected_end_is_a_success(tmp_path):
    found, err = fly("weak_engine", tmp_path, status=0)

    assert {run["status"] for run in found["runs"]} == {"completed", "left_envelope"}
    assert found["missed"] == []
    assert err == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("at_most.gamma.ST_deg = 0.1", "at_least.flight.n_z_max = 9.0",
         "kinematic / paper: flight.n_z_max must be at least 9, got 1.3"),
        ('status = "left_envelope"', 'status = "ground_contact"',
         "jsbsim:aerosonde / paper: left_envelope, must be ground_contact: t = "),
    ],
)  # fmt: skip
def test_what_is_missed_is_said_in_one_line(tmp_path, old, new, line):
    text = scenario_files()["weak_engine"].read_text()
    assert old in text
    path = tmp_path / "asks_more.toml"
    path.write_text(text.replace(old, new))

    found, err = fly(path, tmp_path, status=1)

    assert len(found["missed"]) == 2
    assert err.startswith(f"flighttune: {line}")
    assert err.endswith("(1 more)\n")
    assert err.count("\n") == 1


@pytest.mark.slow
def test_a_start_that_the_aircraft_refuses_is_one_line(tmp_path):
    path = tmp_path / "banked.toml"
    text = scenario_files()["weak_engine"].read_text()
    path.write_text(text.replace("chi_deg    = 0.0", "chi_deg    = 0.0\nphi_deg    = 60.0", 1))

    _, err = flighttune("fly", path, "--out", tmp_path, status=2)

    assert "[flight] `phi_deg` must lie in -45 to 45 deg" in err
    assert err.count("\n") == 1
