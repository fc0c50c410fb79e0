"""Every way JSBSim fails silently or fatally, provoked: an error or a stop that says why."""

import math
import re
import threading

import pytest
from airframes import fdm_of, off_nominal

import flighttune as ft

LEVEL = ft.loop.FlightCondition(V_a=25.0)


def started(folder):
    plant = ft.loop.JSBSimPlant(folder)
    plant.start(LEVEL)
    return plant


XML, TOML, GAINS = "aerosonde.xml", "aircraft.toml", "gains.json"


@pytest.mark.parametrize(
    ("file", "pattern", "new", "message"),
    [
        (TOML, "alpha_deg = ", "alfa_deg = ", r"\[envelope\] `alfa_deg` .*mean `alpha_deg`"),
        (TOML, '"fcs/throttle-pos', '"fcs throttle', r"\.toml: \[engines\] `command` must match"),
        (TOML, 'title  = "', 'title = "\n', r"copy/aircraft\.toml: the file must be valid TOML: "),
        (XML, "</metrics>", "</metric>", r"aerosonde\.xml: must be XML: mismatched tag: line 17"),
        (TOML, '"aerosonde.xml"', '"albatross.xml"', r"albatross\.xml"),
        (XML, 'engine file="aerosonde_motor"', 'engine file="lost"', "lost"),
        (GAINS, "roll/k_p", "roll/k_P", "`ft/gains/roll/k_P`"),
        (GAINS, '"pitch/k_p": .*\n', "", r"gains\.json: `gains` .* `pitch/k_p`"),
        (XML, "<value> 0.023200", "<value> 1e308", r"aircraft\.toml: .* V_a 25 m/s"),
    ],
)
def test_a_file_that_cannot_be_flown_is_named(changed_aircraft, file, pattern, new, message):
    folder = changed_aircraft(file, pattern, new)

    with pytest.raises((ft.loop.PlantError, ft.ScenarioError), match=message) as error:
        started(folder)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["", "a b", "9lives", "fcs//x", "/fcs", "ä", "fcs/x[a]", "fcs\n"])
def test_malformed_property_name_is_an_error_and_not_the_end_of_the_process(name):
    fdm = fdm_of("aerosonde")

    with pytest.raises(ft.loop.PlantError, match="must have the property"):
        fdm.reader(name)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("channel", ["phi_cmd", "n_z_cmd"])
def test_command_that_is_no_number_stops_the_flight(channel, bad):
    plant = ft.loop.JSBSimPlant()
    plant.start(LEVEL)
    plant.advance(0.0, 1.0, 1.0)
    before = plant.observe()

    stop = plant.advance(**{"phi_cmd": 0.0, "n_z_cmd": 1.0, "duration": 0.02} | {channel: bad})

    assert stop.status == "diverged"
    assert re.fullmatch(r"t = 1\.000 s: commands must be finite, got .*phi.* n_z.*\.", stop.reason)
    assert plant.observe() == before
    with pytest.raises(ft.loop.PlantError, match="its flight has ended"):
        plant.advance(0.0, 1.0, 0.02)


def with_channel(changed_aircraft, components):
    """A copy of the Aerosonde with a system of its own."""
    system = f'<system name="x"> <channel name="x"> {components} </channel> </system>'
    return changed_aircraft("aerosonde.xml", "<aerodynamics>", f"{system} <aerodynamics>")


# Zero times one over the seconds left until t = 1 s: not a number there, and ever after.
NOT_A_NUMBER = (
    '<fcs_function name="x/lost"> <function> <sum> <property> ft/rudder-rad </property>'
    "<product> <value> 0 </value> <sqrt> <difference> <value> 1 </value>"
    "<property> simulation/sim-time-sec </property> </difference> </sqrt>"
    "</product> </sum> </function> <output> fcs/rudder-pos-rad </output> </fcs_function>"
)
# A way point beyond the pole is an error that JSBSim raises while it runs.
BEYOND_THE_POLE = (
    '<waypoint_heading name="x/lost">'
    '<target_latitude unit="RAD"> simulation/sim-time-sec </target_latitude>'
    '<target_longitude unit="RAD"> simulation/sim-time-sec </target_longitude>'
    '<source_latitude unit="RAD"> position/lat-geod-rad </source_latitude>'
    '<source_longitude unit="RAD"> position/long-gc-rad </source_longitude>'
    "</waypoint_heading>"
)


@pytest.mark.parametrize(
    ("components", "reason"),
    [
        (NOT_A_NUMBER, r"t = 1\.0\d+ s: state must be finite, got nan for .*n_z"),
        (BEYOND_THE_POLE, r"t = 1\.5\d+ s: JSBSim gave up: .*latitude"),
    ],
)
def test_no_number_and_jsbsim_giving_up_stop_the_flight(changed_aircraft, components, reason):
    plant = started(with_channel(changed_aircraft, components))

    stop = plant.advance(0.0, 1.0, 3.0)

    assert stop.status == "diverged"
    assert re.match(reason, stop.reason)


@pytest.mark.parametrize(
    ("key", "interval", "n_z", "reason"),
    [
        ("alpha_deg", "[-14, 6]", 1.8, r"alpha must stay inside -14 to 6 deg, got 6\.\d+ deg"),
        ("alpha_deg", "[2, 16]", 0.2, r"alpha must stay inside 2 to 16 deg, got 1\.\d+ deg"),
        ("V_a_mps", "[24.9, 45]", 1.8, r"V_a must stay inside 24.9 to 45 m/s, got 24\.\d+ m/s"),
        (
            "V_a_mps", "[15, 26]", 0.2,
            r"V_a must stay inside 15 to 26 m/s, got 26\.\d+ m/s, with the throttle closed",
        ),
        ("n_z", "[-3, 1.5]", 1.8, r"n_z must stay inside -3 to 1.5, got 1\.5\d*"),
        ("n_z", "[0.6, 3]", 0.2, r"n_z must stay inside 0.6 to 3, got 0\.[56]\d*"),
        ("theta_deg", "[-80, 8]", 1.8, r"theta must stay inside -80 to 8 deg, got 8\.\d+ deg"),
        ("theta_deg", "[-3, 80]", 0.2, r"theta must stay inside -3 to 80 deg, got -3\.\d+ deg"),
    ],
)  # fmt: skip
def test_leaving_the_envelope_ends_the_flight(fly, changed_aircraft, key, interval, n_z, reason):
    pattern = rf"(?m)^{key}(\s*)= \[[^]]*\]"
    folder = changed_aircraft("aircraft.toml", pattern, rf"{key}\1= {interval}")

    flight = fly((0.0, n_z), aircraft=folder, duration=5.0)

    assert flight.stop.status == "left_envelope"
    assert re.fullmatch(rf"t = [0-4]\.\d\d\d s: {reason}\.", flight.stop.reason)


def test_jsbsim_ending_the_run_is_an_error(changed_aircraft):
    folder = with_channel(
        changed_aircraft,
        '<fcs_function name="simulation/terminate"> <function>'
        "<gt> <property> simulation/sim-time-sec </property> <value> 0.5 </value> </gt>"
        "</function> </fcs_function>",
    )
    with pytest.raises(ft.loop.PlantError, match=r"0\.5\d+ s: JSBSim ended"):
        started(folder).advance(0.0, 1.0, 2.0)


def test_nothing_is_written_to_the_terminal(capfd, changed_aircraft):
    broken = changed_aircraft("aerosonde.xml", 'file="aerosonde_motor"', 'file="lost"')
    started("aerosonde").advance(0.5, 1.5, 2.0)
    thread = threading.Thread(target=started, args=("aerosonde",))
    thread.start()
    thread.join()
    with pytest.raises(ft.loop.PlantError):
        started(broken)

    assert capfd.readouterr() == ("", "")


def test_an_aircraft_opens_no_files_and_sockets(changed_aircraft, tmp_path, monkeypatch):
    output = '<output name="stray.csv" type="CSV" rate="50"> <rates> ON </rates> </output>'
    end = f'{output} <input port="1137"/> </fdm_config>'
    folder = changed_aircraft("aerosonde.xml", "</fdm_config>", end)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")

    started(folder).advance(0.0, 1.0, 0.5)

    assert list((tmp_path / "here").iterdir()) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<description> {{lift*1.0}} </description>", "must not hold two braces"),
        ("<a>" * 50_000 + "</a>" * 50_000, "has too many elements inside each other"),
    ],
)
def test_what_our_own_copy_of_a_file_cannot_hold_is_refused(changed_aircraft, text, message):
    folder = changed_aircraft("aerosonde.xml", "<aerodynamics>", f"<aerodynamics>{text}")

    with pytest.raises(ft.loop.PlantError, match=rf"aerosonde\.xml {message}") as error:
        ft.loop.JSBSimPlant(folder, off_nominal=off_nominal(lift_factor=1.1))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "pattern", "new", "message"),
    [
        ("a4", '"A4"', '"737"', r"\[engines\] `count` must be that of the model, which has more"),
        (
            "a4", r"\[engines\]\n|\[envelope\]", "[engines]\ncount = 2\n\n[envelope]",
            r"must have the property `propulsion/engine\[1\]/set-running`",
        ),
        (
            "c172p", r"travel_deg = \[-28.0, 23.0\], full_rad = \[-0.4886, 0.40135\]",
            "travel_deg = [-20.0, 15.0], full_rad = [-0.35, 0.26]",
            r"`elevator` must move to 20 deg as `travel_deg` says, the model moves it by 27\.9 deg",
        ),
        (
            "c172p", r"full_rad = \[-0.2792, 0.2792\]", "full_rad = [0.2792, -0.2792]",
            r"`rudder` must raise r_dot at -16 deg, got -",
        ),
        (
            "a4", r"travel_deg = \[-7.0, 7.0\]", "travel_deg = [-20.0, 20.0]",
            r"`rudder` must have an effect up to -20 deg, it is saturated at half",
        ),
        (
            "aerosonde", r'command = "fcs/throttle-pos-norm"', 'command = "fcs/flap-cmd-norm"',
            r"engine 1 of 1 must push at full throttle",
        ),
    ],
)  # fmt: skip
def test_what_is_not_as_the_file_says_is_named(changed_aircraft, name, pattern, new, message):
    folder = changed_aircraft("aircraft.toml", pattern, new, aircraft=name)

    start = ft.loop.FlightCondition(V_a=150.0 if name == "a4" else 50.0)
    with pytest.raises(ft.loop.PlantError, match=message) as error:
        ft.loop.JSBSimPlant(folder).start(start)
    assert "\n" not in str(error.value)


def test_gains_of_another_model_are_refused_and_none_say_what_writes_them(changed_aircraft):
    folder = changed_aircraft("aircraft.toml", "title", "title", aircraft="a4")
    file, start = folder / "aircraft.toml", ft.loop.FlightCondition(V_a=200.0)
    file.write_text(file.read_text().replace('"A4"', '"T38"'))

    with pytest.raises(ft.loop.PlantError, match=r"gains\.json: must be made"):
        ft.loop.JSBSimPlant(folder).start(start)
    (folder / "gains.json").unlink()
    with pytest.raises(ft.loop.PlantError, match=r"gains\.json: .*`flighttune design`"):
        ft.loop.JSBSimPlant(folder).start(start)
