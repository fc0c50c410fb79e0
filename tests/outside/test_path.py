"""Signals of a swinging flight against each other by what they mean: kinematics that close."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import flighttune as ft

G_0 = 9.80665
SPEED = {"aerosonde": 25.0, "c172p": 50.0, "a4": 200.0}
DURATION = 20.0
SECONDS_LEFT_OUT = 0.5
"""At each end, where a spline does not know how the signal goes on."""

PATH = 1e-3
"""Metres over half a kilometre to four."""

SAME_SPEED = 1e-8
LOAD = 1e-4
"""In weights, from samples at 200 Hz."""

TURNING, ATTITUDE = 5.0, math.radians(0.1)
"""Angle after so many s of rolling: JSBSim turns by Euler's rule, of first order in the step."""


@dataclass
class Swing:
    """A flight that rolls to +-34 deg and pulls +-0.25 about level flight, each at its own pace."""

    t: np.ndarray
    signals: dict

    def __getitem__(self, name):
        return self.signals[name]

    @property
    def body(self):
        """Rotations from body to north, east, down."""
        return Rotation.from_euler(
            "ZYX", np.column_stack([self["psi"], self["theta"], self["phi"]])
        )

    @property
    def velocity(self):
        """North, east and down by airspeed, course and path angle, m/s, (n, 3)."""
        V_a, chi, gamma = (self[name] for name in ("V_a", "chi", "gamma"))
        level = V_a * np.cos(gamma)
        return np.column_stack([level * np.cos(chi), level * np.sin(chi), -V_a * np.sin(gamma)])


@cache
def swing(aircraft, steps=1, duration=DURATION):
    plant = ft.loop.JSBSimPlant(aircraft, steps=steps)
    plant.start(ft.loop.FlightCondition(V_a=SPEED[aircraft], h=1000.0))
    dt = 0.005 / steps
    t = np.arange(round(duration / dt) + 1) * dt
    rows = [plant.observe()]
    for now in t[:-1].tolist():
        phi = math.radians(34.0) * math.sin(0.9 * now)
        n_z = 1.0 / math.cos(phi) + 0.25 * math.sin(1.7 * now)
        assert plant.advance(phi, n_z, dt) is None
        rows.append(plant.observe())
    return Swing(t, dict(zip(plant.signals, np.array(rows).T, strict=True)))


@pytest.mark.soak
@pytest.mark.parametrize("aircraft", SPEED)
def test_position_is_the_integral_of_airspeed_course_and_path_angle(aircraft):
    flight = swing(aircraft)

    for i, name in enumerate(("north", "east", "down")):
        travelled = cumulative_simpson(flight.velocity[:, i], x=flight.t, initial=0.0)

        assert flight[name] - flight[name][0] == pytest.approx(travelled, abs=PATH), name


@pytest.mark.slow
@pytest.mark.parametrize("aircraft", SPEED)
def test_velocity_by_incidence_and_attitude_is_that_of_the_path(aircraft):
    flight = swing(aircraft)
    alpha, beta, V_a = (flight[name] for name in ("alpha", "beta", "V_a"))
    ahead = np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)

    velocity = flight.body.apply(V_a[:, None] * np.column_stack(ahead))

    assert velocity == pytest.approx(flight.velocity, abs=SAME_SPEED)


@pytest.mark.slow
@pytest.mark.parametrize("aircraft", SPEED)
def test_load_factors_are_the_curvature_of_the_path_and_gravity(aircraft):
    flight = swing(aircraft)
    inside = (flight.t > SECONDS_LEFT_OUT) & (flight.t < DURATION - SECONDS_LEFT_OUT)
    acceleration = CubicSpline(flight.t, flight.velocity)(flight.t, 1)
    specific = flight.body.inv().apply(acceleration - [0.0, 0.0, G_0]) / G_0
    alpha = flight["alpha"]

    n_z = specific[:, 0] * np.sin(alpha) - specific[:, 2] * np.cos(alpha)

    assert flight["n_z"][inside] == pytest.approx(n_z[inside], abs=LOAD)
    assert flight["n_y"][inside] == pytest.approx(specific[inside, 1], abs=LOAD)
    assert np.ptp(flight["n_z"][inside]) > 0.4


def turned_away(flight):
    """Largest angle between the attitude and the integral of the body rates, rad."""
    rates = np.column_stack([flight[name] for name in "pqr"])
    dt = flight.t[1]
    turned = flight.body[0]
    largest = 0.0
    for before, after, attitude in zip(rates, rates[1:], flight.body[1:], strict=False):
        turned = turned * Rotation.from_rotvec(0.5 * dt * (before + after))
        largest = max(largest, (turned.inv() * attitude).magnitude())
    return largest


@pytest.mark.soak
def test_attitude_is_the_integral_of_the_rates_to_first_order_in_the_step():
    coarse, fine = (turned_away(swing("aerosonde", steps, TURNING)) for steps in (1, 4))

    assert coarse < ATTITUDE
    assert fine == pytest.approx(coarse / 4.0, rel=0.1)
