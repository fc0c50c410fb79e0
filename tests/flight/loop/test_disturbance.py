"""Disturbances of the rates of course and path angle, and the winds that cause them."""

import math

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft

TABLE = {
    "chi_amplitude": 0.3, "chi_omega_rad_s": 2.0, "chi_phase_deg": 30.0,
    "gamma_amplitude": -0.2, "gamma_omega_rad_s": 5.0, "gamma_phase_deg": -90.0,
}  # fmt: skip


def disturbed(**table):
    """The disturbance of a scenario, rad/s over time."""
    return made_up_scenario(disturbance=table).disturbance.sinusoid()


@pytest.mark.parametrize("t", [0.0, 0.4, 3.1])
def test_a_table_is_a_sine_of_the_course_and_a_cosine_of_the_path_angle(t):
    smooth, square = disturbed(**TABLE), disturbed(**TABLE, wave="square")

    chi, gamma = math.sin(2.0 * t + math.pi / 6.0), math.cos(5.0 * t - math.pi / 2.0)
    assert smooth(t) == pytest.approx((0.3 * chi, -0.2 * gamma))
    assert square(t) == (0.3 * math.copysign(1.0, chi), -0.2 * math.copysign(1.0, gamma))
    assert disturbed()(t) == (0.0, 0.0)


def test_a_channel_with_switches_changes_its_sign_at_each():
    """A switch belongs to its sample, whose time may be a little less in floats."""
    switches = {"chi_switch_s": [1.0, 1.5], "gamma_switch_s": [0.3]}
    of = disturbed(chi_amplitude=0.3, gamma_amplitude=-0.2, **switches)

    found = [of(t) for t in (0.0, 0.29, 3 * 0.1 - 1e-12, 0.999, 1.0, 1.49, 1.5, 9.0)]

    assert [chi for chi, _ in found] == [0.3] * 4 + [-0.3] * 2 + [0.3] * 2
    assert [gamma for _, gamma in found] == [-0.2] * 2 + [0.2] * 6


PLAIN = {"chi_amplitude": 0.1, "chi_omega_rad_s": 1.0}


@pytest.mark.parametrize(
    ("changes", "batched"),
    [
        ({}, True), ({"wave": "square"}, False), ({"chi_phase_deg": 6.0}, False),
        ({"gamma_phase_deg": 6.0}, False), ({"gamma_switch_s": [1.0]}, False),
    ],
)  # fmt: skip
def test_the_kernel_flies_plain_sinusoids_alone(changes, batched):
    assert disturbed(**PLAIN | changes).batched is batched


# Amplitudes, angular frequencies and a phase of the course: those of the path angle follow.
SWINGS = [
    (0.3, 2.0, 0.0, 0.0, 0.0),
    (0.0, 0.0, 0.2, 3.0, 0.0),
    # Derivatives a quarter period apart are never large together.
    (0.3, 2.0, 0.2, 2.0, 0.0),
    (0.1, 2.0, -0.4, 2.0, 0.0),
    (0.3, 7.0, 0.2, 4.1, 0.0),
    (0.3, 2.0, 0.2, 2.0, 90.0),
]
KEYS = "chi_amplitude", "chi_omega_rad_s", "gamma_amplitude", "gamma_omega_rad_s", "chi_phase_deg"


@pytest.mark.parametrize("swing", SWINGS)
def test_the_bound_on_its_rate_is_the_largest_that_is_reached(swing):
    of = disturbed(**dict(zip(KEYS, swing, strict=True)))
    times = np.linspace(0.0, 20.0, 4001)
    values = np.array([of(t) for t in times])

    largest = np.linalg.norm(np.diff(values, axis=0), axis=1).max() / (times[1] - times[0])

    # Two frequencies come to their largest rates together only in the long run.
    assert largest == pytest.approx(of.rate_bound, rel=2e-3)


@pytest.mark.parametrize(
    ("numbers", "bound"),
    [
        ({"wave": "square"}, math.inf),
        ({"wave": "square", "chi_omega_rad_s": 0.0}, 0.0),
        ({"chi_omega_rad_s": 0.0, "chi_switch_s": [1.0]}, math.inf),
        ({"gamma_switch_s": [1.0]}, 0.6),  # its amplitude is zero
    ],
)
def test_a_disturbance_that_switches_has_no_bound_on_its_rate(numbers, bound):
    of = disturbed(**{"chi_amplitude": 0.3, "chi_omega_rad_s": 2.0} | numbers)

    assert of.rate_bound == pytest.approx(bound)


@pytest.mark.parametrize(("chi", "gamma"), [(30.0, 5.0), (-60.0, -4.0)])
def test_the_air_of_an_aircraft_swings_across_its_course_and_normal_to_its_path(chi, gamma):
    """A change of wind turns the velocity through the air, whose change is the opposite."""
    swing = {"chi_amplitude": 0.02, "chi_omega_rad_s": 1.5, "as_wind": True}
    swing |= {"gamma_amplitude": 0.01, "gamma_omega_rad_s": 1.1}
    made = made_up_scenario(
        plant=[{"kind": "jsbsim", "aircraft": "aerosonde"}],
        flight={"duration_s": 0.5, "chi_deg": chi, "gamma_deg": gamma, "V_a_mps": 25.0},
        reference={"chi_deg": chi, "gamma_deg": gamma},
        disturbance=swing,
        wind={"speed_mps": 2.0, "from_deg": 70.0},
    )
    (run,) = ft.fly(made).runs
    chi, gamma, t = math.radians(chi), math.radians(gamma), run.t
    right = np.array([-math.sin(chi), math.cos(chi), 0.0])
    down = np.array([math.cos(chi), math.sin(chi)]) * math.sin(gamma)
    down = np.array([*down, math.cos(gamma)])

    across = 25.0 * math.cos(gamma) * 0.02 / 1.5 * np.cos(1.5 * t)
    normal = 25.0 * 0.01 / 1.1 * np.sin(1.1 * t)
    steady = -2.0 * np.array([math.cos(math.radians(70.0)), math.sin(math.radians(70.0)), 0.0])
    expected = steady + np.outer(across, right) + np.outer(normal, down)
    seen = run.signals[["wind_north", "wind_east", "wind_down"]].to_numpy()
    assert seen == pytest.approx(expected, abs=1e-9)
