"""With --json a command prints the answer of the verb of its name, and its numbers hold outside."""

import json
import re

import numpy as np
import pytest
from commands import answer, flighttune
from places import ROOT, STUDIES

import flighttune as ft

WORST = {"budget": 32, "metric": "chi.ITAE", "plant": "kinematic"}
FEW = {"start_deg": 2.0, "plant": "kinematic", "epsilon": 0.5, "confidence": 0.9, "learn": 10}
SLOPE = {"by": ["K_P.phi.chi"], "measures": ["chi.ITAE"]}


def options(settings):
    return " ".join(f"--{key.replace('_', '-')}={value}" for key, value in settings.items())


VERBS = {
    "certify paper --gains K1": lambda: ft.certify("paper", "K1"),
    "compare paper_as_printed@paper paper_as_printed@K1": lambda: ft.compare(
        "paper_as_printed@paper", "paper_as_printed@K1"
    ),
    "verify c.json": lambda: ft.verify("c.json"),
    "verify flown": lambda: ft.refly("flown"),
    "fly turn.toml": lambda: ft.fly("turn.toml"),
    "fly turn.toml --set flight.V_a_mps=30": lambda: ft.fly(
        "turn.toml", changes={"flight.V_a_mps": 30.0}
    ),
    "mission circuit --plan": lambda: ft.route("circuit"),
    "trim aerosonde --V-a 25 --gamma 5": lambda: ft.trim(
        "aerosonde", V_a=[25.0], gamma=[np.radians(5.0)]
    ),
    "tune paper": lambda: ft.tune("paper"),
    "tune paper --frontier --points 3": lambda: ft.frontier("paper", points=3),
    "gradient short.toml --gains paper --by K_P.phi.chi --measure chi.ITAE": lambda: ft.gradient(
        "short.toml", gains="paper", **SLOPE
    ),
    f"worst first_campaign --set seed=3 {options(WORST)}": lambda: ft.worst(
        "first_campaign", **WORST, changes={"seed": 3}
    ),
    f"band turn.toml --gains paper {options(FEW)}": lambda: ft.band(
        "turn.toml", gains="paper", **FEW
    ),
    "gap short.toml --gains paper": lambda: ft.gap("short.toml", "paper"),
    "report flown": lambda: ft.report("flown"),
    "export paper --gains paper --format c": lambda: ft.export(
        "paper", "paper", out="loop", form="c"
    ),
    "meet aim.toml --start paper --budget 2": lambda: ft.meet("aim.toml", start="paper", budget=2),
    "design aerosonde --dry-run": lambda: ft.design("aerosonde"),
}
# What the clock decides, and where the command wrote files.
OF_THE_COMMAND = (
    *("source", "notes", "wall_s", "core_s", "page", "figure", "proof", "recording", "scenario"),
    *("out", "csv", "band", "folder", "written", "model", "route", "timed_runs", "report"),
)


def of_the_value(key, value):
    if key in ("runs", "ladder") and isinstance(value, list):
        return [{k: v for k, v in run.items() if k != "signals"} for run in value]
    return value


LONG = "worst", "gap", "gradient", "meet", "report", "tune paper --frontier"


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", [pytest.param(x, marks=[pytest.mark.soak] * x.startswith(LONG)) for x in VERBS]
)
def test_a_command_prints_the_answer_of_its_verb(here, command):
    made = VERBS[command]().answer()
    expected = json.loads(made.json())
    found = answer(*command.split(), status=made.status if made.failure else 0)

    for key in expected.keys() - {*OF_THE_COMMAND}:
        assert of_the_value(key, found[key]) == of_the_value(key, expected[key]), key


def test_everything_that_ships_is_listed_once():
    listed = re.findall(r"\w+", flighttune("list")[0])
    aircraft = (path.parent for path in (ROOT / "aircraft").glob("*/aircraft.toml"))
    files = [*(ROOT / "scenarios").rglob("*.toml"), *aircraft]
    studies = re.search(r"studies: (.*)", flighttune("list")[0])[1]

    assert not {path.stem for path in files} - {*listed}
    assert {*studies.rstrip(".").split(", ")} == {path.stem for path in STUDIES.glob("*.toml")}
    assert answer("list", "-q") == answer("list")


def test_signals_of_a_run_are_where_fly_says(here):
    for run in answer("fly", "turn.toml", "--out", "o")["runs"]:
        (stored,) = ft.load(run["signals"]).runs
        t, error = stored.t, np.abs(stored.signals["chi_err"].to_numpy())
        assert run["metrics"]["chi"]["ITAE"] == pytest.approx(np.trapezoid(t * error, t), rel=1e-9)


@pytest.mark.slow
def test_a_slope_is_that_of_two_flights(here):
    (row,) = answer(
        *("gradient", "short.toml", "--gains", "paper", "--by", "K_P.phi.chi"),
        "--measure",
        "chi.ITAE",
    )["slopes"]

    def ITAE(step):
        K_P = (ft.PAPER_GAINS.K_P + np.diag([step, 0.0])).tolist()
        own = {"name": "own", "K_P": K_P, "K_I": ft.PAPER_GAINS.K_I.tolist()}
        run = ft.fly("short.toml", changes={"gains": [own]})["jsbsim:aerosonde / own"]
        return float(np.trapezoid(run.t * np.abs(run.signals["chi_err"].to_numpy()), run.t))

    assert row["slope"] == pytest.approx((ITAE(1e-4) - ITAE(-1e-4)) / 2e-4, rel=1e-3)


@pytest.mark.soak
def test_a_gap_is_the_sum_of_its_steps_and_its_cause_the_largest(here):
    found = answer("gap", "short.toml", "--gains", "paper", "--out", "g")

    ladder = found["ladder"]
    assert len(ladder) == len(found["contributions"]) + 1 == 4
    for channel in ("chi", "gamma"):
        rungs = [rung["metrics"][channel]["ITAE"] for rung in ladder]
        steps = {x["adds"]: x["metrics"][channel]["ITAE"] for x in found["contributions"]}
        assert list(steps.values()) == pytest.approx(np.diff(rungs))
        largest = max(steps, key=lambda adds: abs(steps[adds]))
        assert found["cause"][channel] == {"adds": largest, "ITAE": steps[largest]}
    kept = {ft.load(path).runs[0].provenance.plant for path in (here / "g").glob("*.parquet")}
    assert kept == {"kinematic", "point_mass", "point_mass_lag", "jsbsim:aerosonde"}


@pytest.mark.slow
def test_the_largest_disturbance_is_between_the_last_bounded_and_the_first_unbounded(here):
    found = answer("tube", "small.toml", "--gains", "paper", "--disturbance", "largest")

    tried = {row["disturbance"]: row["status"] for row in found["tried"]}
    bounded = [size for size, status in tried.items() if status == "bounded"]
    assert found["largest_disturbance"] == max(bounded)
    assert max(bounded) < min(size for size, status in tried.items() if status == "unbounded")


def test_an_answer_that_is_saved_has_gains_that_are_read(here):
    certified = ft.certify("paper", "paper")

    certified.save(here / "own.json")

    assert (here / "own.json").read_text() == certified.answer().json() + "\n"
    assert ft.load_gains(here / "own.json").K.tolist() == ft.PAPER_GAINS.K.tolist()
    assert str(certified) == "\n".join(certified.answer().text(100))
