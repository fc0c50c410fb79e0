"""Each operator and component of JSBSim's files against JSBSim, on one aircraft with all."""

import numpy as np
import pytest
from airframes import changed_aerosonde
from compiled_flights import flown_by_both

from flighttune.vehicles.compiled.components import _COMPONENTS
from flighttune.vehicles.compiled.functions import _OPERATIONS

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


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Rows of all properties of the test, by JSBSim and compiled."""

    def change(text):
        return text.replace("<aerodynamics>", f"{SYSTEM}<aerodynamics>")

    folder = changed_aerosonde(tmp_path_factory.mktemp("parts") / "aircraft", change)
    return flown_by_both(folder, 4.0)


@pytest.mark.parametrize(
    "name", [*(f"of {name}" for name in OPERATORS), *COMPONENTS, *(x[5:] for x in OTHERS)]
)
def test_it_is_that_of_jsbsim_to_the_bit(flown, name):
    expected, actual = flown[identifier(name)]

    assert np.unique(expected).size > 1
    assert np.array_equal(expected, actual)


def test_no_operator_and_no_component_is_forgotten():
    assert _OPERATIONS.keys() <= OPERATORS.keys()
    assert _COMPONENTS.keys() == {name.partition(" ")[0] for name in COMPONENTS}
