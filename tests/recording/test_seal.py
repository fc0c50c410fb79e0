"""A Parquet file that is not as it was written is refused in one line, before it is decoded."""

import hashlib
import random
import re
from dataclasses import replace

import pytest
from fuzzing import TIMES

import flighttune as ft
from flighttune.records.parquet import parquet_bytes

SEED = 12
FEW, MANY = 40, 250 * TIMES
"""Changes of a run that are tried: here, and in `make soak`."""

COUNTS = [FEW, pytest.param(MANY, marks=pytest.mark.soak)]


@pytest.fixture(scope="module")
def sealed(four_runs, tmp_path_factory):
    """A file of one run."""
    path = tmp_path_factory.mktemp("sealed") / "flight.parquet"
    path.write_bytes(parquet_bytes(four_runs[0]))
    return path


def refusal(path):
    with pytest.raises(ft.RecordingError) as caught:
        ft.load_recording(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: must ")
    assert "\n" not in line
    return line


def bit_flipped(data, draw):
    """Bytes with one bit flipped."""
    place, changed = draw.randrange(len(data)), bytearray(data)
    changed[place] ^= 1 << draw.randrange(8)
    return bytes(changed)


@pytest.mark.parametrize("count", COUNTS)
def test_one_flipped_bit_of_a_file_is_refused(sealed, count, tmp_path):
    data, draw, path = sealed.read_bytes(), random.Random(SEED), tmp_path / sealed.name
    for _ in range(count):
        path.write_bytes(bit_flipped(data, draw))
        assert "SHA-256" in refusal(path)


@pytest.mark.parametrize("kept", [0, 4, 13, 200, 0.5, -1000, -10, -1])
def test_a_file_cut_off_is_refused(sealed, kept, tmp_path):
    data = sealed.read_bytes()
    path = tmp_path / sealed.name
    path.write_bytes(data[: int(kept * len(data)) if isinstance(kept, float) else kept])

    assert ("cut off" if kept else "an empty file") in refusal(path)
    path.write_bytes(data + b"\0")
    assert "another SHA-256" in refusal(path)


def test_the_sha_256_in_a_file_is_that_of_all_its_other_bytes(sealed):
    data = sealed.read_bytes()
    (stated,) = re.findall(rb"SHA-256=([0-9a-f]{64})", data)

    assert hashlib.sha256(data.replace(b"SHA-256=" + stated, b"")).hexdigest() == stated.decode()


def test_a_text_that_looks_like_the_sha_256_does_no_harm(four_runs, tmp_path):
    made = four_runs[0].provenance
    title = f"as SHA-256={'7' * 64} and SHA-256={'0' * 64} say"
    run = replace(
        four_runs[0], provenance=replace(made, scenario={**made.scenario, "title": title})
    )
    path = tmp_path / "flight.parquet"
    path.write_bytes(parquet_bytes(run))

    assert ft.load_recording(path).runs[0].provenance.scenario["title"] == title
