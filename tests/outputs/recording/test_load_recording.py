"""Runs read back from folders and Parquet files, whole, incomplete and damaged."""

import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import rerun as rr
from made_up import shortened

import flighttune as ft


@pytest.fixture(scope="module")
def flown():
    """Two gain sets flown for 2 s, and one that was not: a run without samples."""
    changes = {"plant": [{"kind": "kinematic"}], "gains": ["K1", "paper"]}
    done = ft.fly(shortened("paper", 2.0, **changes))
    made = replace(done.runs[0].provenance, gains_name="strict")
    never = replace(
        done.runs[0], signals=done.runs[0].signals.iloc[:0], status="no_gains", provenance=made
    )
    return replace(done, runs=(done.runs[1], never, done.runs[0]))


@pytest.fixture
def folder(flown, tmp_path):
    ft.record(flown, tmp_path / "runs")
    return tmp_path / "runs"


def labels(runs):
    return [run.label for run in runs]


@pytest.mark.parametrize("name", ["", "flight.rrd"], ids=["folder", "the recording in it"])
def test_a_folder_gives_back_what_was_written_to_the_bit_and_in_order(folder, flown, name):
    recording = ft.load(folder / name)

    assert recording.missing == ()
    assert labels(recording.runs) == labels(flown.runs)
    for got, put in zip(recording.runs, flown.runs, strict=True):
        pd.testing.assert_frame_equal(got.signals, put.signals, check_exact=True)
        assert got.provenance.scenario == put.provenance.scenario


def test_a_lone_recording_names_the_folder_whose_parquet_files_are_needed(
    flown, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    files = ft.record(flown, "runs/paper")
    lone = tmp_path / "lone.rrd"
    shutil.copy(files.recording, lone)

    with pytest.raises(ft.RecordingError) as caught:
        ft.load(lone)

    line = str(caught.value)
    assert line.startswith(f"{lone}: ")
    assert f"Parquet files of the folder {Path('runs/paper')}," in line
    assert "\n" not in line


def test_a_recording_among_the_files_of_another_flight_is_refused(folder, flown, tmp_path):
    other = replace(flown, runs=flown.runs[:1])
    files = ft.record(other, tmp_path / "other")
    shutil.copy(files.recording, folder / "flight.rrd")

    with pytest.raises(ft.RecordingError, match=r"flight\.rrd: .*folder other"):
        ft.load(folder / "flight.rrd")


def test_a_recording_keeps_no_absolute_path(flown, tmp_path):
    files = ft.record(flown, tmp_path / "private" / "runs")

    assert b"private" not in files.recording.read_bytes()


def test_a_folder_without_one_of_its_runs_says_so(folder):
    (folder / "kinematic-paper.parquet").unlink()

    recording = ft.load(folder)

    assert labels(recording.runs) == ["kinematic / strict", "kinematic / K1"]
    assert recording.missing == (f"{folder}: 1 of 3 runs is missing",)


def test_a_flight_leaves_no_file_of_the_one_that_it_replaces(folder, flown):
    ft.record(replace(flown, runs=flown.runs[:1]), folder)

    assert sorted(path.name for path in folder.iterdir()) == [
        "flight.rrd",
        "kinematic-paper.parquet",
    ]
    recording = ft.load(folder)
    assert labels(recording.runs) == ["kinematic / paper"]
    assert recording.missing == ()


def test_a_file_of_a_flight_of_another_name_stays_and_is_not_taken_for_a_run_of_this_one(
    folder, flown
):
    ft.record(replace(flown, runs=flown.runs[:1]), folder, name="other")

    recording = ft.load(folder)

    assert labels(recording.runs) == ["kinematic / paper"]
    assert recording.missing == tuple(
        f"{folder / name}: of another flight"
        for name in ("kinematic-K1.parquet", "kinematic-strict.parquet")
    )


@pytest.mark.parametrize("kept", [-1, -1000, 4])
def test_a_damaged_recording_is_one_line_and_does_no_harm_to_its_folder(folder, flown, kept):
    """Cut off, which warns of nothing else, or no more than the mark of its kind."""
    recording = folder / "flight.rrd"
    recording.write_bytes(recording.read_bytes()[:kept] + (b"damage" * 100 if kept > 0 else b""))

    assert labels(ft.load(folder).runs) == labels(flown.runs)
    with pytest.raises(ft.RecordingError, match=r"flight\.rrd: must be a recording"):
        ft.load(recording)


def of_another_program(path):
    stream = rr.RecordingStream("other")
    stream.save(path)
    stream.log("page", rr.TextDocument("hello"), static=True)
    stream.disconnect()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.rrd", "there is no such file"),
        (".", "must hold Parquet files"),
        ("other.rrd", r"other\.rrd: .*Parquet files"),
    ],
)
def test_what_is_not_there_or_not_ours_gives_one_line(tmp_path, name, words):
    if name == "other.rrd":
        of_another_program(tmp_path / name)

    with pytest.raises(ft.RecordingError, match=words) as refusal:
        ft.load(tmp_path / name)
    assert "\n" not in str(refusal.value)


def test_a_scenario_that_json_cannot_hold_is_refused(flown, tmp_path):
    run = flown.runs[0]
    odd = replace(run, provenance=replace(run.provenance, scenario={"title": object()}))

    with pytest.raises(ft.RecordingError, match="must hold plain values"):
        ft.record(replace(flown, runs=(odd,)), tmp_path)
    assert not list(tmp_path.iterdir())
