"""What experiments find of an aeroplane in closed form: its lift, surfaces, engines and levers.

A row is a change of the Aerosonde's model, what is found of it, and words of the notes.
"""

import math
import re

import pytest

import flighttune as ft

W, RHO, S = 11.0 * 9.80665, 1.11164, 0.55  # N, kg/m3 at 1000 m, m2
V_S = math.sqrt(2.0 * W / (RHO * S * 1.48))  # it stalls at 14 deg, where lift grows less
STRONG = 36576.0 * 0.3048 / 9.80665 / 11.0 / 0.3048**2  # lbf per ft lbf/s, over the weight


def glide(V_a):
    """Lift over drag of the book: C_D = 0.043 + C_L^2 / (pi 0.9 AR)."""
    C_L = W / (0.5 * RHO * V_a**2 * S)
    return C_L / (0.043 + 0.0232 * C_L**2)


def system(*components):
    return f"<system name='own'><channel name='own'>{''.join(components)}</channel></system>"


def more(*parts):
    """The change of a model that adds parts at its end."""
    return "</fdm_config>", f"{''.join(parts)}</fdm_config>"


def gain(name, inside="<gain>0.35</gain>", source=None, output=None, kind="pure_gain"):
    source = source or f"fcs/{name}-cmd-norm"
    output = output or f"fcs/{name}-pos-rad".replace("aileron", "left-aileron")
    return (
        f"<{kind} name='a/{name}'><input>{source}</input>{inside}<output>{output}</output></{kind}>"
    )


ELEVATOR, RUDDER = gain("elevator"), gain("rudder")
CLIP = "<clipto><min>{}</min><max>{}</max></clipto>"


def flown_by(aileron):
    return more(system(aileron, ELEVATOR, RUDDER))


def late(rate):
    lag = f"<c1>{rate}</c1>"
    return [flown_by(gain("aileron", lag, kind="lag_filter"))]


def calculated(name, function, output):
    return f"<fcs_function name='a/{name}'><function>{function}</function>{output}</fcs_function>"


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


def gear(retractable):
    return [more(f"<ground_reactions>{LEG.format(retractable)}</ground_reactions>", system(GEAR))]


# A tail that follows the integral of the stick, a slat that takes 5 s to a half, and a droop that
# follows the pitch rate.
FLY_BY_WIRE = """<integrator name="fcs/fbw/horz-tail-pos-rad"><input>fcs/elevator-cmd-norm</input>
<c1>1</c1></integrator><fcs_function name="a/half"><function><value>0.5</value></function>
</fcs_function><lag_filter name="fcs/fbw/slat-norm"><input>a/half</input><c1>0.2</c1>
</lag_filter><pure_gain name="fcs/fbw/droop"><input>velocities/q-rad_sec</input><gain>1</gain>
</pure_gain>"""
SLAT = """<product \\1><value>0.086</value><sum><property>fcs/fbw/slat-norm</property>
<property>fcs/fbw/droop</property></sum></product>"""
C_D_0 = r"<value (name=\S+CD_0.)> 0.043 </value>"
TAIL = r"(?s)(.*)fcs/elevator-pos-rad(.*)fcs/elevator-pos-rad(.*)fcs/elevator-pos-rad"
BEHIND_TAIL = "\\1{0}\\2{0}\\3{0}".format("fcs/fbw/horz-tail-pos-rad")
NO_RUDDER = r"(?s)(.*)fcs/rudder-pos-rad(.*)fcs/rudder-pos-rad(.*)fcs/rudder-pos-rad"
AT_LOW_SPEED = """<sum \\1><value>0.043</value><product><value>2</value><lt>
<property>velocities/vt-fps</property><value>{}</value></lt></product></sum>"""
AS_LOADED = "surfaces.aileron.travel_deg", "surfaces.aileron.full_rad"
GIVEN = dict(zip(AS_LOADED, ([-20.05, 20.05], [-0.35, 0.35]), strict=True))
CLIPPED = dict(zip(AS_LOADED, ([-10.03, 20.05], [-0.35, 0.35]), strict=True))

# changes, what is asked, what is found by attribute or key of the tables, words of the notes
MODELS = {
    "the book's": ([], {}, {
        "lift.V_s": V_S, "V_a": 1.6 * V_S, "glide_ratio": glide(1.6 * V_S), "lift.stall": 0.24435,
        "lift.negative_stall": -0.20944, "spare_thrust": 120.0 / W - 1.0 / glide(1.6 * V_S),
        "surfaces.elevator.replaces": ["fcs/elevator-pos-rad"], "engines.settle_s": 0.0,
        "largest_drag": ("aero/force/drag", 1.0),
    }, ["its flight control is bypassed"]),
    "at an airspeed": ([], {"V_a": 27.0}, {"V_a": 27.0, "glide_ratio": glide(27.0)}, []),
    "drag at low speeds": (
        [(C_D_0, AT_LOW_SPEED.format(2.1 * V_S / 0.3048))], {}, {"V_a": 2.2 * V_S}, []
    ),
    "a glide": (
        [(r'(<ixx unit="KG.M2">)[^<]*', r"\1 3.5 ")], {"glide": True},
        {"engines.count": 0, "spare_thrust": -1.0 / glide(1.6 * V_S)},
        ["inertia xx exceeds the sum of the others", "about its steady glide"],
    ),
    "a weak motor": ([], {"power": 1}, {"engines.count": 0, "V_a": 1.6 * V_S},
                     [r"at most 0\.\d\d of its drag at any .* stay off"]),
    "a motor that is far too strong": ([], {"power": 36576}, {
        "engines.full": 1.0 / 2048.0, "spare_thrust": STRONG / 2048.0 - 1.0 / glide(1.6 * V_S),
    }, ["far too strong"]),
    "a force": (
        [more(PUSHER)], {"power": 0}, {
            "engines.thrust": "forces/fbx-external-lbs",
            "spare_thrust": 9.0 * 4.4482216 / W - 1.0 / glide(1.6 * V_S),
        }, ["an external force pushes it"],
    ),
    "a gyroscope": ([], {"power": 1500, "ixx": 0.02}, {}, ["its propeller makes it a gyroscope"]),
    "a lever open at a half": (
        [more(system(OPEN))], {"told": lambda tables: tables["engines"].update(command="a/lever")},
        {"spare_thrust": 120.0 / W - 1.0 / glide(1.6 * V_S), "engines.command": "a/lever"}, [],
    ),
    "a lever of its own": ([more(system(OPEN))], {}, {"engines.command": "a/lever"},
                           ["its throttle is moved by a/lever"]),
    "surfaces of a flight control": ([flown_by(gain("aileron"))], {}, GIVEN, []),
    "a surface of the other sense": (
        [flown_by(gain("aileron", "<gain>-0.35</gain>"))], {},
        {AS_LOADED[0]: [-20.05, 20.05], AS_LOADED[1]: [0.35, -0.35]}, [],
    ),
    "a clipped surface": (
        [flown_by(gain("aileron", f"<gain>0.35</gain>{CLIP.format(-0.175, 0.5)}"))], {}, CLIPPED, []
    ),
    "an aileron that drifts": (late(0.3), {}, {}, ["drifts while the aileron command is held"]),
    "an aileron that is late": (late(1.5), {}, {}, ["keeps moving after the aileron command"]),
    "one that does not come to rest": (
        [more(system(FLY_BY_WIRE, gain("aileron", "<gain>0.3</gain>"))), (TAIL, BEHIND_TAIL)], {},
        {}, ["bypassed", "does not come to rest"],
    ),
    "a fly-by-wire": (
        [more(system(FLY_BY_WIRE)), (TAIL, BEHIND_TAIL), (C_D_0, SLAT)], {}, {
            "surfaces.elevator.replaces": ["fcs/fbw/horz-tail-pos-rad"],
            "declared.ft/fcs/fbw/slat-norm": 0.5, "declared.ft/fcs/fbw/droop": 0.0,
            "glide_ratio": glide(1.6 * V_S),  # half of 0.086 is the book's 0.043
        }, ["moves fcs/fbw/droop, fcs/fbw/slat-norm: held as in level flight"],
    ),
    "no rudder": (
        [(NO_RUDDER, "\\1{0}\\2{0}\\3{0}".format("fcs/elevator-pos-rad"))], {},
        {"surfaces.rudder": None}, ["it has no rudder: yaw is left to the airframe"],
    ),
    "levers of FlightGear": ([more(system(FG_GAIN, READS, BRAKE.format("/controls/a")))], {}, {
        "declared./controls/x[1]": 0, "declared.a/rate": 0, "declared./controls/a": 1.0,
        f"linked.{FG_LEVER}": "ft/throttle-norm",
    }, ["with FlightGear's levers linked", "are 0: /controls/x[1], a/rate",
        "fcs/speedbrake-pos-norm is in by /controls/a = 1"]),
    "a brake that stays out": ([more(system(BRAKE.format(TRIM)))], {}, {f"declared.{TRIM}": None},
                               ["fcs/speedbrake-pos-norm is 1: it is out"]),
    "gear that is out": (gear(1), {}, {}, ["gear/gear-pos-norm is 1: it is out"]),
    "a height of FlightGear": ([(
        C_D_0,
        r"<product \1><value>0.043</value><quotient><property>/position/altitude-agl-ft</property>"
        "<value>3280.84</value></quotient></product>",
    )], {}, {"glide_ratio": glide(1.6 * V_S)}, []),
}  # fmt: skip
LATER = ("a lever open at a half", "at an airspeed", "a brake that stays out", "gear that is out")
LATER += ("an aileron that drifts", "a height of FlightGear", "one that does not come to rest")


def value(found, name):
    """A value of a survey by its name, or by its keys in the tables."""
    parts = name.split(".", 2 if name.startswith("surfaces") else 1)
    if hasattr(found, parts[0]):
        return value(getattr(found, parts[0]), parts[1]) if parts[1:] else getattr(found, parts[0])
    inside = found.tables
    for part in parts:
        inside = (inside or {}).get(part)
    return inside


def differs(got, wanted):
    if isinstance(wanted, float) or (isinstance(wanted, list) and isinstance(wanted[0], float)):
        return got != pytest.approx(wanted, rel=2e-3, abs=1e-6)
    return got != wanted and [*got] != pytest.approx([*wanted])


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=pytest.mark.soak if x in LATER else ()) for x in MODELS]
)
def test_what_is_found_of_a_model_is_what_it_was_given(name, own, surveyed):
    changes, asked, values, words = MODELS[name]
    asked = dict(asked)
    motor = {key: asked.pop(key) for key in ("power", "ixx") if key in asked}

    found = surveyed(own(*changes, **motor), **asked)

    got = {key: value(found, key) for key in values}
    assert {key: x for key, x in got.items() if differs(x, values[key])} == {}
    notes = " ".join(found.notes)
    assert [x for x in words if x not in notes and not re.search(x, notes)] == []
    if "surfaces.aileron.full_rad" in values:
        assert "bypassed" not in notes


@pytest.mark.soak
def test_fixed_gear_is_not_called_out(own, surveyed):
    assert "it is out" not in " ".join(surveyed(own(*gear(0))).notes)


@pytest.mark.slow
def test_the_gyroscope_of_a_propeller_is_that_of_its_momentum(own, surveyed):
    note = surveyed(own(power=1500, ixx=0.02)).notes[-1]

    nutation, rpm = map(float, re.findall(r"(\S+) (?:rad/s|rpm)", note))
    across = math.sqrt(1.135 * 1.759) / (14.5939 * 0.3048**2)  # slug ft^2
    assert nutation == pytest.approx(0.02 * rpm * math.pi / 30.0 / across, rel=0.02)


@pytest.mark.soak
def test_a_light_propeller_flies_in_finer_steps_and_one_without_inertia_diverges(own, surveyed):
    heavier, found = (surveyed(own(power=1500, ixx=ixx)) for ixx in (5e-4, 1e-4))

    assert "inner_loop_rate_hz" not in heavier.tables
    assert found.tables["inner_loop_rate_hz"] == 400.0
    assert "its inner loop runs at 400 Hz" in found.notes[-1]
    # A steady propeller pushes alike whatever its inertia.
    assert found.spare_thrust == pytest.approx(heavier.spare_thrust, rel=1e-6)
    assert 0.0 < found.spare_thrust < 1500.0 / found.V_a / W
    with pytest.raises(ft.loop.PlantError, match="propeller diverges: "):
        surveyed(own(power=1500, ixx=0))


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
