"""Flights made up for the tests: the kinematic law, once bare and once behind a slow inner loop."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.recording.record import write_recording

G_0 = 9.80665

DT = 0.02
V_A = 25.0
PHI_MAX = np.deg2rad(45.0)
PHI_RATE = np.deg2rad(60.0)
SCENARIO = {
    "title": "Climbing turn, made up",
    "verifies": "that a recording shows what was flown",
    "seed": 7,
    "gains": ["paper", "tuned"],
    "flight": {"V_a_mps": V_A, "h_m": 1000.0, "chi_deg": 0.0, "gamma_deg": 0.0, "duration_s": 20.0},
    "reference": {"chi_deg": 60.0, "gamma_deg": 30.0},
    "limits": {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 60.0, "n_z": [0.0, 2.0]},
    "plant": [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}],
}
TUNED_GAINS = ft.PIGains(K_P=np.diag([3.1, 2.9]), K_I=np.diag([1.1, 0.9]))


def fly(plant, gains_name, gains, *, seconds=20.0, amplitude=0.0, lag=0.0):
    """Integrate the kinematic law by Euler steps; a lag makes it a stand-in for a full aircraft."""
    t = np.arange(round(seconds / DT) + 1) * DT
    chi_ref, gamma_ref = np.deg2rad(60.0), np.deg2rad(30.0)
    chi = gamma = north = east = down = phi = phi_cmd = 0.0
    n_z, xi, rows = 1.0, np.zeros(2), []
    for now in t:
        error = np.array([chi_ref - chi, gamma_ref - gamma])
        integral = gains.K_I @ xi
        phi_free, n_z_free = gains.K_P @ error + integral + [0.0, np.cos(gamma_ref) / np.cos(phi)]
        wanted = np.clip(phi_free, -PHI_MAX, PHI_MAX)
        step = np.clip(wanted - phi_cmd, -PHI_RATE * DT, PHI_RATE * DT)
        phi_limited = 2.0 if phi_cmd + step != wanted else 1.0 if wanted != phi_free else 0.0
        phi_cmd += step
        n_z_cmd = np.clip(n_z_free, 0.0, 2.0)
        n_z_limited = float(n_z_cmd != n_z_free)
        if not (phi_limited or n_z_limited):
            xi = xi + DT * error
        share = DT / (lag + DT)
        phi += share * (phi_cmd - phi)
        n_z += share * (n_z_cmd - n_z)
        d_chi, d_gamma = amplitude * np.sin(2.0 * now), amplitude * np.cos(2.0 * now)
        row = {"chi": chi, "gamma": gamma, "phi": phi, "n_z": n_z, "V_a": V_A}
        row |= {"north": north, "east": east, "down": down}
        row |= {"chi_ref": chi_ref, "gamma_ref": gamma_ref}
        row |= {"chi_err": error[0], "gamma_err": error[1], "phi_cmd": phi_cmd, "n_z_cmd": n_z_cmd}
        row |= {"phi_unlimited": phi_free, "n_z_unlimited": n_z_free}
        row |= {"phi_integral": integral[0], "n_z_integral": integral[1]}
        row |= {"phi_limited": phi_limited, "n_z_limited": n_z_limited}
        if lag:
            row |= _full_aircraft(row, now)
        else:
            row |= {"d_chi": d_chi, "d_gamma": d_gamma}
        rows.append(row)
        north += DT * V_A * np.cos(gamma) * np.cos(chi)
        east += DT * V_A * np.cos(gamma) * np.sin(chi)
        down -= DT * V_A * np.sin(gamma)
        chi += DT * (G_0 / V_A * np.tan(phi) + d_chi)
        gamma += DT * (G_0 / V_A * (n_z * np.cos(phi) - np.cos(gamma)) + d_gamma)
    return made_up_run(rows, t, plant=plant, gains_name=gains_name, gains=gains, scenario=SCENARIO)


def _full_aircraft(row, now):
    alpha = 0.03 + 0.05 * (row["n_z"] - 1.0)
    V_a = V_A - 1.5 * np.sin(0.3 * now) * np.exp(-now / 8.0)
    return {
        "V_a": V_a,
        "V_g": V_a,
        "alpha": alpha,
        "beta": 0.02 * np.sin(row["phi"]),
        "theta": row["gamma"] + alpha * np.cos(row["phi"]),
        "psi": row["chi"] + 0.01,
        "p": 0.2 * np.cos(now),
        "q": 0.1 * np.sin(now),
        "r": 0.05 * np.sin(2.0 * now),
        "h": 1000.0 - row["down"],
        "n_y": 0.01 * np.sin(now),
        "aileron": 0.1 * (row["phi_cmd"] - row["phi"]),
        "elevator": -0.05 * (row["n_z_cmd"] - row["n_z"]) - 0.02,
        "rudder": 0.01 * np.sin(3.0 * now),
        "throttle": 0.4 + 0.5 * np.sin(row["gamma"]),
        "thrust": 20.0,
    }


@pytest.fixture(scope="session")
def four_runs():
    """Two gain sets on two plants, 20 s each."""
    return [
        fly("kinematic", "paper", ft.PAPER_GAINS),
        fly("jsbsim:aerosonde", "paper", ft.PAPER_GAINS, lag=0.25),
        fly("kinematic", "tuned", TUNED_GAINS),
        fly("jsbsim:aerosonde", "tuned", TUNED_GAINS, lag=0.25),
    ]


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
    return fly("kinematic", "paper", ft.PAPER_GAINS, amplitude=0.05, seconds=6.0)


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
