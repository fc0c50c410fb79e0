"""The kind of a file is that of its content, whatever its name, and a wrong one is named."""

import io
import zipfile

import numpy as np
import pytest

import flighttune as ft

BAND = b'{"about": 1, "format": "flighttune band 3", "flights": 2}'


def archived(packing, member=BAND, name="about.json"):
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", packing) as file:
        file.writestr(name, member)
    return held.getvalue()


def array_of(text):
    held = io.BytesIO()
    np.savez(held, format=np.array(text))
    return held.getvalue()


def mavlink(magic):
    """A telemetry log: the time of a message in 8 bytes, then the message."""
    return b"\x00\x05\xf0\x11\x22\x33\x44\x55" + magic + b"\x09\x00"


RECORDING, LOG, SEALED = "got a recording", "got the log of a flight", "a band file with the SHA"
OTHER, ARCHIVE = "got another file", "an archive that flighttune did not write, or"
KINDS = {
    "rerun": (b"RRF2....", RECORDING),
    "parquet": (b"PAR1....", RECORDING),
    "ulog": (b"ULog\x01\x12\x35\x01", LOG),
    "dataflash": (b"\xa3\x95\x80\x80", LOG),
    "text of dataflash": (b"FMT, 128, 89, FMT, BBnNZ", LOG),
    "labels": (b"<LABELS>Time</LABELS>", LOG),
    "mavlink 1": (mavlink(b"\xfe"), LOG),
    "mavlink 2": (mavlink(b"\xfd"), LOG),
    "no mavlink": (mavlink(b"\xfc"), OTHER),
    "a short file": (mavlink(b"")[:8], OTHER),
    "json": (BAND, SEALED),
    "json of another": (BAND.replace(b"flighttune", b"othertune"), "got 'othertune band 3'"),
    "json that says so late": (b"{" + b" " * 2_000_000 + BAND[1:], "got 'flighttune band 3'"),
    "deflated": (archived(zipfile.ZIP_DEFLATED), SEALED),
    "stored": (archived(zipfile.ZIP_STORED), SEALED),
    "an array": (array_of(BAND.decode()), SEALED),
    "an archive that is cut off": (archived(zipfile.ZIP_DEFLATED)[:-20], ARCHIVE),
    "another archive": (archived(zipfile.ZIP_DEFLATED, b"nothing"), ARCHIVE),
    "nothing": (b"", "got an empty file"),
}


@pytest.mark.parametrize("name", KINDS)
def test_a_claim_that_is_another_file_is_refused_by_what_it_is(tmp_path, name):
    content, words = KINDS[name]
    for ending in (".data", ".json", ".npz"):
        file = tmp_path / f"x{ending}"
        file.write_bytes(content)
        with pytest.raises(ft.InputError) as refusal:
            ft.verify(file)
        assert words in str(refusal.value)
        assert str(refusal.value).startswith(f"{file}: ")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("x.csv", LOG),
        ("x.TLOG", LOG),
        ("x.rrd", RECORDING),
        ("x.csv@1:2", LOG),
        ("folder", "got a"),
    ],
)
def test_a_file_without_a_mark_is_what_its_ending_says(tmp_path, name, words):
    (tmp_path / "folder").mkdir()
    (tmp_path / name.partition("@")[0]).touch()
    if name != "folder":
        (tmp_path / name.partition("@")[0]).write_bytes(b"?")

    with pytest.raises(ft.InputError, match=words):
        ft.verify(f"{tmp_path / name}")


@pytest.mark.parametrize("read", [ft.load, ft.load_gains, ft.refly, ft.verify])
def test_a_file_that_is_not_there_is_one_line(tmp_path, read):
    with pytest.raises(ft.InputError, match="no such file"):
        read(tmp_path / "none.json")


KML = (
    '<kml xmlns="http://www.opengis.net/kml/2.2"><LineString><coordinates>8.5,47.4,500 '
    "8.52,47.4,500</coordinates></LineString></kml>"
)


def kmz(*members, packing=zipfile.ZIP_DEFLATED):
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", packing) as file:
        for name, text in members:
            file.writestr(name, text)
    return held.getvalue()


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_map_in_an_archive_is_the_map_and_what_is_wrong_with_it_is_said(tmp_path):
    (tmp_path / "x.kml").write_text(KML)
    plain = ft.route(tmp_path / "x.kml").answer().values
    for packing in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        data = kmz(("image.png", "x" * 5000), ("doc.kml", KML), packing=packing)
        (tmp_path / "x.kmz").write_bytes(data)
        packed = ft.route(tmp_path / "x.kmz").answer().values
        assert {**packed, "route": ""} == {**plain, "route": ""}
    stored = kmz(("x.kml", KML), packing=zipfile.ZIP_STORED)
    for data, words in (
        (kmz(("x.kml", KML), ("x.kml", KML)), "`x.kml` must be in the file once"),
        (kmz(("x.kml", KML), packing=zipfile.ZIP_LZMA), "`x.kml` must be stored or deflated"),
        (kmz(("x.txt", KML)), "must hold one .kml file, got 0"),
        (stored.replace(b"47.4", b"47.5"), "got"),  # its checksum is wrong
        (b"PK no archive", "got"),
    ):
        (tmp_path / "x.KMZ").write_bytes(data)
        with pytest.raises(ft.InputError) as refusal:
            ft.route(tmp_path / "x.KMZ")
        assert words in str(refusal.value)
        assert "\n" not in str(refusal.value)
