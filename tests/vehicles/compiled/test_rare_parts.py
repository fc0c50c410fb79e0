"""Parts that few models have, in plain numbers: what they compute, and what only JSBSim flies."""

import math
from types import SimpleNamespace
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

from flighttune.vehicles.compiled import (
    aerodynamics,
    components,
    engine_files,
    engines,
    functions,
    masses,
    pistons,
    trace,
    turboprops,
)
from flighttune.vehicles.compiled.properties import Properties, Unsupported

AT = "propulsion/engine"
DT = 0.01


def state(values=(), **how):
    """Properties before a step of 0.01 s."""
    now = Properties(trace.Graph(), DT)
    for name, value in dict(values).items():
        now[name] = value
    for name, value in how.items():
        setattr(now, name, value)
    return now


def engine(motor, pusher="<direct/>", thruster=""):
    axes = np.eye(3).tolist()
    thruster = fromstring(f"<thruster>{thruster}</thruster>")
    return engine_files.EngineFile(0, fromstring(motor), thruster, fromstring(pusher), axes)


ROCKET = "<rocket_engine><minthrottle>0.3</minthrottle>{}</rocket_engine>"
OF_MACH = (
    "<isp><function><product><value>300</value><p>velocities/mach</p></product></function></isp>"
)


@pytest.mark.parametrize(
    ("isp", "lever", "thrust"),
    [("", 0.3, 250.0 * 4.0), ("", 0.29, 0.0), (OF_MACH, 1.0, 300.0 * 0.5 * 4.0)],
)
def test_a_liquid_rocket_burns_above_its_least_throttle(isp, lever, thrust):
    """4 lb a second, of an impulse of 250 s or of a function."""
    now = state({f"{AT}/isp": 250.0, "_propellant0": 4.0, "velocities/mach": 0.5})
    now["fcs/throttle-pos-norm"] = lever

    assert engines._rocket(now, engine(ROCKET.format(isp))) == pytest.approx(thrust)


@pytest.mark.parametrize(
    ("motor", "pusher", "how", "said"),
    [
        (ROCKET.format("<thrust_table/>"), "<direct/>", {}, "a solid rocket"),
        (ROCKET.format(""), "<direct/>", {"trimming": True}, "a rocket in a trim"),
        ("<steam_engine/>", "<direct/>", {}, "the engine <steam_engine>"),
        ("<electric_engine/>", "<rotor/>", {}, "the thruster <rotor>"),
        ("<turboprop_engine/>", "<direct/>", {}, "a turboprop with <direct>"),
    ],
)
def test_an_engine_that_is_not_known_is_left_to_jsbsim(motor, pusher, how, said):
    now = state({"fcs/throttle-pos-norm": 1.0, f"{AT}/x-position": 0.0}, **how)
    for axis in "xyz":
        now[f"{AT}/{axis}-position"] = 0.0

    with pytest.raises(Unsupported, match=said):
        engines._push(now, engine(motor, pusher))


@pytest.mark.parametrize(
    ("power", "unit", "lever", "thrust"),
    [("745.7", "WATTS", 0.5, 275.0), ("2", "HP", 1.0, 1100.0), (None, None, 1.0, 550.0)],
)
def test_an_electric_engine_without_a_thruster_pushes_with_its_power(power, unit, lever, thrust):
    """In ft lbf/s, 550 of which are a horsepower of 745.7 W."""
    part = "" if power is None else f'<power unit="{unit}">{power}</power>'
    now = state({"fcs/throttle-pos-norm": lever} | {f"{AT}/{x}-position": 7.0 for x in "xyz"})

    push = engines._push(now, engine(f"<electric_engine>{part}</electric_engine>"))

    assert push.thrust == pytest.approx(thrust, rel=1e-4)
    assert push.place == [7.0] * 3
    assert now[f"{AT}/power-hp"] == pytest.approx(thrust / 550.0, rel=1e-4)


def test_a_nozzle_loses_the_pressure_of_the_air_on_its_area_and_never_pulls():
    motor, area = ROCKET.format(""), '<nozzle><area unit="IN2">72</area></nozzle>'
    values = {f"{AT}/isp": 250.0, "_propellant0": 8.0, "fcs/throttle-pos-norm": 1.0}
    values |= {f"{AT}/{x}-position": 0.0 for x in "xyz"}

    thrusts = [
        engines._push(state(values | {"atmosphere/P-psf": psf}), engine(motor, area)).thrust
        for psf in (0.0, 1000.0, 9000.0)
    ]

    assert thrusts == pytest.approx([2000.0, 2000.0 - 500.0, 0.0])


def test_forces_of_each_frame_of_axes_come_out_in_body_axes():
    """Drag and lift, axial and normal point backwards and up; X and Z ahead and down."""
    turn = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    now = state(wind_to_body=turn)

    found = [
        [*aerodynamics._in_body_axes(now, [1.0, 2.0, 3.0], axes)]
        for axes in ({"LIFT"}, {"DRAG", "SIDE"}, {"AXIAL"}, {"NORMAL", "SIDE"}, {"X", "Y", "Z"})
    ]

    by_wind = (np.array(turn) @ [-1.0, 2.0, -3.0]).tolist()
    assert found == [by_wind, by_wind, [-1.0, 2.0, -3.0], [-1.0, 2.0, -3.0], [1.0, 2.0, 3.0]]


BALANCE = """<fdm><mass_balance><emptywt>{{w}}</emptywt>
    <location><x>{{x}}</x><y>{{y}}</y><z>{{z}}</z></location>
    <ixx>{{a}}</ixx><iyy>{{b}}</iyy><izz>{{c}}</izz><ixy>{{d}}</ixy><ixz>{{e}}</ixz><iyz>{{f}}</iyz>
    POINTS</mass_balance></fdm>"""
NUMBERS = {"{{w}}": 1000.0, "{{x}}": 50.0, "{{y}}": 1.0, "{{z}}": -5.0}
NUMBERS |= {"{{a}}": 800.0, "{{b}}": 1200.0, "{{c}}": 1700.0} | dict.fromkeys(
    ("{{d}}", "{{e}}", "{{f}}"), 0.0
)
# A pilot, a bag and a tank: lb and inches, x backwards and z upwards
LOADS = [(180.0, (40.0, -10.0, 10.0)), (30.0, (90.0, 0.0, 0.0)), (120.0, (60.0, 20.0, -8.0))]


def loads(more=None):
    values = {"propulsion/tank/contents-lbs": LOADS[2][0]} | (more or {})
    values |= {f"propulsion/tank/{x}-position": p for x, p in zip("xyz", LOADS[2][1], strict=True)}
    for i, (weight, place) in enumerate(LOADS[:2]):
        number = f"[{i}]" if i else ""
        values[f"inertia/pointmass-weight-lbs{number}"] = weight
        for axis, p in zip("XYZ", place, strict=True):
            values[f"inertia/pointmass-location-{axis}-inches{number}"] = p
    return values.get


def test_masses_of_a_flight_are_those_of_its_points_about_their_centre():
    found = masses.mass_properties(fromstring(BALANCE.replace("POINTS", "")), NUMBERS, loads())

    weights = np.array([1000.0, *(w for w, _ in LOADS)])
    places = np.array([(50.0, 1.0, -5.0), *(p for _, p in LOADS)])
    cg = weights @ places / weights.sum()
    assert found["inertia/weight-lbs"] == pytest.approx(1330.0)
    assert found["inertia/mass-slugs"] == pytest.approx(1330.0 / 32.174049)
    assert [found[f"inertia/cg-{x}-in"] for x in "xyz"] == pytest.approx(cg)
    arms = (places - cg) / 12.0 * [-1.0, 1.0, -1.0]  # ft, ahead, to the right and down
    J = np.diag([800.0, 1200.0, 1700.0])
    for w, r in zip(weights / 32.174049, arms, strict=True):
        J = J + w * (r @ r * np.eye(3) - np.outer(r, r))
    tensor = np.array([found[name] for name in masses.INERTIA]).reshape(3, 3)
    assert tensor == pytest.approx(J)
    inverse = np.array([found[name] for name in masses.INVERSE_INERTIA]).reshape(3, 3)
    assert inverse == pytest.approx(np.linalg.inv(J))


@pytest.mark.parametrize(
    ("point", "more", "said"),
    [
        ("<pointmass><form/><weight>3</weight></pointmass>", {}, "a point mass with a form"),
        ("<pointmass><ixz>1</ixz></pointmass>", {}, "a point mass with a form"),
        ("<pointmass><weight>{{p}}</weight></pointmass>", {}, "a point mass of each flight"),
        ("", {"propulsion/tank[0]/local-ixx-slug_ft2": 1.0}, "a tank with a form"),
    ],
)
def test_masses_with_a_form_are_left_to_jsbsim(point, more, said):
    root = fromstring(BALANCE.replace("POINTS", point))

    assert masses.is_open(root)
    assert not masses.is_open(
        fromstring("<fdm><mass_balance><emptywt>9</emptywt></mass_balance></fdm>")
    )
    with pytest.raises(Unsupported, match=said):
        masses.mass_properties(root, NUMBERS, loads(more))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<function><value>1</value><value>2</value></function>", "with several operations"),
        ('<function><p apply="x">a</p></function>', "a property with `apply`"),
        ("<function><random/></function>", "<random> in a function"),
        ('<function><table type="internal"/></function>', "an internal table in a function"),
        (
            "<function><interpolate1d><value>1</value><p>a</p><value>2</value></interpolate1d>"
            "</function>",
            "between points that change",
        ),
    ],
)
def test_a_function_that_is_not_known_is_left_to_jsbsim(text, said):
    with pytest.raises(Unsupported, match=said):
        functions.hidden_function(state(), fromstring(text))


@pytest.mark.parametrize(("x", "y"), [(-9.0, 1.0), (0.0, 1.0), (1.0, 3.0), (2.0, 5.0), (9.0, -1.0)])
def test_an_interpolation_is_linear_between_its_points(x, y):
    points = "".join(f"<value>{v}</value>" for v in (0.0, 1.0, 2.0, 5.0, 5.0, -1.0))
    text = f"<function><interpolate1d><p>a</p>{points}</interpolate1d></function>"

    assert functions.hidden_function(state({"a": x}), fromstring(text)) == pytest.approx(y)


@pytest.mark.parametrize(("x", "whole"), [(0.5, 1.0), (-0.5, -1.0), (1.49, 1.0), (-2.5, -3.0)])
def test_a_number_is_rounded_away_from_zero_as_in_c(x, whole):
    assert trace.call("round", x) == whole


def test_a_place_in_a_table_counts_row_by_row():
    assert [trace.flat_index(row, 4, column) for row, column in ((0, 3), (2, 1))] == [3, 9]


def test_a_file_of_an_engine_in_other_units_or_forms_is_left_to_jsbsim():
    of = engine(
        '<e><thrust unit="KN">1</thrust><function type="post"><value>1</value></function></e>'
    )
    with pytest.raises(Unsupported, match='<thrust> in "KN"'):
        engine_files.value_in(of.motor, "thrust", "LBS", 0.0)
    with pytest.raises(Unsupported, match='a function of type "post"'):
        engine_files.functions_of(state(), of, ())


def test_functions_of_an_engine_are_shown_below_it_if_jsbsim_knows_their_names():
    text = "".join(
        f'<function name="{name}"><value>{x}</value></function>'
        for name, x in (("MilThrust", 3), ("own", 4))
    )
    now = state()

    found = engine_files.functions_of(now, engine(f"<e>{text}</e>"), ("MilThrust",))

    assert found == {"MilThrust": 3.0, "own": 4.0}
    assert now[f"{AT}/MilThrust"] == 3.0
    assert now["own"] == 4.0


PIECE = (
    """<propulsion><engine><piston_engine/><thruster><direct/>{}</thruster></engine></propulsion>"""
)


def test_thrusters_are_turned_by_roll_pitch_and_yaw_and_pointing_ones_are_refused():
    orient = '<orient unit="DEG"><roll>10</roll><pitch>20</pitch><yaw>30</yaw></orient>'
    (found,) = engine_files.engines_of(fromstring(f"<fdm>{PIECE.format(orient)}</fdm>"))

    r, p, y = np.radians([10.0, 20.0, 30.0])

    def turn(axis, angle):
        c, s = math.cos(angle), math.sin(angle)
        i, j = [k for k in range(3) if k != axis]
        m = np.eye(3)
        m[i, i], m[j, j], m[i, j], m[j, i] = c, c, -s, s
        return m if axis != 1 else m.T

    assert np.array(found.orientation) == pytest.approx(turn(2, y) @ turn(1, p) @ turn(0, r))
    with pytest.raises(Unsupported, match="a thruster with <pointing>"):
        engine_files.engines_of(fromstring(f"<fdm>{PIECE.format('<pointing/>')}</fdm>"))


def component(text, values=(), **how):
    element = fromstring(text)
    now = state({"a": 0.0} | dict(values), **how)
    return components.Part(now, element, DT), now


@pytest.mark.parametrize(("x", "y"), [(0.25, 0.05), (-0.15, 0.05), (0.11, -0.09), (-0.05, -0.05)])
def test_a_cyclic_clip_takes_a_value_round_by_whole_turns(x, y):
    part, _ = component(
        '<summer name="s"><clipto type="cyclic"><min>-0.1</min><max>0.1</max></clipto></summer>'
    )

    assert components._clipped(part, x) == pytest.approx(y)


@pytest.mark.parametrize(
    ("ends", "x", "y", "stopped"),
    [
        ((-1, 2), -3.0, -1.0, True), ((-1, 2), 3.0, 2.0, True), ((-1, 2), 0.5, 0.5, False),
        ((2, -1), 0.5, 0.5, True), ((0, 2), -1.0, 0.0, False),
    ],
)  # fmt: skip
def test_a_clip_holds_between_its_ends_and_not_in_the_wrong_order(ends, x, y, stopped):
    """An actuator at a bound of 0 is not said to be at its stop: FGActuator.cpp."""
    low, high = ends
    part, now = component(
        f'<actuator name="s"><clipto><min>{low}</min><max>{high}</max></clipto></actuator>'
    )

    assert components._clipped(part, x) == y
    assert now[f"{part.name}/saturated"] == float(stopped)


@pytest.mark.parametrize(("bits", "y"), [(0, 0.37), (2, 0.0), (4, 0.25), (5, 0.3125)])
def test_a_sensor_of_bits_sees_whole_grains(bits, y):
    """Of a range from -1 to 1: 2 bits are grains of a half."""
    part, _ = component(
        f'<sensor name="s"><input>a</input><quantization><bits>{bits}</bits>'
        "<min>-1</min><max>1</max></quantization></sensor>", {"a": 0.37}
    )  # fmt: skip

    assert components._sensor(part) == pytest.approx(y)


def test_a_component_that_is_not_known_is_left_to_jsbsim():
    now = state({"a": 1.0})
    known = set()
    for text, said in (
        ("<gyro/>", "the component <gyro>"),
        ('<sensor name="s"><input>a</input><noise/></sensor>', "<noise> in <sensor>"),
    ):
        with pytest.raises(Unsupported, match=said):
            components._run(components.Part(now, fromstring(text), DT), known)
    components._run(components.Part(now, fromstring("<description/>"), DT), known)


@pytest.mark.parametrize(
    ("kind", "increment"),
    [
        ("rect", 5.0), ("trap", 4.0), ("ab2", 1.5 * 5.0 - 0.5 * 3.0), ("", 0.0),
        ("ab3", (23.0 * 5.0 - 16.0 * 3.0 + 5.0 * 2.0) / 12.0),
    ],
)  # fmt: skip
def test_rules_of_integration_weigh_the_inputs_of_the_last_steps(kind, increment):
    assert components.integrand(kind, 5.0, 3.0, 2.0) == pytest.approx(increment)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("<pid><kp>1</kp></pid>", ""), ("<pid><ki>1</ki></pid>", "ab2"),
        ('<pid><ki type="trap">1</ki></pid>', "trap"),
        ("<integrator><c1>1</c1></integrator>", "trap"),
    ],
)  # fmt: skip
def test_an_integrator_has_the_rule_that_jsbsim_takes(text, kind):
    assert components.integrator_kind(fromstring(text)) == kind


CHARGED = "<piston_engine><numboostspeeds>{}</numboostspeeds>{}</piston_engine>"


def speeds(*rows):
    """Boost (psi), power (hp) and altitude (ft) of each speed."""
    names = "ratedboost", "ratedpower", "ratedaltitude"
    return "".join(
        f"<{name}{k}>{x}</{name}{k}>"
        for k, row in enumerate(rows, 1)
        for name, x in zip(names, row, strict=True)
    )


@pytest.mark.parametrize(
    ("count", "rows", "usable"),
    [
        (0, [(2, 900, 8000)], 0), (1, [(2, 900, 8000), (2, 800, 18000)], 1),
        (2, [(2, 900, 8000), (2, 800, 18000)], 2), (2, [(2, 900, 8000), (2, 800, 7000)], 1),
        (2, [(2, 900, 8000), (0, 800, 18000)], 1), (2, [(2, 900, 8000), (2, 0, 18000)], 1),
        (1, [(2, 900, -1)], 0), (3, [(2, 900, 0), (2, 900, 0), (1, 900, 5)], 3),
    ],
)  # fmt: skip
def test_speeds_of_a_supercharger_count_as_far_as_they_are_whole_and_rise(count, rows, usable):
    found = pistons.supercharger_of(engine(CHARGED.format(count, speeds(*rows))))

    assert (len(found.speeds) if found else 0) == usable
    if usable:
        standard, psi = 101325.0, 6894.757
        wanted = [standard + boost * psi for boost, *_ in rows[:usable]]
        assert found.pressures == pytest.approx(wanted, rel=1e-3)
        assert found.takeoff is None
        assert len(found.switches) == usable - 1
        assert (found.manual, found.unlimited) == (False, False)


@pytest.mark.parametrize(
    ("manual", "speed", "ambient", "chosen"),
    [
        # Automatic: up below the pressure 1000 ft above its altitude, down above it, by a margin
        (0, 0.0, 60_000.0, 1.0), (0, 0.0, 90_000.0, 0.0), (0, 1.0, 90_000.0, 0.0),
        (0, 1.0, 60_000.0, 1.0), (1, 5.0, 90_000.0, 1.0), (1, -1.0, 60_000.0, 0.0),
        (1, 0.0, 60_000.0, 0.0),
    ],
)  # fmt: skip
def test_a_supercharger_changes_its_speed_by_the_pressure_or_by_hand(
    manual, speed, ambient, chosen
):
    text = speeds((2, 900, 8000), (2, 800, 18000)) + f"<boostmanual>{manual}</boostmanual>"
    of = engine(CHARGED.format(2, text))
    now = state({f"{AT}/boost-speed": speed})

    found = pistons._supercharger_speed(now, of, pistons.supercharger_of(of), ambient)

    assert found == now[f"{AT}/boost-speed"] == chosen


@pytest.mark.parametrize(
    ("text", "how", "said"),
    [(speeds((2, 900, 8000)), {"trimming": True}, "a supercharger in a trim")],
)
def test_a_supercharger_in_a_trim_is_left_to_jsbsim(text, how, said):
    with pytest.raises(Unsupported, match=said):
        pistons.power_of(state(**how), engine(CHARGED.format(1, text)))


@pytest.mark.parametrize(
    ("torque", "lever", "last", "was", "after", "limited"),
    [
        (50.0, 0.8, 0.8, 0.0, 0.8, 0.0),  # below the limit
        (120.0, 0.9, 0.8, 0.0, 0.8 - 0.1 * DT, 1.0),  # above it the lever goes back
        (-120.0, 0.9, 0.8, 0.0, 0.8 - 0.1 * DT, 1.0),
        (50.0, 0.9, 0.8, 1.0, 0.8 + 0.05 * DT, 1.0),  # then forth again, more slowly
        (120.0, 0.7, 0.8, 1.0, 0.7, 0.0),  # unless it was pulled back
    ],
)
def test_a_lever_whose_torque_is_limited_goes_back_and_slowly_forth(
    torque, lever, last, was, after, limited
):
    of = engine("<turboprop_engine><ielumaxtorque>100</ielumaxtorque></turboprop_engine>")
    now = state({
        "fcs/throttle-pos-norm": lever, "_lever0": last, "_limited0": was,
        f"{AT}/propeller-torque-ftlb": torque,
    })  # fmt: skip

    assert turboprops._torque_limited(now, of) == pytest.approx(after)
    assert now["_limited0"] == limited
    assert now["_lever0"] == pytest.approx(after)
    free = engine("<turboprop_engine/>")
    assert turboprops._torque_limited(now, free) == lever


def test_a_turboprop_without_its_tables_is_left_to_jsbsim():
    values = {
        "fcs/throttle-pos-norm": 1.0,
        "_first0": 1.0,
        f"{AT}/n1": 50.0,
        f"{AT}/propeller-rpm": 0.0,
    }
    of = engine("<turboprop_engine/>", "<propeller/>")

    with pytest.raises(Unsupported, match="without the table EnginePowerRPM_N1"):
        turboprops.turboprop(state(values), of)
    with pytest.raises(Unsupported, match="without EnginePowerVC"):
        turboprops._by_airspeed(state(), of)
    now = state(values, trimming=True)
    assert turboprops.turboprop(now, of) == 0.0
    assert now["_first0"] == 1.0


def test_the_moment_of_a_place_is_about_the_centre_of_gravity():
    """Structural axes point backwards, to the right and up, in inches."""
    now = SimpleNamespace(cg=[100.0, 2.0, -3.0])

    assert masses.body_arm([88.0, 26.0, 9.0], now.cg) == pytest.approx([1.0, 2.0, -1.0])
