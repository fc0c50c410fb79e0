"""Bode and Nyquist of a loop: the curves of a closed form, with the margins where they belong."""

import math
import re

import numpy as np
import pytest

import flighttune as ft
from flighttune.control import margins
from flighttune.outputs.pages import charts
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


def test_the_curves_of_a_loop_are_those_of_the_closed_form(level):
    K_P, K_I = (1.7, 2.1), (0.6, 0.9)
    gains = ft.PIGains(K_P=np.diag(K_P), K_I=np.diag(K_I))
    b = G / V

    magnitude, phase, nyquist, plane = loop_charts(level, gains, margins.loop_margins(level, gains))

    poles = np.concatenate([np.roots([1.0, b * p, b * i]) for p, i in zip(K_P, K_I, strict=True)])
    curves = [[x for x in chart._seen if len(x[0]) > 300] for chart in (magnitude, phase, nyquist)]
    for k, (p, i) in enumerate(zip(K_P, K_I, strict=True)):
        (omega, decibel), (at, degrees) = curves[0][k], curves[1][k]
        assert omega[0] < 0.1 * np.abs(poles).min()  # a decade beyond all poles
        assert omega[-1] > 10.0 * np.abs(poles).max()
        size = np.abs(b * (p * 1j * omega + i) / (1j * omega) ** 2)
        assert decibel == pytest.approx(20.0 * np.log10(size), abs=1e-9)
        assert degrees == pytest.approx(np.degrees(np.arctan(p * at / i)) - 180.0, abs=1e-9)
        (real, imaginary), (again, mirrored) = curves[2][2 * k : 2 * k + 2]
        assert (again, mirrored) == (pytest.approx(real), pytest.approx(-imaginary))
    (found,) = [x for x in plane._seen if len(x[0]) > 1]
    assert np.sort_complex(found[0] + 1j * found[1]) == pytest.approx(np.sort_complex(poles))
    # a margin is a line from the level to the curve, where the loop crosses the unit circle
    marks = [(x, y) for x, y in phase._seen if len(x) == 2]
    for (x, y), p, i in zip(marks, K_P, K_I, strict=True):
        assert np.abs(b * (p * 1j * x[0] + i) / x[0] ** 2) == pytest.approx(1.0, rel=0.02)
        assert y == pytest.approx([-180.0, np.degrees(np.arctan(p * x[0] / i)) - 180.0])
    assert nyquist.x_range[0] < -1.0 < nyquist.x_range[1]  # the critical point
    assert nyquist.y_range[0] == -nyquist.y_range[1]


@pytest.mark.parametrize("values", [(-4.0, -1.0), (-1.0, 2.0), (3.0, 4.0)])
def test_eigenvalues_and_the_imaginary_axis_are_inside_their_chart(values):
    low, high = charts._eigenvalues(np.array(values, complex)).x_range

    assert low < min(0.0, *values)
    assert high > max(0.0, *values)


def test_gain_margins_are_drawn_in_decibels_where_the_curve_is_nearest(level):
    """A factor of 2 is 6.0 dB; on the Nyquist chart it is at -1/2, and one of a half at -2."""
    gains = ft.PIGains(K_P=np.diag([0.4, 0.4]), K_I=np.diag([2.0, 2.0]))
    cut = margins.Margins(
        loop="phi", gain_decrease=0.5, gain_increase=2.0, phase_margin=math.inf, delay_margin=1.0
    )
    none = margins.Margins(
        loop="n_z", gain_decrease=0.0, gain_increase=math.inf, phase_margin=math.inf,
        delay_margin=math.inf,
    )  # fmt: skip

    magnitude, _, nyquist, _ = loop_charts(level, gains, [cut, none])

    words = [name for name, *_ in magnitude.legend if name.startswith("gain margin")]
    assert words == ["gain margin +6.0 dB", "gain margin -6.0 dB"]
    marks = [(float(x[0]), float(y[0])) for x, y in magnitude._seen if len(x) == 1 and x[0] > 0.0]
    for (omega, decibel), at in zip(marks, (-0.5, -2.0), strict=True):
        s = 1j * np.array([omega / 1.2, omega, 1.2 * omega])
        L = G / V * (0.4 * s + 2.0) / s**2
        assert np.argmin(np.abs(L - at)) == 1
        assert decibel == pytest.approx(20.0 * math.log10(abs(L[1])))
    assert [(float(x[0]), float(y[0])) for x, y in nyquist._seen if len(x) == 1][-2:] == [
        (-0.5, 0.0), (-2.0, 0.0)
    ]  # fmt: skip
