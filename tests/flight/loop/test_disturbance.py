"""Disturbances of the rates of course and path angle, and the winds that cause them."""

import math

import numpy as np
import pytest

from flighttune.flight.loop.disturbance import Sinusoid

TABLE = {
    "chi_amplitude": 0.3, "chi_omega_rad_s": 2.0, "chi_phase_deg": 30.0,
    "gamma_amplitude": -0.2, "gamma_omega_rad_s": 5.0, "gamma_phase_deg": -90.0,
}  # fmt: skip
TIMES = np.linspace(0.0, 7.0, 1401)


@pytest.mark.parametrize("t", [0.0, 0.4, 3.1])
def test_a_table_is_a_sine_of_the_course_and_a_cosine_of_the_path_angle(t):
    smooth = Sinusoid.of_table(TABLE)
    square = Sinusoid.of_table(TABLE | {"wave": "square"})

    chi, gamma = math.sin(2.0 * t + math.pi / 6.0), math.cos(5.0 * t - math.pi / 2.0)
    assert smooth(t) == pytest.approx((0.3 * chi, -0.2 * gamma))
    assert square(t) == (0.3 * math.copysign(1.0, chi), -0.2 * math.copysign(1.0, gamma))
    assert Sinusoid.of_table({})(t) == (0.0, 0.0)


def test_a_channel_with_switches_changes_its_sign_at_each():
    """A switch belongs to its sample, whose time may be a little less in floats."""
    of = Sinusoid.of_table(TABLE | {"chi_switch_s": [1.0, 1.5], "gamma_switch_s": [0.3]})

    found = [of(t) for t in (0.0, 0.29, 3 * 0.1 - 1e-12, 0.999, 1.0, 1.49, 1.5, 9.0)]

    assert [chi for chi, _ in found] == [0.3] * 4 + [-0.3] * 2 + [0.3] * 2
    assert [gamma for _, gamma in found] == [-0.2] * 2 + [0.2] * 6


@pytest.mark.parametrize(
    ("changes", "batched"),
    [
        ({}, True), ({"square": True}, False), ({"chi_phase": 0.1}, False),
        ({"gamma_phase": 0.1}, False), ({"chi_switches": ()}, False),
        ({"gamma_switches": (1.0,)}, False),
    ],
)  # fmt: skip
def test_the_kernel_flies_plain_sinusoids_alone(changes, batched):
    assert Sinusoid(chi_amplitude=0.1, chi_omega=1.0, **changes).batched is batched


@pytest.mark.parametrize(
    "numbers",
    [
        {"chi_amplitude": 0.3, "chi_omega": 2.0},
        {"gamma_amplitude": 0.2, "gamma_omega": 3.0},
        # Derivatives a quarter period apart are never large together.
        {"chi_amplitude": 0.3, "chi_omega": 2.0, "gamma_amplitude": 0.2, "gamma_omega": 2.0},
        {"chi_amplitude": 0.1, "chi_omega": 2.0, "gamma_amplitude": -0.4, "gamma_omega": -2.0},
        {"chi_amplitude": 0.3, "chi_omega": 7.0, "gamma_amplitude": 0.2, "gamma_omega": 4.1},
        {
            "chi_amplitude": 0.3, "chi_omega": 2.0, "chi_phase": math.pi / 2,
            "gamma_amplitude": 0.2, "gamma_omega": 2.0,
        },
    ],
)  # fmt: skip
def test_the_bound_on_its_rate_is_the_largest_that_is_reached(numbers):
    of = Sinusoid(**numbers)
    times = np.linspace(0.0, 40.0, 20_001)
    values = np.array([of(t) for t in times])

    largest = np.linalg.norm(np.diff(values, axis=0), axis=1).max() / (times[1] - times[0])

    # Two frequencies come to their largest rates together only in the long run.
    assert largest == pytest.approx(of.rate_bound, rel=2e-3)


@pytest.mark.parametrize(
    ("numbers", "bound"),
    [
        ({"square": True}, math.inf),
        ({"square": True, "chi_omega": 0.0}, 0.0),
        ({"chi_switches": (1.0,)}, math.inf),
        ({"gamma_switches": (1.0,)}, 0.6),  # its amplitude is zero
        ({"chi_switches": ()}, 0.6),
    ],
)
def test_a_disturbance_that_switches_has_no_bound_on_its_rate(numbers, bound):
    of = Sinusoid(**{"chi_amplitude": 0.3, "chi_omega": 2.0} | numbers)

    assert of.rate_bound == pytest.approx(bound)


@pytest.mark.parametrize(("chi", "gamma"), [(0.0, 0.0), (2.0, 0.3), (-1.0, -0.5)])
def test_a_wind_of_a_disturbance_turns_the_path_through_the_air_at_its_rates(chi, gamma):
    """A change of wind turns the velocity through the air, whose change is the opposite."""
    of, V_a = Sinusoid(chi_amplitude=0.1, chi_omega=0.5, gamma_amplitude=0.2, gamma_omega=0.7), 25.0
    wind, dt = of.as_wind(V_a, chi, gamma), 1e-5
    right = np.array([-math.sin(chi), math.cos(chi), 0.0])
    up = np.array(
        [-math.cos(chi) * math.sin(gamma), -math.sin(chi) * math.sin(gamma), -math.cos(gamma)]
    )

    for t in (0.0, 1.3, 4.0):
        change = -(np.array(wind.at(t + dt)) - np.array(wind.at(t - dt))) / (2.0 * dt)
        turned = change @ right / (V_a * math.cos(gamma)), change @ up / V_a
        assert turned == pytest.approx(of(t), abs=1e-9)
    calm = Sinusoid(chi_amplitude=0.0, chi_omega=0.0).as_wind(V_a, chi, gamma)
    assert np.abs(calm.at(1.0)).max() == 0.0
