"""What is known of the motion of an aircraft, against motions in closed form."""

import math

import pytest

from flighttune.flight.loop.measured import Moving

DT = 0.02
WIND = (3.0, -2.0, 0.0)
CHI = math.radians(30.0)


def test_the_acceleration_along_the_path_through_the_air_is_that_of_its_airspeed():
    # 20 m/s and 1.5 m/s^2 along a course through the air in a wind
    moving = Moving(DT)
    ahead = math.cos(CHI), math.sin(CHI), 0.0

    def place(t):
        return tuple(
            (20.0 * t + 0.75 * t * t) * a + w * t for a, w in zip(ahead, WIND, strict=True)
        )

    for k in range(1, 5):
        t = k * DT
        V_a = 20.0 + 1.5 * t
        over = [V_a * a + w for a, w in zip(ahead, WIND, strict=True)]
        angles = math.atan2(over[1], over[0]), 0.0, V_a
        V_g, velocity, acceleration = moving(angles, place(t), WIND)

    # differences of positions are the velocity in the middle of a sample
    middle = 20.0 + 1.5 * (t - 0.5 * DT)
    over = [middle * a + w for a, w in zip(ahead, WIND, strict=True)]
    assert V_g == pytest.approx(math.hypot(over[0], over[1]), rel=1e-12)
    assert velocity == pytest.approx(over, rel=1e-3, abs=1e-12)
    assert acceleration == pytest.approx(1.5, rel=1e-3)
