"""A climbing turn, flown by the law and by the aircraft with two gain sets."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.outputs.recording.record import write_recording

TUNED = {"name": "tuned", "K_P": [[3.1, 0.0], [0.0, 2.9]], "K_I": [[1.1, 0.0], [0.0, 0.9]]}
LAW = {"kind": "kinematic"}
SCENARIO = {
    "title": "Climbing turn, made up",
    "verifies": "that a recording shows what was flown",
    "seed": 7,
    "gains": ["paper", TUNED],
    "flight": {
        "V_a_mps": 25.0, "h_m": 1000.0, "chi_deg": 0.0, "gamma_deg": 0.0, "duration_s": 20.0,
    },
    "reference": {"chi_deg": 60.0, "gamma_deg": 30.0},
    "limits": {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 60.0, "n_z": [0.0, 2.0]},
    "controller": {"feed_forward": True},
    "plant": [LAW, {"kind": "jsbsim", "aircraft": "aerosonde"}],
}  # fmt: skip


def flown(**changes):
    """Runs of the scenario, with other tables in it."""
    return ft.fly(ft.scenario_from(SCENARIO | changes)).runs


@pytest.fixture(scope="session")
def four_runs():
    """Two gain sets on two plants, 20 s each."""
    law_paper, law_tuned, aircraft_paper, aircraft_tuned = flown()
    return [law_paper, aircraft_paper, law_tuned, aircraft_tuned]


@pytest.fixture(scope="session")
def without_gains():
    """A run that could not be flown."""
    return made_up_run(
        {}, np.array([]), plant="jsbsim:aerosonde", gains_name="strict", gains=None,
        scenario=SCENARIO, status="no_gains", reason="the smallest reachable I_K is 67.15",
    )  # fmt: skip


@pytest.fixture(scope="session")
def in_sinusoid():
    """A kinematic run in the sinusoidal disturbance."""
    waves = {"chi_amplitude": 0.05, "chi_omega_rad_s": 2.0}
    (run,) = flown(plant=[LAW], gains=["paper"], disturbance=waves)
    return run


@pytest.fixture(scope="session")
def sensed(four_runs):
    """The aircraft's second run, turned to south, as sensors with errors would have shown it."""
    signals = four_runs[3].signals.copy()
    signals["chi"] = (signals["chi"] + 2.7 + np.pi) % (2.0 * np.pi) - np.pi
    swing = np.sin(7.0 * signals.index.to_numpy())
    for name, bias, size in (("chi", 0.02, 0.01), ("gamma", 0.0, 0.3), ("V_a", 0.0, 3.0)):
        signals[f"{name}_meas"] = signals[name] + bias + size * swing
    return replace(four_runs[3], signals=signals)


@pytest.fixture(scope="session")
def cut_short(four_runs):
    """A run that left the envelope after 7 s."""
    whole = four_runs[3]
    return replace(
        whole,
        signals=whole.signals.loc[:7.0],
        status="left_envelope",
        reason="alpha 16.3 deg at t = 7.00 s, must stay below 16 deg",
        provenance=replace(whole.provenance, gains_name="bold"),
    )


@pytest.fixture(scope="session")
def recording(four_runs, cut_short, without_gains, tmp_path_factory):
    """A recording of six runs; a test that changes it changes a copy."""
    path = tmp_path_factory.mktemp("recording") / "flight.rrd"
    write_recording([*four_runs, cut_short, without_gains], path, page="# Page\n", title="Flight")
    return path
