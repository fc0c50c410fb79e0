"""Each part of a model that compiling knows, flown by JSBSim and compiled, and equal to the bit.

A new operator, component, engine or unit is a new row, in its table here and in docs/compiled.md.
"""

import re
import shutil
from pathlib import Path

import jsbsim
import numpy as np
import pytest
from airframes import blowing, changed_aerosonde, of_this_model, varied
from compiled_flights import differing, flown_by_both
from places import ROOT, SHIPPED_AIRCRAFT

import flighttune as ft

PHI, V = "<property>attitude/phi-rad</property>", "<property>velocities/vt-fps</property>"
# Zero until the flight begins: filters then start at rest.
ROLL, LOAD = "<input>ft/phi-cmd-rad</input>", "<input>ft/n_z-err</input>"
HALF = "<value>0.5</value>"
SHARE = f"<quotient>{PHI}<value>3</value></quotient>"
POSITIVE = f"<abs>{PHI}</abs>"


def table(rows, *keys):
    names = ("row", "column", "table")
    variables = "".join(
        f'<independentVar lookup="{name}">{key}</independentVar>'
        for name, key in zip(names, keys, strict=False)
    )
    return f"<table>{variables}{rows}</table>"


LINE = "<tableData>-0.2 1.0\n 0.0 2.0\n 0.1 -1.0\n 0.3 0.5</tableData>"
PLANE = "<tableData> 80.0 82.0 90.0\n-0.2 1.0 2.0 3.0\n0.1 0.5 4.0 1.0\n0.3 7.0 1.0 2.0</tableData>"
SPACE = "".join(
    PLANE.replace("<tableData>", f'<tableData breakPoint="{point}">').replace("4.0", f"{point}")
    for point in (-0.1, 0.0, 0.2)
)
PLACES = ("attitude/phi-rad", "velocities/vt-fps", "velocities/p-rad_sec")

OPERATORS = {
    **{name: f"<{name}>{SHARE}</{name}>" for name in ("sin", "cos", "tan", "asin", "acos", "atan")},
    **{name: f"<{name}>{PHI}</{name}>" for name in ("exp", "abs", "toradians", "todegrees")},
    **{name: f"<{name}>{POSITIVE}</{name}>" for name in ("sqrt", "ln", "log10", "log2")},
    **{name: f"<{name}>{V}</{name}>" for name in ("integer", "fraction", "floor", "ceil")},
    **{
        name: f"<{name}>{PHI}{HALF}{SHARE}</{name}>"
        for name in ("sum", "product", "difference", "avg", "min", "max")
    },
    **{
        name: f"<{name}>{V}<value>7</value></{name}>"
        for name in ("quotient", "fmod", "mod", "atan2")
    },
    **{name: f"<{name}>{PHI}<value>0.1</value></{name}>" for name in ("lt", "le", "gt", "ge")},
    **{name: f"<{name}><integer>{V}</integer><value>81</value></{name}>" for name in ("eq", "nq")},
    "sign": f"<sign><difference>{PHI}<value>0.1</value></difference></sign>",
    "roundmultiple": f"<roundmultiple>{PHI}<value>0.05</value></roundmultiple>",
    "pow": f"<pow>{POSITIVE}<value>1.7</value></pow>",
    "pi": f"<product><pi/>{PHI}</product>",
    "property": PHI,
    "p": "<p>attitude/phi-rad</p>",
    "value": f"<sum><value>0.25</value>{PHI}</sum>",
    "v": f"<sum><v>0.25</v>{PHI}</sum>",
    "and": f"<and><gt>{PHI}<value>0.1</value></gt><lt>{V}<value>99</value></lt></and>",
    "or": f"<or><gt>{PHI}{HALF}</gt><lt>{V}<value>82</value></lt></or>",
    "not": f"<not><gt>{PHI}<value>0.1</value></gt></not>",
    "ifthen": f"<ifthen><gt>{PHI}<value>0.1</value></gt>{V}{SHARE}</ifthen>",
    "switch": f"<switch>{POSITIVE}<value>1</value>{V}</switch>",
    "interpolate1d": f"<interpolate1d>{PHI}<value>-0.1</value><value>1</value><value>0.1</value>"
    "<value>5</value><value>0.3</value><value>2</value></interpolate1d>",
    "table": table(LINE, *PLACES[:1]),
    "t": table(PLANE, *PLACES[:2]).replace("table>", "t>"),
    "table of three keys": table(SPACE, *PLACES),
    "table of one row": table("<tableData> 80 82 90\n 0 1 2 4</tableData>", *PLACES[:2]),
    "table of one column": table("<tableData> 80\n-0.2 1\n 0 5\n 0.3 2</tableData>", *PLACES[:2]),
}

GAIN = "<gain>2.5</gain>"
SIGNED = "<domain><min>-0.4</min><max>0.3</max></domain><range><min>-10</min><max>25</max></range>"
CLIPPED = "<clipto><min>-0.1</min><max>0.15</max></clipto>"
CROSSED = "<clipto><min>0.2</min><max>-0.1</max></clipto>"
FROM_ZERO = "<clipto><min>0</min><max>0.15</max></clipto>"
TURNING = '<clipto type="cyclic"><min>-0.1</min><max>0.15</max></clipto>'
DETENTS = "".join(
    f"<setting><position>{place}</position><time>{time}</time></setting>"
    for place, time in ((-0.2, 0), (0.0, 0.4), (0.1, 0.2), (0.5, 1.0))
)
FILTER = "".join(f"<c{k}>{c}</c{k}>" for k, c in enumerate((0.3, 2.0, 1.5, 4.0, 0.2, 1.0), 1))
TEST = """<test logic="AND" value="0.75"> attitude/phi-rad gt 0.05
    <test logic="OR"> velocities/vt-fps LT 81 \n attitude/phi-rad &gt; 0.1 </test></test>"""

COMPONENTS = {
    "summer": f"{ROLL}<input>-attitude/phi-rad</input><bias>0.01</bias>{CLIPPED}",
    "summer with an upper bound alone": f"{ROLL}<clipto><max>0.1</max></clipto>",
    "summer with crossed bounds": f"{ROLL}{CROSSED}",
    "pure_gain": f"{ROLL}{GAIN}",
    "pure_gain by a property": f"{ROLL}<gain>velocities/vt-fps</gain>{TURNING}",
    "scheduled_gain": f"{ROLL}{GAIN}{table(LINE, *PLACES[:1])}",
    "aerosurface_scale": f"{ROLL}{SIGNED}{GAIN}",
    "aerosurface_scale off centre": f"{ROLL}{SIGNED}<zero_centered>0</zero_centered>",
    "sensor": f"{ROLL}<lag>20</lag><gain>1.5</gain><bias>0.1</bias><delay>0.02</delay>",
    "sensor of steps": f"{ROLL}<quantization><bits>5</bits><min>-1</min><max>1</max>"
    "</quantization>",
    "sensor of no bits": f"{ROLL}<quantization><bits>0</bits><min>-1</min><max>1</max>"
    "</quantization>",
    "deadband": f"{ROLL}<width>0.2</width>{GAIN}",
    "actuator": f"{ROLL}<lag>20</lag><rate_limit>0.3</rate_limit><bias>0.01</bias>{CLIPPED}",
    "actuator of two rates": f'{ROLL}<rate_limit sense="incr">0.4</rate_limit>'
    '<rate_limit sense="decr">0.2</rate_limit><deadband_width>0.1</deadband_width>',
    "actuator with play": f"{ROLL}<hysteresis_width>0.1</hysteresis_width><delay>0.03</delay>",
    "actuator from zero": f"{ROLL}{FROM_ZERO}",
    "actuator that begins at its end": "<input>attitude/phi-rad</input><lag>20</lag>"
    "<rate_limit>0.3</rate_limit><clipto><min>0.05</min><max>0.15</max></clipto>",
    "integrator": f'{ROLL}<c1 type="trap">0.7</c1>',
    "integrator by default": f"{ROLL}<c1>0.7</c1>",
    "kinematic": f"<input>test/summer</input><traverse>{DETENTS}</traverse>",
    "kinematic without scale": "<input>test/summer</input><noscale/>"
    f"<traverse>{DETENTS}</traverse>",
    "lag_filter": f"{ROLL}<c1>3</c1>",
    "washout_filter": f"{ROLL}<c1>3</c1>",
    "lead_lag_filter": f"{ROLL}{FILTER}",
    "second_order_filter": f"{ROLL}{FILTER}",
    "switch": f'<default value="attitude/phi-rad"/>{TEST}<test value="-ft/n_z-err">'
    "attitude/phi-rad lt -0.02</test>",
    "switch with a delay": f'<delay type="frames">4</delay><default value="0"/>{TEST}',
    "angle": '<source_angle unit="DEG">attitude/psi-deg</source_angle>'
    "<target_angle>attitude/phi-rad</target_angle>",
    "fcs_function": f"<function>{SHARE}</function>{LOAD}",
    **{
        f"pid {kind}": f'{ROLL}<kp>0.4</kp><ki type="{kind}">0.3</ki><kd>0.02</kd>'
        for kind in ("rect", "trap", "ab2", "ab3")
    },
    "pid without a slope": f"{ROLL}<kp>0.4</kp><ki>0.3</ki>",
    "pid without a sum": f"{ROLL}<kp>0.4</kp><kd>0.02</kd>",
    "pid standard": f"{ROLL}<kp>0.4</kp><ki>0.3</ki><kd>0.02</kd>",
    "pid with a trigger": f"{ROLL}<kp>0.4</kp><ki>0.3</ki><pvdot>velocities/p-rad_sec</pvdot>"
    "<kd>0.02</kd><trigger>test/switch</trigger>",
}


def identifier(name):
    return f"test/{name.replace(' ', '-')}"


def component(name, content):
    tag = name.partition(" ")[0]
    kind = ' type="standard"' if name == "pid standard" else ""
    return f'<{tag} name="{identifier(name)}"{kind}>{content}</{tag}>'


def operator(name, content):
    return f'<fcs_function name="{identifier(name)}"><function>{content}</function></fcs_function>'


CHOICE = """<distributor name="test/choice" type="exclusive">
    <case><test> attitude/phi-rad gt 0.1 </test><property value="3">test/chosen</property></case>
    <case><test> attitude/phi-rad gt 0.0 </test>
        <property value="attitude/phi-rad">test/chosen</property></case>
    </distributor>"""
SYSTEM = "".join(
    (
        '<system name="test"><property>test/chosen</property><channel name="all">',
        *(operator(f"of {name}", content) for name, content in OPERATORS.items()),
        *(component(name, content) for name, content in COMPONENTS.items()),
        f"{CHOICE}</channel>",
        '<channel name="third" execrate="3">',
        f'<summer name="test/every-third">{ROLL}</summer></channel>',
        '<channel name="at times" execute="test/of-gt">',
        f'<summer name="test/at-times">{ROLL}</summer></channel></system>',
    )
)
STOPS = ("test/actuator/saturated", "test/actuator-from-zero/saturated")
OTHERS = ("test/chosen", "test/every-third", "test/at-times", *STOPS)


def in_other_axes(text, *kind):
    """Lift and drag as axial and normal forces, or as forces along x and z."""
    for old, new in zip(("DRAG", "SIDE", "LIFT"), kind, strict=True):
        text = text.replace(f'<axis name="{old}">', f'<axis name="{new}">')
    text = text.replace("<sum>", "<sum><value>0.01</value>", 1)
    for name in ("lift", "drag"):
        start = f'<function name="aero/force/{name}">'
        i = text.index("<product>", text.index(start)) + len("<product>")
        text = f"{text[:i]}<value>{-1.0 if kind[0] == 'X' else 1.0}</value>{text[i:]}"
    return text


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Rows of all properties of the test, with forces along x, y and z, by JSBSim and compiled."""

    def change(text):
        text = in_other_axes(text, "X", "Y", "Z")
        return text.replace("<aerodynamics>", f"{SYSTEM}<aerodynamics>")

    folder = changed_aerosonde(tmp_path_factory.mktemp("parts") / "aircraft", change)
    return flown_by_both(folder, 4.0)


def test_operators_and_components_are_those_of_jsbsim_to_the_bit(flown):
    parts = {*map(identifier, [*(f"of {name}" for name in OPERATORS), *COMPONENTS]), *OTHERS}

    assert {name for name in parts if np.unique(flown[name][0]).size < 2} == set()
    assert differing(flown) == []


TURBOPROP = """<turboprop_engine name="turboprop"><maxpower unit="HP">0.025</maxpower>
    <psfc>0.6</psfc><idlen1>50</idlen1><maxn1>98</maxn1><n1idle_max_delay>0.7</n1idle_max_delay>
    <betarangeend>0</betarangeend><ielumaxtorque unit="FT*LB">{torque}</ielumaxtorque>
    <table name="EnginePowerVC"><independentVar>velocities/vc-kts</independentVar>
        <tableData> 30 0.5\n 60 1.1 </tableData></table>
    <table name="EnginePowerRPM_N1" type="internal"><tableData>
           50    80    100
        0  0.002 0.005 0.02
     2000  0.002 0.015 0.03
     9000  0.002 0.02  0.05 </tableData></table>
    <table name="ITT_N1" type="internal"><tableData> 0 1\n 0 0 0\n 100 300 700 </tableData></table>
    </turboprop_engine>"""
PROPELLER = """<propeller version="1.1"><ixx>0.0005</ixx><diameter unit="IN">12</diameter>
    <numblades>2</numblades><ct_factor>0.02</ct_factor>
    <table name="C_THRUST" type="internal">
        <tableData> 0.0 0.08\n 0.6 0.05\n 4.0 0.01 </tableData></table>
    <table name="C_POWER" type="internal">
        <tableData> 0.0 0.05\n 0.6 0.03\n 4.0 -0.5 </tableData></table></propeller>"""
# The speeds of its shafts are those that JSBSim takes.
JET = """<turbine_engine name="jet"><milthrust>0.08</milthrust><maxthrust>0.12</maxthrust>
    <bleed>0.02</bleed><augmented>1</augmented><augmethod>{method}</augmethod>
    <function name="IdleThrust"><value>0.1</value></function>
    <function name="MilThrust"><product><value>0.9</value>
        <property>atmosphere/sigma</property></product></function>
    <function name="AugThrust"><value>0.95</value></function></turbine_engine>"""
MOTOR = '<electric_engine name="motor"><power unit="WATTS">30</power></electric_engine>'
GOVERNED = """<propeller><ixx unit="KG*M2">0.0003</ixx><diameter unit="M">0.4</diameter>
    <numblades>2</numblades><gearratio>1.5</gearratio><ct_factor>0.02</ct_factor>
    <cp_factor>0.8</cp_factor><minpitch>5</minpitch><maxpitch>35</maxpitch>
    <minrpm>1500</minrpm><maxrpm>2500</maxrpm>
    <table name="C_THRUST" type="internal"><tableData>
             5    35
        0.0  0.08 0.12
        0.9  0.02 0.07
        2.5  0.01 0.02 </tableData></table>
    <table name="C_POWER" type="internal"><tableData>
             5    35
        0.0  0.05 0.12
        0.9  0.01 0.08
        2.5 -0.05 0.01 </tableData></table>
    <table name="CT_MACH" type="internal">
        <tableData> 0.1 1.0\n 0.3 0.8 </tableData></table>
    <table name="CP_MACH" type="internal">
        <tableData> 0.1 1.0\n 0.3 1.3 </tableData></table>
    </propeller>"""

JSBSIM = Path(jsbsim.get_default_root_dir())
DIRECT, NOZZLE = "<direct/>", '<nozzle><area unit="{}">0.0005</area></nozzle>'
PISTON = """<piston_engine name="piston"><displacement unit="{0}">{1}</displacement>
    <stroke unit="{2}">{3}</stroke><minmp unit="{4}">{5}</minmp><maxhp unit="{6}">{7}</maxhp>
    <cycles>{8}</cycles><idlerpm>550</idlerpm><maxrpm>2700</maxrpm><bsfc unit="{9}">{10}</bsfc>
    {11}</piston_engine>"""
INCHES = "IN3", 320.0, "IN", 4.375, "INHG", 10.0, "HP", 160.0, 4, "LBS/HP*HR", 0.32
METRIC = "CC", 5200.0, "FT", 0.36, "PSI", 5.0, "WATTS", 120e3, 2, "KG/KW*HR", 0.2
LITRES = "LTR", 5.2, "M", 0.11, "ATM", 0.33, "HP", 160.0, 4, "LBS/HP*HR", 0.32
FEET = "FT3", 0.185, "IN", 4.375, "PA", 34e3, "HP", 160.0, 4, "LBS/HP*HR", 0.32
MIXTURE = """<table name="MIXTURE" type="internal">
    <tableData> 0.05 0.2\n 0.08 1.0\n 0.12 0.6 </tableData></table>
    <dynamic-fmep unit="INHG">5</dynamic-fmep><static-fmep unit="PA">40000</static-fmep>
    <man-press-lag>0.3</man-press-lag><peak-piston-speed>70</peak-piston-speed>
    <compression-ratio>7</compression-ratio>"""


def boosts(*speeds, **stated):
    """A supercharger of these speeds: boost (psi) and rated height (ft) of each."""
    stated |= {"numboostspeeds": len(speeds)}
    for k, (boost, height) in enumerate(speeds, 1):
        stated |= {f"ratedboost{k}": boost, f"ratedpower{k}": 150, f"ratedaltitude{k}": height}
        stated |= {f"ratedrpm{k}": 2600 + 50 * k}
    return "".join(f"<{tag}>{value}</{tag}>" for tag, value in stated.items())


SPUN = JET.replace("</turbine", "<bypassratio>2</bypassratio><n1spinup>4</n1spinup></turbine")
OLD = PROPELLER.replace('version="1.1"', "").replace('"IN">12', '"CM">30')
ENGINES = {
    "turboprop without a limit of torque": (TURBOPROP.format(torque=-1), PROPELLER),
    "turboprop": (TURBOPROP.format(torque=0.02), OLD),
    "turbine that burns at full lever": (JET.format(method=1), DIRECT),
    "turbine that burns beyond": (JET.format(method=2), NOZZLE.format("IN2")),
    "turbine of two streams": (SPUN.format(method=0), DIRECT),
    "electric with a governor": (MOTOR, GOVERNED),
    "electric that pushes": (MOTOR.replace('"WATTS">30', '"HP">1e-4'), DIRECT),
}
PISTONS = {
    "piston of two strokes": PISTON.format(*METRIC, MIXTURE),
    "piston with boosts by hand": PISTON.format(
        *INCHES, boosts((1, 0), (2, 9000), boostmanual=1, boostoverride=1)
    ),
}
# That of the aircraft itself, whose pressure at a start is found by what it shows.
CHARGED = boosts((2, 500), (2, 20_000), (3, 30_000), takeoffboost=3)
# Off the axis, askew, and with a propeller that turns the other way.
ASIDE = """<location unit="M"><x>-0.1</x><y>0.2</y><z>-0.05</z></location>
    <orient unit="DEG"><roll>5</roll><pitch>4</pitch><yaw>-3</yaw></orient>
    <sense>-1</sense><p_factor>3</p_factor>"""
PLACE = '<location unit="M"><x>0.05888</x><y>0</y><z>0</z></location>'
# Levers follow the roll, from idle to beyond the end.
LEVER = """<fcs_function name="test/lever-{0}"><function><sum><value>0.6</value><product>
    <value>3</value><property>attitude/phi-rad</property></product></sum></function>
    <clipto><min>0</min><max>1.3</max></clipto>
    <output>fcs/throttle-pos-norm[{0}]</output></fcs_function>"""
STALL = """<alphalimits unit="DEG"><min>-10</min><max>4</max></alphalimits>
    <hysteresis_limits unit="DEG"><min>3</min><max>4</max></hysteresis_limits>"""
LOADED = """<pointmass name="camera"><weight unit="KG">0.5</weight>
    <location unit="M"><x>0.03</x><y>0.02</y><z>-0.04</z></location></pointmass></mass_balance>"""
TANK = f'<tank type="FUEL">{PLACE}<capacity>1</capacity><contents>0.1</contents></tank>'

# The aerodynamic reference point moves with the angle of attack; a part of the lift acts at the CG.
SHIFT = """<function name="aero_ref_pt_shift_x"><product><value>0.05</value>
    <property>aero/alpha-rad</property></product></function>"""
AT_CG = """<function name="test/at-cg" apply_at_cg="true"><product><value>0.02</value>
    <property>aero/qbar-area</property></product></function>"""


def replaced(file, *changes):
    text = file.read_text("latin-1")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text, "latin-1")


def with_engines(folder, engines, aircraft="aerosonde"):
    """An aircraft with engines beside its own that hardly push; their levers follow its roll."""
    shutil.copytree(SHIPPED_AIRCRAFT / aircraft, folder)
    parts, file = folder / "Engines", folder / f"{aircraft}.xml"
    if not file.exists():
        parts.mkdir()
        shutil.copy(JSBSIM / f"aircraft/{aircraft}/{aircraft}.xml", folder)
        for name in ("prop_75in2f", "eng_io320"):
            shutil.copy(JSBSIM / f"engine/{name}.xml", parts)
        replaced(parts / "eng_io320.xml", ("</piston_engine>", f"{CHARGED}</piston_engine>"))
    numbered = dict(enumerate(engines, 1))
    for n, (motor, thruster) in numbered.items():
        (parts / f"motor{n}.xml").write_text(motor)
        (parts / f"thruster{n}.xml").write_text(thruster)
    more = "".join(
        f'<engine file="motor{n}"><feed>0</feed><thruster file="thruster{n}">'
        f"{ASIDE if 'electric' in motor else PLACE}</thruster></engine>"
        for n, (motor, _) in numbered.items()
    )
    levers = "".join(map(LEVER.format, numbered))
    system = f'<system name="levers"><channel name="levers">{levers}</channel></system>'
    tank = "" if "<tank" in file.read_text("latin-1") else TANK
    replaced(
        file,
        ("</propulsion>", f"{more}{tank}</propulsion>"),
        ("</aerodynamics>", f"<aero_ref_pt_shift_x>{SHIFT}</aero_ref_pt_shift_x></aerodynamics>"),
        ('<axis name="LIFT">', f'<axis name="LIFT">{AT_CG}'),
        ("<aerodynamics>", f"{system}<aerodynamics>"),
    )
    toml = folder / "aircraft.toml"
    if "[settings]" not in toml.read_text():
        replaced(toml, ("[engines]", '[settings]\n"propulsion/fuel_freeze" = 1.0\n\n[engines]'))
        replaced(toml, ('command = "fcs/throttle-pos-norm"', "settle_s = 12.0"))
    else:
        replaced(toml, (f'model  = "{aircraft}"', f'model = "{file.name}"'))
    mixed = "".join(f'"fcs/mixture-cmd-norm[{n}]" = 0.9\n' for n in numbered)
    replaced(toml, ("[settings]", f'[settings]\n"atmosphere/delta-T" = 9.0\n{mixed}'))
    replaced(toml, ("[engines]", f"[engines]\ncount = {1 + len(engines)}"))
    of_this_model(folder)
    return folder


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Rows of all properties of an aircraft with small engines, by JSBSim and compiled.

    It has a load beside its axis, signals of a stall, and axial and normal forces.
    """
    folder = with_engines(tmp_path_factory.mktemp("engines") / "aircraft", ENGINES.values())
    file = folder / "aerosonde.xml"
    text = in_other_axes(file.read_text("latin-1"), "AXIAL", "SIDE", "NORMAL")
    text = text.replace("<aerodynamics>", f"<aerodynamics>{STALL}")
    file.write_text(text.replace("</mass_balance>", LOADED), "latin-1")
    of_this_model(folder)
    return flown_by_both(varied(folder, mass_factor=1.02), 1.5)


@pytest.fixture(scope="module")
def charged(tmp_path_factory):
    """The same of one with several piston engines."""
    propeller = (JSBSIM / "engine/prop_75in2f.xml").read_text("latin-1")
    weak = propeller.replace("</propeller>", "<ct_factor>0.01</ct_factor></propeller>")
    pistons = [(motor, weak) for motor in PISTONS.values()]
    return flown_by_both(
        with_engines(tmp_path_factory.mktemp("pistons") / "aircraft", pistons, "c172p"), 5.0
    )


def all_driven(flown, engines):
    """Whether levers and thrusts of engines beside that of the aircraft moved, a lever too far."""
    levers, thrusts = (
        [flown[name.format(n)][0] for n in range(1, 1 + len(engines))]
        for name in ("fcs/throttle-pos-norm[{}]", "propulsion/engine[{}]/thrust-lbs")
    )
    moved = min(np.unique(x).size for x in thrusts) > 100 and min(map(np.ptp, levers)) > 0.3
    return moved and min(x.max() for x in levers) > 1.0


@pytest.mark.slow
def test_turboprops_jets_with_afterburners_and_governed_propellers_are_those_of_jsbsim(driven):
    assert all_driven(driven, ENGINES)
    assert {*np.unique(driven["aero/stall-hyst-norm"][0])} == {0.0, 1.0}
    assert differing(driven) == []
    # Functions that JSBSim looks for by name are shown below their engine.
    jets = [n for n, (motor, _) in enumerate(ENGINES.values(), 1) if "MilThrust" in motor]
    assert {f"propulsion/engine[{n}]/MilThrust" for n in jets} <= driven.keys()


@pytest.mark.slow
def test_a_supercharger_of_several_speeds_is_that_of_jsbsim_to_the_bit(charged):
    assert all_driven(charged, PISTONS)
    assert differing(charged) == []
    manifold, _ = charged["propulsion/engine/map-pa"]
    ambient, _ = charged["atmosphere/P-psf"]
    assert manifold.max() > 47.88 * ambient.max()  # Pa in a psf: no engine without one gets there


GUST = {"axis": "down", "peak": 1.5, "start": 0.05, "rise": 0.15, "hold": 0.05}
AIRS = {
    "gust ahead": {"gust": GUST | {"axis": "ahead", "peak": -3.0}},
    "gust from the side": {"gust": GUST | {"axis": "right"}, "wind": (3.0, -2.0, 0.1)},
    "turbulence of Tustin's rule": {"turbulence": {"model": "tustin"}, "gust": GUST},
    "turbulence of the first order": {"turbulence": {"model": "milspec"}, "wind": (3.0, -2.0, 0.1)},
}
# m: below, between and beyond the heights of MIL-F-8785C, 1000 and 2000 ft
HEIGHTS = 3.0, 400.0, 1000.0


@pytest.mark.slow
@pytest.mark.parametrize("name", AIRS)
def test_the_air_is_that_of_jsbsim_at_any_height(name):
    keys = dict(AIRS[name])
    if rough := keys.get("turbulence"):
        keys["turbulence"] = {"severity": 4, "wind_20ft": 6.0} | rough
    for h in HEIGHTS if rough else HEIGHTS[-1:]:
        condition = ft.loop.FlightCondition(V_a=27.0, h=h, chi=2.5, gamma=0.1, phi=0.3)

        flown = flown_by_both("aerosonde", 0.45, condition, weather=blowing(**keys))

        assert differing(flown) == []
        assert np.ptp(flown["atmosphere/total-wind-down-fps"][1]) > 0.0 or "gust" not in keys


def standard_density(h):
    """ICAO Doc 7488 up to 20 km, kg/m3."""
    T = 288.15 - 0.0065 * min(h, 11_000.0)
    p = 101325.0 * (T / 288.15) ** 5.25588 * np.exp(-9.80665 * max(h - 11e3, 0.0) / 287.05287 / T)
    return p / (287.05287 * T)


@pytest.mark.slow
def test_the_atmosphere_is_that_of_jsbsim_in_every_layer():
    """Thin air with as much more lift: the aircraft flies as at 1000 m, up to 38 km."""
    for h in (100.0, 11_100.0, 21_000.0, 33_000.0):
        thinner = 1.1116 / standard_density(h) if h < 2e4 else 1.1116 / (0.0757, 0.0114)[h > 3e4]
        axes = "lift", "drag", "side_force", "roll_moment", "pitch_moment", "yaw_moment"
        off = varied("aerosonde", **{f"{axis}_factor": thinner for axis in axes})
        condition = ft.loop.FlightCondition(V_a=25.0, h=h)

        assert differing(flown_by_both(off, 0.1, condition)) == []


KNOWN = {
    "operations of functions": {name.partition(" ")[0] for name in OPERATORS} | {"t"},
    "components": {name.partition(" ")[0] for name in COMPONENTS} | {"distributor"},
    "engines": {name.partition(" ")[0] for name in (*ENGINES, *PISTONS)} | {"rocket"},
    "thrusters": {"direct", "nozzle", "propeller"},
    "axes of forces": {"LIFT, DRAG, SIDE", "AXIAL, SIDE, NORMAL", "X, Y, Z"},
}


def told():
    """What the page says that compiling knows, by kind."""
    page = (ROOT / "docs/compiled.md").read_text(encoding="utf-8")
    part = page.partition("## Which parts\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| ([^|]+) \| (`.+`) \|$", part, re.MULTILINE)
    return {kind: {*re.findall("`([^`]+)`", names)} for kind, names in rows}


def test_the_page_and_the_tables_of_parts_name_the_same_ones():
    assert told() == KNOWN


def in_function(text):
    """The change that adds a function to the drag."""
    return (
        "aerosonde.xml",
        '<axis name="DRAG">',
        f'<axis name="DRAG"><function name="a/more">{text}</function>',
    )


def in_channel(text):
    part = f'<system name="more"><channel name="more">{text}</channel></system><aerodynamics>'
    return "aerosonde.xml", "<aerodynamics>", part


PLACES_OF = "".join(
    f"<{end}_{axis}>position/lat-geod-rad</{end}_{axis}>"
    for end in ("source", "target")
    for axis in ("latitude", "longitude")
)
X = "<property>aero/alpha-rad</property>"
INPUT = "<input>aero/alpha-rad</input>"
UNKNOWN = {
    "<random> in a function": in_function("<random/>"),
    "<urandom> in a function": in_function("<urandom/>"),
    "<rotation_bf_to_wf> in a function": in_function(
        f"<rotation_bf_to_wf>{X * 6}<value>1</value>"
        "</rotation_bf_to_wf>"
    ),
    "<interpolate1d> between points that change": in_function(
        f"<interpolate1d>{X}<value>1</value>{X}<value>2</value><value>3</value></interpolate1d>"
    ),
    "the component <waypoint_heading>": in_channel(
        f'<waypoint_heading name="to">{PLACES_OF}</waypoint_heading>'
    ),
    "the component <magnetometer>": in_channel(
        '<magnetometer name="m"><axis>X</axis><location unit="M"><x>0</x><y>0</y><z>0</z>'
        "</location><orientation><x>0</x><y>0</y><z>0</z></orientation></magnetometer>"
    ),
    "the component <linear_actuator>": in_channel(
        f'<linear_actuator name="l">{INPUT}</linear_actuator>'
    ),
    "<noise> in <sensor>": in_channel(
        f'<sensor name="s">{INPUT}<noise variation="ABSOLUTE">0.1</noise></sensor>'
    ),
    "<drift_rate> in <sensor>": in_channel(
        f'<sensor name="s">{INPUT}<drift_rate>0.1</drift_rate></sensor>'
    ),
    '`velocities/machU`, taken for constant, is moved by JSBSim': in_function(
        "<product><property>velocities/machU</property><value>1e-9</value></product>"
    ),
    "axes of aerodynamics in a frame of their own": (
        "aerosonde.xml", '<axis name="ROLL">', '<axis name="ROLL" frame="STABILITY">'
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", UNKNOWN)
def test_what_compiling_does_not_know_is_refused_by_its_name(what, tmp_path):
    folder = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", tmp_path / "aircraft")
    file, old, new = UNKNOWN[what]
    replaced(folder / file, (old, new))
    of_this_model(folder)

    assert what in ft.trim(folder, V_a=[25.0], gamma=[0.0]).not_compiled
