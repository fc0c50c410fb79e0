"""The folder of a campaign: who may fly into it, what is there meanwhile, what is not trusted."""

import json
import os
from dataclasses import replace

import duckdb
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from flown_campaigns import Notes, bits, parts, plan, table_flown

import flighttune as ft
from flighttune.base.errors import StoppedError
from flighttune.campaigns import dataset as dataset_module
from flighttune.flight.fly import library_versions

pytestmark = pytest.mark.slow

RUNS = 12


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    return plan(tmp_path_factory.mktemp("files"), runs=RUNS)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    return plan(tmp_path_factory.mktemp("tuned"), runs=4, top='gains = ["paper", "tuned"]')


@pytest.fixture(scope="module")
def rows(ours):
    return table_flown(ours)


@pytest.fixture
def out(tmp_path, ours, rows):
    """A campaign of which the runs 4 to 8 are missing."""
    return written(tmp_path / "out", ours, rows[:4], rows[8:])


def with_gains(plan, name, factor):
    """The plan with one set of gains times a factor."""
    gains = plan.gain_sets[name]
    return replace(plan, gain_sets={**plan.gain_sets, name: replace(gains, K_P=gains.K_P * factor)})


def written(url, ours, *tables, versions=None):
    dataset = dataset_module.Dataset(url, ours, versions or library_versions())
    dataset.write_plan()
    for table in tables:
        dataset.write_part(table)
    return url


def changed(rows, run, name, value):
    """Rows with another value of a run."""
    values = rows.column(name).to_pylist()
    values[run] = value
    field, place = rows.schema.field(name), rows.schema.get_field_index(name)
    return rows.set_column(place, field, pa.array(values, field.type))


@pytest.mark.counts
def test_pandas_and_duckdb_read_a_campaign_while_it_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(dataset_module, "KEEP_MAX_S", 0.0)  # rows are written as they come
    ours = plan(tmp_path, runs=120)
    counts = []

    def read(progress):
        if parts(tmp_path / "out") and progress.doing == "flying":
            found = pd.read_parquet(tmp_path / "out" / "runs")
            sql = f"SELECT count(*), count(DISTINCT run) FROM '{tmp_path}/out/runs/*.parquet'"
            counts.append((len(found), found["run"].nunique(), *duckdb.sql(sql).fetchall()[0]))
        return False

    ft.run_campaign(ours, tmp_path / "out", workers=1, observer=Notes(read))

    assert len(counts) > 2
    assert all(len(set(count)) == 1 for count in counts)
    assert counts == sorted(counts)
    assert counts[0][0] < counts[-1][0]


def test_rows_are_written_as_consecutive_runs_whatever_their_order(tmp_path, ours, rows):
    """And those that came before an error are there after it."""
    written(tmp_path, ours, rows[5:6])
    dataset = dataset_module.Dataset(tmp_path, ours, library_versions())
    order, asked = [7, 0, 2, 1, 4, 8, 10], []

    def fly(_, runs):
        asked.extend(runs)
        yield from (rows.slice(run, 1).to_pylist()[0] for run in order)
        raise StoppedError("enough")

    with pytest.raises(StoppedError):
        dataset.write_rows(fly, 11)

    spans = [(part.runs.start, part.runs.stop) for part in dataset.parts]
    assert asked == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]
    assert spans == [(0, 3), (4, 5), (5, 6), (7, 9), (10, 11)]
    assert dataset.missing == [3, 6, 9, 11]
    kept = [run for run in range(RUNS) if run not in dataset.missing]
    assert bits(dataset.rows()) == bits(rows.take(kept))


@pytest.mark.soak
def test_a_finished_campaign_needs_nobody(tmp_path, ours, rows):
    ended = {"status": "diverged", "reason": "far off"}
    for name, said in ended.items():
        rows = changed(rows, 0, name, said)
    out = written(tmp_path, ours, rows)
    ft.run_campaign(ours, out, workers=1, resume=True)
    notes, nobody = Notes(), "tcp://127.0.0.1:1"

    done = ft.run_campaign(ours, out, scheduler=nobody, resume=True, observer=notes)

    assert (done.flown, done.runs, done.interrupted) == (0, RUNS, False)
    assert done.endings == [{"run": 0, **ended}]
    assert {(progress.done, progress.runs) for progress in notes.seen} == {(RUNS, RUNS)}


def other_campaign(folder, ours, rows):
    written(folder / "out", ours, rows[:4], rows[8:])
    return plan(folder / "other", runs=RUNS, seed=4, duration=2.0)


def other_library(folder, ours, rows):
    written(folder / "out", ours, rows, versions={**library_versions(), "numpy": "1.0"})
    return ours


def more_of_a_hypercube(folder, *_):
    """Its draws depend on their number."""
    hypercube = plan(folder / "cube", runs=RUNS, top='design = "latin_hypercube"')
    written(folder / "out", hypercube)
    return hypercube.with_runs(RUNS + 1)


def runs_that_are_there_twice(folder, ours, rows):
    written(folder / "out", ours, rows[:4], rows[2:6])
    return ours


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (other_campaign, r"seed: .*3.* 4; scenario\.flight\.duration_s: .*1\.0.*2\.0"),
        (other_library, r"numpy: was 1\.0, is "),
        (more_of_a_hypercube, r"`runs` .*12.* 13"),
        (runs_that_are_there_twice, r"got run 2 in \S*part-0"),
    ],
)
def test_what_cannot_go_on_is_refused_with_what_is_different(tmp_path, ours, rows, asked, words):
    plan_asked = asked(tmp_path, ours, rows)

    with pytest.raises(ft.InputError, match=words):
        ft.run_campaign(plan_asked, tmp_path / "out", resume=True)


@pytest.mark.soak
def test_a_campaign_can_grow_and_not_shrink(out, ours):
    longer = ours.with_runs(RUNS + 6)

    done = ft.run_campaign(longer, out, workers=1, resume=True)

    assert (done.flown, done.planned) == (10, RUNS + 6)
    assert bits(ft.load(out).rows()) == bits(table_flown(longer))
    with pytest.raises(ft.InputError, match=r"`runs` .*18.*12"):
        ft.run_campaign(ours, out, resume=True)


@pytest.mark.soak
def test_a_campaign_goes_on_with_the_tuned_gains_it_began_with(tmp_path, tuned):
    rows = table_flown(tuned)
    out = written(tmp_path, tuned, rows[:2])

    ft.run_campaign(with_gains(tuned, "tuned", 1.0 + 3e-7), out, workers=1, resume=True)

    assert bits(ft.load(out).rows()) == bits(rows)


@pytest.mark.parametrize(("name", "factor"), [("paper", 1.0 + 1e-15), ("tuned", 1.0 + 3e-6)])
def test_other_gains_are_refused(tmp_path, tuned, name, factor):
    out = written(tmp_path, tuned)

    with pytest.raises(ft.InputError, match=rf"gains .*{name}\.K_P: "):
        ft.run_campaign(with_gains(tuned, name, factor), out, resume=True)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda tables: tables["plan"]["gains"].update(paper=None), "its hash differs"),
        (lambda tables: tables.update(format=1), "must be 3, got 1: fly the campaign again"),
        (lambda tables: tables.update(format=99), "`format` must be 3, got 99"),
        (lambda tables: tables.pop("plan"), "its hash differs"),
    ],
)
def test_a_description_that_was_edited_is_refused(out, ours, change, message):
    file = out / "campaign.json"
    tables = json.loads(file.read_text())
    change(tables)
    file.write_text(json.dumps(tables))

    for use in (ft.load, lambda out: ft.run_campaign(ours, out, resume=True)):
        with pytest.raises(ft.RecordingError, match=rf"campaign\.json: .*{message}"):
            use(out)


def test_a_damaged_file_is_told_of_and_its_runs_are_flown_again(out, ours, rows):
    part, notes = sorted((out / "runs").iterdir())[0], Notes()
    part.write_bytes(part.read_bytes()[:-100])

    done = ft.run_campaign(ours, out, workers=1, resume=True, observer=notes)

    assert done.flown == 8
    assert bits(ft.load(out).rows()) == bits(rows)
    assert len(notes.heard) == 1
    assert f"{part}: is damaged or was changed" in notes.heard[0]


def test_a_file_of_more_rows_than_its_name_says_is_refused_unread(tmp_path, ours, rows):
    out = tmp_path / "out"
    dataset = dataset_module.Dataset(out, ours, library_versions())
    dataset.write_plan()
    data = dataset_module.parquet_bytes(rows)
    part = dataset_module.Part.holding(range(4), data)
    (out / "runs").mkdir()
    (out / part.path).write_bytes(data)

    with pytest.raises(ft.RecordingError, match=f"have the 4 runs of its name, got {RUNS}"):
        dataset.rows()


def test_a_folder_of_another_or_that_cannot_be_written_is_one_line(tmp_path, ours):
    with (
        dataset_module.locked(tmp_path),
        pytest.raises(ft.InputError, match=f"process {os.getpid()} on "),
    ):
        ft.run_campaign(ours, tmp_path)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "mine.parquet").write_bytes(b"")
    with pytest.raises(ft.InputError, match=r"runs/ without campaign\.json"):
        ft.run_campaign(ours, tmp_path)
    with pytest.raises(ft.InputError, match="must be writable"):
        ft.run_campaign(ours, tmp_path / "runs" / "mine.parquet" / "out")


@pytest.mark.soak
def test_signals_are_kept_of_failures_the_worst_and_a_sample(tmp_path):
    ours = plan(
        tmp_path, runs=40, keep='failures = 3\nworst = 2\nsample = 2\nworst_by = "gamma.ITAE"'
    )

    done = ft.run_campaign(ours, tmp_path / "out", workers=1)

    found = ft.load(tmp_path / "out")
    rows = found.rows().to_pandas()
    worst = rows["gamma.ITAE"].sort_values(ascending=False, kind="stable").index[:2]
    failures = rows.index[~rows["success"]][:3]
    assert {*worst, *failures} <= set(found.kept)
    assert len(found.kept) == done.kept <= 7
    for run in found.kept:
        (flight,) = ft.load(tmp_path / "out" / "signals" / f"run-{run:010d}.parquet").runs
        assert flight.status == rows["status"][run]
        assert np.abs(flight.signals["chi_err"]).max() == rows["chi.peak_rad"][run]


def test_the_hash_sees_every_bit_but_the_time_flights_took(tmp_path, ours, rows):
    ITAE, success = (rows.column(name)[3].as_py() for name in ("chi.ITAE", "success"))
    plain = dataset_module.dataset_hash(written(tmp_path / "plain", ours, rows))

    for place, (name, value) in enumerate((
        ("wall_s", 99.0), ("chi.ITAE", np.nextafter(ITAE, 9.0)), ("chi.ITAE", None),
        ("reason", "another"), ("success", not success),
    )):  # fmt: skip
        out = written(tmp_path / str(place), ours, changed(rows, 3, name, value))
        assert (dataset_module.dataset_hash(out) == plain) == (name == "wall_s"), name
