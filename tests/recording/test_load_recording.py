"""Runs read back from recordings, folders and Parquet files, whole, cut off and damaged."""

import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import rerun as rr

import flighttune
from flighttune.control.gains import PAPER_GAINS
from flighttune.errors import RecordingError
from flighttune.flight.fly import fly as fly_scenario
from flighttune.recording import run_columns
from flighttune.recording.load import load_recording
from flighttune.recording.parquet import write_run
from flighttune.recording.record import record
from flighttune.recording.rrd import write_recording
from flighttune.recording.run_columns import ROWS
from flighttune.scenario import load_scenario, scenario_from

from .conftest import fly


def written(runs, path):
    write_recording(runs, path, page="# Page\n", title="Flight")
    return path


@pytest.fixture(scope="module")
def runs(four_runs, cut_short, without_gains):
    return [*four_runs, cut_short, without_gains]


@pytest.fixture(scope="module")
def long_flight():
    return fly("kinematic", "paper", PAPER_GAINS, seconds=0.02 * 2.5 * ROWS)


def assert_same(run, other):
    pd.testing.assert_frame_equal(run.signals, other.signals, check_exact=True)
    bits = [np.ascontiguousarray(r.signals.to_numpy()).view(np.uint64) for r in (run, other)]
    assert np.array_equal(*bits)
    assert run.signals.index.name == "t"
    assert (run.status, run.reason) == (other.status, other.reason)
    made, by = run.provenance, other.provenance
    for name in ("scenario", "plant", "gains_name", "seed", "versions", "wall_s"):
        assert getattr(made, name) == getattr(by, name)
    if made.gains is not None:
        assert np.array_equal(made.gains.K, by.gains.K)
        assert (made.gains.inputs, made.gains.errors) == (by.gains.inputs, by.gains.errors)
    else:
        assert by.gains is None


def test_a_recording_gives_back_what_was_written_to_the_bit(recording, runs):
    found = flighttune.load_recording(recording)

    assert found.missing == ()
    assert [run.label for run in found.runs] == [run.label for run in runs]
    for got, put in zip(found.runs, runs, strict=True):
        assert_same(got, put)


def test_odd_numbers_and_odd_times_come_back(four_runs, tmp_path):
    signals = four_runs[0].signals.iloc[:6].copy()
    signals.index = pd.Index([0.0, 0.1 + 0.2, 1.0 / 3.0, 1.0, math.pi, 1800.0], name="t")
    signals["chi_err"] = [-0.0, math.nan, math.inf, -math.inf, 5e-324, 1.0 + 2.0**-52]
    run = replace(four_runs[0], signals=signals)

    (got,) = load_recording(written([run], tmp_path / "odd.rrd")).runs

    assert_same(got, run)


def test_a_run_is_found_by_its_label(recording, four_runs):
    found = load_recording(recording)

    assert found["kinematic / tuned"].label == "kinematic / tuned"
    with pytest.raises(KeyError, match="is not one of kinematic / paper, "):
        found["kinematic / other"]


@pytest.mark.slow
def test_a_folder_and_a_parquet_file_give_the_same(recording, four_runs, tmp_path):
    shutil.copy(recording, tmp_path / "flight.rrd")
    path = tmp_path / "kinematic-paper.parquet"
    write_run(four_runs[0], path)

    assert len(load_recording(tmp_path).runs) == 6
    assert_same(load_recording(tmp_path)["kinematic / paper"], four_runs[0])
    assert_same(load_recording(path).runs[0], four_runs[0])
    assert load_recording(path).runs[0].provenance == four_runs[0].provenance
    assert load_recording(tmp_path).runs[0].provenance == four_runs[0].provenance


@pytest.fixture
def recorded(tmp_path):
    """Two flights, and the folder that they were recorded in."""
    tables = load_scenario("paper").as_dict()
    tables |= {"plant": [{"kind": "kinematic"}], "gains": ["K1", "paper"], "expect": []}
    tables["flight"] = {**tables["flight"], "duration_s": 2.0}
    flown = fly_scenario(scenario_from(tables))
    record(flown, tmp_path)
    return flown.runs, tmp_path


def test_a_whole_folder_is_read_without_rerun(recorded, monkeypatch):
    runs, folder = recorded
    monkeypatch.setattr(run_columns, "RrdReader", None)

    found = load_recording(folder)

    assert found.missing == ()
    for got, put in zip(found.runs, runs, strict=True):
        assert_same(got, put)


def test_a_folder_without_one_of_its_parquet_files_is_read_from_its_recording(recorded):
    runs, folder = recorded
    (folder / "kinematic-K1.parquet").unlink()

    found = load_recording(folder)

    assert [run.label for run in found.runs] == ["kinematic / K1", "kinematic / paper"]
    assert_same(found.runs[0], runs[0])


def test_a_parquet_file_of_another_flight_is_not_taken_for_a_run_of_the_recording(recorded):
    runs, folder = recorded
    write_run(replace(runs[0], reason="another"), folder / "kinematic-K1.parquet")

    found = load_recording(folder)

    assert_same(found.runs[0], runs[0])
    assert found.missing == (
        f"{folder / 'kinematic-K1.parquet'}: of another flight than flight.rrd, which was read",
    )


def test_a_folder_without_its_recording_gives_what_parquet_has_in_order(four_runs, tmp_path):
    for number, run in enumerate(reversed(four_runs)):
        write_run(run, tmp_path / f"{number}.parquet")

    found = load_recording(tmp_path)

    by_plant = [four_runs[k].label for k in (0, 2, 1, 3)]
    assert [run.label for run in found.runs] == by_plant
    assert found.missing == (
        f"{tmp_path}: there is no recording; only runs with a Parquet file are there",
    )


def test_a_folder_whose_recording_is_damaged_falls_back_on_parquet(four_runs, tmp_path):
    (tmp_path / "flight.rrd").write_bytes(b"RRF2" + b"damage" * 100)
    write_run(four_runs[0], tmp_path / "one.parquet")

    found = load_recording(tmp_path)

    assert_same(found.runs[0], four_runs[0])
    assert "flight.rrd: must be" in found.missing[0]


def test_a_folder_whose_recording_is_cut_off_falls_back_on_parquet(recording, four_runs, tmp_path):
    (tmp_path / "flight.rrd").write_bytes(recording.read_bytes()[:-10])
    write_run(four_runs[0], tmp_path / "one.parquet")

    found = load_recording(tmp_path)

    assert_same(found.runs[0], four_runs[0])
    assert "flight.rrd: must be" in found.missing[0]


@pytest.mark.slow
def test_a_flight_of_several_chunks_comes_back_in_order_of_time(long_flight, tmp_path):
    (run,) = load_recording(written([long_flight], tmp_path / "long.rrd")).runs

    assert_same(run, long_flight)


def test_what_is_not_there_or_not_ours_gives_one_line(tmp_path):
    with pytest.raises(RecordingError, match="got no such file"):
        load_recording(tmp_path / "none.rrd")
    with pytest.raises(RecordingError, match="the folder must hold a recording, got none"):
        load_recording(tmp_path)
    stream = rr.RecordingStream("other")
    stream.save(tmp_path / "other.rrd")
    stream.log("page", rr.TextDocument("hello"), static=True)
    stream.disconnect()
    with pytest.raises(RecordingError, match=r"got none: it is .* of another program"):
        load_recording(tmp_path / "other.rrd")


def test_two_recordings_in_a_folder_are_one_too_many(recording, tmp_path):
    for name in ("a.rrd", "b.rrd"):
        shutil.copy(recording, tmp_path / name)

    with pytest.raises(RecordingError, match=r"must hold one recording, got a\.rrd, b\.rrd"):
        load_recording(tmp_path)


def test_a_scenario_that_json_cannot_hold_is_refused(four_runs, tmp_path):
    odd = replace(four_runs[0].provenance, scenario={"title": object()})
    with pytest.raises(RecordingError, match="must hold plain values"):
        written([replace(four_runs[0], provenance=odd)], tmp_path / "odd.rrd")


def test_the_signals_are_columns_that_other_programs_can_read(recording, four_runs):
    from rerun.chunk import RrdReader

    stream = RrdReader(recording).stream().filter(content="/runs_flown/00_kinematic_paper")
    chunks = stream.to_chunks()
    names = next(c.to_record_batch() for c in chunks if c.is_static)
    values = next(c.to_record_batch() for c in chunks if not c.is_static)

    told = names.column("SeriesLines:names")[0].as_py()
    assert told == ["t", *four_runs[0].signals.columns]
    assert values.column("Scalars:scalars")[3].as_py() == [
        four_runs[0].signals.index[3],
        *four_runs[0].signals.iloc[3],
    ]
    assert json.dumps(values.column("flight_time")[3].value) == "60000000"
