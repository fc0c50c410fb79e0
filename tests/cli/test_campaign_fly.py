"""`flighttune verify` of a campaign: rows flown again, some of which were changed."""

import math
import re

import numpy as np
import pyarrow as pa
import pytest
from commands import answer, flighttune
from dispersed import AEROSONDE, KINEMATIC, SOFT, WIND, one_of, plan_of, tables_of, uniform
from flown_campaigns import table_flown

import flighttune as ft
from flighttune.campaigns.dataset import Dataset
from flighttune.flight.fly import library_versions

CHANGED, REFUSED = 3, 8


def written(folder, plan, rows, versions=None):
    """A dataset of rows, without the engine."""
    dataset = Dataset(folder, plan, versions or library_versions())
    dataset.write_plan()
    dataset.write_part(rows)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Twelve runs in wind; one row has another number than its run, one draw is refused."""
    tables = tables_of((KINEMATIC, AEROSONDE), gains=[SOFT, "paper"], wind=WIND)
    tables["flight"]["duration_s"] = 1.5
    plan = plan_of(
        tables, uniform("flight.chi_deg", 10.0, 30.0),
        one_of("flight.V_a_mps", 25.0, 25.0, math.nan), runs=13, seed=2,
    )  # fmt: skip
    rows = table_flown(plan, range(12))
    assert rows["status"][REFUSED].as_py() == "invalid"
    place = rows.schema.get_field_index("chi.ITAE")
    numbers = rows["chi.ITAE"].to_pylist()
    numbers[CHANGED] = np.nextafter(numbers[CHANGED], 1.0)
    changed = rows.set_column(place, rows.schema.field(place), pa.array(numbers))
    versions = {**library_versions(), "numpy": "1.0"}
    return written(tmp_path_factory.mktemp("camp") / "turns", plan, changed, versions)


def test_what_a_run_drew_is_printed_so_that_it_can_be_typed_again(folder, tmp_path):
    out, _ = flighttune("verify", folder, "--run", 2, cwd=tmp_path)

    row = ft.load(folder).rows().to_pylist()[2]
    for key in ("flight.chi_deg", "seed"):
        (text,) = re.findall(rf"^ *{re.escape(key)} +(\S+)", out, re.MULTILINE)
        assert float(text) == row[key]


def test_a_run_is_flown_into_a_recording_and_is_what_its_row_says(folder, tmp_path):
    found = answer("verify", folder, "--run", 2, cwd=tmp_path)

    ((run,), row) = found["runs"], ft.load(folder).rows().to_pylist()[2]
    assert found["equal"]
    assert run["run"] == "run 2: kinematic / soft, draw 0"
    assert run["drawn"] == {key: row[key] for key in run["drawn"]}
    assert found["versions"] == {"numpy": {"recorded": "1.0", "now": np.__version__}}
    recorded = ft.load(tmp_path / found["recording"])
    assert [run.label for run in recorded.runs] == ["jsbsim:aerosonde / soft", "kinematic / soft"]
    flown = recorded["kinematic / soft"]
    assert row["chi.ITAE"] == pytest.approx(
        ft.loop.channel_metrics(flown).at["chi", "ITAE"], rel=1e-12
    )
    assert flown.provenance.scenario["flight"]["chi_deg"] == row["flight.chi_deg"]
    assert ft.refly(recorded).equal


def test_a_row_that_differs_in_the_last_bit_is_told_and_exits_with_1(folder, tmp_path):
    printed, told = flighttune("verify", folder, "--run", CHANGED, status=1, cwd=tmp_path)

    first, second = re.findall(r"\d\.\d{12,}", told)
    assert float(first) == np.nextafter(float(second), 1.0)
    assert f"run {CHANGED}: kinematic / paper, draw 0: chi.ITAE differs" in told
    assert "flight.chi_deg" in printed
    assert "numpy: 1.0 then" in printed
    assert (tmp_path / "runs" / "turns-run-3" / "turns-run-3.rrd").is_file()


def test_some_rows_are_drawn_and_only_a_changed_one_differs(folder):
    again = ft.refly(folder, count=12)

    assert again.flown is None
    assert [len(run.differences) for run in again.runs] == [int(n == CHANGED) for n in range(12)]


@pytest.mark.parametrize(
    ("run", "says"),
    [
        (REFUSED, "`V_a_mps`"),
        (12, "must be one that was flown, got 12 of 13"),
        (99, "got 99 of 13"),
    ],
)
def test_a_run_that_cannot_be_flown_says_why(folder, tmp_path, run, says):
    printed, told = flighttune("verify", folder, "--run", run, status=2, cwd=tmp_path)

    assert says in told
    assert printed == ""
    assert not list(tmp_path.iterdir())


def test_a_count_beside_a_run_is_refused(folder, tmp_path):
    _, told = flighttune("verify", folder, "--run", 2, "--count", 3, status=2, cwd=tmp_path)

    assert "`count` must be at least 1, and absent with `run`" in told
    assert not list(tmp_path.iterdir())
