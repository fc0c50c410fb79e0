"""Bode and Nyquist of a loop: the curves of a closed form, with the margins where they belong."""

import math
import re

import numpy as np
import pytest

import flighttune as ft
from flighttune.control import margins
from flighttune.outputs.pages.charts import loop_charts

G, V = 9.81, 25.0
ROUNDING = 1e-12
OMEGA = np.logspace(-2.0, 2.0, 400)


@pytest.fixture(scope="module")
def level():
    return ft.loop.kinematic_model(V_a=V, gamma=0.0, g=G)


def test_a_decoupled_loop_has_the_response_of_two_integrators_and_a_zero(level):
    gains = ft.PIGains(K_P=np.diag([1.7, 2.1]), K_I=np.diag([0.6, 0.9]))

    found = margins.channel_responses(level, gains, OMEGA)

    s = 1j * OMEGA
    for i, (proportional, integral) in enumerate(((1.7, 0.6), (2.1, 0.9))):
        expected = G / V * (proportional * s + integral) / s**2
        assert found[:, i] == pytest.approx(expected, rel=ROUNDING)


def test_the_phase_margin_drawn_is_that_of_the_closed_form(level):
    gains = ft.PIGains(K_P=np.diag([1.7, 2.1]), K_I=np.diag([0.6, 0.9]))
    charts = loop_charts(level, gains, margins.loop_margins(level, gains))

    drawn = [name for name, _, _ in charts[1].legend if name.startswith("phase margin")]

    for text, proportional, integral in zip(drawn, (1.7, 2.1), (0.6, 0.9), strict=True):
        # |L| = 1: w^4 = (g/V)^2 (P^2 w^2 + I^2), and the phase is atan(P w / I) - 180 deg
        k, p = (G / V * integral) ** 2, (G / V * proportional) ** 2
        omega = math.sqrt((p + math.sqrt(p**2 + 4.0 * k)) / 2.0)
        margin = math.degrees(math.atan(proportional * omega / integral))
        assert float(re.search(r"[\d.]+", text).group()) == pytest.approx(margin, abs=0.051)
