"""A model of JSBSim's becomes an aircraft: what is found, what is refused, what is written."""

import json
import math
import os
import re
import shutil
from pathlib import Path

import jsbsim
import pytest
from book_aeroplane import more, system
from commands import answer, flighttune
from killed import each_end, files_in
from places import SHIPPED_AIRCRAFT, SHIPPED_SCENARIOS

import flighttune as ft

DEG = math.pi / 180.0


CENTIDEGREE = 0.01


MM_PER_S = 0.001


@pytest.fixture(scope="module")
def adopted(tmp_path_factory):
    """The T-38, adopted by the command."""
    folder = tmp_path_factory.mktemp("hangar") / "T38"
    return folder, answer("adopt", "T38", "--out", folder)


@pytest.mark.soak
def test_a_jet_is_adopted(adopted):
    folder, found = adopted

    assert found["status"] == "adopted"
    assert found["reason"] == ""
    assert found["engines"] == 2
    assert min(found["fit_percent"].values()) >= 90.0
    tuned, paper = found["flown"]["tuned"], found["flown"]["paper"]
    assert tuned["status"] == "completed"
    assert tuned["ST_deg"]["chi"] <= 0.5
    for channel in ("chi", "gamma"):
        assert tuned["ITAE"][channel] < paper["ITAE"][channel]
    assert f"glide ratio of {found['glide_ratio']:.1f}" in found["verdict"]
    assert {one.name for one in folder.iterdir()} == {
        *("aircraft.toml", "gains.json", "identified.json", "turn.toml"),
        *("adoption.json", "adoption.html"),
    }
    page = (folder / "adoption.html").read_text(encoding="utf-8")
    assert "Adopted means: both fits reach" in page


@pytest.mark.soak
def test_an_identified_model_of_other_gains_is_refused(adopted, tmp_path):
    folder = shutil.copytree(adopted[0], tmp_path / "T38")
    file = folder / "gains.json"
    tables = json.loads(file.read_text())
    tables["gains"]["roll/k_p"] *= 2.0
    file.write_text(json.dumps(tables))

    _, err = flighttune("tune", folder / "turn.toml", status=2)

    assert "identified.json: must be identified with the gains in gains.json" in err


@pytest.mark.parametrize(
    ("model", "sentence"),
    [
        ("ball", "no lift or normal-force axis"),
        ("weather-balloon", "carried by buoyancy"),
        ("paraglider", "lift does not grow with alpha"),
        (
            "mk82",
            "has no usable effect, and its aerodynamics read nothing that rolls or pitches it",
        ),
    ],
)
def test_what_is_no_case_is_refused_in_one_sentence(tmp_path, model, sentence):
    out, err = flighttune("adopt", model, "--out", tmp_path / model, "--json", status=1)
    found = json.loads(out)

    assert found["status"] == "refused"
    assert re.search(sentence, found["reason"])
    assert found["folder"] is None
    draft = (tmp_path / model / "aircraft.toml").read_text()
    assert f"# refused: {found['reason']}" in draft
    assert "[limits], [design]; their keys are in docs/aircraft.md" in draft
    assert err.splitlines()[0] == "step 1 of 9: reading the model"
    assert err.splitlines()[-1].startswith(f"flighttune: {model}: refused: ")


@pytest.mark.counts
def test_a_rocket_glides_past_a_flight_control_that_jumps_and_does_not_meet_the_ground(tmp_path):
    # Beyond 0.2 of the stick the flight control of x24b.xml takes the elevator to its stop: its
    # gain grows with the position of the elevator.
    found = answer("adopt", "x24b", "--out", tmp_path / "x24b")

    assert (found["status"], found["engines"]) == ("adopted", 0)
    notes = " ".join(found["notes"])
    assert "a rocket has no thrust while its fuel is frozen" in notes
    assert "bypassed: its elevator does not move in proportion to the elevator command" in notes
    assert re.search("its glide is steep: it flies from [234]000 m", notes)
    assert found["flown"]["tuned"]["status"] == "completed"


MODELS = [*Path(jsbsim.get_default_root_dir(), "aircraft").glob("*/*.xml")]
MODELS = [x for x in MODELS if x.stem == x.parent.name]
WINGLESS = "<wingarea.*?>[^<]*", '<wingarea unit="M2"> 0 '


def test_a_value_of_a_property_with_a_slash_needs_the_slash(own, refusal):
    switch = system("<pure_gain name='x'><input>/systems/switch</input></pure_gain>")

    said = refusal(own(more(switch)), "--set", "systems/switch=1")

    assert "--set systems/switch: the model must have or read it" in said
    assert "it does neither; it reads /systems/switch, with a slash." in said


def test_a_pipe_is_no_part_of_a_model(own, tmp_path):
    file = own(('file="aerosonde_motor"', 'file="pipe"'))
    for pipe in ("Engines/pipe.xml", "pipe-set.xml"):
        os.mkfifo(file.parent / pipe)

    found = ft.adopt(str(file.parent), tmp_path / "mine")  # by its main file, the only one

    assert "`file` must name a file" in found.reason


LEFT, RIGHT = "fcs/left-aileron-pos-rad", "fcs/rudder-pos-rad"  # any two that the model reads


def test_surfaces_move_with_properties_that_are_named_once_each_by_its_sign(own, tmp_path, refusal):
    file = own(WINGLESS)
    for named, leader, other in (
        ((LEFT, f"-{RIGHT}"), LEFT, f"-{LEFT}"),
        ((f"-{LEFT}", f"-{RIGHT}"), LEFT, LEFT),
    ):
        refusal(file, *(word for name in named for word in ("--aileron", name)), status=1)
        draft = (tmp_path / "mine/aircraft.toml").read_text()
        assert f'command = "{leader}"' in draft
        assert f'"{RIGHT}" = "{other}"' in draft


def test_what_cannot_move_a_surface_is_refused(own, tmp_path):
    file = own(WINGLESS)
    for commands in ({"flap": [LEFT]}, {"aileron": []}, {"aileron": LEFT}):
        with pytest.raises(ft.InputError, match="`commands` must have "):
            ft.adopt(str(file), tmp_path / "mine", commands=commands)


def test_a_model_that_is_none_of_jsbsims_is_told_the_nearest(refusal):
    assert re.search("c172q: must be a model of JSBSim's set, .*mean c172", refusal("c172q"))


def test_the_main_file_is_found_by_the_files_of_flightgear(own, refusal):
    file = own(WINGLESS)
    folder, set_file, common = file.parent, file.with_name("sonde-set.xml"), "common.xml"
    jsb = "<PropertyList><sim><flight-model>jsb</flight-model></sim></PropertyList>"
    file.with_name(common).write_text(jsb)
    aero = f"<PropertyList include='{common}'><sim><aero> aerosonde </aero></sim></PropertyList>"
    set_file.write_text(aero)

    for path in (folder, set_file):
        assert NO_WING in refusal(path, status=1).splitlines()[-1]

    file.with_name(common).write_text(jsb.replace("jsb<", "yasim<"))
    assert "its flight model must be JSBSim's (jsb), got yasim" in refusal(set_file)
    missing = "none-set.xml: must be a file or folder of FlightGear's, got no such file"
    assert missing in refusal(folder / "none-set.xml")


SHORT = 300  # characters of a reason, without the file that it names


NO_WING = "its wing area must be above zero"


@pytest.mark.parametrize("aero", ["", "../sonde", "/etc/passwd"])
def test_the_main_file_of_flightgear_is_in_the_folder_or_below(own, refusal, aero):
    file = own(WINGLESS)
    set_file = file.with_name("sonde-set.xml")
    sim = "<sim><flight-model>jsb</flight-model><aero>{}</aero></sim>"
    text = f"<PropertyList>{sim}</PropertyList>"

    set_file.write_text(text.format(aero))
    assert f'`aero` must name a file in its folder, got "{aero}"' in refusal(set_file)

    set_file.write_text(text.format("x" * 100_000))
    err = refusal(set_file)
    assert '`aero` must name a file in its folder, got "xxx' in err
    assert len(err) < SHORT + len(str(set_file))

    set_file.write_text(text.format("FDM/aerosonde"))
    file.rename((file.parent / "FDM").mkdir() or file.parent / "FDM/aerosonde.xml")
    assert NO_WING in refusal(set_file, status=1)


def test_files_of_flightgear_that_include_each_other_end(own, tmp_path, refusal):
    file = own(WINGLESS)
    both = "<PropertyList include='{}'><sim include='{}'/></PropertyList>"
    names = [f"{i}.xml" for i in range(40)]
    for name, other in zip(["sonde-set.xml", *names], names, strict=False):
        (file.parent / name).write_text(both.format(other, other))

    assert "sonde-set.xml: must include at most 200 files" in refusal(file.parent)

    jsb = "<PropertyList><sim><flight-model>jsb</flight-model></sim></PropertyList>"
    (tmp_path / "jsb.xml").write_text(jsb)
    (file.parent / "3.xml").write_text(both.format("0.xml", "../../jsb.xml"))
    said = refusal(file.with_name("sonde-set.xml"))
    assert "../../jsb.xml, which 3.xml includes, is not in the folder of the aircraft" in said


def test_of_a_folder_without_a_main_file_the_fault_of_a_file_is_told(own, refusal):
    file = own()
    file.write_bytes(b"\n" + file.read_bytes())  # nothing may stand before the declaration

    assert f"{file}: must be XML: XML or text declaration not at start" in refusal(file.parent)
    file.rename(file.with_suffix(".XML"))
    assert "got aerosonde.XML, whose ending must be .xml" in refusal(file.parent)


def test_a_folder_stands_for_its_only_main_file_or_that_of_its_name(own, refusal):
    file = own(WINGLESS)
    (file.parent / "notes.xml").write_text("<notes")

    assert NO_WING in refusal(file.parent, status=1).splitlines()[-1]

    shutil.copy(file, file.with_name("other.xml"))
    several = "must hold one aircraft of JSBSim's, got aerosonde.xml, other.xml"
    assert several in refusal(file.parent)

    file.rename(file.parent / f"{file.parent.name}.xml")
    assert NO_WING in refusal(file.parent, status=1).splitlines()[-1]


@pytest.mark.counts
def test_what_is_said_of_an_aircraft_is_for_the_airspeed_at_which_it_is_adopted(tmp_path):
    found = answer("adopt", "minisgs", "--out", tmp_path / "minisgs")
    stall = json.loads((tmp_path / "minisgs/adoption.json").read_text())["stall_mps"]
    start = ft.load_scenario(tmp_path / "minisgs/turn.toml").flight

    assert start.V_a_mps > 1.7 * stall  # it is not adopted at the first airspeed that is tried
    assert found["V_a_mps"] == pytest.approx(start.V_a_mps, abs=MM_PER_S)
    assert found["glide_ratio"] == pytest.approx(-1.0 / math.tan(start.gamma_deg * DEG), rel=0.1)
    # That the paper's gains leave the envelope beside those of the adoption is no failure.
    assert found["flown"]["paper"]["status"] == "left_envelope"
    flown = answer("fly", tmp_path / "minisgs/turn.toml", "--out", tmp_path / "out")
    assert flown["claim"]["verdict"] == "met"


@pytest.mark.counts
def test_a_glider_turns_about_its_steady_glide(tmp_path):
    found = answer("adopt", "sgs126", "--out", tmp_path / "sgs126")
    trims = answer("trim", tmp_path / "sgs126", "--V-a", found["V_a_mps"])["trims"]
    start = ft.load_scenario(tmp_path / "sgs126/turn.toml").flight

    assert found["status"] == "adopted"
    # In steady flight without thrust the tangent of the glide is drag over lift.
    assert math.tan(start.gamma_deg * DEG) == pytest.approx(-1.0 / found["glide_ratio"], rel=1e-4)
    spare = json.loads((tmp_path / "sgs126/adoption.json").read_text())["spare_thrust"]
    assert math.tan(start.gamma_deg * DEG) == pytest.approx(spare, rel=0.1)
    assert trims[0]["gamma_deg"] == pytest.approx(start.gamma_deg, abs=CENTIDEGREE)
    _, err = flighttune("trim", tmp_path / "sgs126", "--gamma", 0, status=1)
    assert re.search(r"it has no engine and glides at -\d\.\d+ deg", err)
    plan = SHIPPED_SCENARIOS / "survey.plan"
    _, err = flighttune("mission", plan, "--plan", "--aircraft", tmp_path / "sgs126", status=2)
    assert re.search(
        r"must have an engine .* path angle is \d\.\d deg .* glides at -\d\.\d deg", err
    )
    speeds = "--V-a", 1, "--V-a", found["V_a_mps"]
    (skipped,) = answer("identify", tmp_path / "sgs126", *speeds)["skipped"]
    assert "no steady glide at V_a 1 m/s" in skipped
    answer("new", "mine", "--aircraft", "sgs126", cwd=tmp_path)
    assert answer("fly", "mine.toml", cwd=tmp_path)["claim"]["verdict"] == "met"
    # The export flies what it wrote in JSBSim alone, and fails where that is another flight.
    turn, out = tmp_path / "sgs126/turn.toml", tmp_path / "alone"
    answer("export", turn, "--gains", "exact:tuned_fed_back", "--out", out)


def test_a_model_of_jsbsim_that_is_no_aircraft_yet_is_named_with_its_command():
    assert "`flighttune adopt B747` makes it." in flighttune("trim", "b747", status=2)[1]


def test_an_aircraft_that_was_not_adopted_is_not_written_over(tmp_path):
    folder = shutil.copytree(SHIPPED_AIRCRAFT / "c172p", tmp_path / "c172p")
    before = (folder / "aircraft.toml").read_text()

    err = flighttune("adopt", "c172p", "--out", folder, status=2)[1]

    assert "must not hold an aircraft that `adopt` did not make" in err
    assert (folder / "aircraft.toml").read_text() == before


def bytes_in(folder):
    return {file.relative_to(folder): file.read_bytes() for file in folder.rglob("*")}


@pytest.mark.parametrize("also", ["gains.json", "adoption.json", None])
def test_an_adopted_aircraft_stays_where_another_model_is_refused(tmp_path, also):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "aircraft.toml").write_text('title = "X"\nsource = "flighttune adopt"\n')
    for name in filter(None, [also, "notes.txt"]):
        (folder / name).write_text("{}")
    before = bytes_in(folder)

    found = answer("adopt", "ball", "--out", folder, status=1)

    assert bytes_in(folder) == before
    assert found["draft"] is None
    assert f"adopted in {folder} stays as it is" in found["notes"][-1]


def test_the_draft_of_a_refused_model_is_replaced_by_the_next_one(tmp_path):
    flighttune("adopt", "ball", "--out", tmp_path, status=1)
    first = (tmp_path / "aircraft.toml").read_text()

    flighttune("adopt", "weather-balloon", "--out", tmp_path, status=1)

    assert [file.name for file in tmp_path.iterdir()] == ["aircraft.toml"]
    assert (tmp_path / "aircraft.toml").read_text() != first


@pytest.mark.soak
def test_a_second_adoption_that_is_refused_or_killed_leaves_one_aircraft(adopted, tmp_path):
    before = shutil.copytree(adopted[0], tmp_path / "before")
    (before / "notes.txt").write_text("mine")
    old = files_in(before)

    flighttune("adopt", "T38", "--V-a", "12", "--out", before, status=1)
    assert files_in(before) == old

    out = tmp_path / "out"
    command = "adopt", "J3Cub", "--out", out
    kinds = set()
    for end in each_end(out, before, command, ("SIGKILL", "SIGTERM"), 90):
        now = {x: sha for x, sha in end["settled"].items() if not x.startswith(".flighttune-")}
        assert now.keys() == old.keys()
        assert now.pop("notes.txt") == old["notes.txt"]
        (changed,) = {sha != old[name] for name, sha in now.items()}
        kinds.add(changed)
    assert kinds == {False, True}


def test_the_page_of_the_docs_names_every_model_of_the_wheel():
    text = (Path(__file__).parents[3] / "docs/hangar.md").read_text(encoding="utf-8")
    above, refusals = text.split("\n## Refused\n")
    above, remarks = above.split("\n## Remarks\n")
    table, commands = above.split("\n## With every command\n")
    adopted = [line.split("|")[1].strip() for line in table.splitlines() if line.startswith("| ")][
        2:
    ]
    missed = "the turn ended early|a lag explains|the course error swings"
    flies = re.findall(f"^- `(.+)`: (?:{missed})", remarks, re.MULTILINE)
    refused = re.findall("`([^`]+)`(?=.*: )", refusals)

    assert sorted([*adopted, *flies, *refused]) == sorted(x.stem for x in MODELS)
    assert len(adopted) >= 44
    assert commands.count("| yes | yes | yes | yes | yes |") == 8  # but for gliders
    known = "737", "A320", "c182", "DHC6", "J3Cub", "T38", "B747", "p51d", "sgs126", "f16"
    assert set(known) <= set(adopted)
