"""What experiments find of an aeroplane in closed form: its lift, surfaces, engines and levers.

A row is a change of the Aerosonde's model, what is found of it, and words of the notes.
"""

import math
import re

import numpy as np
import pytest
from book_aeroplane import (
    ALPHA,
    C_D,
    C_L,
    FULL,
    POSITIONS,
    SETTINGS,
    V_S,
    W,
    calculated,
    differs,
    flown_by,
    found_of,
    gain,
    glide,
    more,
    system,
    value,
)  # fmt: skip

import flighttune as ft

STRONG = 36576.0 * 0.3048 / 9.80665 / 11.0 / 0.3048**2  # lbf per ft lbf/s, over the weight


CLIP = "<clipto><min>{}</min><max>{}</max></clipto>"


LEVER, OUT = "<property>a/lever</property>", "<output>fcs/throttle-cmd-norm</output>"
OPEN = calculated("open", f"<product><value>2</value>{LEVER}</product>", CLIP.format(0, 1) + OUT)
BRAKE = """<fcs_function name="a/brake"><function><difference><value>1</value>
<property>{}</property></difference></function><output>fcs/speedbrake-pos-norm</output></fcs_function>
<pure_gain name="a/drag"><input>fcs/speedbrake-pos-norm</input><gain>1</gain></pure_gain>"""
READS = calculated("b", "<property>/controls/x[1]</property>", "")
READS += "<actuator name='a/c'><input>a/b</input><rate_limit>a/rate</rate_limit></actuator>"
FG_LEVER, TRIM = "/controls/engines/engine[0]/throttle", "fcs/pitch-trim-cmd-norm"
FG_GAIN = gain("t", "<gain>1</gain>", FG_LEVER, "fcs/throttle-cmd-norm")
PUSHER = """<external_reactions><force name="pusher" frame="BODY"><function><product>
<property>fcs/throttle-pos-norm</property><value> 9 </value></product></function>
<location unit="M"><x>0</x><y>0</y><z>0</z></location>
<direction><x>1</x><y>0</y><z>0</z></direction></force></external_reactions>"""
LEG = "<contact type='BOGEY' name='n'><retractable>{}</retractable></contact>"
GEAR = '<pure_gain name="a/drag"><input>gear/gear-pos-norm</input><gain>1</gain></pure_gain>'


# A tail that follows the integral of the stick, a slat that takes seconds to a half, and a droop
# that follows the pitch rate.
FLY_BY_WIRE = """<integrator name="fcs/fbw/horz-tail-pos-rad"><input>fcs/elevator-cmd-norm</input>
<c1>1</c1></integrator><fcs_function name="a/half"><function><value>0.5</value></function>
</fcs_function><lag_filter name="fcs/fbw/slat-norm"><input>a/half</input><c1>0.5</c1>
</lag_filter><pure_gain name="fcs/fbw/droop"><input>velocities/q-rad_sec</input><gain>1</gain>
</pure_gain>"""
SLAT = """<product \\1><value>0.086</value><sum><property>fcs/fbw/slat-norm</property>
<property>fcs/fbw/droop</property></sum></product>"""
C_D_0 = r"<value (name=\S+CD_0.)> 0.043 </value>"
TAIL = r"(?s)(.*)fcs/elevator-pos-rad(.*)fcs/elevator-pos-rad(.*)fcs/elevator-pos-rad"
THRICE, DEFINED = "\\1{0}\\2{0}\\3{0}", "<property>{}</property>"
NAMED = "fcs/p", "fcs/q", "fcs/r"
BEHIND_TAIL = THRICE.format("fcs/fbw/horz-tail-pos-rad")
AILERON = TAIL.replace("elevator", "left-aileron")
NO_RUDDER = r"(?s)(.*)fcs/rudder-pos-rad(.*)fcs/rudder-pos-rad(.*)fcs/rudder-pos-rad"
AT_LOW_SPEED = """<sum \\1><value>0.043</value><product><value>2</value><lt>
<property>velocities/vt-fps</property><value>{}</value></lt></product></sum>"""
BOTH = "<sum><property>a/lever</property><property>a/second</property></sum>"
EITHER = calculated("open", f"<product><value>2</value>{BOTH}</product>", CLIP.format(0, 1) + OUT)
FACTOR = calculated(
    "lever", "<product><property>fcs/throttle-cmd-norm</property><property>/controls/on</property>"
    "</product>", "<output>fcs/throttle-pos-norm</output>",
)  # fmt: skip


def late(rate):
    return flown_by(gain("aileron", f"<c1>{rate}</c1>", kind="lag_filter"))


def gear(retractable):
    return f"<ground_reactions>{LEG.format(retractable)}</ground_reactions>"


BYPASSED = {"surfaces": {x: {**FULL, "replaces": [y]} for x, y in POSITIONS.items()}}
NO_USE = "bypassed: its aileron command .fcs/aileron-cmd-norm. has no usable effect"


def engine(**keys):
    return {"engines": {"count": 1, "settle_s": 0.0, **keys}}


# Drag is linear between degrees where no engine tells it again.
SLOW = 1.48 / 1.6**2
SPARE = -np.interp(np.interp(SLOW, C_L[:29], ALPHA[:29]), ALPHA, C_D).item() / SLOW
GLIDES = {"engines": {"count": 0, "settle_s": 0.0}, "spare_thrust": SPARE}
ANY_SPARE, ANY_DRAG = {"spare_thrust": None}, {"lift.drag": None}
# changes, what is asked, what differs from the book's aeroplane (None is any), words of the notes
MODELS = {
    "no flight control": ([], {}, BYPASSED, [NO_USE]),
    "surfaces of all kinds": (
        [more(gear(0), system(
            gain("aileron", f"<gain>0.35</gain>{CLIP.format(-0.175, 0.5)}"), GEAR,
            gain("elevator", "<gain>-0.35</gain>"), gain("rudder", "<gain>0.2</gain>"),
        ))], {"V_a": 27.0},
        {**found_of(27.0), "surfaces": {
            "aileron": {**FULL, "travel_deg": [-10.03, 20.05]},
            "elevator": {**FULL, "full_rad": [0.35, -0.35]},
            "rudder": {"travel_deg": [-11.46, 11.46], "full_rad": [-0.2, 0.2]},
        }}, [],
    ),
    "a command that is the position": (
        [*flown_by("", tops=[f"<system name='o'>{DEFINED.format('fcs/a-rad')}</system>"]),
         (AILERON, THRICE.format("fcs/a-rad"))],
        {"told": lambda x: x["surfaces"]["aileron"].update(command="fcs/a-rad")},
        {"surfaces": dict.fromkeys(POSITIONS, FULL) | {
            "aileron": {
                "travel_deg": [-57.3, 57.3], "full_rad": [-1.0, 1.0], "command": "fcs/a-rad",
            },
        }}, [],
    ),
    "positions of any name, one of the other sense": (
        [*zip((AILERON, TAIL, NO_RUDDER), map(THRICE.format, NAMED), strict=True),
         ("Cm_de.> <value> -0.99", 'Cm_de"> <value> 0.99'),
         more("<system name='o'>", *map(DEFINED.format, NAMED), "</system>")], {},
        {"surfaces": {x: {**FULL, "replaces": [y]} for x, y in zip(
            POSITIONS, (NAMED[0], f"-{NAMED[1]}", NAMED[2]), strict=True)}},
        [NO_USE],
    ),
    "drag at low speeds": (
        [*flown_by(), (C_D_0, AT_LOW_SPEED.format(2.1 * V_S / 0.3048))], {},
        {**found_of(2.2 * V_S), **ANY_DRAG}, [],
    ),
    "a glide of inertias that no body has": (
        [*flown_by(), (r'(<ixx unit="KG.M2">)[^<]*', r"\1 3.5 ")], {"glide": True},
        {**GLIDES, "settings": SETTINGS},
        ["inertia xx exceeds the sum of the others", "about its steady glide"],
    ),
    "a weak motor": (flown_by(), {"power": 1}, GLIDES, [
        r"at most 0\.41 of its drag at any .* stay off", "about its steady glide",
    ]),
    "a motor that is far too strong": (flown_by(), {"power": 36576}, {
        **engine(full=1.0 / 2048.0), "spare_thrust": STRONG / 2048.0 - 1.0 / glide(1.6 * V_S),
    }, ["far too strong: full throttle is 0.000488 of"]),
    "a force": (
        flown_by(tops=[PUSHER]), {"power": 0},
        {**found_of(thrust=9.0 * 4.4482216), **engine(thrust="forces/fbx-external-lbs")},
        ["an external force pushes it"],
    ),
    "a gyroscope": (
        flown_by(), {"power": 1500, "ixx": 0.02}, {**engine(settle_s=60.0), **ANY_SPARE},
        [r"nutates at \S+ rad/s: an inertia of 0.02 slug ft2 at \S+ rpm"],
    ),
    "a lever open at a half": (
        flown_by(parts=[OPEN]), {"told": lambda x: x["engines"].update(command="a/lever")},
        engine(command="a/lever"), [],
    ),
    "levers of its own": (flown_by(parts=[EITHER]), {}, {
        **engine(command="a/lever"), "declared": {"a/lever": 0.0, "a/second": 0.0},
        "linked": {"a/second": "ft/throttle-norm"},
    }, ["its throttle is moved by a/lever, a/second"]),
    "a factor on its throttle": (
        flown_by(parts=[FACTOR]), {}, {"declared": {"/controls/on": 1.0}},
        ["/controls/on = 1 is assumed: .* throttle .* --set /controls/on=1 states it"],
    ),
    "an aileron that drifts": (late(0.3), {}, None, ["drifts while the aileron command is held"]),
    "an aileron that is late": (late(1.5), {}, None, ["keeps moving after the aileron command"]),
    "one that does not come to rest": (
        [more(system(FLY_BY_WIRE, gain("aileron", "<gain>0.3</gain>"))), (TAIL, BEHIND_TAIL)], {},
        None, ["bypassed for its elevator and rudder: .*does not come to rest"],
    ),
    "a fly-by-wire": (
        [more(system(FLY_BY_WIRE)), (TAIL, BEHIND_TAIL), (C_D_0, SLAT)], {}, {
            "surfaces": BYPASSED["surfaces"] | {
                "elevator": {**FULL, "replaces": ["fcs/fbw/horz-tail-pos-rad"]},
            },
            "declared": {"ft/fcs/fbw/slat-norm": 0.5, "ft/fcs/fbw/droop": 0.0},
            # half of 0.086 is the book's 0.043
        }, ["bypassed", "moves fcs/fbw/droop, fcs/fbw/slat-norm: held as in level flight"],
    ),
    "no rudder": (
        [(NO_RUDDER, THRICE.format("fcs/elevator-pos-rad"))], {},
        {"surfaces": {x: BYPASSED["surfaces"][x] for x in ("aileron", "elevator")}},
        [NO_USE, "it has no rudder: yaw is left to the airframe"],
    ),
    "levers of FlightGear": (flown_by(parts=[FG_GAIN, READS, BRAKE.format("/controls/a")]), {}, {
        "declared": {"/controls/x[1]": 0.0, "a/rate": 0.0, "/controls/a": 1.0, FG_LEVER: 0.0},
        "linked": {FG_LEVER: "ft/throttle-norm"},
    }, ["fcs/speedbrake-pos-norm is in by /controls/a = 1", "with FlightGear's levers linked",
        "are 0: /controls/x.1., a/rate$"]),
    "a brake and gear that stay out": (
        flown_by(parts=[BRAKE.format(TRIM), GEAR.replace("drag", "leg")], tops=[gear(1)]), {}, {},
        ["fcs/speedbrake-pos-norm is 1: it is out", "gear/gear-pos-norm is 1: it is out"],
    ),
    "a height of FlightGear": ([*flown_by(), (
        C_D_0,
        r"<product \1><value>0.043</value><quotient><property>/position/altitude-agl-ft</property>"
        "<value>3280.84</value></quotient></product>",
    )], {}, {
        "declared": {"/position/altitude-agl-ft": 0.0},
        "linked": {"/position/altitude-agl-ft": "position/h-agl-ft"},
    }, []),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_what_is_found_of_a_model_is_what_it_was_given(name, own, surveyed):
    changes, asked, others, words = MODELS[name]
    asked = dict(asked)
    motor = {key: asked.pop(key) for key in ("power", "ixx") if key in asked}

    found = surveyed(own(*changes, **motor), **asked)

    values = {} if others is None else found_of() | others
    got = {key: value(found, key) for key in values}
    assert {key: x for key, x in got.items() if differs(x, values[key])} == {}
    assert len(found.notes) == len(words), found.notes
    for note, said in zip(found.notes, words, strict=True):
        assert re.search(said, note)
    if name == "a gyroscope":
        nutation, rpm = map(float, re.findall(r"(\S+) (?:rad/s|rpm)", found.notes[-1]))
        across = math.sqrt(1.135 * 1.759) / (14.5939 * 0.3048**2)  # slug ft^2
        assert nutation == pytest.approx(0.02 * rpm * math.pi / 30.0 / across, rel=0.02)


@pytest.mark.soak
def test_a_light_propeller_flies_in_finer_steps_and_one_without_inertia_diverges(own, surveyed):
    heavier, found = (surveyed(own(*flown_by(), power=1500, ixx=x)) for x in (5e-4, 1e-4))

    assert "inner_loop_rate_hz" not in heavier.tables
    assert found.tables["inner_loop_rate_hz"] == 400.0
    assert "its inner loop runs at 400 Hz" in found.notes[-1]
    # A steady propeller pushes alike whatever its inertia.
    assert found.spare_thrust == pytest.approx(heavier.spare_thrust, rel=1e-6)
    assert 0.0 < found.spare_thrust < 1500.0 / found.V_a / W
    with pytest.raises(ft.loop.PlantError, match="propeller diverges: "):
        surveyed(own(*flown_by(), power=1500, ixx=0))


WEIGHT, AREA = r"(<emptywt.*?>)[^<]*", r"(<wingarea.*?>)[^<]*"
LIFT = r'<function name="aero/coefficient/CL">(?s:.*?)<sum>'
SCALED = "<function name='aero/coefficient/CL'><product><value>{}</value><property>a/C</property>"
SCALED += "</product></function><function name='a/C'><sum>"
CARRIED = r'(<function name="aero/force/lift">\s*<product>)'


def flat(factor):
    return [(CARRIED, rf"\1<value>{factor}</value>")]


ROLLED, POSITION_READ = r'Cl_da"> <value> 0.17 </value> ', "fcs/left-aileron-pos-rad"
AILERON = f"<property> {POSITION_READ} </property>"
ABOUT_X = '<axis name="ROLL">'
REFUSED = {
    r"lift does not grow with alpha \(slope -5": flat(-1.0),
    "it lifts too little: the largest lift coefficient is 0.0": flat(0.01),
    r"it would stall at \d{3} m/s": [(WEIGHT, r"\1 5000 ")],
    r"it would stall at [12] m/s": [(WEIGHT, r"\1 0.1 ")],
    r"its mass must be above zero, got -\S+ \(inertia/mass-slugs\)": [(WEIGHT, r"\1 -1600 ")],
    "its wing area must be above zero, got 0": [(AREA, r"\1 0 ")],
    "must be a <fdm_config> of JSBSim, got a <airplane>": [("<fdm_config(?s:.*)", "<airplane/>")],
    "the slope of q_dot by q is .*, which no aircraft has": [(r"-38\.21", "1e300")],
    "cannot be loaded by JSBSim: unterminated": [("fcs/left-aileron", "fcs/left-aileron[[")],
    "must have all its parts, got no file {}/Systems/Gear Box.xml": [
        more('<system file="Gear Box"/>')
    ],
    "got no file {}/Engines/none.xml": [(r'<engine file="[^"]*"', '<engine file="none"')],
    "{}/gone.xml: must be readable": [
        ("(?s)<aerodynamics>.*</aerodynamics>", '<aerodynamics file="gone.xml"/>')
    ],
    r"^must be XML: mismatched tag: line \d+, column \d+": [("</axis>", "</axes>")],
    "no lift or normal-force axis: DRAG, L2, PITCH, ROLL, SIDE, YAW": [
        ('<axis name="LIFT">', '<axis name="L2">')
    ],
    "its aerodynamics lack a moment axis: ROLL": [(ABOUT_X, '<axis name="roll2">')],
    r"its aileron command \(fcs/aileron-cmd-norm\) has no usable effect": [
        (rf"({ROLLED}){AILERON}", rf"\1<abs><property>{POSITION_READ}</property></abs>")
    ],
    "its thrust does not follow the throttle": [
        more(system(calculated("open", "<value>1</value>", OUT)))
    ],
    "`file` must stay in the folder": [('file="aerosonde_motor"', 'file="../out"')],
}


@pytest.mark.parametrize("sentence", REFUSED)
def test_a_model_that_cannot_fly_is_refused_in_one_line(own, tmp_path, sentence):
    file = own(*REFUSED[sentence])

    found = ft.adopt(str(file), tmp_path / "mine")

    assert found.status == "refused"
    wanted = sentence.replace("{}", re.escape(str(file.parent)))
    assert re.search(wanted, found.reason)
    assert "\n" not in found.reason
    assert f"# refused: {found.reason}" in found.texts["aircraft.toml"]
