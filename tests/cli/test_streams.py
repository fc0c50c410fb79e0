"""Standard output in any encoding, on a full disk, closed, or into a pipe that nobody reads."""

import io
import os
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path
from unittest import mock

import pytest
from commands import flighttune

from flighttune.cli import main

SCENARIO = "paper_as_printed"
"""On the kinematic law alone: 0.3 s."""

POSIX = pytest.mark.skipif(os.name == "nt", reason="pipes and /dev/full are those of POSIX")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("streams")
    flighttune("fly", SCENARIO, "--out", found / "run")
    flighttune("certify", SCENARIO, "--out", found / "certificate.json")
    return found


def printed(folder, command, encoding):
    """What a command writes to a standard output in `encoding`, read back, and its exit status."""
    given = command.format(folder=folder).split()
    output = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    with redirect_stdout(output), mock.patch.object(sys, "argv", ["flighttune", *given]):
        try:
            main()
            status = 0
        except SystemExit as exit_:
            status = exit_.code or 0
    output.flush()
    return output.buffer.getvalue().decode(encoding), status


COMMANDS = [
    "list",
    "fly paper_as_printed --out {folder}/flown",
    "compare {folder}/run {folder}/run",
    "verify {folder}/certificate.json",
    "--help",
]


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.split()[0])
def test_a_command_ends_alike_in_every_encoding(folder, command):
    text, status = printed(folder, command, "utf-8")

    for encoding in ("ascii", "latin-1", "cp1252", "cp437"):
        other, ended = printed(folder, command, encoding)
        assert ended == status
        assert len(other.splitlines()) == len(text.splitlines())


def ended(command, **streams):
    return subprocess.run(
        [sys.executable, "-m", "flighttune", *command.split()], timeout=300, check=False, **streams
    )


@POSIX
@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "status"),
    [("list", 0), ("list --json", 0), ("--help", 0), ("tune paper_printed_limits", 1)],
)
def test_a_pipe_that_nobody_reads_is_no_failure(command, status):
    nobody, pipe = os.pipe()
    os.close(nobody)
    try:
        done = ended(command, stdout=pipe, stderr=subprocess.PIPE)
    finally:
        os.close(pipe)

    assert done.returncode == status
    assert done.stderr.count(b"\n") == status  # the reason for exit status 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.slow
def test_standard_output_on_a_full_disk_is_said_in_one_line():
    with open("/dev/full", "wb") as full:
        done = ended("list", stdout=full, stderr=subprocess.PIPE)

    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        b"flighttune: standard output must be writable, got no space left on device."
    ]


@POSIX
@pytest.mark.slow
def test_a_closed_standard_output_is_no_failure():
    code = "import os, sys; os.close(1); os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    done = subprocess.run(
        [sys.executable, "-c", code, "-m", "flighttune", "list"],
        stderr=subprocess.PIPE,
        timeout=300,
        check=False,
    )

    assert (done.returncode, done.stderr) == (0, b"")
