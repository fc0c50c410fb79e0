"""The wheel as a stranger has it: installed from the package index, far from any checkout."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_shipped import built, contents, copied_sources

pytestmark = pytest.mark.soak

COMMANDS = """
fly paper
certify paper --out certificate.json
verify certificate.json
report runs/paper --out report.html
verify runs/paper/paper.rrd
adopt J3Cub --out mine
export paper --out folder
campaign first_campaign --runs 2
""".strip().splitlines()
NEED_AN_EXTRA = {"campaign first_campaign --out other --scheduler tcp://127.0.0.1:1": "cluster"}

END = "end of a command"
# To import the package anew for each would take half of the time of all. `reproduce` judges all of
# the paper, which takes as long as they: it is imported, and its files are among those compared.
IN_ONE_PROCESS = f"""
import sys
import flighttune.outputs.paper.reproduce
from flighttune.cli import main
for command in {COMMANDS}:
    sys.argv = ["flighttune", *command.split()]
    try:
        main()
    except SystemExit as ended:
        assert not ended.code, (command, ended.code)
    print("{END}", flush=True)
"""


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return copied_sources(tmp_path_factory.mktemp("wheel") / "source")


@pytest.fixture(scope="module")
def wheel(source):
    (found,) = built(source, source.parent / "out", "wheel")
    return found


def test_the_wheel_has_every_file_of_the_package(source, wheel):
    ours = {
        path.relative_to(source).as_posix(): path.read_bytes()
        for path in (source / "flighttune").rglob("*")
        if path.is_file()
    }

    assert len(ours) > 200
    assert ours.items() <= contents(wheel).items()


def test_a_stranger_flies_from_the_wheel(wheel, tmp_path):
    folder, home, work = (tmp_path / name for name in ("env", "home", "work"))
    home.mkdir()
    work.mkdir()
    uv = [sys.executable, "-m", "uv", "--quiet"]  # a tenth of the time that pip takes
    subprocess.run([*uv, "venv", "--python", sys.executable, folder], check=True)
    install = [*uv, "pip", "install", "--python", folder / "bin" / "python", wheel]
    certificates = {"UV_SYSTEM_CERTS": "1", "UV_NATIVE_TLS": "1"}  # as pip: new, old name
    subprocess.run(install, check=True, env=os.environ | certificates)
    # Its own path and home alone, and a locale that has no Greek.
    clean = {"PATH": os.defpath, "HOME": str(home), "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}

    def run(program, *words):
        words = [folder / "bin" / program, *words]
        return subprocess.run(words, cwd=work, env=clean, capture_output=True, check=False)

    one, many = run("flighttune", "--version"), run("python", "-c", IN_ONE_PROCESS)
    for done in (one, many):
        assert done.returncode == 0, done.stderr
        assert b"Warning" not in done.stderr
    printed = many.stdout.split(END.encode())
    assert one.stdout
    assert len(printed) == len(COMMANDS) + 1
    assert all(text.strip() for text in printed[:-1])
    for command, extra in NEED_AN_EXTRA.items():
        done = run("flighttune", *command.split())
        assert (done.returncode, done.stdout) == (2, b""), command
        (line,) = done.stderr.decode("ascii").splitlines()
        assert f"'flighttune[{extra}]'" in line

    where = "import flighttune; print(flighttune.__file__)"
    found = subprocess.run(
        [folder / "bin" / "python", "-c", where],
        cwd=work,
        env=clean,
        capture_output=True,
        text=True,
    )
    assert Path(found.stdout.strip()).is_relative_to(folder)
    # The cache of compiled aircraft is all that is left behind.
    assert {x.name for x in home.glob("*/*")} <= {"flighttune"}
