"""What other users put into a shared folder changes no file of mine, and no command waits for it.

The tests run as root, as CI does: root can make files of others, and is one who must not be fooled.
"""

import os
import shutil
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

import pytest
from commands import flighttune
from fuzzing import in_child
from places import SHIPPED_SCENARIOS

import flighttune as ft
from flighttune.base.files import owned

WHOLE = ".flighttune.whole"
ME, OTHER, LONG_AGO = 1234, 65534, (0.0, 0.0)

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="only root makes files of other users")


def written(place, text="theirs"):
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(text)


def answer(folder, name=WHOLE, mark=True, mode=0o700):
    """An answer that is being put in place, with a file to move and one to remove."""
    made = folder / name
    written(made / "new" / "victim" / "law.py")
    written(made / "new" / "turn.toml")
    written(made / "old" / "victim" / "precious.txt", "")
    if mark:
        written(made / ".flighttune-answer", "")
    made.chmod(mode)
    os.utime(made, LONG_AGO)
    return made


def files_instead(folder, make):
    shutil.rmtree(answer(folder) / "new")
    make(folder / WHOLE / "new")


def link_in_place(folder):
    """A place of a file behind a link that leads out of the folder."""
    (folder / "link").symlink_to("../home")
    written(answer(folder) / "new" / "link" / "law.py")


def further_folder(folder):
    """A folder that the command does not name, listed as version 0.5.0 did."""
    written(folder.parent / "home" / ".flighttune-y" / "new" / "law.py")
    written(answer(folder) / "others", f"{folder.parent}/home/.flighttune-y")


PUT = {
    "nothing": lambda x: None,
    "an answer": answer,
    "an answer that everybody can change": lambda x: answer(x, mode=0o777),
    "an answer without a mark": lambda x: answer(x, mark=False),
    "an answer that is a link": lambda x: (x / WHOLE).symlink_to("../home"),
    "an answer that is a pipe": lambda x: os.mkfifo(x / WHOLE),
    "an answer that is a file": lambda x: (x / WHOLE).touch(),
    "a deep answer": lambda x: (answer(x) / "new" / Path(*["d"] * 100)).mkdir(parents=True),
    "files that are a link": lambda x: files_instead(x, lambda new: new.symlink_to("../../home")),
    "files that are a pipe": lambda x: files_instead(x, os.mkfifo),
    "a file that is a pipe": lambda x: os.mkfifo(answer(x) / "new" / "pipe"),
    "a file that is a link": lambda x: (answer(x) / "new" / "l").symlink_to("/dev/zero"),
    "a place that is a link": link_in_place,
    "a further folder": further_folder,
    "itself as a further folder": lambda x: written(answer(x) / "others", "./.flighttune-x"),
    "endless further folders": lambda x: (answer(x) / "others").symlink_to("/dev/zero"),
    "a pipe of further folders": lambda x: os.mkfifo(answer(x) / "others"),
    "an unfinished file": lambda x: written(x / ".flighttune-x"),
    "an unfinished pipe": lambda x: os.mkfifo(x / ".flighttune-x"),
    "an unfinished link": lambda x: (x / ".flighttune-x").symlink_to("../home"),
    "an unfinished answer": lambda x: answer(x, ".flighttune-x", mode=0o777),
    "a folder of schemas that is a link": lambda x: (x / ".flighttune").symlink_to("../home"),
}
"""What may stand in a folder in which others write."""


def proof():
    return ft.certify("paper", "paper").certificate


def two_files(folder):
    files = ("--out", folder / "one.json", "--figure", folder / "two.svg")
    flighttune("certify", "paper", "--gains", "paper", *files, status=None)


COMMANDS = {
    "reads": lambda x: (ft.load_scenario(x / "turn.toml"), ft.load(x / "turn.toml")),
    "writes a file": lambda x: proof().save(x / "one.json"),
    "writes an answer": two_files,
    "writes a scenario": lambda x: flighttune("new", x / "mine", status=None),
}


def tried(command, folder):
    """Run a command, which may refuse what it finds."""
    with suppress(ft.FlightTuneError):
        command(folder)


def files_of(folder):
    """Kind, owner, mode and content of what is below a folder."""
    found = {}
    for path in folder.rglob("*"):
        about = os.lstat(path)
        content = path.read_bytes() if stat.S_ISREG(about.st_mode) else b""
        found[str(path)] = about.st_mode, about.st_uid, content
    return found


def given_to(user, *paths):
    for path in paths:
        below = path.rglob("*") if path.is_dir() and not path.is_symlink() else ()
        for x in (path, *below):
            os.chown(x, user, user, follow_symlinks=False)


@pytest.fixture
def shared():
    """A folder of all users with a scenario and private files, and the home of a user beside it."""
    above = Path(tempfile.mkdtemp())
    above.chmod(0o755)
    folder = above / "shared"
    for place in (folder / "victim", above / "home"):
        for name in ("law.py", "precious.txt", "scenario.json", "turn.toml"):
            written(place / name, "mine")
            (place / name).chmod(0o600)
        place.chmod(0o700)
    shutil.copy(SHIPPED_SCENARIOS / "paper.toml", folder / "turn.toml")
    folder.chmod(0o1777)
    yield folder
    shutil.rmtree(above)


@pytest.fixture(scope="module", autouse=True)
def imported(tmp_path_factory):
    """Whatever the commands import: another user may not be able to read it."""
    folder = tmp_path_factory.mktemp("imported")
    shutil.copy(SHIPPED_SCENARIOS / "paper.toml", folder / "turn.toml")
    for command in COMMANDS.values():
        tried(command, folder)


@pytest.mark.soak
@pytest.mark.parametrize("me", [ME, 0], ids=["a user", "root"])
@pytest.mark.parametrize("packed", [False, True], ids=["by another user", "in an archive"])
@pytest.mark.parametrize("put", PUT.values(), ids=PUT)
def test_what_stands_in_a_shared_folder_changes_no_file_of_mine(shared, put, packed, me):
    """Whoever packed an archive that I unpack can change what is in its folder, and no more."""
    home, mine = shared.parent / "home", [shared / "victim", shared / "turn.toml"]
    put(shared)
    given_to(me if packed else OTHER, shared, *shared.iterdir())
    given_to(me, home, *([] if packed else mine))
    before = files_of(home) | ({} if packed else files_of(shared))

    def run():
        os.setgroups([])
        os.setresgid(me, me, me)
        os.setresuid(me, me, me)
        for command in COMMANDS.values():
            tried(command, shared)

    assert in_child(run, 30.0, 8 << 30) == ""
    after = files_of(shared.parent)
    assert {name: after.get(name) for name in before} == before
    if put is PUT["nothing"]:
        assert {"one.json", "two.svg", "mine.toml", ".flighttune"} <= {*os.listdir(shared)}


@pytest.mark.parametrize("name", [".flighttune-x", WHOLE])
def test_a_folder_of_mine_that_others_renamed_stays(shared, name):
    """In a folder without the sticky bit everybody can rename what is in it."""
    given_to(OTHER, shared)
    (shared / "victim").rename(shared / name)
    os.utime(shared / name, LONG_AGO)
    before = files_of(shared / name)

    for command in COMMANDS.values():
        tried(command, shared)

    assert files_of(shared / name) == before


READ_BACK = {
    "mine": (lambda x: written(x), True),
    "of another user": (lambda x: (written(x), given_to(OTHER, x)), False),
    "that everybody can change": (lambda x: (written(x), x.chmod(0o666)), False),
    "a link to mine": (lambda x: x.symlink_to("home/law.py"), False),
    "a link of another user": (lambda x: (x.symlink_to("home/law.py"), given_to(OTHER, x)), False),
    "a pipe": (os.mkfifo, False),
    "a folder": (Path.mkdir, False),
}


@pytest.mark.parametrize(("make", "believed"), READ_BACK.values(), ids=READ_BACK)
def test_of_what_is_read_back_only_files_of_mine_are_believed(shared, make, believed):
    folder = shared.parent
    make(folder / "kept")
    before = files_of(folder)

    assert owned.is_believed(folder / "kept") == believed
    if believed:
        assert owned.believed_bytes(folder / "kept") == b"theirs"
        given_to(OTHER, folder)
    with pytest.raises(OSError):  # noqa: PT011
        owned.believed_bytes(folder / "kept")
    with suppress(OSError), owned.appended(folder / "kept") as file:
        os.write(file, b"more")
    after = files_of(folder)
    changed = {name for name in before if after[name][2] != before[name][2]}
    assert changed <= ({str(folder / "kept")} if before[str(folder / "kept")][1] == 0 else set())


FOLDERS = {
    "another user's": lambda x, _: (x.mkdir(mode=0o777), given_to(OTHER, x)),
    "another user's link": lambda x, home: (x.symlink_to(home), given_to(OTHER, x)),
    "a link": lambda x, home: x.symlink_to(home),
    "a file": lambda x, _: x.touch(),
}


@pytest.mark.parametrize("make", FOLDERS.values(), ids=FOLDERS)
@pytest.mark.parametrize("at", [0, 1])
def test_a_folder_of_a_cache_is_mine_and_nothing_else_is_changed(shared, make, at):
    names, home = ("flighttune", "compiled"), shared.parent / "home"
    home.chmod(0o755)
    place = shared.joinpath(*names[: at + 1])
    place.parent.mkdir(exist_ok=True, mode=0o700)
    make(place, home)
    before = files_of(shared.parent)

    with pytest.raises(OSError):  # noqa: PT011
        owned.own_folder(shared, *names)
    assert files_of(shared.parent) == before

    fresh = owned.own_folder(shared / "victim", *names)
    assert {stat.S_IMODE(os.stat(x).st_mode) for x in (fresh, fresh.parent)} == {0o700}
