"""Steady flight found by the trim search, and why there is none."""

import math
import re
import shutil

import numpy as np
import pytest
from places import SHIPPED_AIRCRAFT

import flighttune as ft

DEG = math.pi / 180.0


@pytest.mark.parametrize("phi_deg", [-45.0, -20.0, 30.0, 45.0])
@pytest.mark.parametrize("gamma_deg", [-4.0, 0.0, 20.0])
def test_a_banked_start_is_a_steady_coordinated_turn(fly, phi_deg, gamma_deg):
    phi, gamma = phi_deg * DEG, gamma_deg * DEG

    start = fly((phi, math.cos(gamma) / math.cos(phi)), phi=phi, gamma=gamma, chi=2.0, duration=0.2)

    assert start["chi"][0] == pytest.approx(2.0, abs=1e-6)
    assert start["gamma"] == pytest.approx(gamma, abs=0.05 * DEG)
    assert start["phi"] == pytest.approx(phi, abs=0.05 * DEG)
    assert start["n_y"] == pytest.approx(0.0, abs=1e-3)
    assert start["V_a"] == pytest.approx(25.0, abs=1e-2)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ({"gamma": 80.0 * DEG, "V_a": 40.0}, "V_a .*: full throttle has too little thrust .*left"),
        ({"gamma": -20.0 * DEG}, "V_a .*: the aircraft speeds up with the throttle closed .*left"),
        ({"V_a": 15.2, "phi": 45.0 * DEG}, "V_a .*: it would stall, alpha is at 16.0 deg .*left"),
        ({"V_a": 12.0}, "^`V_a` must lie in 15 to 45 m/s .*, got 12 m/s"),
        ({"phi": 50.0 * DEG}, "^`phi` must lie in -45 to 45 deg .*, got 50 deg"),
        ({"n_z": 2.5}, "^`n_z` must lie in -2.1 to 2.1 .*, got 2.5"),
    ],
)
def test_what_stands_against_a_steady_flight_is_said(condition, message):
    error = ft.InputError if message.startswith("^") else ft.loop.PlantError
    with pytest.raises(error, match=message):
        ft.loop.JSBSimPlant().start(ft.loop.FlightCondition(**{"V_a": 25.0} | condition))


@pytest.mark.parametrize(("V_a", "gamma_deg", "throttle"), [(40.0, 80.0, 1.0), (25.0, -20.0, 0.0)])
def test_what_is_left_over_is_what_thrust_and_weight_lack_along_the_path(V_a, gamma_deg, throttle):
    """By the coefficients of the README; a motor of 120 N, and 11 kg."""
    weight, pressure_area, gamma = 11.0 * 9.80665, 0.5 * 1.1116 * V_a**2 * 0.55, gamma_deg * DEG
    C_L = weight * math.cos(gamma) / pressure_area
    drag = pressure_area * (0.043 + 0.0232 * C_L**2)
    lacking = (120.0 * throttle - drag) / weight - math.sin(gamma)

    with pytest.raises(ft.loop.PlantError) as error:
        ft.loop.JSBSimPlant().start(ft.loop.FlightCondition(V_a=V_a, gamma=gamma))

    size, sense = re.search(r"left over: ([\d.]+) g (\w+)\)", str(error.value)).groups()
    assert float(size) == pytest.approx(abs(lacking), abs=0.01)
    assert sense == ("forward" if lacking > 0.0 else "backward")


@pytest.mark.parametrize(
    ("pattern", "new", "words"),
    [
        (r"(elevator = { travel_deg = \[-25.0), 25.0", r"\1, 1.0", "the elevator is at its stop"),
        (r"(elevator = { travel_deg = \[)-25.0", r"\1-0.3", "the elevator is at its stop"),
        (r"(rudder   = { travel_deg = \[-25.0), 25.0", r"\1, 0.01", "the rudder is at its stop"),
        (r"(rudder   = { travel_deg = \[)-25.0", r"\1-0.01", "the rudder is at its stop"),
        (r"(aileron  = { travel_deg = \[-25.0), 25.0", r"\1, 0.01", "the aileron is at its stop"),
        (r"(aileron  = { travel_deg = \[)-25.0", r"\1-0.01", "the aileron is at its stop"),
        (
            r"alpha_deg = \[-14.0, 16.0\]",
            "alpha_deg = [4.0, 16.0]",
            "negative stall, alpha is at 4",
        ),
    ],
)
def test_a_trim_that_is_not_found_names_the_stop_that_it_lies_at(
    changed_aircraft, pattern, new, words
):
    plant = ft.loop.JSBSimPlant(changed_aircraft("aircraft.toml", pattern, new))

    met = []
    for phi in (-0.7, 0.0, 0.7):
        try:
            plant.start(ft.loop.FlightCondition(V_a=25.0, phi=phi))
        except ft.loop.PlantError as error:
            met.append(str(error))
    assert met
    assert all(words in x for x in met)


@pytest.mark.parametrize(("V_a", "got"), [(10.56789, "10.57"), (14.99999, "14.99999")])
def test_an_airspeed_outside_the_envelope_has_the_digits_that_it_deserves(V_a, got):
    (record,) = ft.trim("aerosonde", V_a=[V_a], gamma=[0.0]).records

    said = f"outside the envelope: `V_a` must lie in 15 to 45 m/s, got {got} m/s"
    assert record["reason"] == said


@pytest.mark.slow
def test_a_glide_is_as_steep_as_its_drag_and_one_that_is_not_steady_is_said_so(changed_aircraft):
    folder = changed_aircraft("aircraft.toml", r"\[engines\]", "[engines]\\ncount = 0")

    slow, steady = ft.trim(folder, V_a=[2.0, 25.0]).records

    assert slow["reason"] == "no steady glide at V_a 2 m/s, h 1000 m"
    weight, pressure_area = 11.0 * 9.80665, 0.5 * 1.1116 * 25.0**2 * 0.55
    C_L = weight / pressure_area
    glide = -math.atan((0.043 + 0.0232 * C_L**2) / C_L)
    assert steady["gamma_deg"] == pytest.approx(glide / DEG, abs=0.1)
    assert steady["trim"]["throttle"] == 0.0
    with pytest.raises(ft.loop.PlantError, match=r"no engine and glides at -5\.\d+ deg"):
        ft.loop.JSBSimPlant(folder).start(ft.loop.FlightCondition(V_a=25.0))


LEVER = """<system name="lever"><channel name="lever"><fcs_function name="a/open"><function><table>
<independentVar>a/lever</independentVar>
<tableData>0 0.05
0.62 0.02
0.66 0.90
1 1</tableData></table></function><output>fcs/throttle-pos-norm</output></fcs_function>
</channel></system>"""


def behind_lever(folder, system, **settle):
    """Copy the Aerosonde, with `system` between the lever ``a/lever`` and its throttle."""
    shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder)
    changes = [
        ("aircraft.toml", "fcs/throttle-pos-norm", "a/lever"),
        ("aerosonde.xml", "</fdm_config>", f"{system}</fdm_config>"),
    ]
    changes += [("aircraft.toml", "[engines]", f"[engines]\n{k} = {v}") for k, v in settle.items()]
    for name, old, new in changes:
        file = folder / name
        assert old in file.read_text()
        file.write_text(file.read_text().replace(old, new))
    return folder


@pytest.mark.slow
def test_a_thrust_that_falls_before_it_grows_steeply_is_trimmed(tmp_path):
    plain = level_throttle("aerosonde")
    folder = behind_lever(tmp_path / "lever", LEVER)

    # The table between its rows at 0.62 and 0.66.
    assert 0.02 < plain < 0.9
    lever = 0.62 + 0.04 * (plain - 0.02) / 0.88
    assert level_throttle(folder) == pytest.approx(lever, abs=1e-6)


def level_throttle(aircraft):
    return ft.trim(aircraft, V_a=[25.0], gamma=[0.0]).records[0]["trim"]["throttle"]


FILTER = """<system name="lever"><property>a/lever</property><channel name="lever">
<lag_filter name="a/slow"><input>a/lever</input><c1>1</c1>
<output>fcs/throttle-pos-norm</output></lag_filter></channel></system>"""


@pytest.mark.soak
def test_a_throttle_behind_a_filter_of_a_second_is_trimmed_as_without_it(tmp_path):
    folder = behind_lever(tmp_path / "filter", FILTER, settle_s=15.0)

    assert level_throttle(folder) == pytest.approx(level_throttle("aerosonde"), abs=1e-6)


# The engine runs from full throttle on, and stops where the lever is closed too fast.
STALLS = """<system name="lever"><property>a/lever</property><property>a/runs</property>
<channel name="lever">
<lag_filter name="a/slow"><input>a/lever</input><c1>1</c1></lag_filter>
<switch name="a/runs-now"><default value="a/runs"/>
<test logic="AND" value="1"> a/lever gt 0.97 </test>
<test logic="AND" value="0"> a/fast gt 0.02 </test><output>a/runs</output></switch>
<summer name="a/fast"><input>a/slow</input><input>-a/lever</input></summer>
<fcs_function name="a/out"><function><product><property>a/lever</property>
<property>a/runs</property></product></function><output>fcs/throttle-pos-norm</output>
</fcs_function></channel></system>"""


@pytest.mark.soak
def test_a_thrust_that_depends_on_the_throttles_before_it_is_said_so(tmp_path):
    folder = behind_lever(tmp_path / "stalls", STALLS, settle_s=3.0)

    (row,) = ft.trim(folder, V_a=[25.0], gamma=[0.0]).records

    # Rounding decides whether the search sees both branches, or on which one its last try lies.
    history = (
        r"its thrust depends on its history, at the throttle 0\.9\d+ it is 1 weights larger .*"
    )
    search = (
        r"the search did not converge, its thrust over its weight is (1\.1 at .*, )?"
        r"0 at .* 1\.1 at .*"
    )
    assert re.fullmatch(f"{history}|{search}", row["reason"])


def test_a_flight_starts_alike_whether_its_trim_is_searched_or_remembered(changed_aircraft):
    folder = changed_aircraft("aircraft.toml", r"title *=.*", 'title = "new"', aircraft="c172p")
    starts = []
    for _ in range(2):
        plant = ft.loop.JSBSimPlant(folder)
        plant.start(ft.loop.FlightCondition(V_a=50.0))
        plant.advance(0.0, 1.0, 0.02)
        starts.append(plant.observe())

    assert starts[0] == starts[1]


@pytest.mark.slow
def test_a_table_of_trims_is_over_the_envelope_and_climbs_of_minus_10_to_45_deg():
    """Six airspeeds, and of each climbs up to the thrust; the rest have their reason."""
    low, high = ft.loop.JSBSimPlant("aerosonde").config.envelope.V_a

    records = ft.trim("aerosonde").records

    speeds = [*dict.fromkeys(row["V_a_mps"] for row in records)]
    assert speeds == pytest.approx(np.linspace(low, high, 6))
    climbs = [row["gamma_deg"] for row in records if row["V_a_mps"] == speeds[2]]
    assert climbs == pytest.approx([-10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 45.0])
    assert len(records) == 6 * 7
    for row in records:
        assert (row["trim"] is None) == bool(row["reason"])
    level = [row["trim"] for row in records if row["gamma_deg"] == 0.0 and row["trim"]]
    # of steady level flight the nose is the angle of attack, which falls with airspeed
    assert [x["theta_deg"] for x in level] == pytest.approx([x["alpha_deg"] for x in level])
    assert [x["alpha_deg"] for x in level] == sorted((x["alpha_deg"] for x in level), reverse=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("speeds", "climbs"), [((45.0, 60.0), (0.0,)), ((45.0,), (0.0, 60.0 * DEG, 3.0 * DEG))]
)
def test_a_trim_of_a_table_that_no_steady_flight_is_near_is_the_one_searched_alone(speeds, climbs):
    """To the bit: the first of an airspeed, and one after a climb that is not steady."""
    *_, last = ft.trim("c172p", V_a=speeds, gamma=climbs).records  # its engine settles

    assert last["trim"] is not None
    assert [last] == [*ft.trim("c172p", V_a=speeds[-1:], gamma=climbs[-1:]).records]
