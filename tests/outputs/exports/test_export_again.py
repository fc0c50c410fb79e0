"""An export into the folder of an earlier one: one export is there afterwards, and other files."""

import hashlib

from flighttune.outputs.exports.jsbsim_folder import _put


def files(folder, **texts):
    """A folder with files of these texts."""
    for name, text in texts.items():
        file = folder / name.replace("_", "/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return folder


def test_what_an_earlier_export_left_is_removed_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    _put(files(tmp_path / "first", aircraft_old="x", systems_own="x", flight="x"), out)
    files(out, notes="mine", systems_own="changed by hand")
    files(tmp_path, outside="mine")
    digest = hashlib.sha256(b"mine").hexdigest()
    with (out / "SHA256SUMS").open("a") as sums:  # as somebody else may have written it
        sums.write(f"{digest}  ../outside\n{digest}  {tmp_path / 'outside'}\n")

    _put(files(tmp_path / "second", aircraft_new="y", flight="y"), out)

    texts = {x.relative_to(out).as_posix(): x.read_text() for x in out.rglob("*") if x.is_file()}
    sums = texts.pop("SHA256SUMS")
    assert texts == {
        "aircraft/new": "y",
        "flight": "y",
        "notes": "mine",
        "systems/own": "changed by hand",
    }
    y = hashlib.sha256(b"y").hexdigest()
    assert sums == f"{y}  aircraft/new\n{y}  flight\n"
    assert (tmp_path / "outside").read_text() == "mine"
