"""Gain sets from files, chosen gain sets, and values set by dotted key, in every command."""

import json

import numpy as np
import pytest
from commands import answer, flighttune
from fuzzing import to_toml

import flighttune as ft

TURN = {
    "title": "turn",
    "gains": ["paper", "my gains.json"],
    "flight": {"V_a_mps": 25.0, "duration_s": 4.0},
    "reference": {"chi_deg": 10.0, "gamma_deg": 0.0},
    "plant": [{"kind": "kinematic"}],
    "expect": [{"gains": "my_gains", "status": "completed"}],
}
K = {"K_P": [[2.5, 0.0], [0.0, 3.5]], "K_I": [[1.0, 0.0], [0.0, 2.0]]}


@pytest.fixture
def turn(tmp_path):
    """A scenario with a file of gains beside it."""
    (tmp_path / "my gains.json").write_text(json.dumps({**K, "status": "optimal"}))
    file = tmp_path / "turn.toml"
    file.write_text(to_toml(TURN))
    return file


def test_a_file_beside_the_scenario_is_a_gain_set_that_outlives_the_file(turn, tmp_path):
    answer("fly", turn, "--out", tmp_path / "out")
    (tmp_path / "my gains.json").unlink()

    _, flown = ft.load(tmp_path / "out").runs

    assert flown.label == "kinematic / my_gains"
    assert np.array_equal(flown.provenance.gains.K_P, K["K_P"])
    assert ft.refly([flown]).equal
    with pytest.raises(ft.ScenarioError, match=r"my gains\.json: .*readable"):
        ft.load_scenario(turn)


@pytest.mark.parametrize("verb", [ft.fly, ft.tune, ft.certify])
def test_values_cannot_be_set_in_a_scenario_that_is_no_file(verb, turn):
    with pytest.raises(ft.InputError, match=r"`changes` .* got flight\.V_a_mps"):
        verb(ft.load_scenario(turn), changes={"flight.V_a_mps": 30.0})


def test_values_set_by_key_are_flown_and_named_in_the_title(turn):
    scenario = ft.load_scenario(turn, changes={"flight.V_a_mps": 30, "limits.phi_deg": [-20, 20]})
    run = ft.fly(scenario).runs[0]

    assert scenario.title == "turn (flight.V_a_mps = 30, limits.phi_deg = [-20, 20])"
    assert run.signals["V_a"].iloc[0] == 30.0
    assert run.provenance.scenario["title"] == scenario.title
    assert ft.load_scenario(turn).flight.V_a_mps == 25.0


@pytest.mark.parametrize(
    ("key", "changed"),
    [
        ("plant.throttle_max", [True, True]),
        ("plant[1].throttle_max", [False, True]),
        ("plant[jsbsim:aerosonde].throttle_max", [True, False]),
        ("plant[jsbsim:aerosonde:heavy_aft].throttle_max", [False, True]),
    ],
)
def test_a_key_of_plants_is_set_for_each_or_for_the_one_named(key, changed):
    plants = ft.load_scenario("heavy_and_aft", changes={key: 0.9}).plant

    assert [plant.throttle_max == 0.9 for plant in plants] == changed


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("flight.V_a_mp=30", "turn.toml with its changes: [flight] `V_a_mp` is not a known key; "
         "did you mean `V_a_mps`?"),
        ("flight.V_a_mps=fast", "[flight] `V_a_mps` must be a valid number, got 'fast'"),
        ("plant[3].kind=kinematic", "`plant[3].kind` must be a position, 0 to 0"),
        (f"seed={'[' * 3000}", "--set: `seed` must not be nested so deeply"),
        (f"seed={'9' * 5000}", "--set: `seed` must be valid TOML: Exceeds the limit"),
        (f"seed=0x{'f' * 5000}", "`value` must be an integer of at most 64 bits"),
        ("seed", "--set: must be KEY=VALUE in one line, got 'seed'"),
    ],
)  # fmt: skip
def test_a_value_that_cannot_be_set_gets_one_line(setting, message, turn):
    _, err = flighttune("fly", turn, "--set", setting, status=2)

    assert message in err
    assert err.count("\n") == 1


def test_a_label_is_not_asked_of_a_plant_with_a_wrong_value(turn):
    wrong = ("--set", "plant[0].aircraft=[45, -45]", "--set", "plant[0].kind=x")
    _, err = flighttune("fly", turn, *wrong, status=2)

    assert "`aircraft` must be a valid string, got [45, -45]" in err
    assert err.count("\n") == 1


# The speed that is set, and the poles of the course with the gains of the file at that speed.
SPEED = "flight.V_a_mps=20"
COURSE = np.roots([1.0, K["K_P"][0][0] * 9.81 / 20.0, K["K_I"][0][0] * 9.81 / 20.0])


def _has_poles(said):
    poles = [complex(*pair) for pair in said["eigenvalues"]]
    return all(min(abs(pole - own) for own in poles) < 1e-9 for pole in COURSE)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("command", "right"),
    [
        ("fly", lambda said: [run["gains"] for run in said["runs"]] == ["my_gains"]),
        ("certify", _has_poles),
        pytest.param("tune", lambda said: said["status"] == "optimal", marks=pytest.mark.slow),
    ],
)
def test_a_command_takes_gains_from_a_file_and_values_by_key(command, right, turn, monkeypatch):
    monkeypatch.chdir(turn.parent)
    chosen = [] if command == "tune" else ["--gains", "my gains.json"]

    said = answer(command, turn, *chosen, "--set", SPEED)
    _, err = flighttune(command, turn, *chosen, "--set", "flight.V_a_mps=0", status=2)

    assert right(said)
    assert "turn.toml with its changes: [flight] `V_a_mps` must be" in err


@pytest.mark.parametrize(
    ("tuned_for", "plant", "V_a", "tuned", "here"),
    [
        ((["c172p"], [50.0]), "jsbsim", 25.0, "the c172p at 50 m/s", "the aerosonde at 25 m/s"),
        ((["c172p"], [50.0]), "kinematic", 25.0, "the c172p at 50 m/s", "the law alone at 25 m/s"),
        ((["c172p"], [50.0]), "kinematic", 50.0, None, None),
        ((["c172p"], []), "jsbsim", 25.0, "the c172p", "the aerosonde at 25 m/s"),
        ((["aerosonde"], [20.0, 30.0]), "jsbsim", 25.0, None, None),
        ((["aerosonde"], [20.0, 24.0]), "jsbsim", 25.0, "the aerosonde at 20 to 24 m/s",
         "the aerosonde at 25 m/s"),
        (([], [26.0]), "jsbsim", 25.0, "the law alone at 26 m/s", "the aerosonde at 25 m/s"),
        (([], []), "jsbsim", 25.0, None, None),
    ],
)  # fmt: skip
def test_gains_of_another_aircraft_or_airspeed_are_named(tuned_for, plant, V_a, tuned, here):
    """Without an aircraft they were tuned on the law, and without an airspeed they suit all."""
    table = {"kind": plant} | ({"aircraft": "aerosonde"} if plant == "jsbsim" else {})
    of = dict(zip(("aircraft", "V_a_mps"), tuned_for, strict=True))
    gains, flight = [{"name": "other", **K, "tuned_for": of}], TURN["flight"] | {"V_a_mps": V_a}
    own = {"gains": gains, "expect": [], "plant": [table], "flight": flight}
    sentence = f"The gains other were tuned for {tuned}; here they fly on {here}."

    assert [*ft.scenario_from(TURN | own).notes] == [sentence] * bool(tuned)


def test_a_copy_with_another_flight_has_a_reference_of_its_own():
    """Values that were found from the old keys would be wrong in the copy."""
    scenario = ft.scenario_from(TURN | {"gains": ["paper"], "expect": []})
    assert scenario.stated_reference.g == 9.81
    flight = scenario.flight.model_copy(update={"g_mps2": 3.71})

    assert scenario.model_copy(update={"flight": flight}).stated_reference.g == 3.71
