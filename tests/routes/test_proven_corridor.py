"""The corridor that design/corridor.md proves for the point mass, against what is flown."""

import math

import numpy as np
import pytest

import flighttune as ft

DEG = math.pi / 180.0
DT, V_A, T = 0.01, 25.0, 3.0
WIND = 8.0

# A chord of a table with points 1 m apart is this far off an arc of 150 m radius, m.
SAG_M = 1.0 / (8.0 * 150.0)


def circuit(**tables):
    made = ft.load_scenario("circuit").as_dict()
    for key in ("expect", "verifies", "source"):
        del made[key]
    return ft.scenario_from(made | {"plant": [{"kind": "kinematic"}]} | tables)


def half_width(L, eps, start=0.0):
    return max(abs(start), L * math.tan(eps))


def biased_point(reference, bias, *, aside=0.0, wind=0.0, seconds=120.0):
    """Cross track and height errors of a point that flies `bias` (rad) beside what is asked."""
    follow, chi, gamma = reference.follower(DT, 1000.0), *reference.initial
    north, east, h = 0.0, aside, 1000.0
    places, courses = [], []
    V_g = V_A + wind * math.cos(chi)
    for _ in range(round(seconds / DT)):
        place = north, east, 1000.0 - h
        seen = ft.loop.Measured(chi, gamma, V_A, 0.0, 1.0, h, place, None, V_g=V_g)
        asked, place = follow(seen)
        chi, gamma = asked.chi - bias[0], asked.gamma - bias[1]
        V_g = V_A + wind * math.cos(chi)
        north, east = north + V_g * DT * math.cos(chi), east + V_g * DT * math.sin(chi)
        h += V_g * DT * math.tan(gamma)
        places.append(place)
        courses.append((chi, gamma))
    between_samples = np.abs(np.diff(courses[1:], axis=0)).max(axis=0)
    return np.array(places), between_samples


SIDEWAYS = [((eps, 0.0), 120.0, wind) for eps in (-5.0 * DEG, 10.0 * DEG) for wind in (0.0, WIND)]
IN_HEIGHT = [((0.0, eps), 60.0, 0.0) for eps in (-2.0 * DEG, 2.0 * DEG)]


@pytest.mark.soak
@pytest.mark.parametrize(("bias", "seconds", "wind"), SIDEWAYS + IN_HEIGHT)
def test_an_angle_that_is_always_wrong_leads_to_the_edge_of_the_corridor(bias, seconds, wind):
    """In turns and a climb too; half of the corridor would not do."""
    flown, between_samples = biased_point(
        ft.route(circuit()).reference, bias, wind=wind, seconds=seconds
    )
    channel, L = int(np.argmax(np.abs(bias))), (V_A + wind) * T
    off, eps = np.abs(flown[:, 1 + channel]), abs(bias[channel])

    assert off.max() <= half_width(L, eps + between_samples[channel]) + SAG_M * (channel == 0)
    assert off.max() > 0.97 * half_width(L, eps)


@pytest.mark.parametrize("eps", [-5.0 * DEG, 5.0 * DEG])
def test_from_beside_the_path_a_flight_comes_back_into_the_corridor(eps):
    flown, between_samples = biased_point(
        ft.route(circuit()).reference, (eps, 0.0), aside=50.0, seconds=35
    )
    beside = flown[:, 1]
    edge = half_width(V_A * T, abs(eps) + between_samples[0]) + SAG_M

    assert np.abs(beside).max() <= 50.0
    outside = beside > edge
    assert outside[0]
    assert not outside[-1]
    assert (np.diff(beside)[outside[:-1]] < 0.0).all()
