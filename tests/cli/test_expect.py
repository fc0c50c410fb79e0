"""`fly` says no where a scenario's expectation is missed, and yes to an end that was expected."""

import json

import pytest
from commands import flighttune
from places import SHIPPED_SCENARIOS


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
    text = (SHIPPED_SCENARIOS / "weak_engine.toml").read_text()
    assert old in text
    path = tmp_path / "asks_more.toml"
    path.write_text(text.replace(old, new))

    shown, err = flighttune("fly", path, "--out", tmp_path, "--json", status=1)

    assert len(json.loads(shown)["missed"]) == 2
    assert err.startswith(f"flighttune: {line}")
    assert err.endswith("(1 more)\n")
    assert err.count("\n") == 1
