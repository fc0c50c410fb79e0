"""References and disturbances at times whose value is plain."""

import math

import numpy as np
import pytest

import flighttune as ft
from flighttune.flight.loop.disturbance import Sinusoid
from flighttune.routes.segments import Segment


def test_segments_add_to_the_start_value():
    reference = ft.loop.Reference(
        chi=1.0,
        gamma=0.0,
        chi_segments=(Segment(1.0, (0.0,), jumps=(0.5,)), Segment(2.0, (0.0, 2.0), rates=(0.25,))),
        gamma_segments=(Segment(1.0, (0.0, 1.0, 2.0), jumps=(0.1, -0.2, 0.1)),),
    )

    chi, gamma = reference.sampled(np.array([0.0, 0.99, 1.0, 2.0, 3.0, 4.0, 9.0]))

    assert chi == pytest.approx([1.0, 1.0, 1.5, 1.5, 1.75, 2.0, 2.0])
    assert gamma == pytest.approx([0.0, 0.0, 0.1, -0.1, 0.0, 0.0, 0.0])
    assert reference.sampled(3.0) == (1.75, 0.0)
    assert reference.rates(3.0) == (0.25, 0.0)


@pytest.mark.soak
@pytest.mark.parametrize("omegas", [(0.15, 0.15), (0.3, 1.1)])
def test_the_rate_bound_is_the_least_upper_bound_of_the_derivative(omegas):
    sinusoid = Sinusoid(
        chi_amplitude=0.1, chi_omega=omegas[0], gamma_amplitude=0.2, gamma_omega=omegas[1]
    )
    t = np.linspace(0.0, 2000.0, 400_001)
    d = np.array([sinusoid(time) for time in t.tolist()])

    largest = np.linalg.norm(np.gradient(d, t, axis=0)[1:-1], axis=1).max()

    assert largest <= sinusoid.rate_bound * (1.0 + 1e-9)
    assert largest == pytest.approx(sinusoid.rate_bound, rel=1e-3)


def test_the_papers_disturbance_has_the_rate_bound_of_its_table():
    sinusoid = Sinusoid(chi_amplitude=0.1, chi_omega=0.15, gamma_amplitude=0.1, gamma_omega=0.15)

    assert sinusoid.rate_bound == pytest.approx(0.015)
    assert sinusoid(0.0) == pytest.approx((0.0, 0.1))
    assert sinusoid(math.pi / 0.3) == pytest.approx((0.1, 0.0), abs=1e-12)


def test_a_square_wave_has_the_sign_of_the_sinusoid_and_its_amplitude():
    shape = {"chi_amplitude": 0.1, "chi_omega": 2.0, "chi_phase": 0.3, "gamma_amplitude": -0.2}
    sine, square = Sinusoid(**shape), Sinusoid(**shape, square=True)

    for t in np.linspace(0.0, 6.0, 50):
        assert square(t)[0] == math.copysign(0.1, math.sin(2.0 * t + 0.3))
        assert square(t)[1] == sine(t)[1] == -0.2  # a cosine that stands at 1
    assert square.rate_bound == math.inf
    assert Sinusoid(square=True).rate_bound == 0.0


def test_a_disturbance_with_switching_times_is_constant_between_them():
    switched = Sinusoid(chi_amplitude=0.1, chi_switches=(1.0, 3.0), gamma_amplitude=-0.2)

    d = [switched(t) for t in (0.0, 0.99, 1.0, 2.99, 3.0, 9.0)]

    assert [chi for chi, _ in d] == [0.1, 0.1, -0.1, -0.1, 0.1, 0.1]
    assert {gamma for _, gamma in d} == {-0.2}
    assert switched.rate_bound == math.inf
    assert Sinusoid(chi_amplitude=0.1, chi_switches=()).rate_bound == 0.0
