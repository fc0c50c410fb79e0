"""One flown scenario and its page, and chromium without a screen to look at it."""

import shutil
import subprocess
import tempfile

import pytest
from pictures import DEMANDED

from flighttune.comparison import Source, load_source
from flighttune.flight import fly
from flighttune.recording.record import record
from flighttune.report.page import write_report
from flighttune.scenario import load_scenario

"""Whether a machine without chromium fails a test instead of skipping it."""

QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--hide-scrollbars", "--virtual-time-budget=4000",
)  # fmt: skip
SECONDS = 90


@pytest.fixture(scope="session")
def flown_paper():
    """The paper's manoeuvre on both plants."""
    return fly(load_scenario("paper"))


@pytest.fixture(scope="session")
def run_folder(flown_paper, tmp_path_factory):
    """The same, recorded."""
    folder = tmp_path_factory.mktemp("report") / "paper"
    record(flown_paper, folder, name="paper")
    return folder


@pytest.fixture(scope="session")
def written(run_folder):
    """The report of that folder."""
    return write_report(run_folder, run_folder.parent / "report.html")


@pytest.fixture(scope="session")
def page(written):
    """Its text."""
    return written.path.read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def printed_source():
    """The paper's own simulation: kinematic, one gain set, with a sinusoidal disturbance."""
    return load_source("paper_as_printed")


@pytest.fixture(scope="session")
def paper_source(flown_paper):
    """The flown manoeuvre as a source."""
    return Source(name="paper", runs=flown_paper.runs)


@pytest.fixture(scope="session")
def chromium():
    """Start chromium once with some flags and an empty profile; return what it printed."""
    program = shutil.which("chromium")
    if program is None:
        reason = "chromium is not installed (apt-get install -y --no-install-recommends chromium)"
        if DEMANDED:
            pytest.fail(reason)
        pytest.skip(reason)

    def run(*flags):
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            done = subprocess.run(
                [program, *QUIET, f"--user-data-dir={profile}", *map(str, flags)],
                capture_output=True,
                text=True,
                timeout=SECONDS,
                check=True,
            )
        return done.stdout

    return run
