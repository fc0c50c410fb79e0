"""Air data and gusts of compiled steps, against definitions."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flighttune.vehicles.compiled import air_data, atmosphere, turbulence
from flighttune.vehicles.compiled.properties import Properties
from flighttune.vehicles.compiled.trace import Graph
from flighttune.vehicles.plants.weather import Gust

FT = 0.3048
DT = 1.0 / 120.0
ROUNDING = 1e-9


def state(values, dt=DT):
    """Properties before a step."""
    now = Properties(Graph(), dt)
    for name, value in values.items():
        now[name] = value
    return now


@pytest.mark.parametrize("mach", [0.4, 0.7, 0.999, 1.0, 1.05, 1.5, 2.5])
def test_the_pressure_of_air_at_rest_is_isentropic_behind_a_normal_shock_above_mach_1(mach):
    if mach < 1.0:
        ratio = (1.0 + 0.2 * mach**2) ** 3.5
    else:  # isentropic behind a normal shock
        rise = (2.8 * mach**2 - 0.4) / 2.4
        behind_2 = (0.4 * mach**2 + 2.0) / (2.8 * mach**2 - 0.4)
        ratio = rise * (1.0 + 0.2 * behind_2) ** 3.5

    assert atmosphere.stagnation_pressure(mach, 2000.0) == pytest.approx(
        2000.0 * ratio, rel=ROUNDING
    )


@pytest.mark.parametrize(
    ("velocity", "beta"), [((5e-4, 0.0, 5e-4), 0.0), ((1e-4, 30.0, 5e-4), math.pi / 2.0)]
)
def test_air_that_hardly_moves_has_no_angle_of_attack_and_no_rates(velocity, beta):
    now = state({
        **dict(zip(air_data.VELOCITY, velocity, strict=True)),
        **dict(zip(air_data.VELOCITY_RATE, (1.0, 1.0, 2.0), strict=True)),
        **dict.fromkeys((*air_data.ANGULAR_RATES, *air_data.TOTAL_WIND), 0.0),
        "metrics/cbarw-ft": 2.0, "atmosphere/rho-slugs_ft3": 0.0024, "atmosphere/a-fps": 1116.0,
    })  # fmt: skip
    now.local_to_body, now.viscosity = np.eye(3).tolist(), 1.6e-4
    now.turbulent_rates = [0.0] * 3

    air_data._flow(now)

    names = "alpha-rad", "alphadot-rad_sec", "betadot-rad_sec"
    assert [now[f"aero/{name}"] for name in names] == [0.0] * 3
    assert now["aero/beta-rad"] == pytest.approx(beta, abs=1e-4)


@pytest.mark.parametrize(("axis", "body"), [("ahead", 0), ("right", 1), ("down", 2)])
def test_a_gust_is_a_cosine_up_and_down_along_the_axis_where_it_began(axis, body):
    """It is 3 m/s the other way: up in 5 steps from the fourth on, held for 3, then down in 5."""
    gust = Gust(axis=axis, peak=-3.0, start=4 * DT, rise=5 * DT, hold=3 * DT)
    numbers = turbulence.gust_numbers(gust, 1.0 / DT)
    zero = (turbulence.GUST_COUNT, turbulence.GUST_TIME, turbulence.GUST_BLOWS)
    now = state(
        numbers | dict.fromkeys((*zero, *turbulence.GUST_DIRECTION, *turbulence.COSINE_GUST), 0.0)
    )
    first, turn = (
        Rotation.from_euler("ZYX", [1.1, -0.2, 0.3]),
        Rotation.from_rotvec([0.05, 0, 0.02]),
    )
    attitude, met = first, []
    for _ in range(25):
        now.local_to_body = attitude.as_matrix().T.tolist()
        turbulence._cosine_gust(now)
        met.append(now.vector(turbulence.COSINE_GUST))
        attitude = attitude * turn  # the aircraft turns meanwhile

    t = (np.arange(25) - 3) * DT  # the time since its beginning, at the fourth step
    up, down = 0.5 * (1.0 - np.cos(np.pi * t / (5 * DT))), 13 * DT - t
    size = np.select(
        [t < 0.0, t <= 5 * DT, t <= 8 * DT, t <= 12.5 * DT],
        [0.0, up, 1.0, 0.5 * (1.0 - np.cos(np.pi * down / (5 * DT)))],
        0.0,
    )
    began = first * turn**3
    along = began.as_matrix()[:, body] * -3.0 / FT
    last = 15  # its last step ends where it is over
    assert np.array(met)[:last] == pytest.approx(np.outer(size, along)[:last], abs=1e-6)
    assert not np.array(met)[17:].any()
