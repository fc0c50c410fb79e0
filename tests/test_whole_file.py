"""Files written whole or not at all."""

import pytest

from flighttune import whole_file
from flighttune.errors import OutputError


def test_text_has_the_same_bytes_on_every_system(tmp_path):
    path = whole_file.write_text(tmp_path / "new" / "file.json", "χ\nγ²\n")

    assert path.read_bytes() == "χ\nγ²\n".encode()


def test_a_file_that_cannot_be_replaced_stays_as_it_is(tmp_path, monkeypatch):
    path = whole_file.write_text(tmp_path / "report.html", "old")

    def refused(*_):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("pathlib.Path.replace", refused)

    with pytest.raises(OutputError, match=r"report\.html: .*permission denied"):
        whole_file.write_text(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
