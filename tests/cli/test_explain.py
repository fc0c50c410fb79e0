"""Commands that compare and bound flights of a moment: their numbers and their files."""

from pathlib import Path

import numpy as np
import pytest
from commands import answer, flighttune
from made_up import made_up_scenario, scenario_file
from made_up_tubes import tube_scenario

import flighttune as ft
from flighttune.cli.app import FOR_ALL
from flighttune.cli.options import COMMANDS
from flighttune.flight.records.parquet import RERUN

AEROSONDE = {"kind": "jsbsim", "aircraft": "aerosonde"}


@pytest.fixture(scope="module")
def turn(tmp_path_factory):
    """Two seconds of a turn on law and aircraft, as a file."""
    scenario = made_up_scenario(
        flight={"chi_deg": 5.0, "duration_s": 2.0}, plant=[{"kind": "kinematic"}, AEROSONDE]
    )
    return scenario_file(tmp_path_factory.mktemp("turn") / "turn.toml", scenario)


@pytest.mark.slow
def test_a_gap_is_the_sum_of_its_steps_and_its_cause_the_largest(turn, tmp_path):
    for name in ("gap.svg", "gap.html"):
        (tmp_path / name).write_text("an earlier one")

    found = answer("gap", turn, "--gains", "paper", "--out", tmp_path)

    ladder = found["ladder"]
    assert len(ladder) == len(found["contributions"]) + 1 == 4
    for channel in ("chi", "gamma"):
        rungs = [rung["metrics"][channel]["ITAE"] for rung in ladder]
        steps = {x["adds"]: x["metrics"][channel]["ITAE"] for x in found["contributions"]}
        assert list(steps.values()) == pytest.approx(np.diff(rungs))
        largest = max(steps, key=lambda adds: abs(steps[adds]))
        assert found["cause"][channel] == {"adds": largest, "ITAE": steps[largest]}
    assert found["figure"] == str(tmp_path / "gap.svg")
    assert found["page"] == str(tmp_path / "gap.html")
    assert Path(found["figure"]).read_text(encoding="utf-8").startswith("<svg")
    assert "<html" in Path(found["page"]).read_text(encoding="utf-8")
    assert Path(found["recording"]).read_bytes().startswith(RERUN)
    kept = {ft.load(path).runs[0].provenance.plant for path in tmp_path.glob("*.parquet")}
    assert kept == {"kinematic", "point_mass", "point_mass_lag", "jsbsim:aerosonde"}


@pytest.mark.slow
def test_the_largest_disturbance_is_between_the_last_bounded_and_the_first_unbounded(tmp_path):
    scenario = tube_scenario(chi_err_deg=0.3, gamma_deg=15.2, duration_s=0.16, rate_hz=12.5)
    file = scenario_file(tmp_path / "tube.toml", scenario)

    found = answer("tube", file, "--gains", "paper", "--disturbance", "largest")

    tried = {row["disturbance"]: row["status"] for row in found["tried"]}
    bounded = [size for size, status in tried.items() if status == "bounded"]
    assert found["largest_disturbance"] == max(bounded)
    assert max(bounded) < min(size for size, status in tried.items() if status == "unbounded")
    for more in (["--out", tmp_path / "tube.npz"], ["--boxes", "no.npz"]):
        refused = flighttune("tube", file, "--disturbance", "largest", *more, status=2)[1]
        assert "`disturbance` must be a number with --boxes or --out" in refused
    assert "must be a number" in flighttune("tube", file, "--disturbance", "much", status=2)[1]


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".rrd", ".html"])
def test_runs_are_compared_in_a_recording_or_on_a_page(turn, tmp_path, ending):
    out = tmp_path / f"both{ending}"

    found = answer("compare", f"{turn}@paper", f"{turn}@K1", "--out", out)

    other = {".rrd": "page", ".html": "recording"}[ending]
    assert found[{".rrd": "recording", ".html": "page"}[ending]] == str(out)
    assert found[other] is None
    begins = RERUN if ending == ".rrd" else b"<!doctype html"
    assert out.read_bytes()[: len(begins)].lower() == begins.lower()


@pytest.mark.slow
def test_slopes_of_a_measure_are_those_of_two_flights(turn):
    """Central differences of the gain of the course."""
    found = answer(
        *("gradient", turn, "--gains", "paper"), *("--by", "K_P.phi.chi", "--measure", "chi.ITAE")
    )

    def ITAE(K):
        own = {"name": "own", "K_P": K.tolist(), "K_I": ft.PAPER_GAINS.K_I.tolist()}
        run = ft.fly(turn, changes={"gains": [own]})["jsbsim:aerosonde / own"]
        t, error = run.t, np.abs(run.signals["chi_err"].to_numpy())
        return float(np.trapezoid(t * error, t))

    step = np.array([[1e-4, 0.0], [0.0, 0.0]])
    K_P = ft.PAPER_GAINS.K_P
    expected = (ITAE(K_P + step) - ITAE(K_P - step)) / 2e-4
    (row,) = found["slopes"]
    assert row["slope"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("seed", ["-1", "1.5", "true"])
def test_a_seed_is_an_integer_from_zero_on(turn, seed):
    assert (
        "`seed` must be an integer from 0 on"
        in (flighttune("band", turn, "--set", f"seed={seed}", status=2)[1])
    )


def test_the_help_lists_every_command_and_the_options_of_all():
    shown = " ".join(flighttune("--help")[0].split())

    for panel, commands in COMMANDS.items():
        assert f"{panel}:" in shown
        for name in commands:
            assert f" {name} " in shown
    for option in FOR_ALL:
        assert ", ".join(option["flags"]) in shown
