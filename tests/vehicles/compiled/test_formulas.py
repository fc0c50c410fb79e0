"""Formulas of compiled steps that few aircraft use, against definitions."""

import math
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from compiled_parts import DT, engine_of, state_of
from scipy.spatial.transform import Rotation

from flighttune.vehicles.compiled import (
    air_data,
    atmosphere,
    engine_files,
    engines,
    pistons,
    propellers,
    tables,
    turbines,
    turboprops,
    turbulence,
    vectors,
)
from flighttune.vehicles.plants.weather import Gust

AT = "propulsion/engine[0]"
ROUNDING = 1e-12
JSBSIM_DIGITS = 2e-4
"""Relative error of JSBSim's own factors, of which an inch of mercury has four digits."""

INCH, POUND, HORSEPOWER = 0.0254, 0.45359237, 550.0 * 0.3048 * 0.45359237 * 9.80665
FOOT, NEWTON = 12.0 * INCH, 1.0 / (POUND * 9.80665)
INCH_OF_MERCURY, POUND_PER_INCH_2 = 3386.389, 9.80665 * POUND / INCH**2
FACTORS = [
    *(("M", "FT", 1.0 / FOOT), ("CM", "FT", 0.01 / FOOT), ("KM", "FT", 1000.0 / FOOT)),
    *(("IN", "FT", 1.0 / 12.0), ("FT", "IN", 12.0), ("M", "IN", 1.0 / INCH)),
    *(("M2", "FT2", FOOT**-2), ("IN2", "FT2", 1.0 / 144.0)),
    *(("CC", "IN3", (100.0 * INCH) ** -3), ("FT3", "IN3", 1728.0), ("LTR", "IN3", 1e-3 * INCH**-3)),
    *(("KG*M2", "SLUG*FT2", NEWTON / FOOT), ("N", "LBS", NEWTON), ("KG", "LBS", 1.0 / POUND)),
    *(("KG/SEC", "LBS/SEC", 1.0 / POUND), ("WATTS", "HP", 1.0 / HORSEPOWER)),
    *(("HP", "WATTS", HORSEPOWER), ("PSI", "INHG", POUND_PER_INCH_2 / INCH_OF_MERCURY)),
    *(("ATM", "INHG", 101325.0 / INCH_OF_MERCURY), ("PA", "INHG", 1.0 / INCH_OF_MERCURY)),
    *(("INHG", "PA", INCH_OF_MERCURY), ("INHG", "PSI", INCH_OF_MERCURY / POUND_PER_INCH_2)),
    ("KG/KW*HR", "LBS/HP*HR", HORSEPOWER / 1000.0 / POUND),
]


@pytest.mark.parametrize(("given", "wanted", "factor"), FACTORS)
def test_a_unit_of_an_engine_is_worth_what_its_definition_says(given, wanted, factor):
    engine = fromstring(f'<engine><size unit="{given}">2.0</size></engine>')

    assert engine_files.value_in(engine, "size", wanted, 0.0) == pytest.approx(
        2.0 * factor, rel=JSBSIM_DIGITS
    )


@pytest.mark.parametrize("largest", range(4))
def test_a_quaternion_is_that_of_its_rotation_whichever_part_is_the_largest(largest):
    parts = np.array([0.1, -0.2, 0.3, 0.25])
    parts[largest] = 0.9
    parts /= np.linalg.norm(parts)
    # JSBSim's matrices turn axes, not vectors: the other way round
    matrix = Rotation.from_quat(parts, scalar_first=True).as_matrix().T

    q = np.array(vectors.quaternion_of(matrix.tolist()))

    assert q * np.sign(q @ parts) == pytest.approx(parts, abs=ROUNDING)
    assert np.array(vectors.matrix_of(q.tolist())) == pytest.approx(matrix, abs=ROUNDING)


@pytest.mark.parametrize(("start", "target", "lag"), [(30.0, 90.0, 1.5), (90.0, 30.0, 4.0)])
def test_a_turboprop_spools_up_and_down_by_a_time_constant_for_each(start, target, lag):
    value, dt, steps = start, DT, 240

    for _ in range(steps):
        value = turboprops._approach(value, target, 1.5, 4.0, dt)

    left = (start - target) * math.exp(-steps * dt / lag)
    assert value == pytest.approx(target + left, rel=ROUNDING)


@pytest.mark.parametrize("limit", ["", "<ielumaxtorque>0.5</ielumaxtorque>"])
def test_a_torque_above_its_limit_moves_the_lever_down_and_one_below_slowly_up_again(limit):
    """It moves by 10 % and 5 % a second; FGTurboProp.cpp takes no limit where none is stated."""
    engine = engine_of(f"<turboprop_engine>{limit}</turboprop_engine>", "<propeller/>")
    now = state_of({engine.throttle: 0.6, "_lever0": 0.6, "_limited0": 0.0})

    def levers(torque, steps, throttle=0.6):
        now[f"{AT}/propeller-torque-ftlb"], now[engine.throttle] = torque, throttle
        return [turboprops._torque_limited(now, engine) for _ in range(steps)]

    down, up = levers(-0.51, 12), levers(0.49, 12)
    there, back = levers(0.49, 40), levers(-0.51, 2, throttle=0.3)

    n = np.arange(1.0, 13.0)
    moves = 1.0 if limit else 0.0
    assert down == pytest.approx(0.6 - moves * 0.1 * DT * n, abs=ROUNDING)
    assert up == pytest.approx(0.6 - moves * DT * (1.2 - 0.05 * n), abs=ROUNDING)
    assert there[11] == pytest.approx(0.6, abs=ROUNDING)
    assert there[13:] == [0.6] * 27
    assert back == [0.3, 0.3 - moves * 0.1 * DT]


@pytest.mark.parametrize(
    ("phi", "theta", "psi"), [(0.3, 0.2, 1.0), (-2.8, -1.2, 3.5), (3.0, 1.4, 6.0), (0.4, 0.5, 0.0)]
)
def test_angles_are_those_of_their_rotation_with_the_heading_from_0_to_2_pi(phi, theta, psi):
    matrix = Rotation.from_euler("ZYX", [psi, theta, phi]).as_matrix().T

    assert vectors.euler_angles(matrix.tolist()) == pytest.approx((phi, theta, psi), abs=ROUNDING)


@pytest.mark.parametrize("theta", [0.5 * math.pi, -0.5 * math.pi])
def test_an_attitude_straight_up_or_down_has_its_turn_in_roll(theta):
    matrix = Rotation.from_euler("ZYX", [0.0, theta, 0.7]).as_matrix().T
    matrix[0, 2] = -math.copysign(1.0, theta)

    assert vectors.euler_angles(matrix.tolist()) == pytest.approx((0.7, theta, 0.0), abs=ROUNDING)


def propeller(text, thruster="", **attributes):
    stated = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    part = f"<propeller {stated}>{text}</propeller>"
    return engine_files.propeller_of(engine_of("<piston_engine/>", part, thruster))


@pytest.mark.parametrize(("version", "sign"), [("1.0", 1.0), ("1.01", -1.0), ("1.1", -1.0)])
def test_propellers_of_files_newer_than_1_0_spin_the_other_way_in_jsbsim(version, sign):
    """`Sense_multiplier` of FGPropeller.cpp."""
    assert propeller("", version=version).moment_sign == sign


def test_a_propeller_is_what_its_file_states_and_otherwise_what_jsbsim_takes():
    """The defaults of the constructor of FGPropeller.cpp."""
    bare = propeller("")
    stated = propeller(
        "<ixx>0.5</ixx><diameter>6</diameter><gearratio>2</gearratio><cp_factor>0.9</cp_factor>"
        "<minpitch>10</minpitch><maxpitch>40</maxpitch><minrpm>850</minrpm><maxrpm>2700</maxrpm>",
        "<sense>-1</sense><p_factor>3</p_factor>",
    )

    names = "inertia diameter gear_ratio power_factor sense p_factor moment_sign pitch governed"
    of_bare, of_stated = (tuple(getattr(x, name) for name in names.split()) for x in (bare, stated))
    assert of_bare == (1e-6, 0.001, 1.0, 1.0, 1.0, 0.0, 1.0, None, False)
    assert of_stated == (0.5, 6.0, 2.0, 0.9, -1.0, 3.0, 1.0, (10.0, 40.0, 850.0, 2700.0), True)


@pytest.mark.parametrize(
    ("rpm", "power", "left_over", "torque", "after"),
    [
        (1200.0, 500.0, 300.0, 500.0, 300.0),
        (1200.0, -500.0, -300.0, -500.0, -300.0),
        (600.0, -500.0, -1e7, -500.0, -math.inf),  # braked, it stops and does not turn backwards
        (0.0, 40.0, 3.0, 40.0 / 0.01, 3.0),  # at rest power counts at 0.01 rad/s, its rise at 1
    ],
)
def test_what_a_propeller_does_not_take_turns_it_faster_until_it_stops(
    rpm, power, left_over, torque, after
):
    """``I omega d(omega)/dt`` is the power that is left; torque is against the sense."""
    now = state_of({f"{AT}/propeller-rpm": rpm, **dict.fromkeys(propellers.INERTIAL_RATES, 0.0)})
    part = '<propeller version="1.1"><ixx>0.5</ixx><gearratio>2</gearratio></propeller>'
    engine = engine_of("<piston_engine/>", part, "<sense>-1</sense>")
    now["velocities/qi-rad_sec"], now["velocities/ri-rad_sec"] = 0.3, -0.2
    omega = rpm / 60.0 * 2.0 * math.pi

    moment = propellers._turned(now, engine, engine_files.propeller_of(engine), power, left_over)

    torque = torque / omega if omega else torque
    faster = omega + after / 0.5 / (omega or 1.0) * DT
    turns = max(0.0, faster * 60.0 / (2.0 * math.pi))
    assert now[f"{AT}/propeller-torque-ftlb"] == pytest.approx(torque, rel=ROUNDING)
    assert now[f"{AT}/propeller-rpm"] == pytest.approx(turns, rel=ROUNDING)
    assert now[f"{AT}/engine-rpm"] == pytest.approx(2.0 * turns, rel=ROUNDING)
    # the moment of the spin is that of JSBSim's sign for files of this version
    assert moment == pytest.approx([torque, -0.1 * omega, -0.15 * omega], rel=ROUNDING)


@pytest.mark.parametrize(("lever", "n_1", "n_2"), [(0.0, 30.0, 60.0), (1.0, 100.0, 100.0)])
def test_shafts_of_a_turbine_whose_file_states_no_speeds_turn_as_jsbsim_takes_them(lever, n_1, n_2):
    """`IdleN1`, `IdleN2`, `MaxN1` and `MaxN2` of FGTurbine.cpp, in %."""
    thrusts = '<function name="IdleThrust"><value>0</value></function>'
    thrusts += '<function name="MilThrust"><value>1</value></function>'
    jet, at = engine_of(f"<turbine_engine>{thrusts}</turbine_engine>"), "propulsion/engine"
    started = {"_first0": 1.0, f"{at}/set-running": 1.0, "fcs/throttle-pos-norm": lever}
    unmoved = dict.fromkeys((f"{at}/n1", f"{at}/n2", "_n2-norm0", "aero/qbar-psf"), 0.0)
    now = state_of(started | unmoved | {"atmosphere/sigma": 1.0})

    turbines.turbine(now, jet)

    assert (now[f"{at}/n1"], now[f"{at}/n2"]) == pytest.approx((n_1, n_2), rel=ROUNDING)


def charged(*speeds, **stated):
    """A piston engine whose supercharger has these speeds, each a boost (psi) and height (ft)."""
    parts = {"numboostspeeds": len(speeds), **stated}
    for k, (boost, height) in enumerate(speeds, 1):
        parts |= {f"ratedboost{k}": boost, f"ratedpower{k}": 1000, f"ratedaltitude{k}": height}
    text = "".join(f"<{tag}>{value}</{tag}>" for tag, value in parts.items())
    return engine_of(f"<piston_engine>{text}</piston_engine>", "<propeller/>")


@pytest.mark.parametrize(
    ("rated", "takeoff", "lever", "boost"),
    [
        *((2, {"takeoffboost": 0}, 1.0, 2), (0.5, {}, 1.0, 0.5)),
        *((2, {"takeoffboost": 4}, 0.9, 2), (2, {"takeoffboost": 4}, 1.0, 4)),
    ],
)
def test_a_supercharger_is_held_at_its_boost_and_at_that_of_takeoff_by_a_lever_fully_open(
    rated, takeoff, lever, boost
):
    """Boosts are pressures (psi) above the standard one; at sea level it could give 8 psi."""
    now = state_of({"fcs/throttle-pos-norm": lever})

    manifold, lost = pistons._boosted(
        now,
        charged((rated, 9000), **takeoff),
        101325.0,
        pistons._Air(101325.0, 101325.0, 2500.0, 40.0),
    )

    expected = 101325.0 + boost * POUND_PER_INCH_2
    assert (manifold, lost) == pytest.approx((expected, 0.0), rel=JSBSIM_DIGITS)


@pytest.mark.parametrize(("asked", "speed"), [(-1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (7.0, 2.0)])
def test_a_speed_of_a_supercharger_chosen_by_hand_is_one_that_it_has(asked, speed):
    engine = charged((3, 0), (3, 9000), (3, 20_000), boostmanual=1)
    now = state_of({f"{AT}/boost-speed": asked})

    found = pistons._supercharger_speed(now, engine, pistons.supercharger_of(engine), 3e4)

    assert found == now[f"{AT}/boost-speed"] == speed


# Pressures of the standard atmosphere at 9000 + 1000 ft and 20,000 + 1000 ft, Pa.
AT_10, AT_21 = 69_682.0, 44_650.0


@pytest.mark.parametrize(
    ("ambient", "before", "speed"),
    [
        *((AT_10 - 700.0, 0.0, 0.0), (AT_10 - 1300.0, 0.0, 1.0), (AT_21 - 1300.0, 1.0, 2.0)),
        *((AT_10 + 700.0, 1.0, 1.0), (AT_10 + 1300.0, 1.0, 0.0), (AT_21 + 1300.0, 2.0, 1.0)),
        *((1000.0, 2.0, 2.0), (101_325.0, 0.0, 0.0), (AT_21 + 700.0, 2.0, 2.0)),
    ],
)
def test_a_supercharger_changes_its_speed_a_thousand_feet_above_the_rated_height(
    ambient, before, speed
):
    """It does so 1000 Pa beyond the pressure there, which JSBSim has from a polynomial."""
    engine = charged((3, 9000), (3, 20_000), (3, 30_000))
    now = state_of({f"{AT}/boost-speed": before})

    assert (
        pistons._supercharger_speed(now, engine, pistons.supercharger_of(engine), ambient) == speed
    )
    assert now[f"{AT}/boost-speed"] == speed


def test_a_supercharger_takes_the_power_of_an_adiabatic_compression():
    """``k/(k - 1) p V' ((p_2/p)^((k - 1)/k) - 1)`` of an ideal gas, with k as JSBSim has it."""
    engine = charged((2, 9000), **{"boost-loss-factor": 0.5})
    flow = {"_air-flow0": 0.08, f"{AT}/boostloss-factor": 0.5}  # m^3/s of the step before
    now = state_of(flow | {"fcs/throttle-pos-norm": 0.7})

    manifold, lost = pistons._boosted(now, engine, 6e4, pistons._Air(7e4, 7e4, 2500.0, 40.0))

    k, ratio = 1.414, manifold / 6e4
    watts = k / (k - 1.0) * 6e4 * 0.08 * (ratio ** ((k - 1.0) / k) - 1.0)
    assert ratio > 1.3
    assert lost == pytest.approx(0.5 * watts / HORSEPOWER, rel=JSBSIM_DIGITS)
    assert now[f"{AT}/boostloss-hp"] == lost


@pytest.mark.parametrize(("rpm", "fuel", "running"), [(1000.0, 0.001, 1.0), (200.0, 0.001, 0.0)])
def test_a_piston_engine_shows_that_it_runs_and_that_it_stands(rpm, fuel, running):
    """`Running` of FGPiston.cpp, below 80 % of the idle speed of 600 1/min."""
    at = "propulsion/engine[0]"
    of_air = {"atmosphere/P-psf": 2116.2, "atmosphere/T-R": 518.7, "propulsion/pt-lbs_sqft": 2116.2}
    of_engine = dict.fromkeys((f"{at}/ram-air-factor", f"{at}/set-running"), 1.0)
    of_engine |= {f"{at}/air-intake-impedance-factor": 0.15, f"{at}/volumetric-efficiency": 0.85}
    of_engine |= {f"{at}/friction-hp": 1.5, f"{at}/bsfc-lbs_hphr": 0.32, "_throttled0": 9e4}
    of_engine |= {f"{at}/propeller-rpm": rpm, f"{at}/fuel-flow-rate-pps": fuel}
    levers = dict.fromkeys(("fcs/throttle-pos-norm[0]", "fcs/mixture-pos-norm[0]"), 1.0)
    now = state_of(of_air | of_engine | levers)

    pistons.power_of(now, engine_of("<piston_engine/>", "<propeller/>"))

    assert now[f"{at}/set-running"] == running


@pytest.mark.parametrize(
    ("text", "fastest", "strength"),
    [
        ("<starter-rpm>900</starter-rpm><starter-torque>0.5</starter-torque>", 900.0, 0.5),
        ("<starter-rpm>0.5</starter-rpm><starter-torque>70</starter-torque>", 0.5, 70.0),
        ("<idlerpm>700</idlerpm><maxhp>150</maxhp>", 1400.0, 60.0),
        ("", 1200.0, 80.0),  # of 600 1/min and 200 hp
    ],
)
@pytest.mark.parametrize("rpm", [0.0, 1.2, 300.0, 1300.0])
def test_a_starter_has_less_torque_the_faster_it_turns(text, fastest, strength, rpm):
    """FGPiston.cpp: `StarterRPM` and `StarterTorque`; its power is that of 1 1/min at least."""
    engine = engine_of(f"<piston_engine>{text}</piston_engine>", "<propeller/>")
    now = state_of({f"{AT}/starter-norm": 0.9, f"{AT}/friction-hp": 1.5, pistons.STARTER: 1.0})

    power = pistons._cranked(now, engine, rpm)

    torque = 0.9 * strength * max(0.0, 1.0 - rpm / fastest)  # lbf ft
    per_s = 2.0 * math.pi * max(1.0, rpm) / 60.0
    assert power == pytest.approx(torque * per_s / 550.0, rel=JSBSIM_DIGITS)
    now[pistons.STARTER] = 0.0
    assert pistons._cranked(now, engine, rpm) == -1.5


@pytest.mark.parametrize("x", [-1.0, 2.0, 9.0])
def test_a_table_of_one_row_or_column_or_point_has_no_slope_along_it(x):
    """FGTable.cpp, where an axis with a single point is not searched."""
    line = tables.Table1((0.0, 4.0), (1.0, 9.0)).at(x)
    assert line == pytest.approx(np.interp(x, (0.0, 4.0), (1.0, 9.0)), rel=ROUNDING)

    assert tables.Table1((2.0,), (7.0,)).at(x) == 7.0
    assert tables.Table2((2.0,), (0.0, 4.0), (1.0, 9.0)).at(-5.0, x) == line
    assert tables.Table2((0.0, 4.0), (2.0,), (1.0, 9.0)).at(x, -5.0) == line
    assert (
        tables.Table3((2.0,), (tables.Table2((0.0, 4.0), (2.0,), (1.0, 9.0)),)).at(x, 0.0, 5.0)
        == line
    )


@pytest.mark.parametrize(
    ("pusher", "rpm", "power", "taken"),
    [
        *(("propeller", 900.0, -50.0, -50.0), ("propeller", 0.05, -50.0, 0.0)),
        *(("propeller", 900.0, 50.0, 50.0), ("propeller", 0.05, 50.0, 50.0)),
        *(("direct", 900.0, -50.0, 0.0), ("direct", 0.0, 50.0, 50.0)),
    ],
)
def test_an_engine_brakes_a_propeller_that_turns_and_nothing_else(pusher, rpm, power, taken):
    """FGPiston.cpp: below 0.1 1/min of the crankshaft, power is at least 0."""
    now = state_of({"propulsion/engine[0]/propeller-rpm": rpm})

    assert engines._braking(now, engine_of("<piston_engine/>", f"<{pusher}/>"), power) == taken


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
    now = state_of({
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


@pytest.mark.parametrize("h", [4.0, 10.0, 400.0, 1000.0, 1400.0, 2000.0, 5000.0])
def test_turbulence_has_the_lengths_and_strengths_of_the_standard_for_its_height(h):
    """MIL-F-8785C, 3.7.3: up to 1000 ft, from 2000 ft on, and straight lines between them."""
    w_20, span = 50.0, 30.0
    near = max(h, 10.0)  # ft
    ground = 0.177 + 0.000823 * near
    lengths = near / ground**1.2, near
    deviations = 0.1 * w_20 / ground**0.4, 0.1 * w_20
    high = np.interp(h, (500.0, 1750.0, 3750.0, 7500.0), (6.6, 6.9, 7.4, 6.7))  # Fig. 7
    if h > 1000.0:
        lengths = [np.interp(h, (1000.0, 2000.0), (1000.0, 1750.0))] * 2
        deviations = [np.interp(h, (1000.0, 2000.0), (0.1 * w_20, high))] * 2
    state = {"position/h-sl-ft": h, "metrics/bw-ft": span, turbulence.SEVERITY: 3.0}
    blown = (*turbulence.VELOCITY, *turbulence.WIND, *turbulence.GUST, *turbulence.COSINE_GUST)
    now = state_of(state | {turbulence.WIND_20FT: w_20, **dict.fromkeys(blown, 0.0)})
    now[turbulence.VELOCITY[0]], now[turbulence.WIND[0]] = 190.0, 10.0
    now[turbulence.COSINE_GUST[0]] = 30.0
    now.local_to_body = np.eye(3).tolist()

    scales, in_gust = (turbulence._scales(now, gust=gust) for gust in (False, True))

    assert (scales.V, in_gust.V) == (180.0, 150.0)
    assert (scales.L_u, scales.L_w) == pytest.approx(lengths, rel=ROUNDING)
    assert (scales.sigma_u, scales.sigma_w) == pytest.approx(deviations, rel=ROUNDING)
    assert (scales.tau_u, scales.tau_w) == pytest.approx(np.divide(lengths, 180.0), rel=ROUNDING)
    # The gusts that roll the aircraft depend on its span.
    root = math.sqrt(lengths[1] * span)
    assert scales.sigma_p == pytest.approx(1.9 / root * deviations[1], rel=ROUNDING)
    assert scales.tau_p == pytest.approx(root / 2.6 / 180.0, rel=ROUNDING)


@pytest.mark.parametrize(("axis", "body"), [("ahead", 0), ("right", 1), ("down", 2)])
def test_a_gust_is_a_cosine_up_and_down_along_the_axis_where_it_began(axis, body):
    """It is 3 m/s the other way: up in 5 steps from the fourth on, held for 3, then down in 5."""
    gust = Gust(axis=axis, peak=-3.0, start=4 * DT, rise=5 * DT, hold=3 * DT)
    numbers = turbulence.gust_numbers(gust, 1.0 / DT)
    zero = (turbulence.GUST_COUNT, turbulence.GUST_TIME, turbulence.GUST_BLOWS)
    now = state_of(
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
    along = began.as_matrix()[:, body] * -3.0 / FOOT
    last = 15  # its last step ends where it is over
    assert np.array(met)[:last] == pytest.approx(np.outer(size, along)[:last], abs=1e-6)
    assert not np.array(met)[17:].any()
