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
from fuzzing import refused_apart
from made_up import run_file

import flighttune as ft
from flighttune.base.files import budget, parquet
from flighttune.base.files.load import BLANK, seal
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.flight.records import parquet as records


def read(path):
    (run,) = ft.load(path).runs
    return run


def assert_same(again, run):
    pd.testing.assert_frame_equal(again.signals, run.signals, check_exact=True)
    assert again.signals.to_numpy().tobytes() == run.signals.to_numpy(dtype=float).tobytes()
    assert again.signals.index.to_numpy().tobytes() == run.signals.index.to_numpy().tobytes()
    assert (again.status, again.reason, again.label) == (run.status, run.reason, run.label)
    for name in ("scenario", "plant", "gains_name", "seed", "versions", "wall_s"):
        assert getattr(again.provenance, name) == getattr(run.provenance, name)


def test_a_run_comes_back_to_the_bit(four_runs, without_gains, tmp_path):
    for k, run in enumerate([*four_runs, without_gains]):
        assert_same(read(run_file(tmp_path / f"{k}.parquet", run)), run)


def test_gains_and_values_at_the_edge_of_float64_come_back_to_the_bit(four_runs, tmp_path):
    third = ft.PIGains(K_P=np.full((2, 2), 1.0 / 3.0), K_I=np.full((2, 2), -1e-300))
    edge = [np.nan, np.inf, -np.inf, -0.0, 5e-324, np.nextafter(1.0, 2.0), 1.7976931348623157e308]
    t = pd.Index([0.0, 0.1 + 0.2, 1.0 / 3.0, 2.0, 3.0, 4.0, 5e5], name="t")
    made = replace(four_runs[0].provenance, gains=third)
    run = replace(four_runs[0], signals=pd.DataFrame({"chi": edge}, index=t), provenance=made)

    again = read(run_file(tmp_path / "run.parquet", run))

    assert_same(again, run)
    assert again.provenance.gains.K.tobytes() == third.K.tobytes()
    assert again.provenance.gains.inputs == third.inputs


def test_units_and_a_description_in_json_are_in_the_file_for_others(four_runs, tmp_path):
    schema = pq.read_schema(run_file(tmp_path / "run.parquet", four_runs[1]))
    made = json.loads(schema.metadata[b"flighttune.run"])["provenance"]

    assert all(field.metadata[b"unit"] for field in schema)
    for name, unit in (("t", b"s"), ("alpha", b"rad"), ("V_a", b"m/s")):
        assert schema.field(name).metadata == {b"unit": unit}
    assert made["scenario"]["flight"]["V_a_mps"] == 25.0
    assert made["gains"]["K_P"] == four_runs[1].provenance.gains.K_P.tolist()


def test_the_sha_256_of_a_run_is_that_of_its_description_and_signals(four_runs):
    # Computed with sha256sum of a file with both, one behind the other.
    run = four_runs[0]
    description, _, sha256 = records.parts_of(run)
    values = np.column_stack([run.signals.index.to_numpy(), run.signals.to_numpy()])
    digest = hashlib.sha256(description.encode() + values.astype("<f8").tobytes())

    assert sha256 == digest.hexdigest()


def test_the_sha_256_in_a_file_is_that_of_all_its_other_bytes(four_runs, tmp_path):
    data = run_file(tmp_path / "run.parquet", four_runs[0]).read_bytes()
    (stated,) = re.findall(rb"SHA-256=([0-9a-f]{64})", data)

    assert hashlib.sha256(data.replace(b"SHA-256=" + stated, b"")).hexdigest() == stated.decode()


def test_a_text_that_looks_like_the_sha_256_does_no_harm(four_runs, tmp_path):
    made = four_runs[0].provenance
    title = f"as SHA-256={'7' * 64} and SHA-256={'0' * 64} say"
    scenario = {**made.scenario, "title": title}
    run = replace(four_runs[0], provenance=replace(made, scenario=scenario))

    assert read(run_file(tmp_path / "flight.parquet", run)).provenance.scenario["title"] == title


def of_another_program():
    written = pa.BufferOutputStream()
    pq.write_table(pa.table({"t": [0.0, 1.0]}), written)
    return written.getvalue().to_pybytes()


def of_an_older_version():
    """It is sealed too."""
    written = pa.BufferOutputStream()
    stated = {b"flighttune.run": '{"format": 99}', records.SEAL: BLANK}
    pq.write_table(pa.table({"t": [0.0, 1.0]}).replace_schema_metadata(stated), written)
    return seal(written.getvalue().to_pybytes())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (of_another_program(), "of another program"),
        (of_an_older_version(), "layout must be 3, got"),
        (b"", "an empty file"),
    ],
    ids=["another program", "older version", "empty"],
)
def test_what_is_no_file_of_ours_is_refused(tmp_path, content, words):
    path = tmp_path / "run.parquet"
    path.write_bytes(content)

    with pytest.raises(ft.RecordingError, match=words):
        ft.load(path)


def test_a_file_that_is_cut_off_is_refused(four_runs, tmp_path):
    path = run_file(tmp_path / "run.parquet", four_runs[0])
    path.write_bytes(path.read_bytes()[:-1])

    with pytest.raises(ft.RecordingError, match="cut off"):
        ft.load(path)


def test_a_file_in_another_unit_is_refused(four_runs, tmp_path, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setitem(SIGNAL_UNITS, "chi", "deg")
        path = run_file(tmp_path / "run.parquet", four_runs[0])

    with pytest.raises(ft.RecordingError, match="`chi` must be in rad"):
        ft.load(path)


def large(columns, rows, **changed):
    """A file of equal numbers, with its right seal, whose bytes are few."""
    described = {"format": 3, "status": "completed", "reason": "", "columns": {"t": "s"}, **changed}
    metadata = {
        b"flighttune.run": json.dumps(described),
        b"flighttune.flight": "[]",
        records.SEAL: BLANK,
    }
    names = [f"c{i}" for i in range(columns)]
    schema = pa.schema([pa.field(name, pa.float64()) for name in names], metadata=metadata)
    column = pa.array(np.zeros(rows))
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table([column] * columns, schema=schema), sink, compression="zstd")
    return seal(sink.getvalue().to_pybytes())


@pytest.mark.parametrize(("columns", "rows"), [(23, 1_500_000), (400, 80_000)])
def test_a_file_of_more_numbers_than_fit_is_refused_unread(tmp_path, columns, rows):
    (tmp_path / "run.parquet").write_bytes(large(columns, rows))

    said, grown = refused_apart(lambda: ft.load(tmp_path / "run.parquet"))

    assert said.endswith(f"it must have at most 30000000 numbers, got {rows} rows of {columns}.")
    assert grown < 100_000_000  # unpacked it has over 256 MB


def test_texts_that_unpack_to_much_are_refused_unread(tmp_path, monkeypatch):
    monkeypatch.setattr(budget, "PARQUET", budget.Budget(unpacked=100_000, entries=60_000))
    table = pa.table({"t": pa.array(["x" * 1000] * 300)})
    sink = pa.BufferOutputStream()
    made = table.replace_schema_metadata({records.SEAL: BLANK})
    pq.write_table(made, sink, compression="zstd", use_dictionary=False)
    (tmp_path / "run.parquet").write_bytes(seal(sink.getvalue().to_pybytes()))

    with pytest.raises(ft.RecordingError, match="it must unpack to at most 100000 bytes, got 30"):
        ft.load(tmp_path / "run.parquet")


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compression": "zstd", "data_page_version": "2.0"},
        {"compression": "none", "use_dictionary": False},
        {"data_page_size": 100, "write_page_checksum": True},
        {"compression": "gzip", "row_group_size": 300, "write_page_index": True},
    ],
)
def test_pages_are_as_large_as_the_metadata_of_their_column_state(options):
    texts, holes = [f"{i % 77}" for i in range(2000)], [None if i % 3 else i for i in range(2000)]
    lists = [[1.0] * (i % 4) for i in range(2000)]
    table = pa.table({"x": np.random.default_rng(1).normal(size=2000), "t": texts, "n": holes})
    sink = pa.BufferOutputStream()
    pq.write_table(table.append_column("l", [lists]), sink, **options)
    data = sink.getvalue().to_pybytes()

    stated = parquet.opened(data).metadata
    columns = [
        stated.row_group(i).column(j) for i in range(stated.num_row_groups) for j in range(4)
    ]
    for column in columns:
        assert sum(parquet.pages(data, column)) == column.total_uncompressed_size


def test_a_page_that_claims_more_than_its_metadata_is_refused_unread(monkeypatch):
    monkeypatch.setattr(budget, "PARQUET", budget.Budget(unpacked=1_000_000, entries=60_000))
    sink = pa.BufferOutputStream()
    numbers = pa.table({"x": np.zeros(50_000)})
    pq.write_table(numbers, sink, compression="zstd", use_dictionary=False, data_page_size=2**20)
    data = sink.getvalue().to_pybytes()
    assert data[4:7] == b"\x15\0\x15"  # the type of the first page, then its size: an integer
    assert data[7] > 127 < data[8]  # of three bytes
    assert data[9] < 128

    parquet.opened(data)
    largest = b"\xfe\xff\x7f"  # 1,048,575
    with pytest.raises(ft.RecordingError, match=r"unpack to at most 1000000 bytes, got 1[0-9]{6}"):
        parquet.opened(data[:7] + largest + data[10:])
    with pytest.raises(ft.RecordingError, match="its pages must have whole headers"):
        parquet.opened(data[:4] + b"\xff" * 20 + data[24:])


def test_no_run_is_written_that_could_not_be_read(four_runs):
    text, _, digest = records.parts_of(four_runs[0])

    with pytest.raises(ft.RecordingError, match="at most 30000000 numbers, got 40000000 rows of 1"):
        records.record_bytes((text, np.broadcast_to(0.0, (40_000_000, 1)), digest))
