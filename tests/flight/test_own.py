"""Laws and plants of a user's own, from Python and from files."""

import textwrap

import numpy as np
import pytest
from fuzzing import to_toml
from made_up import made_up_scenario, scenario_tables
from plain_members import Glider, Proportional

import flighttune as ft

TABLES = scenario_tables(
    law=[
        {"name": "mine", "kind": "python", "module": "my_law.py", "class": "Mine",
         "parameters": {"gain": 1.5}}
    ],
    flight={"duration_s": 2.0},
    reference={"chi_deg": 10.0},
    plant=[{"kind": "point_mass"}],
)  # fmt: skip
LAW = """
    import math

    class Mine:
        signals = {}

        def __init__(self, setup, gain=1.0):
            self.dt, self.gain = setup.dt, gain

        def start(self, condition):
            pass

        def step(self, measured, reference, t):
            return self.gain * (reference.chi - measured.chi), math.cos(measured.gamma)
"""


@pytest.fixture
def files(tmp_path):
    (tmp_path / "own.toml").write_text(to_toml(TABLES))
    (tmp_path / "my_law.py").write_text(textwrap.dedent(LAW))
    return tmp_path


@pytest.fixture
def scenario():
    return made_up_scenario(
        flight={"duration_s": 2.0}, reference={"chi_deg": 10.0}, limits={"phi_deg": [-20.0, 20.0]}
    )


def mine(_):
    return Proportional()


@pytest.mark.parametrize(
    ("takes_gains", "names"), [(False, ["mine:paper"]), (True, ["mine:paper", "mine:K3"])]
)
def test_a_law_is_flown_once_unless_it_takes_gains(scenario, takes_gains, names):
    class Mine(Proportional):
        def __init__(self, _):
            pass

    Mine.takes_gains = takes_gains
    both = scenario.model_copy(update={"gains": ["paper", "K3"]})
    flown = ft.fly(both, laws={"mine": Mine})

    assert [run.provenance.gains_name for run in flown.runs] == ["paper", "K3", *names]
    assert flown.scenario.gain_names == ("paper", "K3", *names)


def test_they_are_recorded_read_and_flown_again_with_their_classes(scenario, tmp_path):
    flown = ft.fly(scenario, laws={"mine": mine}, plants={"glider": Glider})
    ft.record(flown, tmp_path / "out")
    again = ft.load(tmp_path / "out").runs

    assert ft.refly(again, laws={"mine": mine}, plants={"glider": Glider}).equal
    with pytest.raises(ft.ScenarioError, match=r"\[\[law\]\] mine: .*`laws="):
        ft.refly(again)


class Falls(Glider):
    def advance(self, phi_cmd, n_z_cmd, duration):
        if self.chi > 0.05:
            raise RuntimeError("wing off")
        return super().advance(phi_cmd, n_z_cmd, duration)


class Blind(Glider):
    def observe(self):
        seen = super().observe()
        return seen if self.chi < 0.05 else (np.nan, *seen[1:])


class Short(Glider):
    def observe(self):
        return (0.0,)


@pytest.mark.parametrize(
    ("plant", "status", "said"),
    [
        (Falls, "plant_failed", "RuntimeError: wing off"),
        (Blind, "plant_failed", "`observe` must return 8 finite numbers"),
        (Short, "no_trim", "`observe` must return 8 finite numbers"),
    ],
)
def test_a_plant_that_fails_ends_its_flight_in_one_line(scenario, plant, status, said):
    (_, run) = ft.fly(scenario, plants={"mine": plant}).runs

    assert run.status == status
    assert said in run.reason
    assert run.reason.startswith("plant mine at t = ")
    assert (len(run.signals) > 2) == (status == "plant_failed")


def test_a_file_names_a_class_and_its_parameters_and_the_recording_knows_its_hash(files):
    scenario = ft.load_scenario(files / "own.toml")
    flown = ft.fly(scenario)
    (run,) = flown.runs

    assert run.label == "point_mass / mine:paper"
    assert run.signals["phi_cmd"].iloc[0] == pytest.approx(1.5 * np.deg2rad(10.0))
    (table,) = run.provenance.scenario["law"]
    assert len(table["sha256"]) == 64
    assert table["class"] == "Mine"
    assert ft.refly(flown.runs, run_code=True).equal


def test_a_file_that_is_gone_or_changed_is_refused(files):
    scenario = ft.load_scenario(files / "own.toml")
    law = files / "my_law.py"
    law.write_text(law.read_text() + "\n# changed\n")

    with pytest.raises(ft.ScenarioError, match=r"\[\[law\]\] mine: `module`.* the file"):
        ft.fly(scenario)
    law.unlink()
    with pytest.raises(ft.ScenarioError, match=r"\[\[law\]\] mine: `module`.* a file"):
        ft.fly(scenario)
    with pytest.raises(ft.ScenarioError, match=r"own.toml: \[\[law\]\] `module`"):
        ft.load_scenario(files / "own.toml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("class Other: pass", r"\(Other\), got Mine"),
        ("import nothing_of_that_name", "ModuleNotFoundE"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_line(files, text, said):
    (files / "my_law.py").write_text(text)

    with pytest.raises(ft.ScenarioError, match=said) as error:
        ft.fly(ft.load_scenario(files / "own.toml"))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"plant": [{"kind": "python"}]}, "`name` must be given with kind python"),
        ({"plant": [{"kind": "kinematic", "module": "x.py"}]}, "`module` must .* kind python"),
        ({"plant": [{"kind": "python", "name": "x", "module": "x.py"}]}, "`module` and `class`"),
    ],
)
def test_tables_that_say_half_are_refused_by_key(scenario, change, said):
    with pytest.raises(ft.ScenarioError, match=said):
        ft.scenario_from(scenario.as_dict() | change)


def test_lags_around_a_plant_are_those_of_the_point_mass_behind_them():
    lags = (
        ft.loop.InnerLag(order=2, natural_frequency=8.0, damping=0.6, delay=0.03),
        ft.loop.InnerLag(order=1, natural_frequency=10.0),
    )
    plants = ft.loop.PointMassPlant(lags), ft.loop.LaggedPlant(ft.loop.PointMassPlant(), lags)
    for plant in plants:
        plant.start(ft.loop.FlightCondition(V_a=25.0))
        for k in range(100):
            plant.advance(0.5 if k < 50 else -0.2, 1.2, 0.02)

    alone, around = (np.array(plant.observe()[:2]) for plant in plants)
    assert plants[1].signals[: len(ft.loop.COMMON_SIGNALS)] == ft.loop.COMMON_SIGNALS
    assert around == pytest.approx(alone, abs=1e-5)


def test_a_linear_model_of_the_wrong_kind_is_said(files):
    law = files / "my_law.py"
    law.write_text(law.read_text() + "\n    def linear(self):\n        return 1, 2\n")

    with pytest.raises(ft.InputError, match=r"`linear` .*\(1, 2\)"):
        ft.fly(ft.load_scenario(files / "own.toml"))


def test_what_a_law_of_a_file_prints_is_not_on_stdout(files, capfd):
    law = files / "my_law.py"
    text = law.read_text().replace("pass", "print('started')")
    law.write_text(f"print('imported')\n{text}")

    ft.fly(ft.load_scenario(files / "own.toml"))

    printed = capfd.readouterr()
    assert printed.out == ""
    assert "imported" in printed.err
    assert "started" in printed.err


@pytest.mark.slow
def test_a_band_of_a_law_that_raises_says_why_and_how_often(tmp_path):
    """At 25 m/s it is 25 m along its leg when the law raises after 1 s."""
    law = LAW.replace("return", "if t > 1.0: missing\n            return")
    (tmp_path / "my_law.py").write_text(textwrap.dedent(law))
    leg = [{"north_m": 0.0, "east_m": 0.0}, {"north_m": 60.0, "east_m": 0.0}]
    limits = {"phi_deg": [-30.0, 30.0], "phi_rate_dps": 30.0}
    tables = {key: value for key, value in TABLES.items() if key != "reference"}
    file = tmp_path / "own.toml"
    file.write_text(to_toml(tables | {"route": {"waypoint": leg}, "limits": limits}))
    few = {"epsilon": 0.5, "confidence": 0.5, "learn": 10, "workers": 1}
    ended = r"10 law_failed: .*'missing'.* on the leg to waypoint 2, 2[56]( to 26)? m along\."

    with pytest.raises(ft.InputError, match=rf"`learn` .* got 0\. {ended}$"):
        ft.band(file, start_deg=1.0, **few)


@pytest.mark.parametrize("keyword", ["laws", "plants"])
@pytest.mark.parametrize(
    ("made", "reason"),
    [
        ({"no lift": Glider}, r"`name` must match pattern .*, got 'no lift'"),
        ({"": Glider}, r"`name` must have at least 1 character"),
        ({3: Glider}, r" must be text, got 3"),
        ([Glider], r" must be a dictionary or None, got a list"),
        ({"mine": 3}, r" must have a function for mine, got 3"),
    ],
)
def test_laws_and_plants_from_python_are_refused_in_a_line(keyword, made, reason):
    with pytest.raises(ft.InputError, match=rf"`{keyword}`.*{reason}") as refused:
        ft.fly(made_up_scenario(), **{keyword: made})
    assert len(str(refused.value).splitlines()) == 1
