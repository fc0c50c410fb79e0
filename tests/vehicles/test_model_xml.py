"""Our systems in the main file of a model, and its engines with placeholders and units."""

import math
from pathlib import Path
from xml.etree.ElementTree import fromstring

import pytest
from compiled_parts import state_of

import flighttune as ft
from flighttune.vehicles.aircraft import aircraft, model_xml
from flighttune.vehicles.compiled.functions import hidden_function

SURFACES = {
    "aileron": {
        "travel_deg": [-20.0, 25.0],
        "full_rad": [-0.3, 0.4],
        "replaces": [
            *("fcs/left-elevon-norm", "-fcs/right-elevon-norm"),
            *("fcs/roll-deg", "fcs/mag-roll-rad"),
        ],
    },
    "elevator": {
        "travel_deg": [-25.0, 30.0],
        "full_rad": [0.5, -0.25],  # a command of the opposite sense
        "replaces": ["fcs/left-elevon-norm", "fcs/right-elevon-norm", "fcs/pitch-rad"],
    },
}
READ = ("left-elevon-norm", "right-elevon-norm", "roll-deg", "mag-roll-rad", "pitch-rad")


@pytest.mark.parametrize(
    ("aileron", "elevator", "shares"),
    [
        *((0.4, 0.5, (1.0, -1.0)), (-0.3, -0.25, (-1.0, 1.0)), (0.1, -0.05, (0.25, 0.2))),
        *((-0.15, 0.25, (-0.5, -0.5)), (0.0, 0.0, (0.0, 0.0))),
    ],
)
def test_positions_that_surfaces_replace_are_shares_of_those_at_full_command_or_angles(
    aileron, elevator, shares
):
    """Full commands are at -0.3 and 0.4 rad, and at 0.5 and -0.25 rad; elevons get the sum."""
    config = aircraft.load_aircraft("aerosonde").model_copy(
        update={"surfaces": aircraft.Surfaces.model_validate(SURFACES)}
    )
    drag = "".join(f"<property> -fcs/{name} </property>" for name in READ)
    root = fromstring(f"<fdm><aerodynamics><sum>{drag}</sum></aerodynamics></fdm>")

    model_xml.put_in_front(root, config)

    now = state_of({"ft/aileron-rad": aileron, "ft/elevator-rad": elevator})
    made = {part.get("name"): part.find("function") for part in root.iter("fcs_function")}
    found = [hidden_function(now, made[f"ft/fcs/{name}"]) for name in READ]
    roll, pitch = shares
    expected = (roll + pitch, pitch - roll, math.degrees(aileron), abs(aileron), -elevator)
    assert found == pytest.approx(expected, abs=1e-12)
    texts = [part.text for part in root.iterfind("aerodynamics//property")]
    assert texts == [f"-ft/fcs/{name}" for name in READ]


JET = "<turbine_engine><milthrust>900</milthrust><maxthrust>1100.5</maxthrust></turbine_engine>"
PROPELLER = "<propeller>{}<diameter>{}</diameter></propeller>"


def engines(*parts):
    """A model with engines, each a motor and a thruster in place."""
    text = "".join(
        f"<engine>{motor}<thruster>{thruster}</thruster></engine>" for motor, thruster in parts
    )
    return fromstring(f"<fdm><propulsion>{text}</propulsion></fdm>")


def test_a_factor_on_thrust_is_one_on_each_propeller_and_on_the_numbers_of_other_engines():
    root = engines(
        ("<piston_engine/>", PROPELLER.format("<ct_factor>0.9</ct_factor>", 6)),
        ("<electric_engine><power>400</power></electric_engine>", PROPELLER.format("", 6)),
        ("<electric_engine><power>300</power></electric_engine>", "<direct/>"),
        (JET, "<direct/>"),
    )

    model_xml.scale_thrust(root, [Path()], Path("mine.xml"))

    text = model_xml.filled(model_xml.template_of(root), {"thrust": 1.5})
    parts = fromstring(text.encode())
    factors = [float(part.text) for part in parts.iter("ct_factor")]
    assert factors == pytest.approx([1.35, 1.5])
    assert [float(part.text) for part in parts.iter("power")] == pytest.approx([400.0, 450.0])
    of_jet = [float(parts.findtext(f".//{tag}")) for tag in ("milthrust", "maxthrust")]
    assert of_jet == pytest.approx([1350.0, 1650.75])
    with pytest.raises(ft.InputError, match=r"mine.xml has a <rocket_engine> without a propeller"):
        model_xml.scale_thrust(
            engines(("<rocket_engine/>", "<direct/>")), [Path()], Path("mine.xml")
        )


@pytest.mark.parametrize("off", [True, False])
def test_propellers_of_74_ft_are_in_inches_and_jets_that_are_off_do_not_push(tmp_path, off):
    """Of the files that are named, those alone that change are put into the main file."""
    parts = {
        "small": PROPELLER.format("", 6.2),
        "large": PROPELLER.format("", 74),
        "stated": '<propeller><diameter unit="CM">190</diameter></propeller>',
        "jet": JET,
    }
    for name, text in parts.items():
        (tmp_path / f"{name}.xml").write_text(text)
    named = "".join(f'<engine file="jet"><thruster file="{name}"/></engine>' for name in parts)
    root = fromstring(f'<fdm><propulsion>{named}<engine file="none"/></propulsion></fdm>')

    model_xml.mend_engines(root, [tmp_path], off=off)

    thrusters = dict(zip(parts, root.findall(".//thruster"), strict=True))
    diameter = thrusters["large"].find("propeller/diameter")
    assert (diameter.text, diameter.get("unit")) == ("74", "IN")
    assert thrusters["large"].get("file") is None
    for name in ("small", "stated"):
        assert (thrusters[name].get("file"), len(thrusters[name])) == (name, 0)
    *jets, missing = root.findall("propulsion/engine")
    assert missing.get("file") == "none"
    thrusts = [jet.findtext("turbine_engine/milthrust") for jet in jets]
    assert thrusts == ["0" if off else None] * 4
    assert [jet.get("file") for jet in jets] == [None if off else "jet"] * 4


DERIVATIVES = """
    <fdm><aerodynamics>
      <axis name="LIFT">
        <function name="aero/CLo"><description>at rest</description><value>2</value></function>
        <function name="aero/CLa"><product><value>3</value><value>4</value></product></function>
      </axis>
      <axis name="DRAG"><function name="aero/CDo"><value>5</value></function></axis>
    </aerodynamics></fdm>"""


def derivatives(root, **values):
    """What the functions of a model are, with these numbers in its placeholders."""
    filled = fromstring(model_xml.filled(model_xml.template_of(root), values).encode())
    return [hidden_function(state_of({}), part) for part in filled.iter("function")]


@pytest.mark.parametrize(
    ("name", "expected"), [("aero/CLa", (2.0, 18.0, 5.0)), ("CDo", (2.0, 12.0, 7.5))]
)
def test_a_factor_on_a_coefficient_is_on_the_function_of_this_name_alone(name, expected):
    root = fromstring(DERIVATIVES)
    model_xml.strip_text(root)

    model_xml.scale_coefficient(root, name, Path("mine.xml"))

    factor = {f"{model_xml.COEFFICIENT}{name}": 1.5}
    assert derivatives(root, **factor) == pytest.approx(expected)


def test_a_factor_on_an_axis_is_on_all_its_functions():
    root = fromstring(DERIVATIVES)
    model_xml.strip_text(root)
    assert list(root.iter("description")) == []

    model_xml.scale_axis(root, "lift", Path("mine.xml"))

    assert derivatives(root, lift=0.5) == pytest.approx((1.0, 6.0, 5.0))


@pytest.mark.parametrize("name", ["CLb", "aero/CL", "LIFT"])
def test_a_factor_on_what_is_no_function_is_refused(name):
    with pytest.raises(
        ft.InputError, match=rf"`coefficient_factors.{name}` must be .* of mine.xml"
    ):
        model_xml.scale_coefficient(fromstring(DERIVATIVES), name, Path("mine.xml"))


def test_a_name_of_two_coefficients_is_refused_with_both_and_an_axis_with_those_there_are():
    twice = DERIVATIVES.replace("aero/CDo", "wing/CLo")
    with pytest.raises(ft.InputError, match="it means aero/CLo, wing/CLo"):
        model_xml.scale_coefficient(fromstring(twice), "CLo", Path("mine.xml"))
    with pytest.raises(
        ft.InputError, match=r"`side_force_factor` .* no SIDE axis, only LIFT, DRAG"
    ):
        model_xml.scale_axis(fromstring(DERIVATIVES), "side_force", Path("mine.xml"))


def test_a_factor_on_a_part_of_a_function_is_on_this_part_alone():
    named = DERIVATIVES.replace("<value>4</value>", '<sum name="slope"><value>4</value></sum>')
    root = fromstring(named.replace("<value>3</value>", "<value>7</value>"))
    model_xml.strip_text(root)

    model_xml.scale_coefficient(root, "slope", Path("mine.xml"))

    (sum_,) = root.iter("sum")
    (scaled,) = (part for part in root.iter("product") if sum_ in list(part))
    (factor,) = scaled.findall("value")
    assert factor.text == model_xml.placeholder(f"{model_xml.COEFFICIENT}slope")
