"""One adoption from beginning to end: what it writes, measures and records."""

import json
import math
import re
import shutil
import tomllib

import numpy as np
import pytest
from book_aeroplane import more, system
from commands import flighttune
from places import SHIPPED_AIRCRAFT

import flighttune as ft

DEG = math.pi / 180.0
FILES = "aircraft.toml", "gains.json", "identified.json", "turn.toml", "adoption.json"
WRITTEN = 1e-4
"""Files have five digits."""

W, RHO, S, B, C = 11.0 * 9.80665, 1.11164, 0.55, 2.8956, 0.18994
C_L_STALL, C_L_LOW = 1.48, -0.94496  # where lift stops growing, at 14 and -12 deg
JX, JZ, JXZ, JY = 0.8244, 1.759, 0.1204, 1.135
WEAK_CL_DA, MUCH_CL_DE = 0.08, 0.5
# A glider whose aileron is weak and whose elevator lifts much.
GLIDER = {"> 0.17 <": f"> {WEAK_CL_DA} <", "> 0.13 <": f"> {MUCH_CL_DE} <"}


def adoption(folder, *, changes=None, power=None, **asked):
    """The Aerosonde's model with changes, adopted; what was said meanwhile."""
    said = []
    sonde = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder / "sonde")
    file, motor = sonde / "aerosonde.xml", sonde / "Engines/aerosonde_motor.xml"
    for old, new in (changes or {}).items():
        assert old in file.read_text()
        file.write_text(file.read_text().replace(old, new))
    if power:
        motor.write_text(re.sub("(<power.*?>)[^<]*", rf"\g<1> {power} ", motor.read_text()))
    return ft.adopt(str(file), folder / "mine", say=said.append, **asked), said


@pytest.fixture(scope="module")
def adopted(tmp_path_factory):
    return adoption(tmp_path_factory.mktemp("driven"))


@pytest.fixture(scope="module")
def glider(tmp_path_factory):
    return adoption(tmp_path_factory.mktemp("gliding"), changes=GLIDER, power=1)


def tables(found):
    return tomllib.loads(found.texts["aircraft.toml"])


@pytest.mark.soak
def test_an_adoption_says_its_steps_and_writes_its_files(adopted):
    found, said = adopted

    steps = list(dict.fromkeys(x.split(":")[0] for x in said))
    assert steps == [f"step {k} of 9" for k in range(1, 10)]
    assert (found.status, found.reason, found.name, found.engines) == ("adopted", "", "mine", 1)
    assert sorted(file.name for file in found.folder.iterdir()) == sorted(FILES)
    assert {name: (found.folder / name).read_text() for name in FILES} == found.texts
    assert tables(found)["model"] == "../sonde/aerosonde.xml"
    assert found.draft is None
    assert not any("drag may be missing" in note for note in found.notes)
    assert found.not_compiled == ""
    assert found.seconds > 1.0


@pytest.mark.soak
@pytest.mark.parametrize("name", ["adopted", "glider"])
def test_the_record_of_an_adoption_has_its_answers(name, request):
    found, _ = request.getfixturevalue(name)
    record = json.loads(found.texts["adoption.json"])

    for key in ("status", "reason", "glide_ratio", "fit_percent", "flown"):
        assert record[key] == getattr(found, key)
    assert record["V_a_mps"] == found.V_a
    assert (record["notes"], record["trims"]) == ([*found.notes], [*found.trims])
    assert {*record["versions"]} == {"flighttune", "jsbsim"}
    nominal = json.loads(found.texts["identified.json"])["conditions"][0]["channels"]
    for channel, fit in found.fit_percent.items():
        assert fit == pytest.approx(nominal[channel]["fit_percent"], rel=WRITTEN)
        assert fit >= 90.0 or found.status == "flies"
    assert record["stall_mps"] == pytest.approx(
        math.sqrt(2.0 * W / (RHO * S * C_L_STALL)), rel=2e-3
    )


def book(V_a, glide=False):
    """Slopes of the published coefficients at an airspeed, as an adoption needs them."""
    q_S = 0.5 * RHO * V_a**2 * S
    aileron = WEAK_CL_DA if glide else 0.17
    turn = JX * JZ - JXZ**2

    def roll(C_l, C_n):
        return q_S * B * (JZ * C_l + JXZ * C_n) / turn

    lever, pitch, C_L_e = 0.31, q_S * C / JY, MUCH_CL_DE if glide else 0.13
    return {
        "power": roll(aileron, -0.011 + 0.075 * 0.05888 / B),
        "damping": -roll(-0.51, -0.069) * B / (2.0 * V_a),
        "M_a": (-2.74 + 5.61 * lever) * pitch, "M_e": (-0.99 + C_L_e * lever) * pitch,
        "M_q": -38.21 * C / (2.0 * V_a) * pitch, "n_a": 5.61 * q_S / W, "n_e": C_L_e * q_S / W,
    }  # fmt: skip


@pytest.mark.soak
@pytest.mark.parametrize("name", ["adopted", "glider"])
def test_envelope_limits_and_goals_are_those_of_the_published_coefficients(name, request):
    found, _ = request.getfixturevalue(name)
    made, V_a = tables(found), found.V_a
    V_s = json.loads(found.texts["adoption.json"])["stall_mps"]
    of, goals, limits = book(V_a, glide=name == "glider"), made["design"], made["limits"]

    assert V_a == pytest.approx(1.6 * V_s)
    # Commands take 0.85 of the lift, at most 3 and at least -1.
    lift = 0.85 * 1.6**2 * np.array([C_L_LOW / C_L_STALL, 1.0])
    low, high = max(lift[0], -1.0), min(lift[1], 3.0)
    assert limits["n_z"] == pytest.approx([low, high], rel=2e-3)
    assert limits["phi_deg"] == [-45.0, 45.0]
    envelope = made["envelope"]
    assert envelope["n_z"] == pytest.approx([low - 1.0, high + 1.0], rel=2e-3)
    assert envelope["V_a_mps"] == pytest.approx([1.05 * V_s, 1.8 * V_a], rel=WRITTEN)
    assert envelope["alpha_deg"] == pytest.approx([-13.0, 14.0], rel=WRITTEN)
    # 0.4 of the steady rate of full aileron, at most 30 deg/s; the roll begins with 0.8 of it.
    full = of["power"] * made["surfaces"]["aileron"]["travel_deg"][1] * DEG
    rate = min(30.0 * DEG, 0.4 * full / of["damping"])
    roll = np.clip(0.8 * full / rate - of["damping"], 0.5, 4.0)
    assert limits["phi_rate_dps"] == pytest.approx(rate / DEG, rel=0.02)
    assert goals["roll_rad_s"] == pytest.approx(roll, rel=0.02)
    if of["damping"] > 3.0 * 2.3 * roll:  # e'' - L_p e' + roll_error^2 e = 0 has a pole there
        poles = np.roots([1.0, of["damping"], goals["roll_error_rad_s"] ** 2])
        assert max(poles) == pytest.approx(-2.3 * roll, rel=0.05)
    else:
        assert "roll_error_rad_s" not in goals
    # alpha' = q, q' = M alpha + M_q q, where the elevator keeps the load factor
    stiffness = of["M_a"] - of["M_e"] * of["n_a"] / of["n_e"]
    zero = max(np.roots([1.0, -of["M_q"], -stiffness]).real)
    load = np.clip(0.6 * zero, 0.8, 8.0)
    assert goals["n_z_rad_s"] == pytest.approx(load, rel=0.05)
    assert limits["n_z_rate_per_s"] == pytest.approx(np.clip(0.12 * load, 0.3, 1.0), rel=0.05)
    assert goals["roll_t90_s"] == pytest.approx(30.0 * DEG / rate + 3.0 / roll, rel=0.02)
    n_z_rate = limits["n_z_rate_per_s"]
    assert goals["n_z_t90_s"] == pytest.approx(0.5 / n_z_rate + 5.0 / goals["n_z_rad_s"], rel=1e-3)
    assert goals["speed_rad_s"] == pytest.approx(min(0.5, 15.0 / V_a), rel=WRITTEN)
    assert (goals["h_m"], goals["V_a_mps"]) == (1000.0, pytest.approx(V_a, rel=WRITTEN))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["adopted", "glider"])
def test_trims_of_an_adoption_are_those_of_the_trim_command(name, request):
    """Four airspeeds about that chosen, at which it descends, keeps its height and climbs."""
    found, _ = request.getfixturevalue(name)
    gammas = None if name == "glider" else [-3.0 * DEG, 0.0, 3.0 * DEG]
    speeds = [share * found.V_a for share in (0.85, 1.0, 1.15, 1.3)]

    again = ft.trim(found.folder, V_a=speeds, gamma=gammas).records

    assert [*found.trims] == [*again]
    assert [row["reason"] for row in again] == [""] * len(again)
    at = next(row for row in again if row["V_a_mps"] == pytest.approx(found.V_a))
    level = min(again, key=lambda row: (abs(row["V_a_mps"] - found.V_a), abs(row["gamma_deg"])))
    C_L = W / (0.5 * RHO * found.V_a**2 * S)
    book = (0.043 + 0.0232 * C_L**2) / C_L
    if name == "glider":
        assert math.tan(-at["gamma_deg"] * DEG) == pytest.approx(1.0 / found.glide_ratio, rel=1e-3)
    else:
        assert level["trim"]["throttle"] == pytest.approx(book * W / 120.0, rel=0.02)
    assert 1.0 / found.glide_ratio == pytest.approx(book, rel=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["adopted", "glider"])
def test_the_measures_of_the_turn_are_those_of_its_flights(name, request):
    found, _ = request.getfixturevalue(name)
    turn = ft.load_scenario(found.folder / "turn.toml")
    names = {"tuned": "exact:tuned_fed_back", "paper": "exact:paper_scaled"}

    assert {*found.flown} == {*names}
    for kind, flown in found.flown.items():
        run = found.turn[f"jsbsim:mine / {names[kind]}"]
        assert (flown["gains"], flown["status"]) == (names[kind], run.status)
        late = run.t >= 30.0
        for channel in ("chi", "gamma") if run.status == "completed" else ():
            error = (run.signals[f"{channel}_ref"] - run.signals[channel]).to_numpy()
            whole = np.trapezoid(run.t * np.abs(error), run.t)
            assert flown["ITAE"][channel] == pytest.approx(whole, rel=1e-9), run.reason
            assert flown["ST_deg"][channel] == pytest.approx(error[late].std() / DEG, rel=1e-6)
    ours, paper = found.flown["tuned"], found.flown["paper"]
    better = [ours["ITAE"][x] < paper["ITAE"].get(x, math.inf) for x in ours["ITAE"]]
    assert (found.status == "adopted") <= all(better)
    assert max(ours["ST_deg"].values()) <= 0.5 or found.status == "flies"
    assert turn.flight.V_a_mps == pytest.approx(found.V_a, rel=WRITTEN)
    text = tomllib.loads(found.texts["turn.toml"])
    glide = text["flight"].get("gamma_deg", 0.0)
    assert (glide < 0.0) == (name == "glider")
    climb = glide - 3.0 if name == "glider" else 3.0
    assert text["reference"] == {"chi_deg": 20.0, "gamma_deg": pytest.approx(climb, rel=WRITTEN)}
    assert ("speed_priority" in text["controller"]) == (name == "adopted")
    assert found.turn.runs[0].t[-1] == pytest.approx(40.0)
    # gains for the same loop grow with airspeed, from the paper's 25 m/s
    _, scaled = text["gains"]
    for key in ("K_P", "K_I"):
        expected = found.V_a / 25.0 * getattr(ft.PAPER_GAINS, key)
        assert np.array(scaled[key]) == pytest.approx(expected, rel=WRITTEN)


@pytest.mark.slow
def test_the_steps_of_an_adopted_aircraft_meet_what_it_was_designed_for(adopted):
    found, _ = adopted
    goals = tables(found)["design"]

    sizes = [(step.channel, step.size) for step in found.steps]
    assert sizes == [("phi", pytest.approx(30.0 * DEG)), ("n_z", 0.5), ("n_z", -0.5)]
    for step in found.steps:
        signal = step.signals[step.channel]
        share = (signal - signal[0]) / step.size
        assert step.t90 == step.signals["t"][np.argmax(share >= 0.9)]
        assert step.overshoot == pytest.approx(max(0.0, share.max() - 1.0))
        assert step.t90 <= goals[f"{'roll' if step.channel == 'phi' else 'n_z'}_t90_s"]
        assert step.met


@pytest.mark.soak
def test_a_steep_glide_begins_at_the_next_kilometre_above_the_height_that_it_loses(tmp_path):
    """In 60 s, 3 deg below a glide whose drag is ten times that of the book."""
    found, said = adoption(tmp_path, changes={"> 0.043 <": "> 0.43 <"}, power=1)

    lost = 60.0 * found.V_a * (1.0 / found.glide_ratio + math.tan(3.0 * DEG))
    height = tables(found)["design"]["h_m"]
    assert lost < height <= lost + 1000.0
    assert f"a steep glide, from {height:.0f} m instead of 1000 m" in said
    assert f"its glide is steep: it flies from {height:.0f} m" in found.notes


COMMANDS = """
--aileron fcs/no | --aileron: the model must read fcs/no
--aileron a_b! | --aileron must be a property of the model, got a_b!
--aileron fcs/left-aileron-pos-rad --aileron -fcs/left-aileron-pos-rad | must name a property once
--set no/such=1 | --set no/such: the model must have or read it
--set a=nan | --set must be NAME=VALUE
--set =1 | --set must be NAME=VALUE
--set fcs/flap-cmd-norm | --set must be NAME=VALUE
--set a[[=1 | --set must be NAME=VALUE
--V-a nan | `V_a` must be positive, got nan
--altitude -5 | must be positive
""".strip().splitlines()


@pytest.mark.parametrize("row", COMMANDS)
def test_what_adopt_cannot_be_told_is_refused_in_a_line(row, own, refusal, tmp_path):
    asked, _, words = row.partition(" | ")

    said = refusal(own(), *asked.replace("--altitude", "--h").split())

    assert words in said
    assert not (tmp_path / "mine").exists() or not [*(tmp_path / "mine").iterdir()]


def test_what_was_told_and_found_is_in_the_draft_of_what_is_refused(own, tmp_path):
    """Its motor does not push, which is found after its levers and the flight control."""
    told = "--aileron fcs/left-aileron-pos-rad --set fcs/x=0.25 --set /a/b=2 --no-rudder"
    told += " --throttle a/t"
    reads = [
        f"<pure_gain name='a/{x[-1]}'><input>{x}</input></pure_gain>" for x in ("fcs/x", "a/t")
    ]
    defined = "<system name='o'><property>a/t</property><property>fcs/x</property></system>"
    file = own(more(defined, system(*reads)), power=0)

    flighttune("adopt", file, "--out", tmp_path / "mine", *told.split(), status=1)

    text = (tmp_path / "mine/aircraft.toml").read_text()
    draft = tomllib.loads(text)
    assert (draft["settings"]["fcs/x"], draft["declared"]["/a/b"]) == (0.25, 2.0)
    assert draft["engines"]["command"] == "a/t"
    assert draft["surfaces"]["aileron"]["command"] == "fcs/left-aileron-pos-rad"
    assert "rudder" not in draft["surfaces"]
    comments = [line for line in text.splitlines() if line.startswith("#")]
    assert comments[0].startswith("# refused: engine 1 of 1 does not run")
    assert "[design]" in comments[1]
    assert "[engines]" not in comments[1]
