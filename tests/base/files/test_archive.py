"""Archives of others: what is taken, and what is refused before it is unpacked."""

import zipfile

import pytest

import flighttune as ft
from flighttune.base.files import archive


def is_text(name):
    return name.endswith(".txt")


def opened(path, most=10, packed=10_000):
    said = "zip archive with a .txt", "its .txt"
    with archive.opened(path, *said, is_text, archive.Budget(packed, most)) as (file, names):
        return {name: file.read(name) for name in names}


def made(path, *members, packing=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", packing) as file:
        for name, text in members:
            file.writestr(name, text)
    return path


@pytest.mark.parametrize("packing", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_the_members_that_are_wanted_are_read_and_others_may_have_any_size(tmp_path, packing):
    members = [("a.txt", "12345"), ("b/c.txt", "67890"), ("d.bin", "x" * 5000)]

    assert opened(made(tmp_path / "x.zip", *members, packing=packing)) == {
        "a.txt": b"12345",
        "b/c.txt": b"67890",
    }


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_members_that_are_too_large_or_doubled_or_of_another_packing_are_refused(tmp_path):
    large = made(tmp_path / "large.zip", ("a.txt", "12345"), ("b.txt", "678901"))
    with pytest.raises(ft.InputError, match=r"its \.txt must have at most 10 bytes"):
        opened(large)
    twice = made(tmp_path / "twice.zip", ("a.txt", "1"), ("a.txt", "2"))
    with pytest.raises(ft.InputError, match=r"`a\.txt` must be in the file once"):
        opened(twice)
    other = made(tmp_path / "other.zip", ("a.txt", "1"), packing=zipfile.ZIP_LZMA)
    with pytest.raises(ft.InputError, match=r"`a\.txt` must be stored or deflated"):
        opened(other)
    size = large.stat().st_size
    assert opened(large, most=11, packed=size)
    with pytest.raises(ft.InputError, match=f"at most {size - 1} bytes"):
        opened(large, most=11, packed=size - 1)


def test_what_is_no_archive_or_not_there_is_refused_in_one_line(tmp_path):
    (tmp_path / "x.zip").write_bytes(b"PK no archive")
    with pytest.raises(ft.InputError, match=r"must be a zip archive with a \.txt, got"):
        opened(tmp_path / "x.zip")
    with pytest.raises(ft.InputError, match="the file must be readable"):
        opened(tmp_path / "none.zip")
    whole = made(tmp_path / "cut.zip", ("a.txt", "12345"), packing=zipfile.ZIP_STORED)
    whole.write_bytes(whole.read_bytes().replace(b"12345", b"12346"))
    with pytest.raises(ft.InputError, match=r"must be a zip archive with a \.txt, got"):
        opened(whole)  # its checksum is wrong
