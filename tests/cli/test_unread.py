"""A command whose progress nobody reads any more does its work all the same."""

import subprocess
import sys

import pytest

from flighttune.campaign.dataset import open_dataset

pytestmark = pytest.mark.slow

FLIGHTS = 4


def test_a_campaign_goes_on_where_nobody_reads_its_progress(tmp_path):
    command = [sys.executable, "-m", "flighttune", "campaign", "run", "first_campaign"]
    options = ["--runs", str(FLIGHTS), "--workers", "1", "--out", str(tmp_path / "runs")]
    with subprocess.Popen(
        [*command, *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as running:
        running.stderr.close()

        assert running.wait(timeout=120.0) == 0

    assert sum(len(part.runs) for part in open_dataset(tmp_path / "runs").parts) == FLIGHTS
