"""Scenario files: what is read, and the one line that says what is wrong."""

import json
import math
import pickle
import tomllib

import numpy as np
import pytest
from fuzzing import to_toml
from places import SHIPPED_SCENARIOS

import flighttune as ft
from flighttune.control.gains import paper_family
from flighttune.flight.conditions import start_condition

ROUNDING = 1e-12


def paper_tables():
    return tomllib.loads((SHIPPED_SCENARIOS / "paper.toml").read_text())


@pytest.fixture
def tables():
    return paper_tables()


def test_edges_are_degrees_and_the_inside_is_radians():
    scenario = ft.load_scenario("paper")
    limits = scenario.limits.limits()

    assert start_condition(scenario).chi == pytest.approx(math.pi / 3, abs=ROUNDING)
    assert start_condition(scenario).gamma == pytest.approx(math.pi / 4, abs=ROUNDING)
    assert limits.lower == pytest.approx([-math.pi / 4, -2.1], abs=ROUNDING)
    assert limits.rate_upper == pytest.approx([math.pi / 6, 1.0], abs=ROUNDING)


def test_a_rate_may_be_a_range(tables):
    tables["limits"]["phi_rate_dps"] = [-10.0, 20.0]
    limits = ft.scenario_from(tables).limits.limits()

    assert limits.rate_lower[0] == pytest.approx(math.radians(-10.0))
    assert limits.rate_upper[0] == pytest.approx(math.radians(20.0))


def test_a_scenario_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        ft.load_scenario("paper").seed = 2  # pyright: ignore[reportAttributeAccessIssue]


WRONG = [
    ("flight", {"V_a_mps": -50.0}, r"\[flight\] `V_a_mps` must be greater .* 1, got -50\.0"),
    ("flight", {"V_a": 50.0}, r"\[flight\] `V_a` is not a known key; did you mean `V_a_mps`\?"),
    ("flight", {"V_a_mps": "25"}, r"`V_a_mps` must be a valid number, got '25'"),
    ("flight", {"duration_s": 0.01}, r"`duration_s` of \[flight\] must be at least two samples"),
    ("limits", {"phi_deg": [45.0, -45.0]}, r"must be a range \[low, high\] with low below high"),
    ("limits", {"phi_rate_dps": [3.0, 5.0]}, r"`phi_rate_dps` must be a range of rates"),
    ("controller", {"anti_windup": "clamp"}, r"must be 'none', 'conditional' or 'back_calc"),
    ("reference", {"chi_deg": [{"shape": "jump"}]}, r"'shape' .*'doublet'"),
    (
        "reference",
        {"gamma_deg": [{"shape": "step", "start_s": 99.0, "change_deg": 5.0}]},
        r"\[reference\.gamma_deg\] `start_s` must lie before the end of the flight .*, got 99 s\.$",
    ),
    ("tuning", {"R_min": 0.3}, "`R_min` must be absent"),
    ("tuning", {"model": "identified", "I_star": 4.0}, "`I_star` must be absent with model"),
    (None, {"tuning": {"model": "identified", "lag_rad_s": [4, 8]}}, "`lag_rad_s` must be absent"),
    (
        None,
        {"tuning": {"identified": "nowhere.json"}, "gains": ["tuned_identified"], "expect": []},
        r"\[tuning\] `identified` .*nowhere",
    ),
    (
        None,
        {"plant": [{"kind": "kinematic"}], "gains": ["tuned_identified"], "expect": []},
        r"`identified` of \[tuning\] must be given",
    ),
    (None, {"gains": ["paper", "paper"]}, r"`gains` must not name anything twice"),
    (None, {"gains": [{"name": "x", "K_P": [[1.0]], "K_I": [[1.0]]}]}, r"must have 2 rows"),
    (None, {"plant": [{"kind": "jsbsim"}]}, r"`aircraft` must be given with kind jsbsim"),
    (
        None,
        {"plant": [{"kind": "kinematic", "roll_lag_rad_s": 4.0}]},
        "`roll_lag_rad_s` must be given with kind point_mass_lag only",
    ),
    (
        None,
        {"plant": [{"kind": "point_mass_lag", "roll_lag_rad_s": 4.0}]},
        "`n_z_lag_rad_s` must be given with kind point_mass_lag",
    ),
    (None, {"disturbance": {"chi_amplitude": 0.1}}, r"`disturbance` must be absent where a plant"),
]


@pytest.mark.parametrize(("table", "change", "message"), WRONG)
def test_a_wrong_value_gets_one_line_with_file_and_key(table, change, message, tables, tmp_path):
    (tables if table is None else tables[table]).update(change)
    path = tmp_path / "wrong.toml"
    path.write_text(to_toml(tables))

    with pytest.raises(ft.ScenarioError, match=message) as caught:
        ft.load_scenario(path)

    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_of_many_mistakes_five_are_told_and_the_rest_counted(tables):
    tables["flight"].update({f"key{i}": i for i in range(8)})

    with pytest.raises(ft.ScenarioError, match=r"; and 3 more\.$") as caught:
        ft.scenario_from(tables)

    assert str(caught.value).count("is not a known key") == 5
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".json", ".toml"])
def test_gains_are_read_from_json_and_toml(suffix, tmp_path):
    path = tmp_path / f"gains{suffix}"
    numbers = {"K_P": ft.PAPER_GAINS.K_P.tolist(), "K_I": ft.PAPER_GAINS.K_I.tolist()}
    path.write_text(json.dumps({**numbers, "R_K": 0.5}) if suffix == ".json" else to_toml(numbers))

    gains = ft.load_gains(path)

    assert np.array_equal(gains.K_P, ft.PAPER_GAINS.K_P)
    assert np.array_equal(gains.K_I, ft.PAPER_GAINS.K_I)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1]", r"must hold one object, got list"),
        ('{"K_P": [[1, 0], [0, 1]]}', r"`K_I` must be given"),
        ('{"K_P": [[1, 0]], "K_I": [[1, 0], [0, 1]]}', r"`K_P` must have 2 rows"),
    ],
)
def test_gains_that_cannot_be_read_get_one_line(text, message, tmp_path):
    path = tmp_path / "gains.json"
    path.write_text(text)

    with pytest.raises(ft.ScenarioError, match=message) as caught:
        ft.load_gains(path)

    assert str(caught.value).startswith(f"{path}: ")


def test_the_papers_family_is_shifted_as_its_table_says():
    family = paper_family()

    assert family["K1"].K_P == pytest.approx(ft.PAPER_GAINS.K_P + 4.0 * np.eye(2))
    assert family["K6"].K_I == pytest.approx(ft.PAPER_GAINS.K_I - 1.0 * np.eye(2))


def test_a_scenario_keeps_its_aircraft_but_does_not_send_it_to_workers():
    scenario = ft.load_scenario("paper")
    table = scenario.aircraft[0]

    copy = pickle.loads(pickle.dumps(scenario))

    assert table.config is table.config
    assert "config" not in vars(copy.aircraft[0])  # its files may lie elsewhere there
    assert copy == scenario
    assert copy.aircraft[0].config == table.config
