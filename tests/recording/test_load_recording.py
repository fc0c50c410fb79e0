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
from flighttune.recording.load import load_recording
from flighttune.recording.parquet import write_run
from flighttune.recording.record_columns import ROWS
from flighttune.recording.rrd import write_recording

from .conftest import fly

MESSAGE = 16
"""Bytes in front of a message that say its kind and length."""


def written(runs, path):
    write_recording(runs, path, page="# Page\n", title="Flight")
    return path


@pytest.fixture(scope="module")
def runs(four_runs, cut_short, without_gains):
    return [*four_runs, cut_short, without_gains]


@pytest.fixture(scope="module")
def recording(runs, tmp_path_factory):
    return written(runs, tmp_path_factory.mktemp("load") / "flight.rrd")


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


def test_a_folder_and_a_parquet_file_give_the_same(recording, four_runs, tmp_path):
    shutil.copy(recording, tmp_path / "flight.rrd")
    path = tmp_path / "kinematic-paper.parquet"
    write_run(four_runs[0], path)

    assert len(load_recording(tmp_path).runs) == 6
    assert_same(load_recording(tmp_path)["kinematic / paper"], four_runs[0])
    assert_same(load_recording(path).runs[0], four_runs[0])
    assert load_recording(path).runs[0].provenance == four_runs[0].provenance
    assert load_recording(tmp_path).runs[0].provenance == four_runs[0].provenance


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


def test_a_recording_cut_off_gives_what_there_is_and_says_what_is_missing(long_flight, tmp_path):
    second = replace(long_flight, provenance=replace(long_flight.provenance, gains_name="second"))
    whole = written([long_flight, second], tmp_path / "whole.rrd").read_bytes()
    path, seen = tmp_path / "cut.rrd", set()
    for size in range(400_000, len(whole), 150_000):
        path.write_bytes(whole[:size])
        found = load_recording(path)
        assert found.missing[0] == "the end of the file is cut off"
        for got, put in zip(found.runs, [long_flight, second], strict=True):
            n = len(got.signals)
            seen.add(n)
            pd.testing.assert_frame_equal(
                got.signals, put.signals.iloc[:n], check_exact=True, check_index_type=False
            )
            if n == len(put.signals):
                assert got.status == "completed"
            else:
                assert got.status == "cut_off"
                wanted = f"{got.label}: {n} of {len(put.signals)} samples are there"
                assert any(line.startswith(wanted) for line in found.missing)
                assert got.reason.startswith(wanted)
                assert got.reason.endswith("; the whole flight was completed")

    assert {0, len(long_flight.signals)} <= seen
    assert seen & {ROWS, 2 * ROWS}


def test_a_recording_without_its_last_bytes_lacks_no_sample(recording, runs, tmp_path):
    path = tmp_path / "cut.rrd"
    path.write_bytes(recording.read_bytes()[:-10])

    found = load_recording(path)

    assert found.missing == ("the end of the file is cut off",)
    for got, put in zip(found.runs, runs, strict=True):
        assert_same(got, put)


def test_damage_anywhere_gives_one_line_or_what_was_written(recording, runs, tmp_path):
    whole = recording.read_bytes()
    path, said = tmp_path / "bad.rrd", []
    for place in np.linspace(20, len(whole) - 20, 40).astype(int).tolist():
        data = bytearray(whole)
        data[place : place + 4] = bytes(255 - byte for byte in data[place : place + 4])
        path.write_bytes(data)
        try:
            found = load_recording(path)
        except RecordingError as error:
            said.append(str(error))
            continue
        for got, put in zip(found.runs, runs, strict=True):
            assert got.status in (put.status, "cut_off")
            assert got.signals.equals(put.signals.iloc[: len(got.signals)])

    assert said
    assert all(line.startswith(f"{path}: must ") for line in said)
    assert not any("\n" in line or len(line) > 300 for line in said)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "got an empty file"),
        (b"hello, world" * 20, "got a file of another kind"),
        (b"RRF2" + b"\0" * 8, "got nothing whole in it"),
        (b"RRF2" + b"\xff" * 100, "got damage at byte 12"),
    ],
    ids=["empty", "foreign", "header", "garbage"],
)
def test_what_cannot_be_read_gives_one_line(tmp_path, data, words):
    path = tmp_path / "odd.rrd"
    path.write_bytes(data)

    with pytest.raises(RecordingError, match=words) as caught:
        load_recording(path)

    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_what_is_not_there_or_not_ours_gives_one_line(tmp_path):
    with pytest.raises(RecordingError, match="got no such file"):
        load_recording(tmp_path / "none.rrd")
    with pytest.raises(RecordingError, match="the folder must hold a recording, got none"):
        load_recording(tmp_path)
    stream = rr.RecordingStream("other")
    stream.save(tmp_path / "other.rrd")
    stream.log("page", rr.TextDocument("hello"), static=True)
    stream.disconnect()
    with pytest.raises(RecordingError, match="must be a recording of flighttune, got one of other"):
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
