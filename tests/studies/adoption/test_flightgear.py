"""Values that FlightGear's files state: read as SimGear reads them, and used by an adoption."""

import os
import re

import jsbsim
import numpy as np
import pytest
from book_aeroplane import differs, flown_by, found_of, value

import flighttune as ft

SET = """<PropertyList{}><sim><flight-model>jsb</flight-model><aero>tuned</aero></sim>{}
</PropertyList>"""


def fdm(text):
    return f"<fdm><jsbsim>{text}</jsbsim></fdm>"


@pytest.fixture
def stated(tmp_path, beside):
    """What a description with a text in its root states, beside other files by name."""

    def stated(text="", include="", **files):
        folder = tmp_path / "Tuned"
        folder.mkdir(exist_ok=True)
        (folder / "tuned.xml").write_text("<fdm_config/>")
        for name, content in files.items():
            (folder / f"{name}.xml").write_text(f"<PropertyList>{content}</PropertyList>")
        included = f' include="{include}"' if include else ""
        (folder / "tuned-set.xml").write_text(SET.format(included, text))
        return beside(folder / "tuned.xml")

    return stated


# By SimGear's reader, simgear/props/props_io.cxx: atoi, atof and strtod take the beginning of a
# text, only bool knows "true", and an index is counted in each element of a file.
@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("<x>1.5</x>", {"x": 1.5, "x[0]": 1.5, "/fdm/jsbsim/x": 1.5, "y": None}),
        ("<x type='double'> 1.5e1 m</x>", {"x": 15.0}),
        ("<x type='float'>0.1</x>", {"x": float(np.float32(0.1))}),
        ("<x type='int'>3.7</x>", {"x": 3.0}),
        ("<x type='bool'>true</x><y type='bool'>7</y>", {"x": 1.0, "y": 1.0}),
        ("<x type='bool'>false</x><y type='bool'>yes</y>", {"x": 0.0, "y": 0.0}),
        ("<x>true</x><y type='string'>2.5</y><z/>", {"x": 0.0, "y": 2.5, "z": 0.0}),
        ("<x>1<!-- 2 -->3</x><!-- <y>4</y> -->", {"x": 13.0, "y": None}),
        ("<x>1e999</x><y>nan</y>", {"x": None, "y": 0.0}),
        ("<t n='0'><x>1</x></t><t n='2'><x>2</x></t>", {"t/x": 1, "t[2]/x": 2, "t[1]/x": None}),
        ("<x>1</x><x>2</x><x n='5'>3</x><x>4</x>", {"x": 1, "x[1]": 2, "x[5]": 3, "x[6]": 4}),
        ("<x n='5'>1</x><x n='2'>2</x><x>3</x>", {"x[5]": 1, "x[2]": 2, "x[6]": 3, "x[3]": None}),
        ("<a><x>1</x></a><a><x>2</x></a>", {"a/x": 1, "a[1]/x": 2}),
        ("<a>7<x>1</x></a>", {"a": None, "a/x": 1}),
        ("<x alias='/fdm/jsbsim/y'/><y>3</y>", {"x": 3}),
        ("<x alias='../y'>9</x><y>3</y>", {"x": 3}),
        ("<x alias='../y'/><y alias='../z'/><z>3</z>", {"x": 3, "y": 3}),
        ("<x alias='../y'/><y alias='../x'/>", {"x": None}),
        ("<x alias='/controls/x'/>", {"x": None}),
        ("<a><x>1</x></a>", {"a//x": 1, "./a/x": 1, "a/x/": 1, "a[0]x": 1, "b/../a/x": 1}),
    ],
)
def test_values_are_those_of_simgear(stated, text, values):
    found = stated(fdm(text))

    assert {name: found.of(name) for name in values} == values


def test_a_second_element_of_a_name_is_another_one(stated):
    found = stated(fdm("<x>1</x>") + fdm("<x>2</x>") + "<fdm n='0'><jsbsim><y>3</y></jsbsim></fdm>")

    assert [found.of(name) for name in ("x", "/fdm[1]/jsbsim/x", "y")] == [1.0, 2.0, 3.0]


def test_a_file_states_over_those_that_it_includes(stated):
    found = stated(
        fdm("<x>1</x><t include='t.xml'><z>9</z></t><u include='t.xml'/>"),
        include="common.xml",
        common=fdm("<x>5</x><y>6</y>") + "<controls include='t.xml'/>",
        t="<y>7</y><z>8</z>",
    )

    names = "x", "y", "t/y", "t/z", "u/z", "/controls/y"
    assert [found.of(name) for name in names] == [1.0, 6.0, 7.0, 9.0, 8.0, 7.0]
    assert not found.unread


def test_a_file_is_named_from_the_folder_of_the_aircraft_too(stated):
    assert stated(include="Aircraft/Tuned/common.xml", common=fdm("<x>5</x>")).of("x") == 5.0


@pytest.mark.parametrize(
    ("include", "why"),
    [
        ("gone.xml", "gone.xml, which tuned-set.xml includes, is not there"),
        ("Aircraft/Generic/x.xml", "is not there"),
        ("http://example.org/x.xml", "is not there"),
        ("../outside.xml", "is not in the folder of the aircraft"),
        ("/etc/hosts", "is not in the folder of the aircraft"),
        ("link.xml", "is not in the folder of the aircraft"),
        ("pipe.xml", "is not there"),
        ("broken.xml", "cannot be read .*must be XML"),
    ],
)
def test_what_is_not_read_is_said_of_the_properties_below_it(stated, tmp_path, include, why):
    (tmp_path / "outside.xml").write_text(f"<PropertyList>{fdm('<x>5</x>')}</PropertyList>")
    stated()
    (tmp_path / "Tuned/link.xml").symlink_to("../outside.xml")
    os.mkfifo(tmp_path / "Tuned/pipe.xml")
    (tmp_path / "Tuned/broken.xml").write_text("<PropertyList>")

    found = stated(f"<fdm include='{include}'/>")

    assert found.of("x") is None
    (said,) = found.faults(["x", "/controls/y"])
    assert re.search(why, said)
    assert not found.faults(["/controls/y"])


@pytest.mark.parametrize("size", ["wide", "deep", "large"])
def test_what_a_description_includes_is_bounded(stated, size, tmp_path):
    deep = "<a>" * 100 + "</a>" * 100
    files = {
        "wide": {"t": "<a include='u.xml'/>" * 20, "u": "<a include='v.xml'/>" * 20, "v": ""},
        "deep": {"t": deep},
        "large": {"t": f"<!--{'x' * 8_000_000}-->"},
    }[size]

    stated("<fdm include='t.xml'/>", **files)

    with pytest.raises(ft.InputError, match=r"at most (200 files with 8 MB|60 levels), got more"):
        ft.adopt(str(tmp_path / "Tuned/tuned-set.xml"), tmp_path / "mine")


FACTOR = "<property>tuning/factor</property>"
PARASITE, DAMPING = "aero/force/parasite", "aero/moment/roll-damping"


def apart(axis, name, *factors):
    """The change of a model that gives an axis a function of its own behind a factor."""
    product = "".join((FACTOR, *factors))
    function = f'<function name="{name}"><product>{product}</product></function>'
    return f'<axis name="{axis}">', f'<axis name="{axis}">{function}'


# Of the book's 0.043 and of its damping in roll, what the factor is before.
DRAG = (
    (r"(CD_0.)> 0.043 <", r"\1> 0.02 <"),
    apart("DRAG", PARASITE, "<property>aero/qbar-S</property><value>0.023</value>"),
)
ROLL = (
    (r"(Cl_p.> <value>) -0.51 ", r"\1 0.0 "),
    apart(
        "ROLL", DAMPING, "<property>aero/qbar-S-b</property><value>-0.51</value>"
        "<property>aero/p-hat</property>",
    ),
)  # fmt: skip
TUNING = "<tuning n='0'><factor type='double'>{}</factor></tuning>"
LEVEL = 0.0232 * (1.48 / 1.6**2) ** 2  # of the drag, which lift induces at 1.6 times the stall


@pytest.fixture
def aircraft(own, surveyed):
    """What is found of the book's aeroplane with changes, and with what descriptions state."""

    def aircraft(*changes, sets=(), parts=(), tops=(), **asked):
        file = own(*flown_by(parts=parts, tops=tops), *changes)
        for i, values in enumerate(sets):
            text = SET.format("", fdm(values)).replace("tuned", "aerosonde")
            file.with_name(f"tuned{i or ''}-set.xml").write_text(text)
        return surveyed(file, **asked)

    return aircraft


DEFINED = '<system name="s"><property value="{}">tuning/factor</property></system>'


# What a system defines is not overwritten: JSBSim says "Property tuning/factor is already defined."
@pytest.mark.soak
@pytest.mark.parametrize(
    ("asked", "notes"),
    [
        ({"sets": [TUNING.format("1.0")]}, ["tuned-set.xml states tuning/factor = 1"]),
        ({"sets": [TUNING.format(0.25)], "values": {"tuning/factor": 1.0}}, []),
        ({"sets": [TUNING.format("1.0")], "tops": [DEFINED.format(0.5)]}, None),
        ({"sets": [TUNING.format("1.0")], "tops": [DEFINED.format(1.0)]}, None),
    ],
)
def test_a_factor_that_flightgear_states_is_that_of_the_model(aircraft, asked, notes):
    """With the factor 1 the aircraft is the book's."""
    found = aircraft(*DRAG, *ROLL, **asked)

    share = (0.02 + LEVEL) / (0.043 + LEVEL)
    values = found_of() | {"largest_drag": ("aero/force/drag", share)}
    values["declared"] = {"tuning/factor": 1.0}
    got = {name: value(found, name) for name in values}
    assert {name: x for name, x in got.items() if differs(x, values[name])} == {}
    assert notes in (None, [*found.notes])


def test_a_coefficient_that_a_zero_switches_off_is_named_with_its_weight(aircraft):
    found = aircraft(*DRAG, *ROLL)

    (drag, roll) = found.switched_off
    assert (drag.function, drag.names, drag.axis) == (PARASITE, ("tuning/factor",), "drag")
    assert drag.share == pytest.approx(0.023 / (0.043 + LEVEL), rel=1e-3)
    assert (roll.function, roll.axis) == (DAMPING, "roll moment")
    assert roll.share == pytest.approx(1.0, rel=1e-3)  # in a roll nothing else acts on it
    (said,) = (note for note in found.notes if "switches off" in note)
    assert said.startswith(f"tuning/factor of another simulator is 0 and switches off {PARASITE}")
    assert f"{DAMPING} (with 1 up to 100 % of the roll moment)" in said
    assert f"(with 1 up to {drag.share:.0%}".replace("%", " %") in said
    assert "--set tuning/factor=VALUE states it" in said


@pytest.mark.soak
def test_two_zeros_in_a_product_are_both_named(aircraft):
    both = tuple(
        x.replace(FACTOR, f"{FACTOR}<property>/controls/other</property>") for x in DRAG[1]
    )
    found = aircraft(DRAG[0], both)

    (drag,) = found.switched_off
    assert drag.names == ("tuning/factor", "/controls/other")
    (said,) = found.notes
    assert said.startswith("tuning/factor and /controls/other of another simulator are 0")
    assert "--set tuning/factor=VALUE states them" in said


@pytest.mark.soak
@pytest.mark.parametrize("how", ["states", "sets"])
def test_a_zero_that_is_stated_is_no_question(aircraft, how):
    given = {"sets": [TUNING.format("0")]} if how == "states" else {}
    found = aircraft(*DRAG, values={} if how == "states" else {"tuning/factor": 0.0}, **given)

    assert not found.switched_off
    said = ["tuned-set.xml states 0 for tuning/factor"] if how == "states" else []
    assert [*found.notes] == said


def test_values_in_which_descriptions_differ_are_not_taken(aircraft):
    other = TUNING.format(2) + "<trim-a>3</trim-a>"
    (said,) = aircraft(*DRAG, sets=[TUNING.format(1), other]).notes

    assert "switches off" in said
    assert "tuned-set.xml and tuned1-set.xml state several values of tuning/factor" in said


def test_a_refusal_names_the_zero_that_may_be_its_reason(aircraft):
    lift = r'(<function name="aero/force/lift">\s*<product>)', rf"\1{FACTOR}"
    wanted = (
        "lifts too little: .* tuning/factor, which is of .*: --set tuning/factor=VALUE states it$"
    )

    with pytest.raises(ft.loop.PlantError, match=wanted):
        aircraft(lift)


def test_gear_and_flaps_are_in_whatever_a_parked_aircraft_states(aircraft):
    lever = '<pure_gain name="s/drag"><input>systems/gear-cmd</input><gain>1</gain></pure_gain>'
    found = aircraft(sets=["<systems><gear-cmd>1</gear-cmd></systems>"], parts=[lever])

    assert found.tables["declared"] == {"systems/gear-cmd": 0.0}
    assert "systems/gear-cmd is 0 as in flight, 1 is stated" in found.notes


NAMES = (
    *("/a/tank[0]level-gal_us", "//a/b", "/a/./c", "/a/d/", "/a/../e/f"),
    *("a//b", "./c/d", "a[1]/b[2]/c[3]"),
)


@pytest.mark.soak
def test_names_are_written_as_jsbsim_takes_them(aircraft):
    """Each name in the tables leads JSBSim to the node to which the name in the model does."""
    gauges = [
        f'<pure_gain name="fcs/gauge{i}"><input>{name}</input><gain>1</gain></pure_gain>'
        for i, name in enumerate(NAMES)
    ]
    stated = {name: i + 0.123456789 for i, name in enumerate(NAMES)}

    found = aircraft(parts=gauges, values=stated)

    written = found.tables["declared"]
    tree = jsbsim.FGFDMExec(jsbsim.get_default_root_dir()).get_property_manager()
    for i, name in enumerate(NAMES):
        (own,) = (key for key, x in written.items() if x == i + 0.123456789)
        nodes = [tree.get_node(x, True).get_fully_qualified_name() for x in (name, own)]
        assert nodes[0] == nodes[1]
