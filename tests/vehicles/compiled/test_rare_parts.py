"""Parts that few models have: forces, masses, and the refusal of those that only JSBSim flies."""

from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from compiled_parts import DT, engine_of, state_of
from scipy.spatial.transform import Rotation

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
from flighttune.vehicles.compiled.properties import Unsupported

AT = "propulsion/engine"


ROCKET = "<rocket_engine><minthrottle>0.3</minthrottle>{}</rocket_engine>"
OF_MACH = (
    "<isp><function><product><value>300</value><p>velocities/mach</p></product></function></isp>"
)


@pytest.mark.parametrize(
    ("isp", "lever", "thrust"),
    [("", 0.3, 250.0 * 4.0), ("", 0.29, 0.0), (OF_MACH, 1.0, 300.0 * 0.5 * 4.0)],
)
def test_a_liquid_rocket_burns_above_its_least_throttle(isp, lever, thrust):
    """Its propellant flows at 4 lb/s; its specific impulse is 250 s or that of a function."""
    now = state_of({f"{AT}/isp": 250.0, "_propellant0": 4.0, "velocities/mach": 0.5})
    now["fcs/throttle-pos-norm"] = lever

    assert engines._rocket(now, engine_of(ROCKET.format(isp))) == pytest.approx(thrust)


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
    now = state_of({"fcs/throttle-pos-norm": 1.0, f"{AT}/x-position": 0.0}, **how)
    for axis in "xyz":
        now[f"{AT}/{axis}-position"] = 0.0

    with pytest.raises(Unsupported, match=said):
        engines._push(now, engine_of(motor, pusher))


@pytest.mark.parametrize(
    ("power", "unit", "lever", "thrust"),
    [("745.7", "WATTS", 0.5, 275.0), ("2", "HP", 1.0, 1100.0), (None, None, 1.0, 550.0)],
)
def test_an_electric_engine_without_a_thruster_pushes_with_its_power(power, unit, lever, thrust):
    """Its thrust in lbf is its power in ft lbf/s, 550 of which are a horsepower of 745.7 W."""
    part = "" if power is None else f'<power unit="{unit}">{power}</power>'
    now = state_of({"fcs/throttle-pos-norm": lever} | {f"{AT}/{x}-position": 7.0 for x in "xyz"})

    push = engines._push(now, engine_of(f"<electric_engine>{part}</electric_engine>"))

    assert push.thrust == pytest.approx(thrust, rel=1e-4)
    assert push.place == [7.0] * 3
    assert now[f"{AT}/power-hp"] == pytest.approx(thrust / 550.0, rel=1e-4)


def test_a_nozzle_loses_the_pressure_of_the_air_on_its_area_and_never_pulls():
    motor, area = ROCKET.format(""), '<nozzle><area unit="IN2">72</area></nozzle>'
    values = {f"{AT}/isp": 250.0, "_propellant0": 8.0, "fcs/throttle-pos-norm": 1.0}
    values |= {f"{AT}/{x}-position": 0.0 for x in "xyz"}

    thrusts = [
        engines._push(state_of(values | {"atmosphere/P-psf": psf}), engine_of(motor, area)).thrust
        for psf in (0.0, 1000.0, 9000.0)
    ]

    assert thrusts == pytest.approx([2000.0, 2000.0 - 500.0, 0.0])


def test_forces_of_each_frame_of_axes_come_out_in_body_axes():
    """Drag and lift, axial and normal point backwards and up; X and Z ahead and down."""
    turn = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    now = state_of(wind_to_body=turn)

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
# Weights (lb) and places (in; x backwards, z upwards) of a pilot, a bag and a tank
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
        functions.hidden_function(state_of(), fromstring(text))


@pytest.mark.parametrize(("x", "whole"), [(0.5, 1.0), (-0.5, -1.0), (1.49, 1.0), (-2.5, -3.0)])
def test_a_number_is_rounded_away_from_zero_as_in_c(x, whole):
    assert trace.call("round", x) == whole


def test_a_file_of_an_engine_in_other_units_or_forms_is_left_to_jsbsim():
    of = engine_of(
        '<e><thrust unit="KN">1</thrust><function type="post"><value>1</value></function></e>'
    )
    with pytest.raises(Unsupported, match='<thrust> in "KN"'):
        engine_files.value_in(of.motor, "thrust", "LBS", 0.0)
    with pytest.raises(Unsupported, match='a function of type "post"'):
        engine_files.functions_of(state_of(), of, ())


def test_functions_of_an_engine_are_shown_below_it_if_jsbsim_knows_their_names():
    text = "".join(
        f'<function name="{name}"><value>{x}</value></function>'
        for name, x in (("MilThrust", 3), ("own", 4))
    )
    now = state_of()

    found = engine_files.functions_of(now, engine_of(f"<e>{text}</e>"), ("MilThrust",))

    assert found == {"MilThrust": 3.0, "own": 4.0}
    assert now[f"{AT}/MilThrust"] == 3.0
    assert now["own"] == 4.0


PIECE = (
    """<propulsion><engine><piston_engine/><thruster><direct/>{}</thruster></engine></propulsion>"""
)


def test_thrusters_are_turned_by_roll_pitch_and_yaw_and_pointing_ones_are_refused():
    orient = '<orient unit="DEG"><roll>10</roll><pitch>20</pitch><yaw>30</yaw></orient>'
    (found,) = engine_files.engines_of(fromstring(f"<fdm>{PIECE.format(orient)}</fdm>"))

    turn = Rotation.from_euler("ZYX", [30.0, 20.0, 10.0], degrees=True)
    assert np.array(found.orientation) == pytest.approx(turn.as_matrix())
    with pytest.raises(Unsupported, match="a thruster with <pointing>"):
        engine_files.engines_of(fromstring(f"<fdm>{PIECE.format('<pointing/>')}</fdm>"))


def test_a_component_that_is_not_known_is_left_to_jsbsim():
    now = state_of({"a": 1.0})
    known = set()
    for text, said in (
        ("<gyro/>", "the component <gyro>"),
        ('<sensor name="s"><input>a</input><noise/></sensor>', "<noise> in <sensor>"),
    ):
        with pytest.raises(Unsupported, match=said):
            components._run(components.Part(now, fromstring(text), DT), known)
    components._run(components.Part(now, fromstring("<description/>"), DT), known)


def test_a_supercharger_in_a_trim_is_left_to_jsbsim():
    charged = engine_of(
        "<piston_engine><numboostspeeds>1</numboostspeeds><ratedboost1>2</ratedboost1>"
        "<ratedpower1>900</ratedpower1><ratedaltitude1>8000</ratedaltitude1></piston_engine>"
    )

    with pytest.raises(Unsupported, match="a supercharger in a trim"):
        pistons.power_of(state_of(trimming=True), charged)


def test_a_turboprop_without_its_tables_is_left_to_jsbsim():
    values = {
        "fcs/throttle-pos-norm": 1.0,
        "_first0": 1.0,
        f"{AT}/n1": 50.0,
        f"{AT}/propeller-rpm": 0.0,
    }
    of = engine_of("<turboprop_engine/>", "<propeller/>")

    with pytest.raises(Unsupported, match="without the table EnginePowerRPM_N1"):
        turboprops.turboprop(state_of(values), of)
    with pytest.raises(Unsupported, match="without EnginePowerVC"):
        turboprops._by_airspeed(state_of(), of)
    now = state_of(values, trimming=True)
    assert turboprops.turboprop(now, of) == 0.0
    assert now["_first0"] == 1.0
