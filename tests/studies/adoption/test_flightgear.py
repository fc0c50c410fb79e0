"""Values that FlightGear's files state: read as SimGear reads them, and used by an adoption."""

import os
import re
from pathlib import Path

import jsbsim
import numpy as np
import pytest

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


C172P = (Path(jsbsim.get_default_root_dir()) / "aircraft/c172p/c172p.xml").read_text("latin-1")
FACTOR = "<property>tuning/factor</property>"


@pytest.fixture
def aircraft(tmp_path):
    """The c172p of JSBSim with changed texts, a factor on some functions, and descriptions."""

    def write(*functions, sets=(), changes=()):
        text = C172P
        for name in functions:
            part = re.search(rf'<function name="{name}">.*?</function>', text, re.DOTALL)[0]
            assert "<product>" in part
            text = text.replace(part, part.replace("<product>", f"<product>{FACTOR}", 1))
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        for i, values in enumerate(sets):
            (tmp_path / f"tuned{i or ''}-set.xml").write_text(SET.format("", fdm(values)))
        (tmp_path / "tuned.xml").write_text(text, "latin-1")
        return tmp_path / "tuned.xml"

    return write


TUNING = "<tuning n='0'><factor type='double'>{}</factor></tuning>"
CDO, CLP = "aero/coefficient/CDo", "aero/coefficient/Clp"


@pytest.fixture(scope="module")
def glide_of_c172p(surveyed):
    return surveyed("c172p").glide_ratio


@pytest.mark.slow
def test_a_factor_that_flightgear_states_is_that_of_the_model(aircraft, surveyed, glide_of_c172p):
    """With the factor 1 the aircraft is the c172p of the wheel, to the digit."""
    found = surveyed(aircraft(CDO, sets=[TUNING.format("1.0")]))

    assert found.tables["declared"]["tuning/factor"] == 1.0
    assert found.glide_ratio == glide_of_c172p
    assert "tuned-set.xml states tuning/factor = 1" in found.notes
    assert not found.switched_off


@pytest.mark.soak
@pytest.mark.parametrize("value", [0.5, 1.0])
def test_what_a_system_defines_has_the_value_that_is_stated_before_it(
    aircraft, surveyed, glide_of_c172p, value
):
    """JSBSim: "Property tuning/factor is already defined. Its value will not be overridden."."""
    system = f'<system name="s"><property value="{value}">tuning/factor</property></system>'
    file = aircraft(
        CDO, sets=[TUNING.format(1.0)], changes=[("<flight_control", f"{system}<flight_control")]
    )

    assert surveyed(file).glide_ratio == glide_of_c172p


@pytest.mark.soak
def test_what_is_set_stands_before_what_is_stated(aircraft, surveyed, glide_of_c172p):
    file = aircraft(CDO, sets=[TUNING.format(0.25)])

    assert surveyed(file, values={"tuning/factor": 1.0}).glide_ratio == glide_of_c172p


@pytest.mark.slow
def test_a_coefficient_that_a_zero_switches_off_is_named_with_its_weight(aircraft, surveyed):
    """Without CDo about half of the drag is left: its glide ratio is near twice that of 10.3."""
    found = surveyed(aircraft(CDO, CLP))

    (drag, roll) = found.switched_off
    assert (drag.function, drag.names, drag.axis) == (CDO, ("tuning/factor",), "drag")
    assert 1.0 - drag.share == pytest.approx(10.26 / found.glide_ratio, abs=0.05)
    assert (roll.function, roll.axis) == (CLP, "roll moment")
    assert roll.share > 0.9  # in a roll nothing else acts on it
    (said,) = (note for note in found.notes if "switches off" in note)
    assert "tuning/factor of another simulator is 0 and switches off aero/coefficient/CDo" in said
    assert "--set tuning/factor=VALUE states it" in said


@pytest.mark.soak
def test_two_zeros_in_a_product_are_both_named(aircraft, surveyed):
    file = aircraft(CDO, changes=[(FACTOR, f"{FACTOR}<property>/controls/other</property>")])

    (drag,) = surveyed(file).switched_off
    assert drag.names == ("tuning/factor", "/controls/other")


@pytest.mark.soak
@pytest.mark.parametrize("how", ["states", "sets"])
def test_a_zero_that_is_stated_is_no_question(aircraft, surveyed, how):
    file = aircraft(CDO, sets=[TUNING.format("0")] if how == "states" else [])
    found = surveyed(file, values={} if how == "states" else {"tuning/factor": 0.0})

    assert not found.switched_off
    assert ("tuned-set.xml states 0 for tuning/factor" in found.notes) == (how == "states")


@pytest.mark.slow
def test_values_in_which_descriptions_differ_are_not_taken(aircraft, surveyed):
    file = aircraft(CDO, sets=[TUNING.format(1), TUNING.format(2) + "<trim-a>3</trim-a>"])
    (said,) = (note for note in surveyed(file).notes if "switches off" in note)

    assert "tuned-set.xml and tuned1-set.xml state several values of tuning/factor" in said


def test_a_refusal_names_the_zero_that_may_be_its_reason(aircraft, surveyed):
    file = aircraft("aero/coefficient/CLwbh")

    with pytest.raises(ft.loop.PlantError, match=r"does not grow .*: --set tuning/factor=VALUE"):
        surveyed(file)


@pytest.mark.slow
def test_gear_and_flaps_are_in_whatever_a_parked_aircraft_states(aircraft, surveyed):
    lever = '<system name="s"><channel name="s"><pure_gain name="s/drag"><input>systems/gear-cmd'
    lever += "</input><gain>1</gain></pure_gain></channel></system><flight_control"
    parked = "<systems><gear-cmd>1</gear-cmd></systems>"
    found = surveyed(aircraft(sets=[parked], changes=[("<flight_control", lever)]))

    assert found.tables["declared"]["systems/gear-cmd"] == 0.0
    assert "systems/gear-cmd is 0 as in flight, 1 is stated" in found.notes


NAMES = (
    *("/a/tank[0]level-gal_us", "//a/b", "/a/./c", "/a/d/", "/a/../e/f"),
    *("a//b", "./c/d", "a[1]/b[2]/c[3]"),
)


@pytest.mark.slow
def test_names_are_written_as_jsbsim_takes_them(aircraft, surveyed):
    """Each name in the tables leads JSBSim to the node to which the name in the model does."""
    gauges = "".join(
        f'<pure_gain name="fcs/gauge{i}"><input>{name}</input><gain>1</gain></pure_gain>'
        for i, name in enumerate(NAMES)
    )
    system = f'<system name="s"><channel name="s">{gauges}</channel></system><flight_control'
    file = aircraft(changes=[("<flight_control", system)])

    found = surveyed(file, values={name: i + 0.123456789 for i, name in enumerate(NAMES)})

    written = found.tables["declared"]
    tree = jsbsim.FGFDMExec(jsbsim.get_default_root_dir()).get_property_manager()
    for i, name in enumerate(NAMES):
        (own,) = (key for key, x in written.items() if x == i + 0.123456789)
        nodes = [tree.get_node(x, True).get_fully_qualified_name() for x in (name, own)]
        assert nodes[0] == nodes[1]
