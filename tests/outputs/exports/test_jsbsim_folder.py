"""A folder that JSBSim flies by itself, run by its own console command: the flight of `fly`."""

import math
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from airframes import changed_aerosonde
from commands import answer, flighttune
from fuzzing import first_or_all
from made_up import scenario_tables, shortened
from places import SCENARIO_NAMES, SHIPPED_SCENARIOS

import flighttune as ft

SAME = 1e-9
"""Rad, 1 of load factor, and relative to the airspeed.

The shipped aircraft differ by 3e-13 at most, by 2e-10 where they follow an airspeed in wind, the
adopted by 1e-11.
"""

CSV = "flight.csv"
COLUMNS = ["Time", "chi_rad", "gamma_rad", "phi_rad", "n_z", "V_a_mps"]
LONGEST_S = 120
ADOPTED = sorted((Path(__file__).parents[2] / "adopted").glob("*/turn.toml"))
assert len(ADOPTED) >= 10


FLOWN = ("jet_pull_up", "sensor_noise", "heavy_and_aft", "speed_change_in_turn")
"""Scenarios in which something differs: aircraft, sensors, airframe or law. Engines fail below."""


def flights(names):
    """Scenarios over time in still air, the first gains by a law of ours, and each aircraft."""
    for name in names:
        scenario = ft.load_scenario(name)
        gains, *_ = (one for one in scenario.gain_names if scenario.law_of(one)[0].kind != "python")
        of_time = not (scenario.route or scenario.windy or scenario.disturbance)
        for table in scenario.plant if of_time else ():
            if table.kind == "jsbsim":
                yield scenario, gains, table.label


def flown_by_jsbsim(command, cwd=None):
    """Run JSBSim's console command; return what it printed."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        shlex.split(command),
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
        cwd=cwd,
        env=os.environ | {"PATH": path},
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


def apart(scenario, gains_name, plant, folder, *, moved=False):
    """Largest difference of each signal between JSBSim's flight and that of `fly`.

    JSBSim's is that of `export`, or of a user who has moved the folder.
    """
    made = folder / "made"
    exported = ft.export(scenario, gains_name, out=made, plant=plant)
    assert exported.same, exported.verdict
    assert f"with the gains {gains_name}:" in exported.verdict
    if moved:
        (made / CSV).unlink()
        sent = made.rename(folder / "sent to a colleague")
        flown_by_jsbsim(exported.command.replace(str(made), shlex.quote(str(sent))))
        made = sent
    flown = ft.fly(scenario, gains_name)[f"{plant} / {gains_name}"].signals
    written = pd.read_csv(made / CSV)
    assert list(written.columns) == COLUMNS
    assert len(written) == round(scenario.flight.duration_s * scenario.controller.rate_hz) + 1
    written = written[: len(flown)]  # JSBSim flies on where `fly` ends at the edge of the envelope
    np.testing.assert_allclose(written["Time"] - exported.start, flown.index, rtol=0.0, atol=1e-6)
    apart = {
        name: written[column].to_numpy() - flown[name].to_numpy()
        for name, column in zip(("chi", "gamma", "phi", "n_z", "V_a"), COLUMNS[1:], strict=True)
        if name != "V_a" or scenario.airspeed
    }
    apart["chi"] = np.angle(np.exp(1j * apart["chi"]))  # one of the two is modulo a turn
    return {name: float(np.abs(values).max()) for name, values in apart.items()}


@pytest.mark.soak
@pytest.mark.parametrize(
    "names",
    [
        *([name] for name in FLOWN[1:]),
        pytest.param(["jet_pull_up"], marks=pytest.mark.counts),
        pytest.param(sorted({*SCENARIO_NAMES} - {*FLOWN}), marks=pytest.mark.counts),
    ],
    ids=lambda names: names[0],
)
def test_jsbsim_alone_flies_as_fly_does(names, tmp_path):
    differences = {
        (scenario.title, plant): apart(scenario, gains, plant, tmp_path / str(k), moved=True)
        for k, (scenario, gains, plant) in enumerate(flights(names))
    }

    assert differences
    assert all(max(found.values()) < SAME for found in differences.values()), differences


@pytest.mark.soak
@pytest.mark.parametrize("file", first_or_all(ADOPTED), ids=lambda file: file.parent.name)
def test_adopted_aircraft_fly_as_well(file, tmp_path):
    scenario = shortened(file, 15.0)

    found = apart(scenario, scenario.gain_names[-1], scenario.plant[0].label, tmp_path)

    assert max(found.values()) < SAME, found


CLIMB_IN_WIND = """
gains = ["tuned_identified"]
flight = {{V_a_mps = {V}, h_m = 1000.0, duration_s = 15.0}}
wind = {{speed_mps = {wind}, from_deg = 60.0, down_mps = {down}}}
controller = {{anti_windup = "{anti_windup}"}}
tuning = {{identified = "{aircraft}"}}
plant = [{{kind = "jsbsim", aircraft = "{aircraft}"{engine}}}]
[reference]
V_mps = {V}
gamma_deg = [{{shape = "ramp", start_s = 2.0, duration_s = 6.0, rate_dps = 2.0}}]
chi_deg = [{{shape = "ramp", start_s = 5.0, duration_s = 6.0, rate_dps = 5.0}}]
"""


@pytest.mark.soak
@pytest.mark.parametrize(
    ("aircraft", "V", "down", "gains", "anti_windup", "engine"),
    [
        ("c172p", 55.0, 0.0, "tuned_identified", "conditional", ""),
        (
            *("x8", 18.0, 2.0, "exact:tuned_identified", "back_calculation"),
            ", throttle_max = 0.3, throttle_max_from_s = 4.01",
        ),
    ],
)
def test_speed_has_priority_as_in_fly(aircraft, V, down, gains, anti_windup, engine, tmp_path):
    """A climb that the engine cannot carry, with a turn in wind, and an engine that fails."""
    air = {"wind": 0.15 * V, "down": down}
    text = CLIMB_IN_WIND.format(
        aircraft=aircraft, V=V, anti_windup=anti_windup, engine=engine, **air
    )
    tables = tomllib.loads(text) | {"title": "a climb", "law": ["paper", "exact"]}
    found = apart(ft.scenario_from(tables), gains, f"jsbsim:{aircraft}", tmp_path)

    found["V_a"] /= V
    assert max(found.values()) < SAME, found
    written = pd.read_csv(tmp_path / "made" / CSV)
    assert written["gamma_rad"].iloc[-1] < math.radians(11.0)  # of 12 deg that are asked for


SPEED = {"name": "speed", "law": "exact", "K_P": np.diag([1.5, 1.4, 2.5]).tolist()}
SPEED |= {"K_I": np.diag([0.8, 0.7, 0.6]).tolist()}


def failing_climb(aircraft, V, **changes):
    """Two seconds of a climb in wind whose engine fails, with errors of sensors."""
    ramp = {"shape": "ramp", "start_s": 0.2, "duration_s": 1.0, "rate_dps": 4.0}
    tables = scenario_tables(
        flight={"V_a_mps": V, "h_m": 1000.0, "duration_s": 2.0},
        wind={"speed_mps": 0.15 * V, "from_deg": 60.0, "down_mps": 1.0},
        sensors={"chi_bias_deg": 1.0, "gamma_noise_sd_deg": 0.2, "V_a_noise_sd_mps": 0.5},
        reference={"gamma_deg": [ramp], "chi_deg": [ramp | {"start_s": 0.5}]},
        controller={"rate_hz": 50.0},
        plant=[{"kind": "jsbsim", "aircraft": aircraft, "throttle_max": 0.1}],
    )
    tables["plant"][0]["throttle_max_from_s"] = 0.51
    for key, value in changes.items():
        tables[key] = {**tables.get(key, {}), **value} if isinstance(value, dict) else value
    return ft.scenario_from(tables)


# Values of the priority of the airspeed in docs/airspeed.md, with thrust as a channel and beside.
PRIORITY = {
    "aerosonde": {
        "n_x/priority-per-g": 0.35 / 9.81, "V-least-share": 0.95, "n_x/steepest-dive": -0.5,
        "n_x/throttle-min": 0.0, "n_x/beyond-stop": 0.05, "n_x/rate-max": 1e300,
        "n_x/range-min": -0.5, "n_x/range-max": 1.0, "n_z/min": -2.1, "n_z/max": 2.1,
    },
    "c172p": {
        "n_x/priority-per-g": 1.5 / 55.0, "V-least-share": 0.875, "n_x/steepest-dive": -0.5,
        "V-ref-mps": 55.0, "n_z/min": -0.5, "n_z/max": 2.5,
    },
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aircraft", "V", "changes"),
    [
        # thrust is a channel of the law
        ("aerosonde", 25.0, {"reference": {"V_mps": 25.0}, "gains": [SPEED], "law": ["exact"]}),
        # a piston engine, whose starter and propeller take time
        ("c172p", 55.0, {"controller": {"speed_priority": True}}),
    ],
    ids=["thrust", "piston"],
)
def test_an_engine_fails_beside_wind_and_sensors_as_in_fly(aircraft, V, changes, tmp_path):
    scenario = failing_climb(aircraft, V, **changes)

    flight = ft.export(scenario, scenario.gain_names[0], out=tmp_path)

    assert flight.same, flight.verdict
    largest = dict(flight.differences)
    assert ("V_a" in largest) == bool(scenario.airspeed)
    largest["V_a"] = largest.get("V_a", 0.0) / V
    assert max(largest.values()) < SAME
    assert flight.start == {"aerosonde": 40.0, "c172p": 100.0}[aircraft]
    written = pd.read_csv(tmp_path / CSV)
    assert written["Time"].iloc[0] == pytest.approx(flight.start, abs=1e-9)
    assert len(written) == 101
    law = ElementTree.parse(tmp_path / "systems/ft_outer_loop.xml").getroot()
    stated = {
        x.text.strip().removeprefix("ft/outer/"): float(x.get("value") or "nan")
        for x in law.iterfind("property")
    }
    rates = {"aerosonde": (30.0, 1.0), "c172p": (20.0, 0.7)}[aircraft]
    expected = PRIORITY[aircraft] | {
        "dt-s": 0.02, "least-speed": 0.2, "per-g-s2_m": 1.0 / scenario.flight.g_mps2,
        "phi/min": -math.radians(45.0), "phi/max": math.radians(45.0),
        "phi/rate-min": -math.radians(rates[0]), "phi/rate-max": math.radians(rates[0]),
        "n_z/rate-min": -rates[1], "n_z/rate-max": rates[1],
    }  # fmt: skip
    assert {name: stated[name] for name in expected} == pytest.approx(expected)
    per_rad = {"aerosonde": (1.5 * 25.0 / 9.81, 1.4 * 25.0 / 9.81), "c172p": (1.6968, 1.9556)}
    roll, lift = per_rad[aircraft]  # commands by an error that changes fast
    told = " ".join(flight.notes)
    assert f"moves the roll command by {roll:.3g} deg" in told
    assert f"moves the load factor by {math.radians(lift):.2g}." in told
    readme = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "(50 a second)" in readme
    assert f"`Time` = {flight.start:g} s, and lasts 2 s." in readme


def test_a_law_in_python_is_refused_by_name(tmp_path):
    scenario = ft.load_scenario("paper")
    law = {"name": "mine", "kind": "python", "module": __file__, "class": "Path"}
    tables = scenario.as_dict() | {"law": [law], "expect": []}

    with pytest.raises(ft.InputError, match="got the law 'mine'"):
        ft.export(ft.scenario_from(tables), "mine:paper", out=tmp_path)


@pytest.mark.parametrize(
    ("key", "tables"),
    [
        ("gust", {"gust": {"axis": "right", "peak_mps": 1.0, "start_s": 1.0, "length_m": 20.0}}),
        ("turbulence", {"turbulence": {"intensity": "light"}}),
        (
            "wind.level",
            {"wind": {"level": [{"h_m": h, "speed_mps": h / 500.0, "from_deg": 0.0}
                                for h in (500.0, 1500.0)]}},
        ),
        (
            "disturbance.as_wind",
            {"disturbance": {"chi_amplitude": 0.1, "chi_omega_rad_s": 0.5, "as_wind": True}},
        ),
        ("navigation", {"navigation": {"grade": "standard"}}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)  # fmt: skip
def test_air_that_moves_otherwise_than_as_a_steady_wind_is_refused(key, tables, tmp_path):
    plant = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    scenario = ft.scenario_from(scenario_tables(plant=plant, **tables))

    with pytest.raises(ft.InputError, match=f"^`{key}` must be absent from a scenario that is exp"):
        ft.export(scenario, "paper", out=tmp_path / "made")
    assert not (tmp_path / "made").exists()


def exported(scenario, folder):
    """The command's answer."""
    return answer("export", scenario, "--gains", "paper", "--out", folder)


CLOCK = """
<function name="aero/moment/clock"> <product> <value> 0.1 </value>
  <sin> <property> simulation/sim-time-sec </property> </sin>
</product> </function>
"""


def turn_of_changed(change, folder):
    """A level turn of the Aerosonde, the text of whose main file is changed."""
    changed_aerosonde(folder, change)
    scenario = folder.parent / "turn.toml"
    text = (SHIPPED_SCENARIOS / "level_turn.toml").read_text().replace('"aerosonde"', f'"{folder}"')
    scenario.write_text(text)
    return scenario


HYSTERESIS = """
<flight_control name="own"><channel name="own"><pure_gain name="a/cmd">
  <input>fcs/elevator-pos-rad</input><gain>1</gain><output>fcs/cmd</output></pure_gain>
  <fcs_function name="a/endless"><function><quotient><value>1</value><value>0</value></quotient>
  </function><output>fcs/endless</output></fcs_function></channel>
</flight_control>
<system name="own"><channel name="own"><actuator name="a/tail"> <input>fcs/cmd</input>
  <hysteresis_width>0.02</hysteresis_width> <output>fcs/tail</output> </actuator></channel></system>
</fdm_config>"""


@pytest.mark.soak
def test_flight_control_begins_where_that_of_fly_does_hysteresis_and_infinity_included(tmp_path):
    def change(text):
        aerodynamics = text.replace("fcs/elevator-pos-rad", "fcs/tail")
        return aerodynamics.replace("</fdm_config>", HYSTERESIS)

    turn = turn_of_changed(change, tmp_path / "loose")

    differences = exported(turn, tmp_path / "out")["differences"]
    assert max(differences.values()) < SAME


@pytest.mark.soak
def test_a_flight_that_is_not_that_of_fly_is_no_success(tmp_path):
    """A roll moment by JSBSim's clock, which has run on when the exported flight starts."""

    def change(text):
        return text.replace('<axis name="ROLL">', f'<axis name="ROLL">{CLOCK}')

    scenario = turn_of_changed(change, tmp_path / "clocked")

    out, err = flighttune(
        "export", scenario, "--gains", "paper", "--out", tmp_path / "out", "-q", status=1
    )

    said = "JSBSim's flight is not that of `flighttune fly`: phi differs first, at t = 0.02 s"
    assert said in err
    readme = (tmp_path / "out/README.md").read_text(encoding="utf-8")
    assert said in readme
    for needed in ("by an inertial filter", "moves the roll command by", "s more delay"):
        assert needed in readme
    assert out == ""


@pytest.mark.soak
def test_the_command_of_the_readme_flies_the_folder_wherever_it_was_moved(tmp_path):
    values = exported("level_turn", tmp_path / "made")
    flown = Path(values["csv"]).read_bytes()
    Path(values["csv"]).unlink()
    moved = (tmp_path / "made").rename(tmp_path / "from a colleague")
    readme = (moved / "README.md").read_text(encoding="utf-8")
    command = re.search("^jsbsim .*$", readme, re.MULTILINE)[0]
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    for cwd, line in (
        (moved, command),
        (elsewhere, command.replace("=.", "='../from a colleague'", 1)),
    ):
        flown_by_jsbsim(line, cwd=cwd)

        assert (moved / CSV).read_bytes() == flown
        (moved / CSV).unlink()
    assert shlex.split(values["command"])[2:] == shlex.split(command)[2:]
    assert f"`Time` = {values['start_s']:g} s" in readme
    assert max(values["differences"].values()) < SAME


@pytest.mark.slow
def test_a_title_with_control_characters_is_written_as_xml_beside_comments_of_the_law(tmp_path):
    title = '\x1b[31mred\x07\x9b\u202e <&> "end"'
    tables = ft.load_scenario("level_turn").as_dict() | {"title": title, "expect": []}
    tables["flight"]["duration_s"] = 1.0
    tables["reference"] = {"chi_deg": 0.0, "gamma_deg": 0.0}
    scenario = ft.scenario_from(tables)

    ft.export(scenario, "paper", out=tmp_path)

    script = ElementTree.parse(tmp_path / "flight.xml").getroot()
    assert script.get("name") == ' [31mred    <&> "end"'
    assert "\x1b" not in (tmp_path / "README.md").read_text(encoding="utf-8")
    law = (tmp_path / "systems/ft_outer_loop.xml").read_text(encoding="utf-8")
    assert "<!-- Measured minus true value -->" in law


@pytest.mark.soak
def test_a_console_that_takes_another_step_flies_nothing(tmp_path):
    found = exported("level_turn", tmp_path)
    command = " ".join(part for part in found["command"].split() if "rate" not in part)

    said = flown_by_jsbsim(command)

    assert "the step must be 0.005 s" in said
    assert Path(found["csv"]).read_text().strip() == ",".join(COLUMNS)
