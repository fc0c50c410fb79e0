"""A model of JSBSim's becomes an aircraft: what is found, what is refused, what is written."""

import json
import math
import os
import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import jsbsim
import numpy as np
import pytest
from airframes import fdm_of
from commands import answer, flighttune
from killed import each_end, files_in
from places import SHIPPED_AIRCRAFT, SHIPPED_SCENARIOS

import flighttune as ft
from flighttune.base.files.shipped import models_of_jsbsim
from flighttune.flight.conditions import start_condition
from flighttune.studies.adoption import adopt, survey
from flighttune.vehicles.aircraft.aircraft import aircraft_from
from flighttune.vehicles.aircraft.model_xml import in_inches
from flighttune.vehicles.identification.design import Airframe
from flighttune.vehicles.plants.jsbsim.bench import AirframeState, Bench, check_moves
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.trim import _TrimProblem, level

DEG = math.pi / 180.0
CENTIDEGREE = 0.01
MM_PER_S = 0.001
STILL = 1e-3  # rad/s^2, where full aileron alone has 3.9


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
def test_other_commands_take_the_folder(adopted, tmp_path):
    folder, found = adopted

    flown = answer("fly", folder / "turn.toml", "--out", tmp_path / "out")
    tuned = flown["runs"][0]

    assert tuned["gains"] == found["flown"]["tuned"]["gains"]
    assert tuned["metrics"]["chi"]["ITAE"] == pytest.approx(found["flown"]["tuned"]["ITAE"]["chi"])
    assert answer("trim", folder, "--V-a", found["V_a_mps"], "--gamma", 0)["trims"][0]["trim"]


@pytest.mark.soak
def test_an_identified_model_of_other_gains_is_refused(adopted, tmp_path):
    folder = shutil.copytree(adopted[0], tmp_path / "T38")
    file = folder / "gains.json"
    tables = json.loads(file.read_text())
    tables["gains"]["roll/k_p"] *= 2.0
    file.write_text(json.dumps(tables))

    _, err = flighttune("tune", folder / "turn.toml", status=2)

    assert "identified.json: must be identified with the gains in gains.json" in err


@pytest.mark.soak
@pytest.mark.parametrize(
    ("model", "travel_deg"),
    [
        # aerosurface scale of its flight control
        ("c172p", {"elevator": (-28.0, 23.0), "rudder": (-16.0, 16.0)}),
        ("A4", {"elevator": (-0.35 / DEG, 0.30 / DEG)}),
    ],
)
def test_travel_is_found_as_the_model_has_it(tmp_path, model, travel_deg):
    surfaces = survey.survey(survey.wide_tables(model), tmp_path, h=1000.0).tables["surfaces"]

    for name, travel in travel_deg.items():
        assert surfaces[name]["travel_deg"] == pytest.approx(travel, abs=5.0 * CENTIDEGREE)


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
def test_an_airframe_without_stability_in_yaw_is_adopted(tmp_path):
    # The reference point of the aerodynamics lies 650 in ahead of the centre of mass in XB-70.xml.
    found = answer("adopt", "XB-70", "--out", tmp_path / "XB-70")

    assert (found["status"], found["engines"]) == ("adopted", 6)


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


PROPELLER = """<propeller name="small"><ixx> {} </ixx><diameter unit="IN"> 16 </diameter>
<numblades> 2 </numblades><gearratio> 1 </gearratio>
<table name="C_THRUST" type="internal"><tableData>0 0.10
0.6 0.04
1.0 -0.05</tableData></table>
<table name="C_POWER" type="internal"><tableData>0 0.04
0.6 0.03
1.0 -0.01</tableData></table></propeller>"""
WINGLESS = "<wingarea.*?>[^<]*", '<wingarea unit="M2"> 0 '


@pytest.fixture
def own(tmp_path):
    """A model of one's own, and how to write it with a change, another motor or a propeller."""
    folder = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", tmp_path / "models/sonde")
    file, motor = folder / "aerosonde.xml", folder / "Engines/aerosonde_motor.xml"
    text = file.read_text()

    def write(pattern="38.21", change="38.2", *, power=None, ixx=None):
        file.write_text(re.sub(pattern, change, text, count=1))
        assert file.read_text() != text
        if power is not None:
            motor.write_text(re.sub("(<power.*?>)[^<]*", rf"\g<1> {power} ", motor.read_text()))
        if ixx is not None:
            (folder / "Engines/direct.xml").write_text(PROPELLER.format(ixx))
        return file

    return write


@pytest.fixture
def surveyed(tmp_path):
    """What a survey at 1000 m finds of a model."""
    return lambda file, **asked: survey.survey(
        survey.wide_tables(str(file)), tmp_path, h=1000.0, **asked
    )


@pytest.fixture
def refusal(tmp_path):
    """What `adopt` says of what it refuses."""
    out = "--out", tmp_path / "mine"
    return lambda *asked, status=2: flighttune("adopt", *asked, *out, status=status)[1]


def system(*components):
    return f"<system name='own'><channel name='own'>{''.join(components)}</channel></system>"


def more(*parts):
    """The change of a model that adds parts at its end."""
    return "</fdm_config>", f"{''.join(parts)}</fdm_config>"


def glide_of_the_book(V_a):
    """Lift over drag at 1000 m, with C_D = 0.043 + C_L^2 / (pi 0.9 AR)."""
    C_L = 11.0 * 9.80665 / (0.5 * 1.11164 * V_a**2 * 0.55)
    return C_L / (0.043 + 0.0232 * C_L**2)


@pytest.mark.parametrize(
    ("pattern", "change", "sentence"),
    [
        (r"(<emptywt.*?>)[^<]*", r"\1 -1600 ",
         r"its mass must be above zero, got -\S+ \(inertia/mass-slugs\)"),
        (r"(<wingarea.*?>)[^<]*", r"\1 0 ", "its wing area must be above zero, got 0"),
        ("<fdm_config(?s:.*)", "<airplane/>", "must be a <fdm_config> of JSBSim, got a <airplane>"),
        (r"-38\.21", "1e300", "the slope of q_dot by q is .*, which no aircraft has"),
        (r"fcs/left-aileron", "fcs/left-aileron[[", r"cannot be loaded by JSBSim: unterminated"),
        (*more('<system file="Gear Box"/>'),
         "must have all its parts, got no file {}/Systems/Gear Box.xml"),
        (r'<engine file="[^"]*"', '<engine file="none"', "got no file {}/Engines/none.xml"),
        ("</axis>", "</axes>", r"^must be XML: mismatched tag: line \d+, column \d+"),
    ],
)  # fmt: skip
def test_a_model_that_cannot_fly_is_refused_in_one_line(own, tmp_path, pattern, change, sentence):
    file = own(pattern, change)

    out, err = flighttune("adopt", file, "--out", tmp_path / "mine", "--json", status=1)

    reason = json.loads(out)["reason"]
    assert re.search(sentence.format(re.escape(str(file.parent))) + r"[^\n]{0,80}$", reason)
    assert "flighttune-" not in err  # the private folder that JSBSim loads the model from


READS = "<fcs_function name='a/b'><function><property>/controls/x[1]</property></function>"
READS += "</fcs_function><actuator name='a/c'><input>a/b</input><rate_limit>a/rate</rate_limit>"
READS += "</actuator>"
LEVER = "/controls/engines/engine[0]/throttle"
GAIN = f"<pure_gain name='a/t'><input>{LEVER}</input><gain>1</gain>"
GAIN += "<output>fcs/throttle-cmd-norm</output></pure_gain>"
BRAKE = """<fcs_function name="a/brake"><function><difference><value>1</value>
<property>{}</property></difference></function><output>fcs/speedbrake-pos-norm</output></fcs_function>
<pure_gain name="a/drag"><input>fcs/speedbrake-pos-norm</input><gain>1</gain></pure_gain>"""
OUT = "fcs/speedbrake-pos-norm is"
TRIM = "fcs/pitch-trim-cmd-norm"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parts", "note", "table", "values"),
    [
        (READS, "are 0: /controls/x[1], a/rate", "declared", {"/controls/x[1]": 0, "a/rate": 0}),
        (GAIN, "with FlightGear's levers linked", "linked", {LEVER: "ft/throttle-norm"}),
        (BRAKE.format("/controls/a"), f"{OUT} in by /controls/a = 1", "declared",
         {"/controls/a": 1.0}),
        (BRAKE.format(TRIM), f"{OUT} 1: it is out", "declared", {TRIM: None}),
    ],
    ids=["missed", "throttle of FlightGear", "brake put in", "brake out"],
)  # fmt: skip
def test_what_a_model_reads_is_declared_linked_or_named(own, surveyed, parts, note, table, values):
    found = surveyed(own(*more(system(parts))))

    assert note in " ".join(found.notes)
    assert {key: found.tables[table].get(key) for key in values} == values


@pytest.mark.soak
def test_a_height_that_flightgear_shows_is_that_of_the_flight(own, surveyed):
    file = own(
        r"<value (name=\S+CD_0.)> 0.043 </value>",
        r"<product \1><value>0.043</value><quotient><property>/position/altitude-agl-ft</property>"
        "<value>3280.84</value></quotient></product>",
    )

    found = surveyed(file)

    # 1000 m are 3280.84 ft: the drag is the book's.
    assert found.glide_ratio == pytest.approx(glide_of_the_book(found.V_a), rel=0.01)
    assert found.largest_drag == ("aero/force/drag", 1.0)
    assert "another simulator" not in " ".join(found.notes)


@pytest.mark.slow
@pytest.mark.parametrize("retractable", [1, 0])
def test_fixed_gear_is_not_called_out(own, surveyed, retractable):
    drag = '<pure_gain name="a/drag"><input>gear/gear-pos-norm</input><gain>1</gain></pure_gain>'
    gear = f"<contact type='BOGEY' name='n'><retractable>{retractable}</retractable></contact>"
    parts = f"<ground_reactions>{gear}</ground_reactions>", system(drag)

    notes = surveyed(own(*more(*parts))).notes

    assert notes.count("gear/gear-pos-norm is 1: it is out") == retractable


@pytest.mark.slow
def test_a_model_whose_aerodynamics_read_no_rudder_has_none(own, surveyed):
    file = own()
    file.write_text(file.read_text().replace("fcs/rudder-pos-rad", "fcs/elevator-pos-rad"))

    found = surveyed(file)

    assert set(found.tables["surfaces"]) == {"aileron", "elevator"}
    assert "it has no rudder: yaw is left to the airframe" in found.notes


# A tail that follows the integral of the stick, a slat that takes 5 s to a half, and a droop that
# follows the pitch rate.
FLY_BY_WIRE = """<integrator name="fcs/fbw/horz-tail-pos-rad"><input>fcs/elevator-cmd-norm</input>
<c1>1</c1></integrator><fcs_function name="a/half"><function><value>0.5</value></function>
</fcs_function><lag_filter name="fcs/fbw/slat-norm"><input>a/half</input><c1>0.2</c1>
</lag_filter><pure_gain name="fcs/fbw/droop"><input>velocities/q-rad_sec</input><gain>1</gain>
</pure_gain>"""


@pytest.mark.slow
def test_what_a_fly_by_wire_moves_besides_the_surfaces_is_held(own, surveyed):
    file = own(*more(system(FLY_BY_WIRE)))
    positions = "<property>fcs/fbw/slat-norm</property><property>fcs/fbw/droop</property>"
    slat = f"<value>0.086</value><sum>{positions}</sum></product>"
    text = file.read_text().replace("fcs/elevator-pos-rad", "fcs/fbw/horz-tail-pos-rad")
    drag = re.sub(r"<value (name=\S+CD_0.)> 0.043 </value>", rf"<product \1>{slat}", text)
    assert drag != text
    file.write_text(drag)

    found = surveyed(file)

    assert found.tables["surfaces"]["elevator"]["replaces"] == ["fcs/fbw/horz-tail-pos-rad"]
    assert found.tables["declared"]["ft/fcs/fbw/slat-norm"] == pytest.approx(0.5, rel=1e-3)
    assert found.tables["declared"]["ft/fcs/fbw/droop"] == pytest.approx(0.0, abs=1e-9)
    notes = " ".join(found.notes)
    assert "moves fcs/fbw/droop, fcs/fbw/slat-norm: held as in level flight" in notes
    assert "another simulator" not in notes
    # The book's drag: half of 0.086 is its 0.043.
    assert found.glide_ratio == pytest.approx(glide_of_the_book(found.V_a), rel=0.01)


def test_a_flight_control_that_does_not_come_to_rest_is_called_that(own, surveyed):
    aileron = '<pure_gain name="a/roll"><input>fcs/aileron-cmd-norm</input><gain>0.3</gain>'
    aileron += "<output>fcs/left-aileron-pos-rad</output></pure_gain>"
    file = own(*more(system(FLY_BY_WIRE, aileron)))
    text = file.read_text().replace("fcs/elevator-pos-rad", "fcs/fbw/tail")
    file.write_text(text.replace("fcs/fbw/horz-tail-pos-rad", "fcs/fbw/tail"))

    found = surveyed(file)

    assert "bypassed" in found.notes[0]
    assert "does not come to rest" in found.notes[0]
    assert found.tables["surfaces"]["elevator"]["replaces"] == ["fcs/fbw/tail"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "said"),
    [
        # 1 - exp(-0.3 t) of its way: a tenth of it between 3 and 4 s
        (0.3, "drifts while the aileron command is held"),
        # it is there at 3 s, but not at once
        (1.5, "keeps moving after the aileron command"),
    ],
)
def test_a_flight_control_that_is_late_is_called_that(own, surveyed, rate, said):
    late = f'<lag_filter name="a/roll"><input>fcs/aileron-cmd-norm</input><c1>{rate}</c1>'
    late += "<output>fcs/left-aileron-pos-rad</output></lag_filter>"
    others = (
        f'<pure_gain name="a/{name}"><input>fcs/{name}-cmd-norm</input><gain>0.3</gain>'
        f"<output>fcs/{name}-pos-rad</output></pure_gain>"
        for name in ("elevator", "rudder")
    )

    found = surveyed(own(*more(system(late, *others))))

    assert f"its flight control {said}" in " ".join(found.notes)


OPEN = """<fcs_function name="a/open"><function><product><value>2</value>
<property>a/lever</property></product></function><clipto><min>0</min><max>1</max></clipto><output>fcs/throttle-cmd-norm</output>
</fcs_function>"""


def test_a_lever_that_is_fully_open_at_a_half_is_one(own, tmp_path):
    tables = survey.wide_tables(str(own(*more(system(OPEN)))))
    tables["engines"]["command"] = "a/lever"

    assert survey.survey(tables, tmp_path, h=1000.0).spare_thrust > 0.5


@pytest.mark.soak
def test_an_aeroplane_whose_engines_do_not_keep_it_level_glides(own, surveyed):
    file = own(power=1)  # W

    found = surveyed(file)

    assert found.tables["engines"]["count"] == 0
    (why, *_) = found.notes
    assert re.fullmatch(r"its thrust is at most 0\.\d\d of its drag at any .* stay off", why)
    with pytest.raises(ft.loop.PlantError, match=r"is 0\.\d\d of its drag"):
        surveyed(file, V_a=22.0)


def mixed(*parts):
    """A half of the sum of some properties, or of their negatives."""
    terms = (
        f"<product><value>{-0.5 if part[0] == '-' else 0.5}</value><property>{part.lstrip('-')}"
        "</property></product>"
        for part in parts
    )
    return f"<sum>{''.join(terms)}</sum>"


def external(position):
    """The command of a position that a renamed model has."""
    return position.replace("_rad", "_ext_rad")


# Positions that its aerodynamics read, by the surfaces of the book's model.
NAMED_OTHERWISE = {
    "left-aileron": ("fcs/posAilL_rad", "-fcs/posAilR_rad"),
    "elevator": ("-tail/posElev_rad", "-tail/posElev_rad"),
    "rudder": ("fcs/posRud_rad", "fcs/posRud_rad"),
}
ELEVONS = {
    "left-aileron": ("fcs/elevonL_rad", "-fcs/elevonR_rad"),
    "elevator": ("fcs/elevonL_rad", "fcs/elevonR_rad"),
    "rudder": ("fcs/fin_rad", "fcs/fin_rad"),
}

V_TAIL = NAMED_OTHERWISE | {
    "elevator": ("tail/left_rad", "tail/right_rad"),
    "rudder": ("tail/left_rad", "-tail/right_rad"),
}


@pytest.fixture
def renamed(own):
    """A model whose surfaces and throttle have other names, commanded by others again."""

    def write(parts):
        names = {name.lstrip("-") for pair in parts.values() for name in pair}
        actuators = (
            f"<actuator name='a/s{i}'><input>{external(name)}</input><lag>33</lag><clipto>"
            f"<min>-0.5</min><max>0.5</max></clipto><output>{name}</output></actuator>"
            for i, name in enumerate(sorted(names))
        )
        motor = "<pure_gain name='a/m'><input>fcs/motor_ext_rad</input><gain>1</gain>"
        motor += "<output>fcs/throttle-cmd-norm</output></pure_gain>"
        inputs = (f"<property>{external(name)}</property>" for name in (*names, "fcs/motor_rad"))
        flown = system(*actuators, motor).replace("<channel", f"{''.join(inputs)}<channel")
        file = own("</fdm_config>", f"{flown}</fdm_config>")
        text = file.read_text()
        for name, pair in parts.items():
            position = rf"<property>\s*fcs/{name}-pos-rad\s*</property>"
            text, count = re.subn(position, mixed(*pair), text)
            assert count
        file.write_text(text)
        return file

    return write


@pytest.mark.soak
@pytest.mark.parametrize(
    "parts", [NAMED_OTHERWISE, ELEVONS, V_TAIL], ids=["named otherwise", "elevons", "V-tail"]
)
def test_controls_are_found_by_what_they_move(renamed, surveyed, tmp_path, parts):
    found = surveyed(renamed(parts))

    surfaces = found.tables["surfaces"]
    aileron, elevator, rudder = (sorted({*pair}) for pair in parts.values())
    assert surfaces["aileron"]["replaces"] == sorted(aileron, key=lambda x: x.lstrip("-"))
    assert surfaces["elevator"]["replaces"] == elevator
    assert surfaces["rudder"]["replaces"] == sorted(rudder, key=lambda x: x.lstrip("-"))
    assert found.tables["engines"]["command"] == "fcs/motor_ext_rad"
    assert "its throttle is moved by fcs/motor_ext_rad" in found.notes
    bench, level_ = Bench(Fdm(aircraft_from(found.tables, tmp_path)), 1000.0), {"V_a": 30.0}
    # Span 2.8956 m, chord 0.18994 m, C_l of 0.17 and C_m of -0.99 a radian, from the book's table.
    q_S = 0.5 * 1.11164 * 30.0**2 * 0.55
    for surface, rate, inertia, moment in (
        ("aileron", "p_dot", "xx", 0.17 * q_S * 2.8956),
        ("elevator", "q_dot", "yy", -0.99 * q_S * 0.18994),
    ):
        positions = (AirframeState(**level_, **{surface: x}) for x in (0.1, 0.0))
        moved, neutral = (bench.accelerations(state)[rate] for state in positions)
        slugs = bench.fdm.reader(f"inertia/i{inertia}-slugs_ft2")()
        # The product of inertia turns a part of the roll moment into yaw.
        assert (moved - neutral) * slugs * 1.35582 == pytest.approx(0.1 * moment, rel=0.05)


@pytest.mark.slow
def test_commands_of_surfaces_can_be_named(renamed, tmp_path, refusal):
    file = renamed(NAMED_OTHERWISE)
    left, right = "fcs/posAilL_ext_rad", "fcs/posAilR_ext_rad"
    tables = survey.wide_tables(str(file))
    tables["surfaces"]["aileron"]["command"], tables["linked"] = left, {right: f"-{left}"}
    tables["surfaces"]["elevator"]["command"] = "tail/posElev_ext_rad"
    tables["surfaces"]["rudder"]["command"] = "fcs/posRud_ext_rad"

    surfaces = survey.survey(tables, tmp_path, h=1000.0).tables["surfaces"]

    # The actuators stop at 0.5 rad; the tail of this model has the opposite sense.
    assert surfaces["aileron"]["travel_deg"] == pytest.approx((-28.65, 28.65), abs=CENTIDEGREE)
    assert surfaces["aileron"]["full_rad"] == pytest.approx((-1.0, 1.0))
    assert surfaces["elevator"]["full_rad"] == pytest.approx((1.0, -1.0))
    file.write_text(re.sub("(<wingarea.*?>)[^<]*", r"\1 0 ", file.read_text()))
    refusal(file, "--aileron", left, "--aileron", f"-{right}", status=1)
    draft = (tmp_path / "mine/aircraft.toml").read_text()
    assert f'command = "{left}"' in draft
    assert f'"{right}" = "-{left}"' in draft
    for wrong, sentence in (
        ("fcs/no", "--aileron: the model must read fcs/no, it does not"),
        ("a b", "--aileron must be a property of the model, got a b"),
    ):
        for named in (("--aileron", wrong), ("--aileron", left, "--aileron", wrong)):
            assert sentence in refusal(file, *named)
    twice = refusal(file, "--aileron", left, "--aileron", f"-{left}")
    assert f"--aileron must name a property once, got {left}, -{left}" in twice
    for commands in ({"flap": [left]}, {"aileron": []}, {"aileron": left}):
        with pytest.raises(ft.InputError, match="`commands` must have "):
            ft.adopt(str(file), tmp_path / "mine", commands=commands)


@pytest.mark.counts
def test_a_propeller_without_inertia_is_called_diverging(own, surveyed):
    with pytest.raises(ft.loop.PlantError, match="propeller diverges: "):
        surveyed(own(ixx=0))


@pytest.mark.soak
def test_a_diameter_without_a_unit_that_no_propeller_has_is_in_inches(surveyed, tmp_path):
    """The files of the L410 say 99, an engine of 700 hp, and a propeller governed to 2080 rpm."""
    engine, propeller = (
        Path(jsbsim.get_default_root_dir(), "engine", name).read_text()
        for name in ("engtm601.xml", "vrtule2.xml")
    )
    (rated,) = map(float, re.findall(r"<maxpower .*?>(.*?)<", engine))
    (governed,) = map(float, re.findall("<maxrpm>(.*?)<", propeller))
    found = surveyed("L410")
    fdm = Fdm(aircraft_from(found.tables, tmp_path))

    alpha, _ = found.lift.at(found.V_a)
    state = AirframeState(V_a=found.V_a, alpha=alpha, theta=alpha, throttle=1.0)
    Bench(fdm, 1000.0).accelerations(state)
    fdm.hold(20.0)  # an evaluation leaves a turboprop without power

    power, rpm, thrust, share = (
        fdm.reader(f"propulsion/engine/{name}")()
        for name in ("power-hp", "propeller-rpm", "thrust-lbs", "thrust-coefficient")
    )
    per_D4 = share * fdm.reader("atmosphere/rho-slugs_ft3")() * (rpm / 60.0) ** 2
    assert (
        "the diameter of its propeller has no unit: it is inches, not feet as JSBSim has it"
        in found.notes
    )
    assert (thrust / per_D4) ** 0.25 == pytest.approx(99.0 / 12.0, rel=0.01)
    assert rpm == pytest.approx(governed, rel=0.01)
    assert 0.9 * rated < power <= rated


def test_a_turbine_that_is_off_does_not_push(tmp_path):
    """JSBSim takes it for an idle one in the evaluation of a state, in which no time passes."""
    tables = survey.wide_tables("T38")
    tables["engines"]["count"] = 0
    fdm = Fdm(aircraft_from(tables, tmp_path))

    Bench(fdm, 1000.0).accelerations(AirframeState(V_a=120.0))

    assert fdm.reader("propulsion/engine/thrust-lbs")() == 0.0
    assert fdm.reader("forces/fbx-prop-lbs")() == 0.0


def test_drag_is_that_at_the_throttle_that_drives_an_aeroplane(surveyed):
    """By its file, propellers of the OV10 brake it below a throttle of 5 %, by 7 % of qbar S."""
    found = surveyed("OV10")

    assert found.tables["engines"]["count"] == 2
    assert found.spare_thrust > 0.05
    assert found.largest_drag[0] == "aero/coefficient/dCDprop"  # of the glide


@pytest.mark.slow
def test_engines_stay_off_in_a_glide_and_inertias_that_no_body_has_are_named(own, surveyed):
    found = surveyed(own(r'(<ixx unit="KG.M2">)[^<]*', r"\1 3.5 "), glide=True)

    # 3.5 kg m^2 about x, 1.135 and 1.759 about the others
    assert found.notes[0].endswith("those of no body: inertia xx exceeds the sum of the others")
    assert found.tables["engines"]["count"] == 0
    assert "it flies without an engine, about its steady glide" in found.notes


def test_a_model_without_propulsion_has_no_engines_and_one_without_drag_no_largest(own, tmp_path):
    def tables(*change):
        return survey.wide_tables(str(own(*change)))

    whole, without = tables(), tables("(?s)<propulsion>.*</propulsion>", "")
    assert survey._engine_count(aircraft_from(without, tmp_path)) == 0
    fdm = Fdm(aircraft_from(tables('(?s)<axis name="DRAG">.*?</axis>', ""), tmp_path))
    Bench(fdm, 1000.0).accelerations(AirframeState(V_a=25.0))
    name, share = survey._largest_drag(fdm)
    assert (name, math.isnan(share)) == ("", True)
    own()  # all of it again
    assert survey._engine_count(aircraft_from(whole, tmp_path)) == 1


@pytest.mark.soak
def test_empty_tanks_are_said_unless_a_value_fills_them(tmp_path, surveyed):
    folder = shutil.copytree(Path(jsbsim.get_default_root_dir(), "aircraft/c172p"), tmp_path / "p")
    file = folder / "c172p.xml"
    file.write_text(re.sub("(<contents.*?>)[^<]*", r"\1 0 ", file.read_text()))

    empty = surveyed(file)
    filled = surveyed(file, values={"propulsion/tank/contents-lbs": 100.0})

    assert [note for note in empty.notes if note not in filled.notes] == [
        "its tanks are empty: it flies without the weight of fuel, and its engines run because "
        "fuel is frozen; `--set propulsion/tank/contents-lbs=LBS` fills the first tank"
    ]
    assert filled.lift.V_s > empty.lift.V_s


@pytest.mark.slow
def test_a_propeller_that_makes_the_airframe_a_gyroscope_is_named(own, surveyed):
    note = surveyed(own(power=1500, ixx=0.02)).notes[-1]

    nutation, rpm = map(float, re.findall(r"(\S+) (?:rad/s|rpm)", note))
    across = math.sqrt(1.135 * 1.759) / (14.5939 * 0.3048**2)  # slug ft^2
    assert nutation == pytest.approx(0.02 * rpm * math.pi / 30.0 / across, rel=0.02)
    assert note.startswith("its propeller makes it a gyroscope")


def made_up(*, p_dot=-40.0, elevator=-0.1):
    """A survey and the slopes of an aeroplane that stalls at 20 m/s, at 30 m/s."""
    alpha = np.array([-0.2, -0.1, 0.0, 0.3])
    lift = survey.Lift(alpha, 2.5 * alpha + 0.25, 0.02 + alpha**2, 0.3, -0.2, 20.0)
    tables = {"surfaces": {"aileron": {"travel_deg": [-30.0, 20.0]}}}
    slopes = {"p_dot": {"p": p_dot, "aileron": 200.0}, "n_z": {"alpha": 20.0, "elevator": elevator}}
    slopes["q_dot"] = {"alpha": -30.0, "q": -5.0, "elevator": -40.0}
    model = Airframe(trimmed=AirframeState(V_a=30.0), slopes=slopes)
    return survey.Survey(tables, lift, 30.0, 1.0, 10.0, ("", 0.0), ()), model


def test_errors_of_a_roll_with_much_damping_decay_as_fast_as_others():
    found, model = made_up()

    goals = adopt.final_tables(found, model, 1000.0, 1.0)["design"]

    # e'' - L_p e' + roll_error^2 e = 0: the slow pole is that which 4 rad/s has without damping.
    poles = np.roots([1.0, 40.0, goals["roll_error_rad_s"] ** 2])
    assert goals["roll_rad_s"] == 4.0
    assert max(poles) == pytest.approx(-2.3 * 4.0, rel=1e-6)
    assert (
        "roll_error_rad_s" not in adopt.final_tables(*made_up(p_dot=-20.0), 1000.0, 1.0)["design"]
    )


def test_load_factors_stay_below_the_lift_and_within_the_envelope():
    """At 1.5 times the stalling speed the wings lift 2.25 times the weight, and 0.56 downwards."""
    found, model = made_up()

    tables = adopt.final_tables(found, model, 1000.0, 1.0)

    assert tables["limits"]["n_z"] == pytest.approx([-0.85 * 2.25 * 0.25, 0.85 * 2.25])
    low, high = tables["limits"]["n_z"]
    assert tables["envelope"]["n_z"] == pytest.approx([low - 1.0, high + 1.0])
    assert tables["envelope"]["V_a_mps"] == pytest.approx([1.05 * 20.0, 1.8 * 30.0])
    assert tables["envelope"]["alpha_deg"] == pytest.approx([-0.2 / DEG - 1.0, 0.3 / DEG])


@pytest.mark.parametrize(
    ("aileron", "damping", "share", "gentle", "rate_dps", "roll"),
    [
        # full aileron rolls steadily at 200 x 20 deg / 40; 0.4 of it exceed the limit, 30 deg/s
        (200.0, 40.0, 1.0, 1.0, 30.0, 4.0),
        (200.0, 40.0, 0.5, 1.0, 30.0, 2.0),
        (200.0, 40.0, 1.0, 0.4, 12.0, 4.0),
        # two fifths of the steady rate, 50 x 20 deg / 40
        (50.0, 40.0, 1.0, 1.0, 10.0, 4.0),
        # the roll begins with 0.8 of the aileron: 0.8 x 8 x 20 deg / 30 deg/s - 2
        (8.0, 2.0, 1.0, 1.0, 30.0, 0.8 * 8.0 * 20.0 / 30.0 - 2.0),
        # damping is at least 0.1: 0.8 x 0.2 x 20 / 16 deg/s - 0.1
        (0.2, 0.0, 1.0, 1.0, 16.0, 0.5),
    ],
)
def test_rolls_are_as_fast_as_the_aileron_allows(aileron, damping, share, gentle, rate_dps, roll):
    found, model = made_up(p_dot=-damping)
    model.slopes["p_dot"]["aileron"] = aileron

    tables = adopt.final_tables(found, model, 1000.0, share, gentle)

    assert tables["limits"]["phi_rate_dps"] == pytest.approx(rate_dps)
    assert tables["limits"]["phi_deg"] == [-45.0, 45.0]
    goals = tables["design"]
    assert goals["roll_rad_s"] == pytest.approx(roll)
    assert goals["roll_t90_s"] == pytest.approx(30.0 / rate_dps + 3.0 / roll)
    # an elevator that lifts at once leaves the largest bandwidth, 8 rad/s
    assert goals["n_z_rad_s"] == pytest.approx(8.0 * share)
    assert tables["limits"]["n_z_rate_per_s"] == pytest.approx(0.12 * 8.0 * share)
    assert goals["n_z_t90_s"] == pytest.approx(0.5 / (0.96 * share) + 5.0 / (8.0 * share))


@pytest.mark.parametrize(
    ("V_a", "speed"), [(31.0, 15.0 / 31.0), (60.0, 0.25), (160.0, 0.1), (29.0, 0.5)]
)
def test_the_airspeed_is_held_more_slowly_at_more_speed(V_a, speed):
    found, model = made_up()
    goals = adopt.final_tables(found._replace(V_a=V_a), model, 900.0, 1.0)["design"]

    assert goals["speed_rad_s"] == pytest.approx(speed)
    assert (goals["V_a_mps"], goals["h_m"], goals["V_a_shown_mps"]) == (V_a, 900.0, [V_a])


@pytest.mark.parametrize(
    ("V_a", "more_lift", "n_z"),
    [
        # from -1 to 3 whatever the wings lift
        (45.0, 0.0, (-1.0, 3.0)),
        # a wing that lifts upwards at its negative stall keeps below level flight
        (30.0, 0.3, (2.25 * 0.05 / 0.85, 0.85 * 2.25)),
        (30.0, 0.6, (0.7, 0.85 * 2.25)),
    ],
)
def test_load_factors_are_those_of_aeroplanes(V_a, more_lift, n_z):
    found, model = made_up()
    lift = found.lift._replace(lift=found.lift.lift + more_lift)

    limits = adopt.final_tables(found._replace(V_a=V_a, lift=lift), model, 1e3, 1.0)["limits"]

    assert limits["n_z"] == pytest.approx(n_z)


def test_an_airspeed_at_which_no_turn_is_possible_is_refused():
    """The wings lift 1.3^2 times the weight, and a turn needs 1.5 / 0.85."""
    found, model = made_up()
    with pytest.raises(survey.Refusal, match=r"at 26 m/s it lifts 1\.69 .* a turn needs 1\.76"):
        adopt.final_tables(found._replace(V_a=26.0), model, 1000.0, 1.0)


def turn(status="completed", chi=0.3, gamma=0.4, ITAE=(1.0, 2.0), swinging=()):
    return {
        "status": status, "reason": "it fell.", "ST_deg": {"chi": chi, "gamma": gamma},
        "ITAE": dict(zip(("chi", "gamma"), ITAE, strict=True)), "swinging": [*swinging],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("fits", "tuned", "paper", "missed"),
    [
        ((90.0, 90.0), {}, {"ITAE": (1.1, 2.1)}, []),
        ((89.9, math.nan), {}, {"ITAE": (1.1, 2.1)},
         ["a lag explains 89.9 % of roll, less than 90 %", "a lag explains nan % of n_z"]),
        ((90.0, 90.0), {"status": "diverged", "chi": 9.0}, {}, ["the turn ended early: it fell"]),
        ((90.0, 90.0), {"chi": 0.5, "gamma": 0.51}, {"ITAE": (1.1, 2.1)},
         ["the error of the path angle swings by 0.51 deg in the last quarter"]),
        ((90.0, 90.0), {"swinging": ("phi",)}, {"ITAE": (1.1, 2.1)}, ["phi_cmd "]),
        ((90.0, 90.0), {}, {"ITAE": (1.1, 2.0)},
         ["ITAE of gamma is 2, with the paper's scaled gains 2"]),
        ((90.0, 90.0), {}, {"ITAE": (0.1, 0.2), "status": "diverged"}, []),
    ],
)  # fmt: skip
def test_criteria_that_an_adoption_misses_are_named(fits, tuned, paper, missed):
    named = dict(zip(("roll", "n_z"), fits, strict=True))
    said = [*adopt._missed(named, turn(**tuned), turn(**paper))]

    assert len(said) == len(missed)
    assert all(x.startswith(y) for x, y in zip(said, missed, strict=True))


def test_a_glide_loses_the_height_of_a_minute_three_degrees_steeper_than_steady():
    found, _ = made_up()
    glider, driven = (
        found._replace(tables={"engines": {"count": count}}, glide_ratio=10.0) for count in (0, 1)
    )

    assert adopt._height_lost(glider) == pytest.approx(60.0 * 30.0 * (0.1 + math.tan(3.0 * DEG)))
    assert adopt._height_lost(driven) == 0.0


def test_named_controls_lead_and_others_follow_them_with_their_sign():
    surfaces = {name: {} for name in ("aileron", "elevator", "rudder")}
    tables = {"surfaces": surfaces, "engines": {}, "linked": {}}
    commands = {"aileron": ["fcs/a", "-fcs/b"], "elevator": ["-fcs/e", "fcs/f", "-fcs/g"]}

    adopt._set_controls(tables, "fcs/t", commands, rudder=False)

    assert tables["engines"] == {"command": "fcs/t"}
    assert tables["surfaces"] == {
        "aileron": {"command": "fcs/a"}, "elevator": {"command": "fcs/e"}
    }  # fmt: skip
    # -e, f and -g: f moves against e, g with it
    assert tables["linked"] == {"fcs/b": "-fcs/a", "fcs/f": "-fcs/e", "fcs/g": "fcs/e"}
    kept = {"surfaces": {"rudder": {}}, "engines": {}, "linked": {}}
    adopt._set_controls(kept, None, {}, rudder=True)
    assert kept == {"surfaces": {"rudder": {}}, "engines": {}, "linked": {}}


@pytest.mark.parametrize(
    ("commands", "words"),
    [
        ({"canard": ["fcs/a"]}, "got .'fcs/a'. by canard"),
        ({"aileron": "fcs/a"}, "got 'fcs/a' by aileron"),
        ({"aileron": []}, "by aileron"),
        ({"aileron": ["fcs/a", "fcs/b c"]}, "--aileron must be a property .*, got fcs/b c"),
        ({"aileron": ["fcs/a", "fcs/b", "-fcs/a"]}, "--aileron must name a property once"),
    ],
)
def test_names_of_commands_are_properties_of_a_surface(commands, words):
    tables = {"surfaces": {"aileron": {}}, "engines": {}, "linked": {}}
    with pytest.raises(ft.InputError, match=words):
        adopt._set_controls(tables, None, commands, rudder=True)


def test_a_draft_has_what_was_found_and_names_what_is_missing():
    begun = survey.wide_tables("c172p")
    tables = survey.wide_tables("c172p")
    tables["settings"]["fcs/x"] = 0.123456789
    tables["declared"] |= {"a/b": 1.123456789, "ft/c": 0.123456789}
    tables["engines"]["settle_s"] = 15.0

    text = adopt.draft_text(tables, begun, "it is a stone")

    comments = [line for line in text.splitlines() if line.startswith("#")]
    assert comments[0] == "# refused: it is a stone"
    assert "[surfaces]" in comments[1]
    assert "[engines]" not in comments[1]
    assert tomllib.loads(text) == {
        "title": "c172p", "source": survey.SOURCE, "model": "c172p",
        "engines": {"count": 1, "settle_s": 15.0}, "settings": {"fcs/x": 0.123456789},
        # what was measured is rounded
        "declared": {"a/b": 1.123456789, "ft/c": pytest.approx(0.123456789, rel=1e-3)},
    }  # fmt: skip
    assert tomllib.loads(text)["declared"]["ft/c"] != 0.123456789
    assert "\n[engines] # time they take to a steady thrust\n" in text
    aileron = {"aileron": {"full_rad": [0.0, 1.0]}}
    other = tables | {"inner_loop_rate_hz": 400.0, "surfaces": aileron}
    whole = tomllib.loads(adopt.aircraft_text(other, ()))
    assert (whole["inner_loop_rate_hz"], whole["surfaces"]) == (400.0, aileron)


@pytest.mark.parametrize("elevator", [0.4, 0.8, -0.1])
def test_a_load_factor_is_slower_than_the_zero_of_its_elevator(elevator):
    _, model = made_up(elevator=elevator)

    # The short period whose elevator keeps the load factor: alpha' = q, q' = M alpha + M_q q.
    stiffness = -30.0 + 40.0 * 20.0 / elevator
    roots = np.roots([1.0, 5.0, -stiffness])
    expected = max(roots.real) if elevator > 0.0 else math.inf
    assert adopt.elevator_zero(model) == pytest.approx(expected)


@pytest.mark.slow
def test_two_fifths_of_the_roll_rate_of_a_weak_aileron_are_commanded(own, surveyed, tmp_path):
    """Of the side that moves less, by 2 deg."""
    found = surveyed(own())
    fdm = Fdm(aircraft_from(found.tables, tmp_path))
    found.tables["surfaces"]["aileron"]["travel_deg"] = [-3.0, 2.0]
    model = Airframe.about(fdm, level(fdm.config, found.V_a, 1000.0))

    limits = adopt.final_tables(found, model, 1000.0, 1.0)["limits"]

    # At the final rate the damping of the roll leaves no acceleration.
    final = limits["phi_rate_dps"] * DEG / 0.4
    rolling = replace(model.trimmed, p=final, aileron=2.0 * DEG)
    assert Bench(fdm, 1000.0).accelerations(rolling)["p_dot"] == pytest.approx(0.0, abs=STILL)


@pytest.mark.slow
def test_of_a_motor_that_is_far_too_strong_a_part_of_the_throttle_is_used(own, surveyed):
    found = surveyed(own(power=36576))

    # JSBSim pushes with one lbf per ft lbf/s: 1112 weights, of which 2048 parts are below one.
    weights = 36576.0 * 0.3048 / 9.80665 / 11.0 / 0.3048**2
    assert found.tables["engines"]["full"] == 1.0 / 2048.0
    assert found.spare_thrust + 1.0 / found.glide_ratio == pytest.approx(weights / 2048.0, rel=1e-3)
    assert "far too strong" in found.notes[-1]


PUSHER = """<external_reactions><force name="pusher" frame="BODY"><function><product>
<property>fcs/throttle-pos-norm</property><value> 9 </value></product></function>
<location unit="M"><x>0</x><y>0</y><z>0</z></location>
<direction><x>1</x><y>0</y><z>0</z></direction></force></external_reactions>"""


@pytest.mark.soak
def test_an_external_force_that_follows_the_throttle_is_thrust(own, surveyed, tmp_path):
    found = surveyed(own(*more(PUSHER), power=0))

    thrust = 9.0 * 4.4482216 / (11.0 * 9.80665)  # 9 lbf over the weight of 11 kg
    assert found.tables["engines"]["thrust"] == "forces/fbx-external-lbs"
    assert found.spare_thrust + 1.0 / found.glide_ratio == pytest.approx(thrust, rel=1e-3)
    check_moves(aircraft_from(found.tables, tmp_path))


@pytest.mark.soak
@pytest.mark.parametrize("switch", ["battery/is-on", "/systems/battery/is-on"])
def test_a_switch_that_opens_the_throttle_is_on(own, surveyed, switch):
    defined = "" if switch[0] == "/" else f"<property>{switch}</property>"
    motor = "<fcs_function name='b/m'><function><product><property>fcs/throttle-cmd-norm</property>"
    motor += f"<property>{switch}</property></product></function>"
    motor += "<output>fcs/throttle-pos-norm</output></fcs_function>"

    found = surveyed(own(*more(system(motor).replace("<channel", f"{defined}<channel"))))

    assert found.tables["declared" if switch[0] == "/" else "settings"][switch] == 1.0
    assert any(f"--set {switch}=1 " in note for note in found.notes)
    assert found.spare_thrust > 0.0


def test_a_value_of_a_property_with_a_slash_needs_the_slash(own, refusal):
    part = "<pure_gain name='x'><input>/systems/switch</input></pure_gain>"

    said = refusal(own(*more(system(part))), "--set", "systems/switch=1")

    assert "--set systems/switch: the model must have or read it" in said
    assert "it does neither; it reads /systems/switch, with a slash." in said


@pytest.mark.counts
def test_a_light_propeller_flies_in_finer_steps(own, surveyed):
    heavier, found = (surveyed(own(power=1500, ixx=ixx)) for ixx in (5e-4, 1e-4))

    assert "inner_loop_rate_hz" not in heavier.tables
    assert found.tables["inner_loop_rate_hz"] == 400.0
    assert "inner_loop_rate_hz = 400" in adopt.aircraft_text(found.tables, found.notes)
    assert "its inner loop runs at 400 Hz" in found.notes[-1]
    # A steady propeller pushes alike whatever its inertia.
    assert found.spare_thrust == pytest.approx(heavier.spare_thrust, rel=1e-6)


@pytest.mark.slow
def test_engines_are_found_beside_a_main_file_without_a_folder_for_them(own, surveyed):
    folder = own().parent
    for part in (folder / "Engines").iterdir():
        part.rename(folder / part.name)
    (folder / "Engines").rmdir()

    assert surveyed(folder / "aerosonde.xml").tables["engines"]["count"] == 1


def test_a_part_that_is_not_there_is_looked_for_beside_the_main_file(own, surveyed):
    file = own("(?s)<aerodynamics>.*</aerodynamics>", '<aerodynamics file="gone.xml"/>')

    with pytest.raises(
        ft.loop.PlantError, match=re.escape(f"{file.parent}/gone.xml: must be readable")
    ):
        surveyed(file)


@pytest.mark.soak
def test_an_electric_engine_settles_in_the_steps_of_its_flight(own, surveyed):
    file = own(power=1500, ixx=0.0005)
    (file.parent / "Engines").rename(file.parent / "engine")  # JSBSim knows both names

    found = surveyed(file)

    # 1500 W at the airspeed chosen cannot push with more than this, over the weight.
    assert 0.0 < found.spare_thrust < 1500.0 / found.V_a / (11.0 * 9.80665)


def test_thrust_of_an_electric_engine_depends_on_the_throttle_alone(own, tmp_path):
    tables = survey.wide_tables(str(own(power=1500, ixx=0.0005)))
    tables["engines"]["settle_s"] = 15.0

    def thrusts(*throttles):
        bench = Bench(Fdm(aircraft_from(tables, tmp_path)), 1000.0)
        thrust = bench.fdm.reader("propulsion/engine/thrust-lbs")
        for throttle in throttles:
            bench.accelerations(AirframeState(V_a=25.0, throttle=throttle))
            yield thrust()

    (from_rest,) = thrusts(1.0)
    closed, half, full, closed_again = thrusts(0.0, 0.5, 1.0, 0.0)

    assert closed < 0.0 < half < full  # a windmill brakes
    assert (from_rest, closed_again) == pytest.approx((full, closed), rel=1e-6)


@pytest.mark.slow
def test_a_link_that_leads_nowhere_is_no_fault(own, surveyed):
    file = own()
    for name, target in ((".#lost.xml", "nowhere"), (".#itself.xml", ".#itself.xml")):
        (file.parent / "Engines" / name).symlink_to(target)

    assert surveyed(file).V_a > 0.0


def test_a_pipe_is_no_part_of_a_model(own, tmp_path):
    file = own('file="aerosonde_motor"', 'file="pipe"')
    for pipe in ("Engines/pipe.xml", "pipe-set.xml"):
        os.mkfifo(file.parent / pipe)

    found = ft.adopt(str(file.parent), tmp_path / "mine")  # by its main file, the only one

    assert "`file` must name a file" in found.reason


@pytest.mark.slow
def test_parts_are_named_from_the_folder_of_flightgears_aircraft(own, surveyed):
    file = own()
    text = file.read_text()
    part = text[text.index("<propulsion>") : text.index("<aerodynamics>")]
    below = file.parent / "FDM"
    below.mkdir()
    (below / "motor.xml").write_text(part)
    (below / file.name).write_text(text.replace(part, '<propulsion file="FDM/motor.xml"/>'))
    (file.parent / "sonde-set.xml").write_text("<PropertyList/>")

    assert surveyed(below / file.name).V_a > 0.0


@pytest.mark.slow
def test_what_adopt_is_told_is_kept_in_the_file_of_a_refused_model(own, tmp_path, refusal):
    file = own(*WINGLESS)
    told = "--set", "fcs/flap-cmd-norm=0.25", "--set", "/a/b=2", "--throttle", "a/lever"

    refusal(file, *told, "--no-rudder", status=1)

    draft = (tmp_path / "mine/aircraft.toml").read_text()
    for line in ('"fcs/flap-cmd-norm" = 0.25', '"/a/b" = 2.0', 'command = "a/lever"'):
        assert line in draft
    assert "rudder =" not in draft
    assert "--set no/such: the model must have or read it" in refusal(file, "--set", "no/such=1")
    for wrong in ("fcs/flap-cmd-norm", "a[[=1", "a=nan", "=1", "x" * 100_000):
        err = refusal(file, "--set", wrong)
        assert "--set must be NAME=VALUE" in err
        assert len(err) < SHORT


def test_the_main_file_is_found_by_the_files_of_flightgear(own, refusal):
    file = own(*WINGLESS)
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
    file = own(*WINGLESS)
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
    file = own(*WINGLESS)
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
    file = own(*WINGLESS)
    (file.parent / "notes.xml").write_text("<notes")

    assert NO_WING in refusal(file.parent, status=1).splitlines()[-1]

    shutil.copy(file, file.with_name("other.xml"))
    several = "must hold one aircraft of JSBSim's, got aerosonde.xml, other.xml"
    assert several in refusal(file.parent)

    file.rename(file.parent / f"{file.parent.name}.xml")
    assert NO_WING in refusal(file.parent, status=1).splitlines()[-1]


@pytest.mark.counts
def test_an_aircraft_whose_path_angle_swings_gets_a_slower_inner_loop(tmp_path):
    found = answer("adopt", "MD11", "--out", tmp_path / "MD11")  # 5 deg with the first one

    assert found["status"] == "adopted"
    assert found["flown"]["tuned"]["ST_deg"]["gamma"] < 0.5


@pytest.mark.counts
def test_what_is_said_of_an_aircraft_is_for_the_airspeed_at_which_it_is_adopted(tmp_path):
    found = answer("adopt", "minisgs", "--out", tmp_path / "minisgs")
    stall = json.loads((tmp_path / "minisgs/adoption.json").read_text())["stall_mps"]
    start = start_condition(ft.load_scenario(tmp_path / "minisgs/turn.toml"))

    assert start.V_a > 1.7 * stall  # it is not adopted at the first airspeed that is tried
    assert found["V_a_mps"] == pytest.approx(start.V_a, abs=MM_PER_S)
    assert found["glide_ratio"] == pytest.approx(-1.0 / math.tan(start.gamma), rel=0.1)
    # That the paper's gains leave the envelope beside those of the adoption is no failure.
    assert found["flown"]["paper"]["status"] == "left_envelope"
    flown = answer("fly", tmp_path / "minisgs/turn.toml", "--out", tmp_path / "out")
    assert flown["claim"]["verdict"] == "met"


@pytest.mark.counts
def test_a_glider_turns_about_its_steady_glide(tmp_path):
    found = answer("adopt", "sgs126", "--out", tmp_path / "sgs126")
    trims = answer("trim", tmp_path / "sgs126", "--V-a", found["V_a_mps"])["trims"]
    start = start_condition(ft.load_scenario(tmp_path / "sgs126/turn.toml"))

    assert found["status"] == "adopted"
    # In steady flight without thrust the tangent of the glide is drag over lift.
    assert math.tan(start.gamma) == pytest.approx(-1.0 / found["glide_ratio"], rel=1e-4)
    spare = json.loads((tmp_path / "sgs126/adoption.json").read_text())["spare_thrust"]
    assert math.tan(start.gamma) == pytest.approx(spare, rel=0.1)
    assert trims[0]["gamma_deg"] == pytest.approx(start.gamma / DEG, abs=CENTIDEGREE)
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


@pytest.mark.soak
def test_parts_of_jsbsim_are_found_beside_those_two_levels_up(own, surveyed, tmp_path):
    file = own(*more('<system file="GNCUtilities"/>'))
    for part in ("systems", "engine"):
        (tmp_path / part).mkdir()
    for part in [*(file.parent / "Engines").glob("*.xml")]:
        part.rename(tmp_path / "engine" / part.name)

    assert surveyed(file).V_a > 0.0


@pytest.mark.counts
def test_a_model_of_ones_own_has_its_engines_beside_it(tmp_path):
    shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", tmp_path / "models")
    for file in (tmp_path / "models").glob("*.json"):
        file.unlink()

    found = answer("adopt", tmp_path / "models/aerosonde.xml", "--out", tmp_path / "mine")

    # Its published lift slope of 5.61 and largest C_L of 1.5 at 1000 m: the stall.
    stall = math.sqrt(2.0 * 11.0 * 9.80665 / (1.11164 * 0.55 * 1.5))
    assert found["status"] == "adopted"
    assert found["V_a_mps"] == pytest.approx(1.6 * stall, rel=0.02)
    # It has no flight control: its aerodynamics read positions that nothing else writes.
    assert "its flight control is bypassed" in found["notes"][0]
    assert ft.loop.JSBSimPlant(tmp_path / "mine").config.model == "../models/aerosonde.xml"


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
    for end in each_end(out, before, command, ("SIGKILL", "SIGTERM"), 37):
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

    assert sorted([*adopted, *flies, *refused]) == sorted(models_of_jsbsim())
    assert len(adopted) >= 44
    assert commands.count("| yes | yes | yes | yes | yes |") == 8  # but for gliders
    known = "737", "A320", "c182", "DHC6", "J3Cub", "T38", "B747", "p51d", "sgs126", "f16"
    assert set(known) <= set(adopted)


@pytest.mark.parametrize(("aircraft", "V_a"), [("aerosonde", 25.0), ("c172p", 50.0)])
def test_the_largest_part_of_the_drag_has_its_share_of_what_acts(aircraft, V_a):
    """JSBSim's own sum of the drag axis, in lbf."""
    fdm = fdm_of(aircraft)
    trimmed = _TrimProblem(fdm, ft.loop.FlightCondition(V_a=V_a, h=1000.0))
    trimmed.check(trimmed.steady())

    name, share = survey._largest_drag(fdm)

    total, part = fdm.reader("forces/fwx-aero-lbs")(), fdm.reader(name)()
    assert share == pytest.approx(part / total, rel=1e-9)
    assert share > 0.5


@pytest.mark.parametrize(
    ("diameters", "inches"),
    [
        ("<diameter>74</diameter>", True),
        ("<diameter>6.2</diameter>", False),
        ('<diameter unit="IN">74</diameter>', False),
        ("<diameter>6.2</diameter><diameter>74</diameter>", True),
        ("<diameter>wide</diameter>", False),
        ("", False),
    ],
)
def test_a_diameter_is_in_inches_if_no_propeller_is_so_wide_in_feet(diameters, inches):
    assert in_inches(ElementTree.fromstring(f"<propeller>{diameters}</propeller>")) == inches
