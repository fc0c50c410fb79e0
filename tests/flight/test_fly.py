"""A whole scenario flown: what the controller knows of the aircraft, and what stands in a run."""

import tomllib

import numpy as np
import pytest
from places import SHIPPED_SCENARIOS

import flighttune as ft

ROUNDING = 1e-12


def scenario(**tables):
    given = tomllib.loads((SHIPPED_SCENARIOS / "paper.toml").read_text())
    return ft.scenario_from({**given, "gains": ["paper"], "expect": [], **tables})


def test_the_controller_keeps_inside_the_limits_of_the_aircraft_it_flies():
    wide = {"phi_deg": [-80.0, 80.0], "n_z": [-3.0, 3.0]}
    runs = {run.provenance.plant: run for run in ft.fly(scenario(limits=wide)).runs}

    kinematic, aircraft = (runs[name].signals for name in ("kinematic", "jsbsim:aerosonde"))
    assert np.rad2deg(kinematic["phi_cmd"].abs().max()) > 60.0
    assert np.rad2deg(aircraft["phi_cmd"].abs().max()) <= 45.0 + ROUNDING
    assert (aircraft["phi_cmd"].diff().abs().max() / 0.02) <= np.deg2rad(30.0) * (1.0 + 1e-9)


def test_a_run_knows_what_made_it_and_tells_its_progress():
    told = {}

    (run, _) = ft.fly(
        scenario(seed=7), progress=lambda label, part: told.setdefault(label, []).append(part)
    ).runs

    assert list(told) == ["kinematic / paper", "jsbsim:aerosonde / paper"]
    assert all(parts == sorted(parts) and parts[-1] == 1.0 for parts in told.values())
    assert run.provenance.seed == 7
    assert run.provenance.scenario["flight"]["V_a_mps"] == 25.0
    assert {"flighttune", "numpy", "jsbsim", "python"} <= run.provenance.versions.keys()
    assert ft.scenario_from(dict(run.provenance.scenario)) == scenario(seed=7)


@pytest.mark.parametrize("rate_hz", [10.0, 30.0, 60.0, 100.0, 250.0])
def test_any_controller_rate_flies_on_the_full_aircraft(rate_hz):
    settings = {"rate_hz": rate_hz, "feed_forward": True}
    short = {"V_a_mps": 25.0, "duration_s": 1.0}
    (_, run) = ft.fly(scenario(controller=settings, flight=short)).runs

    assert run.status == "completed"
    assert len(run.signals) == round(rate_hz) + 1
