"""Air, gusts and air data of compiled steps, against published numbers and definitions."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flighttune.vehicles.compiled import air_data, atmosphere, turbulence, vectors
from flighttune.vehicles.compiled.properties import Properties
from flighttune.vehicles.compiled.trace import Graph
from flighttune.vehicles.plants.weather import Gust

FT, SLUG, LBF = 0.3048, 14.593902937, 4.4482216152605
PASCAL_OF_PSF = LBF / FT**2
DT = 1.0 / 120.0
FIVE_DIGITS = 2e-5
"""Of JSBSim's constants, beside those of the published table."""
ROUNDING = 1e-9


def state(values, dt=DT):
    """Properties before a step."""
    now = Properties(Graph(), dt)
    for name, value in values.items():
        now[name] = value
    return now


def air_at(h_m, bias=0.0, sea_level=2116.228):
    """The atmosphere at a geometric height."""
    rho = sea_level / (atmosphere.R_DRY * (518.67 + bias))
    values = {
        "position/h-sl-ft": h_m / FT,
        "atmosphere/delta-T": bias,
        "atmosphere/P-sl-psf": sea_level,
    }
    now = state(
        values | {"atmosphere/rho-sl-slugs_ft3": rho} | atmosphere.pressures(sea_level, bias)
    )
    atmosphere.atmosphere(now)
    return now


# U.S. Standard Atmosphere 1976, table I: geopotential height (km'), K, Pa.
STANDARD = [
    (-1.0, 294.65, 113929.0), (0.0, 288.15, 101325.0), (5.0, 255.65, 54019.9),
    (11.0, 216.65, 22632.1), (15.0, 216.65, 12044.6), (20.0, 216.65, 5474.89),
    (25.0, 221.65, 2511.02), (32.0, 228.65, 868.019), (40.0, 251.05, 277.522),
    (47.0, 270.65, 110.906), (49.0, 270.65, 86.1623), (51.0, 270.65, 66.9389),
    (60.0, 245.45, 20.3143), (71.0, 214.65, 3.95642),
]  # fmt: skip


@pytest.mark.parametrize(("km", "kelvin", "pascal"), STANDARD)
def test_the_atmosphere_is_that_of_the_standard_of_1976(km, kelvin, pascal):
    earth = 6356.766
    now = air_at(1000.0 * km * earth / (earth - km))

    # 8 significant digits of heights in feet, and R = 287.053 J/(kg K)
    close = {"rel": 1e-4 if km < 50.0 else 1e-3}
    assert now["atmosphere/T-R"] / 1.8 == pytest.approx(kelvin, rel=FIVE_DIGITS)
    assert now["atmosphere/P-psf"] * PASCAL_OF_PSF == pytest.approx(pascal, **close)
    rho = pascal / (287.05287 * kelvin)
    assert now["atmosphere/rho-slugs_ft3"] * SLUG / FT**3 == pytest.approx(rho, **close)
    assert now["atmosphere/a-fps"] * FT == pytest.approx(
        math.sqrt(1.4 * 287.05287 * kelvin), rel=1e-4
    )
    assert now["atmosphere/delta"] == pytest.approx(pascal / 101325.0, **close)
    assert now["atmosphere/sigma"] == pytest.approx(rho / 1.225, **close)
    # Sutherland's law, kinematic
    mu = 1.458e-6 * kelvin**1.5 / (kelvin + 110.4)
    assert now.viscosity * FT**2 == pytest.approx(mu / rho, rel=2e-3)


@pytest.mark.parametrize("km", [-0.5, 0.0, 4.0, 15.0, 25.0, 40.0, 48.0, 60.0, 75.0])
def test_in_the_standard_air_the_altitudes_of_pressure_and_density_are_the_height(km):
    now = air_at(1000.0 * km)

    for of in ("pressure", "density"):
        assert now[f"atmosphere/{of}-altitude"] * FT == pytest.approx(1000.0 * km, abs=0.5)


def test_air_that_is_warmer_throughout_is_thinner_and_its_density_altitude_higher():
    """18 Rankine are 10 K: at sea level the density of 1.225 * 288.15 / 298.15."""
    now = air_at(0.0, bias=18.0)

    rho = 1.225 * 288.15 / 298.15
    assert now["atmosphere/rho-slugs_ft3"] * SLUG / FT**3 == pytest.approx(rho, rel=1e-4)
    assert now["atmosphere/pressure-altitude"] == pytest.approx(0.0, abs=1e-6)
    # the height of that density: T / L ((rho / 1.225)^(1 / (g / (R L) - 1)) - 1)
    power = 1.0 / (9.80665 / (287.05287 * 0.0065) - 1.0)
    height = 288.15 / 0.0065 * (1.0 - (rho / 1.225) ** power)
    assert now["atmosphere/density-altitude"] * FT == pytest.approx(height, rel=1e-3)
    # the pressure falls more slowly: at 2 km by the hypsometric formula of that temperature
    high = air_at(2000.0, bias=18.0)
    h = 2000.0 * 6356766.0 / (6356766.0 + 2000.0)
    assert high["atmosphere/P-psf"] / 2116.228 == pytest.approx(
        (1.0 - 0.0065 * h / 298.15) ** (9.80665 / (287.05287 * 0.0065)), rel=1e-5
    )


@pytest.mark.parametrize("km", [5.0, 18.0, 28.0, 40.0, 49.0, 60.0])
def test_the_pressure_of_warmer_air_is_that_of_the_hydrostatic_equation(km):
    """By the trapezoidal rule over the heights between the layers of the standard."""
    heights = np.linspace(0.0, 1000.0 * km, 4001)
    knots, kelvin = np.array([(h, T) for h, T, _ in STANDARD[1:]]).T
    layers = np.interp(heights, 1000.0 * knots, kelvin) + 10.0
    fall = np.trapezoid(9.80665 / (287.05287 * layers), heights)
    earth = 6356766.0

    now = air_at(1000.0 * km * earth / (earth - 1000.0 * km), bias=18.0)

    assert now["atmosphere/P-psf"] / 2116.228 == pytest.approx(math.exp(-fall), rel=1e-3)


@pytest.mark.parametrize("mach", [0.4, 0.7, 0.999, 1.0, 1.05, 1.5, 2.5])
def test_the_pressure_of_air_at_rest_is_isentropic_and_that_of_rayleigh_above_mach_1(mach):
    if mach < 1.0:
        ratio = (1.0 + 0.2 * mach**2) ** 3.5
    else:  # NACA report 1135, eq. (100)
        ratio = (6.0 * mach**2 / 5.0) ** 3.5 * (6.0 / (7.0 * mach**2 - 1.0)) ** 2.5

    assert atmosphere.stagnation_pressure(mach, 2000.0) == pytest.approx(
        2000.0 * ratio, rel=ROUNDING
    )


def flying(velocity, rates=(0.0, 0.0, 0.0), wind=(0.0, 0.0, 0.0), accelerated=(0.0, 0.0, 0.0)):
    """Air data of a body at an attitude, in wind, at sea level (ft, s)."""
    phi, theta, psi = 0.3, -0.2, 1.1
    to_local = Rotation.from_euler("ZYX", [psi, theta, phi]).as_matrix()
    now = state({
        "attitude/phi-rad": phi, "attitude/theta-rad": theta,
        **dict(zip(air_data.ANGULAR_RATES, map(float, rates), strict=True)),
        **dict(zip(air_data.VELOCITY, map(float, velocity), strict=True)),
        **dict(zip(air_data.VELOCITY_RATE, map(float, accelerated), strict=True)),
        **dict(zip(air_data.TOTAL_WIND, wind, strict=True)),
        **dict(zip(air_data.LOCAL_VELOCITY, (to_local @ velocity).tolist(), strict=True)),
        "metrics/cbarw-ft": 2.0, "atmosphere/rho-slugs_ft3": 0.0023769, "atmosphere/a-fps": 1116.45,
        "atmosphere/P-psf": 2116.228, "atmosphere/T-R": 518.67,
    })  # fmt: skip
    now.local_to_body, now.body_to_local = to_local.T.tolist(), to_local.tolist()
    now.turbulent_rates, now.viscosity, now.sin_theta = (
        (0.01, -0.02, 0.03),
        1.57e-4,
        math.sin(theta),
    )
    for part in (air_data._attitude_rates, air_data._flow, air_data._path):
        part(now)
    return now, to_local


def test_flow_angles_and_their_rates_are_those_of_the_velocity_through_the_air():
    velocity, change, wind = (
        np.array([150.0, 12.0, 20.0]),
        np.array([3.0, -2.0, 5.0]),
        (10.0, -6.0, 4.0),
    )
    now, to_local = flying(velocity, wind=wind, accelerated=change)

    def angles(t):
        u, v, w = velocity + t * change - to_local.T @ wind
        V = math.sqrt(u * u + v * v + w * w)
        return np.array([math.atan2(w, u), math.asin(v / V), V])

    alpha, beta, V = angles(0.0)
    found = [now[f"aero/{x}-rad"] for x in ("alpha", "beta", "mag-beta")]
    assert found == pytest.approx([alpha, beta, abs(beta)])
    assert now["aero/mag-beta-deg"] == pytest.approx(math.degrees(abs(beta)))
    assert [now[f"aero/{x}-deg"] for x in ("alpha", "beta")] == pytest.approx(
        np.degrees([alpha, beta])
    )
    assert now["velocities/vt-fps"] == pytest.approx(V)
    slope = (angles(1e-5) - angles(-1e-5)) / 2e-5
    found = [now[f"aero/{x}dot-rad_sec"] for x in ("alpha", "beta")]
    assert found == pytest.approx(slope[:2], rel=1e-6)
    u, v, w = through = velocity - to_local.T @ wind
    half = 0.5 * 0.0023769
    found = [now[f"aero/qbar{x}-psf"] for x in ("", "UW", "UV")]
    assert found == pytest.approx([half * V * V, half * (u * u + w * w), half * (u * u + v * v)])
    assert now["velocities/mach"] == pytest.approx(V / 1116.45)
    assert now["aero/Re"] == pytest.approx(V * 2.0 / 1.57e-4)
    # the wind axes: the first along the flow
    assert np.array(now.wind_to_body) @ [V, 0.0, 0.0] == pytest.approx(through)
    assert np.array(now.wind_to_body) @ np.array(now.body_to_wind) == pytest.approx(np.eye(3))


@pytest.mark.parametrize(
    ("velocity", "beta"), [((5e-4, 0.0, 5e-4), 0.0), ((1e-4, 30.0, 5e-4), math.pi / 2.0)]
)
def test_at_rest_or_straight_aside_there_is_no_angle_of_attack(velocity, beta):
    now, _ = flying(velocity, accelerated=(1.0, 1.0, 2.0))

    assert now["aero/alpha-rad"] == 0.0
    assert now["aero/alphadot-rad_sec"] == 0.0
    assert now["aero/betadot-rad_sec"] == 0.0
    assert now["aero/beta-rad"] == pytest.approx(beta, abs=1e-4)


def test_rates_of_attitude_are_those_of_the_rotation():
    rates = np.array([0.4, -0.3, 0.5])
    now, to_local = flying((150.0, 0.0, 0.0), rates)

    def attitude(t):
        return (Rotation.from_matrix(to_local) * Rotation.from_rotvec(rates * t)).as_euler("ZYX")

    change = (attitude(1e-6) - attitude(-1e-6)) / 2e-6
    names = "psidot", "thetadot", "phidot"
    assert [now[f"velocities/{x}-rad_sec"] for x in names] == pytest.approx(change, abs=1e-8)
    assert now.vector(air_data.AIR_RATES) == pytest.approx(rates - [0.01, -0.02, 0.03])


@pytest.mark.parametrize("velocity", [(150.0, 12.0, 20.0), (-150.0, 60.0, -20.0)])
def test_the_path_over_ground_has_a_course_from_0_to_2_pi(velocity):
    now, to_local = flying(velocity)

    north, east, down = to_local @ velocity
    assert now["velocities/vg-fps"] == pytest.approx(math.hypot(north, east))
    assert now["flight-path/psi-gt-rad"] == pytest.approx(math.atan2(east, north) % math.tau)
    assert now["flight-path/gamma-rad"] == pytest.approx(
        -math.asin(down / np.linalg.norm(velocity))
    )


def test_at_sea_level_calibrated_and_equivalent_airspeeds_are_the_true_one():
    now, _ = flying((500.0, 0.0, 0.0))
    air_data._pressures(now)

    # five digits of the density, and of the speed of sound
    for name in ("vc", "ve"):
        assert now[f"velocities/{name}-fps"] == pytest.approx(500.0, rel=1e-4)
        knots = now[f"velocities/{name}-fps"] * FT * 3600.0 / 1852.0
        assert now[f"velocities/{name}-kts"] == pytest.approx(knots)
    mach = 500.0 / 1116.45
    assert now["propulsion/tat-r"] == pytest.approx(518.67 * (1.0 + 0.2 * mach**2))
    assert now["propulsion/pt-lbs_sqft"] == pytest.approx(2116.228 * (1.0 + 0.2 * mach**2) ** 3.5)


def test_load_factors_at_the_pilot_are_those_of_the_turning_body():
    """Two feet ahead of the centre of gravity, half a foot to the right and one above it."""
    g, rates, turning = 9.80665 / FT, np.array([0.5, -0.2, 0.3]), np.array([1.0, 2.0, -0.5])
    body = np.array([3.0, -2.0, -40.0])
    now = state({
        **dict(zip(air_data.BODY_ACCELERATION, body.tolist(), strict=True)),
        **dict(zip(air_data.ANGULAR_ACCELERATION, turning.tolist(), strict=True)),
        **dict(zip(air_data.INERTIAL_RATES, rates.tolist(), strict=True)),
        "metrics/eyepoint-x-in": 76.0, "metrics/eyepoint-y-in": 8.0, "metrics/eyepoint-z-in": 15.0,
        "_lift": 3000.0, "inertia/mass-slugs": 50.0,
        "position/h-agl-ft": 60.0, "metrics/bw-ft": 30.0,
    }, 0.01)  # fmt: skip
    now.cg, now.reference_point = [100.0, 2.0, 3.0], [1.0, 2.0, 3.0]
    now.body_to_local = np.eye(3).tolist()

    air_data._load_factors(now)

    assert [now[f"accelerations/N{x}"] for x in "xyz"] == pytest.approx(body / g * [1, 1, -1])
    arm = np.array([2.0, 0.5, -1.0])
    pilot = body + np.cross(turning, arm) + np.cross(rates, np.cross(rates, arm))
    assert [now[f"accelerations/a-pilot-{x}-ft_sec2"] for x in "xyz"] == pytest.approx(pilot)
    assert [now[f"accelerations/n-pilot-{x}-norm"] for x in "xyz"] == pytest.approx(pilot / g)
    assert now["forces/load-factor"] == pytest.approx(3000.0 / (50.0 * 32.174049))
    assert now["aero/h_b-cg-ft"] == 2.0
    assert now["aero/h_b-mac-ft"] == pytest.approx(57.0 / 30.0)


def test_vectors_and_rotations_are_those_of_numpy_and_scipy():
    rng = np.random.default_rng(3)
    a, b, m, n = (
        rng.normal(size=3),
        rng.normal(size=3),
        rng.normal(size=(3, 3)),
        rng.normal(size=(3, 3)),
    )

    assert vectors.inverse(m.tolist()) == pytest.approx(np.linalg.inv(m), rel=ROUNDING)
    assert vectors.product(m.tolist(), n.tolist()) == pytest.approx(m @ n)
    assert vectors.times(m.tolist(), a.tolist()) == pytest.approx(m @ a)
    assert vectors.cross(a.tolist(), b.tolist()) == pytest.approx(np.cross(a, b))
    assert vectors.magnitude(a.tolist()) == pytest.approx(np.linalg.norm(a))
    assert vectors.over(a.tolist(), 4.0) == pytest.approx(a / 4.0)
    angles = 0.4, -0.3, 2.0
    attitude = Rotation.from_euler("ZYX", angles[::-1])
    q = vectors.quaternion_by(*angles)
    assert q == pytest.approx(attitude.as_quat(scalar_first=True), rel=ROUNDING)
    turned = Rotation.from_rotvec(b)
    both = vectors.quaternion_product(q, turned.as_quat(scalar_first=True).tolist())
    assert both == pytest.approx((attitude * turned).as_quat(scalar_first=True), rel=ROUNDING)
    assert vectors.normalized([2.0 * x for x in q]) == pytest.approx(q, rel=ROUNDING)
    near = [x * (1.0 + 5e-11) for x in q]
    assert vectors.normalized(near) == near  # as JSBSim leaves it


@pytest.mark.parametrize(("axis", "body"), [("ahead", 0), ("right", 1), ("down", 2)])
def test_a_gust_is_a_cosine_up_and_down_along_the_axis_where_it_began(axis, body):
    """Of 3 m/s the other way, from the fourth step on, up in 5 steps, held for 3, then down."""
    gust = Gust(axis=axis, peak=-3.0, start=4 * DT, rise=5 * DT, hold=3 * DT)
    numbers = turbulence.gust_numbers(gust, 1.0 / DT)
    zero = (turbulence.GUST_COUNT, turbulence.GUST_TIME, turbulence.GUST_BLOWS)
    now = state(
        numbers | dict.fromkeys((*zero, *turbulence.GUST_DIRECTION, *turbulence.COSINE_GUST), 0.0)
    )
    attitude = Rotation.from_euler("ZYX", [1.1, -0.2, 0.3])
    met = []
    for _ in range(25):
        now.local_to_body = attitude.as_matrix().T.tolist()
        turbulence._cosine_gust(now)
        met.append(now.vector(turbulence.COSINE_GUST))
        attitude = attitude * Rotation.from_rotvec(
            [0.05, 0.0, 0.02]
        )  # the aircraft turns meanwhile

    t = (np.arange(25) - 3) * DT  # the time since its beginning, at the fourth step
    up, down = 0.5 * (1.0 - np.cos(np.pi * t / (5 * DT))), 13 * DT - t
    size = np.select(
        [t < 0.0, t <= 5 * DT, t <= 8 * DT, t <= 12.5 * DT],
        [0.0, up, 1.0, 0.5 * (1.0 - np.cos(np.pi * down / (5 * DT)))],
        0.0,
    )
    began = (
        Rotation.from_euler("ZYX", [1.1, -0.2, 0.3]) * Rotation.from_rotvec([0.05, 0.0, 0.02]) ** 3
    )
    along = began.as_matrix()[:, body] * -3.0 / FT
    last = 15  # its last step ends where it is over
    assert np.array(met)[:last] == pytest.approx(np.outer(size, along)[:last], abs=1e-6)
    assert not np.array(met)[17:].any()
