"""Standard output in any encoding, on a full disk, closed, or into a pipe that nobody reads."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import flighttune
from flown_campaigns import write_campaign

import flighttune as ft

pytestmark = pytest.mark.slow


def ended(command, **streams):
    return subprocess.run(
        [sys.executable, "-m", "flighttune", *command.split()], timeout=300, check=False, **streams
    )


@pytest.mark.soak
def test_an_encoding_may_lack_greek_letters():
    command = "compare paper_as_printed@paper paper_as_printed@K1"
    text, _ = flighttune(*command.split())

    plain = ended(command, stdout=subprocess.PIPE, env={**os.environ, "PYTHONIOENCODING": "ascii"})

    assert plain.returncode == 0
    assert len(plain.stdout.decode("ascii").splitlines()) == len(text.splitlines()) > 2


@pytest.fixture
def unread():
    nobody, pipe = os.pipe()
    os.close(nobody)
    yield pipe
    os.close(pipe)


def test_a_pipe_that_nobody_reads_is_no_failure(unread):
    done = ended("list", stdout=unread, stderr=subprocess.PIPE)

    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_standard_output_on_a_full_disk_is_said_in_one_line():
    with open("/dev/full", "wb") as full:
        done = ended("list", stdout=full, stderr=subprocess.PIPE)

    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        b"flighttune: standard output must be writable, got no space left on device."
    ]


def test_a_closed_standard_output_is_no_failure():
    code = "import os, sys; os.close(1); os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    done = subprocess.run(
        [sys.executable, "-c", code, "-m", "flighttune", "list"],
        stderr=subprocess.PIPE,
        timeout=300,
        check=False,
    )

    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.counts
def test_a_campaign_goes_on_where_nobody_reads_its_progress(tmp_path):
    file = write_campaign(tmp_path, runs=4, wind="", aircraft=())
    command = [sys.executable, "-m", "flighttune", "campaign", file]
    options = ["--workers", "1", "--out", str(tmp_path / "out")]
    with subprocess.Popen(
        [*command, *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as running:
        running.stderr.close()

        assert running.wait(timeout=120.0) == 0

    assert len(ft.load(tmp_path / "out").rows()) == 4
