"""Kinds of files by their content, and the hash that they carry of themselves."""

import hashlib
import io
import zipfile

import numpy as np
import pytest

import flighttune as ft
from flighttune.base.files import load

BAND = b'{"about": 1, "format": "flighttune band 3", "flights": 2}'


def archived(packing, member=BAND, name="about.json"):
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", packing) as file:
        file.writestr(name, member)
    return held.getvalue()


def arrays_with(text):
    """An archive of NumPy whose first array is a text."""
    held = io.BytesIO()
    np.savez(held, format=np.array(text))
    return held.getvalue()


def mavlink(magic):
    """A telemetry log: the time of a message in 8 bytes, then the message."""
    return b"\x00\x05\xf0\x11\x22\x33\x44\x55" + magic + b"\x09\x00"


CONTENTS = {
    "rerun": (b"RRF2....", load.RECORDING),
    "parquet": (b"PAR1....", load.RECORDING),
    "ulog": (b"ULog\x01\x12\x35\x01", load.LOG),
    "dataflash": (b"\xa3\x95\x80\x80", load.LOG),
    "text of dataflash": (b"FMT, 128, 89, FMT, BBnNZ", load.LOG),
    "labels": (b"<LABELS>Time</LABELS>", load.LOG),
    "mavlink 1": (mavlink(b"\xfe"), load.LOG),
    "mavlink 2": (mavlink(b"\xfd"), load.LOG),
    "no mavlink": (mavlink(b"\xfc"), ""),
    "a short file": (mavlink(b"")[:8], ""),
    "json": (BAND, load.BAND),
    "json of another": (BAND.replace(b"flighttune", b"othertune"), ""),
    "json that says so late": (b"{" + b" " * load.HEAD + BAND[1:], ""),
    "deflated": (archived(zipfile.ZIP_DEFLATED), load.BAND),
    "stored": (archived(zipfile.ZIP_STORED), load.BAND),
    "an array": (arrays_with(BAND.decode()), load.BAND),
    "nothing": (b"", ""),
}


@pytest.mark.parametrize("name", CONTENTS)
def test_the_kind_of_a_file_is_that_of_its_content_whatever_its_name(tmp_path, name):
    content, kind = CONTENTS[name]
    for ending in (".data", ".json"):
        file = tmp_path / f"x{ending}"
        file.write_bytes(content)
        assert load.kind_of(file) == kind


def test_an_archive_that_is_cut_off_or_of_another_program_is_refused_unless_it_is_a_map(tmp_path):
    whole = archived(zipfile.ZIP_DEFLATED)
    for content in (whole[:-20], archived(zipfile.ZIP_DEFLATED, b"nothing")):
        (tmp_path / "x.npz").write_bytes(content)
        with pytest.raises(ft.InputError, match=r"x\.npz: .* archive"):
            load.kind_of(tmp_path / "x.npz")
        (tmp_path / "x.KMZ").write_bytes(content)
        assert load.kind_of(tmp_path / "x.KMZ") == ""


def test_a_kind_without_a_mark_is_that_of_the_ending_and_a_folder_has_its_own(tmp_path):
    for ending, kind in ((".csv", load.LOG), (".TLOG", load.LOG), (".rrd", load.RECORDING)):
        (tmp_path / f"x{ending}").write_bytes(b"?")
        assert load.kind_of(tmp_path / f"x{ending}") == kind
    assert load.kind_of(tmp_path) == load.RECORDING
    (tmp_path / load.CAMPAIGN).write_text("{}")
    assert load.kind_of(tmp_path) == load.DATASET
    assert load.kind_of(f"{tmp_path / 'x.csv'}@mine") == load.LOG


def test_a_seal_is_the_hash_of_all_other_bytes():
    data = load.seal(b"before" + load.BLANK.encode() + b"after")

    digest = hashlib.sha256(b"beforeafter").hexdigest().encode()
    assert data == b"before" + load.MARK + digest + b"after"


@pytest.mark.parametrize("size", [0, 10, 3 * 2**20 + 5])
def test_a_seal_at_the_end_is_the_hash_of_what_comes_before(tmp_path, size):
    file, before = tmp_path / "x", bytes(range(256)) * (size // 256) + b"!" * (size % 256)
    file.write_bytes(before + load.BLANK.encode())

    load.seal_end(file)

    digest = hashlib.sha256(before).hexdigest().encode()
    assert file.read_bytes() == before + load.MARK + digest
    assert load.sealed_bytes(file, "file") == file.read_bytes()


def test_a_sealed_file_that_is_changed_or_another_is_refused(tmp_path):
    file = tmp_path / "x"
    sealed = load.seal(b"before" + load.BLANK.encode() + b"after")
    for content, said in (
        (sealed.replace(b"before", b"Before"), "another SHA-256"),
        (sealed[:-1], "another SHA-256"),
        (b"beforeafter", "got none"),
        (b"", "an empty file"),
        (load.seal(BAND + load.BLANK.encode()), "got a band file"),
    ):
        file.write_bytes(content)
        with pytest.raises(ft.InputError, match=said):
            load.sealed_bytes(file, "recording")
    with pytest.raises(ft.InputError, match="got a folder"):
        load.file_bytes(tmp_path, "recording")
    with pytest.raises(ft.InputError, match="no such file"):
        load.file_bytes(tmp_path / "none", "recording")
    file.write_bytes(b"12345")
    assert load.file_bytes(file, "recording", 3) == b"123"
    assert load.file_bytes(file, "recording") == b"12345"


def test_a_file_of_another_kind_is_refused_by_what_it_is(tmp_path):
    band, other = tmp_path / "band.json", tmp_path / "other.json"
    band.write_bytes(BAND)
    other.write_bytes(BAND.replace(b"flighttune", b"othertune"))

    with pytest.raises(ft.InputError, match="must be a certificate, got a band file"):
        load.load_one(str(band), "certificate", load.CERTIFICATE)
    with pytest.raises(ft.InputError, match="`format` must be that of a certificate, got 'other"):
        load.load_one(other, "certificate", load.CERTIFICATE)
    assert load.load_one(3, "certificate", load.CERTIFICATE) == 3
    assert load.written(band, load.CERTIFICATE) is None
    assert load.written(3, load.CERTIFICATE) is None
