"""Commands behind switches of another simulator, and properties that are read late."""

import re

import pytest
from book_aeroplane import FULL, POSITIONS, differs, found_of, gain, more, system, value


def component(kind, inside):
    return f'<{kind} name="fcs/{{axis}}-gated">{inside}</{kind}>'


def function(inside):
    return component("fcs_function", f"<function>{inside}</function>")


def product(*names):
    factors = "".join(f"<property>{name}</property>" for name in names)
    return f"<product>{factors}</product>"


CMD, ON = "fcs/{axis}-cmd-norm", "/controls/fbw/switch"
INPUT = f"<input>{CMD}</input>"
TABLE = (
    f"<table><independentVar>{ON}</independentVar>"
    "<tableData> 0.0 0.0 \n 20.0 0.0 \n 28.0 1.0 \n</tableData></table>"
)


def switch(test):
    return component("switch", f'<default value="0"/><test value="{CMD}"> {test} </test>')


# What stands between a command and the flight control, and the values that switch it on.
GATES = {
    "product": (function(product(CMD, ON)), {ON: 1}),
    "two in series": (function(product(CMD, ON, "/systems/bus")), {ON: 1, "/systems/bus": 1}),
    "three in series": (
        function(product(CMD, "/a/x", "/b/x", "/c/x")), {"/a/x": 1, "/b/x": 1, "/c/x": 1}
    ),
    "a function before": (
        '<fcs_function name="fcs/power"><function>' + product("/systems/bus", "/systems/generator")
        + "</function></fcs_function>" + function(product(CMD, "fcs/power")),
        {"/systems/bus": 1, "/systems/generator": 1},
    ),
    "switch": (switch(f"{ON} == 1"), {ON: 1}),
    "switch of several": (switch(f"{ON} gt 0.5 \n /systems/bus ge 1"), {ON: 1, "/systems/bus": 1}),
    "mode": (switch(f"{ON} eq 2"), {ON: 2}),
    "volts": (switch(f"{ON} gt 20"), {ON: 21}),
    "below zero": (switch(f"{ON} lt -0.5"), {ON: -1}),
    "compared": (
        function(
            f"<ifthen><ge><property>{ON}</property><value>24</value></ge>"
            f"<property>{CMD}</property><value>0</value></ifthen>"
        ),
        {ON: 24},
    ),
    "table": (function(f"<product><property>{CMD}</property>{TABLE}</product>"), {ON: 28}),
    "gain": (component("pure_gain", f"{INPUT}<gain>{ON}</gain>"), {ON: 1}),
    "pid": (component("pid", f"{INPUT}<kp>{ON}</kp><ki>0</ki><kd>0</kd>"), {ON: 1}),
    "limits": (
        component("summer", f"{INPUT}<clipto><min>-{ON}</min><max>{ON}</max></clipto>"), {ON: 1}
    ),
    "smoothed": (
        function(product(CMD, ON)).replace("gated", "raw") + component(
            "kinematic",
            "<input>fcs/{axis}-raw</input><traverse><setting><position>-1</position><time>0.1"
            "</time></setting><setting><position>1</position><time>0.1</time></setting></traverse>",
        ),
        {ON: 1},
    ),
    # beside zeros that stop the command again, and one that is not on its way
    "beside harm": (
        function(
            f"<product><property>{CMD}</property><property>{ON}</property>"
            "<property>/systems/bus</property><difference><value>1</value>"
            "<property>/controls/fault</property></difference></product>"
        ) + '<pure_gain name="fcs/lamp"><input>/lamp</input><gain>1</gain></pure_gain>',
        {ON: 1, "/systems/bus": 1},
    ),
}  # fmt: skip


@pytest.fixture
def gated(own, surveyed):
    """What is found of the book's aeroplane with gates by axis, further parts, and text before."""

    def gated(gates, *parts, before=""):
        texts = [gate.replace("{axis}", axis) for axis, gate in gates.items()]
        behind = [gain(x, source=f"fcs/{x}-gated" if x in gates else None) for x in POSITIONS]
        return surveyed(own(more(before, system(*texts, *behind, *parts))))

    return gated


def is_same(found, **others):
    """Whether a survey has the values of the book's aeroplane, but for others."""
    values = found_of() | {"declared": None, "settings": None} | others
    got = {name: value(found, name) for name in values}
    assert {name: x for name, x in got.items() if differs(x, values[name])} == {}
    return True


def says(found, values):
    """Whether the notes name each value with its option, and nothing else is assumed."""
    said = [note for note in found.notes if "assumed" in note]
    options = {x for note in said for x in re.findall(r"--set (\S+)", note)}
    assert options == {f"{name}={value:g}" for name, value in values.items()}
    return True


NOW = "mode", "three in series", "table"
MORE = (
    "product",
    "a function before",
    "switch",
    "volts",
    "below zero",
    "gain",
    "pid",
    "two in series",
)
AXES = {kind: [*POSITIONS][i % 3] for i, kind in enumerate(GATES)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(
            x, marks=[pytest.mark.soak] * (x not in NOW) + [pytest.mark.counts] * (x in MORE)
        )
        for x in GATES
    ],
)
def test_a_command_behind_switches_is_that_of_the_aircraft_with_them_on(gated, kind):
    gate, values = GATES[kind]

    found = gated({AXES[kind]: gate})

    assert says(found, values)
    tables = found.tables["declared"]
    others = {name: 0.0 for name in tables if name not in values}
    assert is_same(found, declared=values | others)


# Gates of several commands: gates by axis, text before the flight control, values that are found.
TOGETHER = {
    "one of all": (dict.fromkeys(POSITIONS, GATES["product"][0]), "", {ON: 1}),
    "one each": (
        {axis: function(product(CMD, f"/controls/{axis}-on")) for axis in POSITIONS},
        "",
        {f"/controls/{axis}-on": 1 for axis in POSITIONS},
    ),
    "its own": (
        {"aileron": function(product(CMD, "systems/fbw"))},
        '<system name="s"><property value="0">systems/fbw</property></system>',
        {"systems/fbw": 1},
    ),
    "of two, in series of another": (
        {"aileron": GATES["two in series"][0], "elevator": GATES["product"][0]},
        "",
        {ON: 1, "/systems/bus": 1},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(x, marks=[pytest.mark.soak] * (x in ("one each", "one of all")))
        for x in TOGETHER
    ],
)
def test_switches_of_several_commands_are_each_found(gated, kind):
    gates, before, values = TOGETHER[kind]

    found = gated(gates, before=before)

    assert says(found, values)
    assert is_same(found)
    assert values.items() <= {**found.tables["declared"], **found.tables["settings"]}.items()


# Gates that with 1 change something that moves without them, so that they stay at 0.
HARM = {
    "another surface": {
        "aileron": function(product(CMD, ON)),
        "elevator": function(
            f"<product><property>{CMD}</property><difference><value>1</value><product>"
            f"<value>0.5</value><property>{ON}</property></product></difference></product>"
        ),
    },
    "an autopilot": {
        "aileron": function(product(CMD, ON)),
        "elevator": function(
            f"<sum><property>{CMD}</property>{product('velocities/q-rad_sec', ON)}</sum>"
        ),
    },
    "a bias": {
        "aileron": function(product(CMD, ON)),
        "elevator": function(
            f"<sum><property>{CMD}</property><product><value>0.1</value><property>{ON}</property>"
            "</product></sum>"
        ),
    },
}  # fmt: skip


@pytest.mark.parametrize(
    "kind",
    [pytest.param(x, marks=pytest.mark.soak if x != "a bias" else pytest.mark.slow) for x in HARM],
)
def test_a_switch_that_changes_what_moves_stays_and_only_the_dead_surface_is_replaced(gated, kind):
    found = gated(HARM[kind])

    assert says(found, {})
    assert found.tables["declared"][ON] == 0.0
    (said,) = (note for note in found.notes if "bypassed for its aileron" in note)
    assert f"--set {ON}=VALUE" in said
    past = {**FULL, "replaces": [POSITIONS["aileron"]]}
    assert is_same(found, surfaces={"aileron": past, "elevator": FULL, "rudder": FULL})


LEVER = "fcs/throttle-cmd-norm"


@pytest.mark.soak
@pytest.mark.parametrize(
    ("inside", "values"),
    [
        (product(LEVER, ON, "/systems/bus"), {ON: 1, "/systems/bus": 1}),
        (f"<product><property>{LEVER}</property>{TABLE}</product>", {ON: 28}),
        # /open opens it whatever its command is
        (f"<max>{product(LEVER, ON)}<property>/open</property></max>", {ON: 1}),
    ],
)
def test_a_throttle_behind_switches_is_that_of_the_aircraft_with_them_on(gated, inside, values):
    output = "<output>fcs/throttle-pos-norm</output>"
    gate = f'<fcs_function name="fcs/lever"><function>{inside}</function>{output}</fcs_function>'

    found = gated({}, gate)

    assert says(found, values)
    assert is_same(found)


LAMP = "/gear/gear[1]/wow"


def lamp(test, name=LAMP):
    """An indicator that reads a property only while a test holds."""
    value, compared, bound = test.split()
    return (
        f'<fcs_function name="fcs/lamp"><function><ifthen><{compared}>'
        f"<property>{value}</property><value>{bound}</value></{compared}>"
        f"<property>{name}</property><value>0</value></ifthen></function></fcs_function>"
    )


LATE = (
    "gear/gear-cmd-norm lt 0.5",
    "fcs/throttle-cmd-norm gt 0.9",
    "simulation/sim-time-sec gt 30",
    "velocities/vt-fps gt 400",
    "attitude/phi-rad gt 0.2",
)


@pytest.mark.parametrize(
    "test",
    [
        pytest.param(test, marks=pytest.mark.counts if i else pytest.mark.slow)
        for i, test in enumerate(LATE)
    ],
)
def test_a_property_that_is_read_late_is_0(gated, test):
    assert is_same(gated({}, lamp(test)), declared={LAMP: 0.0})
