"""What an export says of the estimates that its law needs."""

import math

import numpy as np
import pytest

import flighttune as ft
from flighttune.outputs.exports.export import ExportedSource
from flighttune.outputs.exports.needs import noise_gain

V_A, G, DT, LOOK_AHEAD = 25.0, 9.80665, 0.005, 3.0
FAST = 2.0 * math.pi * 20.0
"""rad/s: integrators have less than a hundredth of the gain there."""


def responses(gains, look_ahead):
    """Amplitude of the commands of the exact law for a fast error of course and path angle."""
    law = ft.loop.ExactLaw(gains, dt=DT, g=G)
    law.start(ft.loop.FlightCondition(V_a=V_A))
    per_T = 1.0 / look_ahead if look_ahead else 0.0
    found = []
    for k in range(2000):
        error = 1e-6 * math.sin(FAST * k * DT)
        seen = ft.loop.Measured(error, error, V_A, 0.0, 1.0, 1000.0, (0.0, 0.0, 0.0), None)
        turn = -per_T * error
        aim = ft.loop.ReferenceSample(chi=0.0, gamma=0.0, chi_dot=turn, gamma_dot=turn)
        phi, n_z, *_ = law.step(seen, aim, k * DT)
        found.append((phi, n_z - 1.0))
    rows, wave = np.array(found[1000:]), np.arange(1000, 2000) * DT * FAST
    return 2e6 * np.abs(np.exp(-1j * wave) @ rows) / len(rows)


@pytest.mark.parametrize("look_ahead", [None, LOOK_AHEAD])
def test_noise_gain_is_the_frequency_response_of_the_law(look_ahead):
    gains = ft.PIGains(
        K_P=np.diag([2.57, 2.23]),
        K_I=np.diag([1.02, 0.82]),
        inputs=("chi_dot", "gamma_dot"),
        errors=("chi", "gamma"),
        feedback=(0.36, 0.26),
    )

    gain = noise_gain(gains, V_A, G, look_ahead)

    assert responses(gains, look_ahead) == pytest.approx(gain, rel=0.01)


@pytest.mark.slow
def test_an_export_says_what_its_law_needs(tmp_path):
    exported = ft.export("c172_cruise_turn", "tuned", out=tmp_path, form="c")

    assert isinstance(exported, ExportedSource)
    said = " ".join(exported.notes)
    assert "The law needs estimates of course and path angle over ground" in said
    assert "s more delay than its model has" in said
    assert "moves the roll command by" in exported.source.read_text()
