"""A run read back is the run that was written, to the bit; anything else gets one clear line."""

import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import flighttune as ft
from flighttune.files.load import BLANK, seal
from flighttune.records.parquet import DESCRIPTION, SEAL, parquet_bytes, parts_of, read_run
from flighttune.simulate.run import SIGNAL_UNITS


def assert_same(read, run):
    pd.testing.assert_frame_equal(read.signals, run.signals, check_exact=True)
    assert read.signals.to_numpy().tobytes() == run.signals.to_numpy(dtype=float).tobytes()
    assert read.signals.index.to_numpy().tobytes() == run.signals.index.to_numpy().tobytes()
    assert (read.status, read.reason, read.label) == (run.status, run.reason, run.label)
    for name in ("scenario", "plant", "gains_name", "seed", "versions", "wall_s"):
        assert getattr(read.provenance, name) == getattr(run.provenance, name)


def test_a_run_comes_back_to_the_bit(four_runs, without_gains, tmp_path):
    for k, run in enumerate([*four_runs, without_gains]):
        (tmp_path / f"{k}.parquet").write_bytes(parquet_bytes(run))

        assert_same(read_run(tmp_path / f"{k}.parquet"), run)


def test_gains_and_values_at_the_edge_of_float64_come_back_to_the_bit(four_runs, tmp_path):
    third = ft.PIGains(K_P=np.full((2, 2), 1.0 / 3.0), K_I=np.full((2, 2), -1e-300))
    edge = [np.nan, np.inf, -np.inf, -0.0, 5e-324, np.nextafter(1.0, 2.0), 1.7976931348623157e308]
    t = pd.Index([0.0, 0.1 + 0.2, 1.0 / 3.0, 2.0, 3.0, 4.0, 5e5], name="t")
    made = replace(four_runs[0].provenance, gains=third)
    run = replace(four_runs[0], signals=pd.DataFrame({"chi": edge}, index=t), provenance=made)

    (tmp_path / "run.parquet").write_bytes(parquet_bytes(run))
    read = read_run(tmp_path / "run.parquet")

    assert_same(read, run)
    assert read.provenance.gains.K.tobytes() == third.K.tobytes()
    assert read.provenance.gains.inputs == third.inputs


def test_units_and_a_description_in_json_are_in_the_file_for_others(four_runs, tmp_path):
    (tmp_path / "run.parquet").write_bytes(parquet_bytes(four_runs[1]))
    schema = pq.read_schema(tmp_path / "run.parquet")
    made = json.loads(schema.metadata[DESCRIPTION])["provenance"]

    for name, unit in (("t", b"s"), ("alpha", b"rad"), ("V_a", b"m/s")):
        assert schema.field(name).metadata == {b"unit": unit}
    assert made["scenario"]["flight"]["V_a_mps"] == 25.0
    assert made["gains"]["K_P"] == four_runs[1].provenance.gains.K_P.tolist()


def test_a_missing_file_and_a_folder_are_told_apart(tmp_path):
    with pytest.raises(ft.RecordingError, match="got no such file"):
        read_run(tmp_path / "run.parquet")
    with pytest.raises(ft.RecordingError, match="got a folder"):
        read_run(tmp_path)


def test_parquet_of_another_program_is_refused(tmp_path):
    pq.write_table(pa.table({"t": [0.0, 1.0]}), tmp_path / "foreign.parquet")

    with pytest.raises(ft.RecordingError, match="of another program"):
        read_run(tmp_path / "foreign.parquet")


def test_a_file_of_another_layout_is_refused(tmp_path):
    """Sealed as the file of an older version is."""
    path = tmp_path / "old.parquet"
    table = pa.table({"t": [0.0, 1.0]})
    sink = pa.BufferOutputStream()
    pq.write_table(
        table.replace_schema_metadata({DESCRIPTION: '{"format": 99}', SEAL: BLANK}), sink
    )
    path.write_bytes(seal(sink.getvalue().to_pybytes()))

    with pytest.raises(ft.RecordingError, match="layout must be 3, got"):
        read_run(path)


def test_signals_in_another_unit_are_refused(four_runs, tmp_path, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setitem(SIGNAL_UNITS, "chi", "deg")
        (tmp_path / "degrees.parquet").write_bytes(parquet_bytes(four_runs[0]))

    with pytest.raises(ft.RecordingError, match="`chi` must be in rad"):
        read_run(tmp_path / "degrees.parquet")


def test_the_sha_256_of_a_run_is_that_of_its_description_and_signals(four_runs):
    # Computed with sha256sum of a file with both, one behind the other.
    run = four_runs[0]
    description, _, sha256 = parts_of(run)
    values = np.column_stack([run.signals.index.to_numpy(), run.signals.to_numpy()])
    digest = hashlib.sha256(description.encode() + values.astype("<f8").tobytes())

    assert sha256 == digest.hexdigest()


def test_the_sha_256_in_a_file_is_that_of_all_its_other_bytes(four_runs):
    data = parquet_bytes(four_runs[0])
    (stated,) = re.findall(rb"SHA-256=([0-9a-f]{64})", data)

    assert hashlib.sha256(data.replace(b"SHA-256=" + stated, b"")).hexdigest() == stated.decode()


def test_a_text_that_looks_like_the_sha_256_does_no_harm(four_runs, tmp_path):
    made = four_runs[0].provenance
    title = f"as SHA-256={'7' * 64} and SHA-256={'0' * 64} say"
    scenario = {**made.scenario, "title": title}
    run = replace(four_runs[0], provenance=replace(made, scenario=scenario))
    path = tmp_path / "flight.parquet"
    path.write_bytes(parquet_bytes(run))

    assert ft.load(path).runs[0].provenance.scenario["title"] == title


@pytest.mark.parametrize(("kept", "said"), [(0, "an empty file"), (-1, "cut off")])
def test_a_file_that_is_not_whole_says_which(four_runs, tmp_path, kept, said):
    path = tmp_path / "flight.parquet"
    path.write_bytes(parquet_bytes(four_runs[0])[:kept])

    with pytest.raises(ft.RecordingError, match=said):
        ft.load(path)
