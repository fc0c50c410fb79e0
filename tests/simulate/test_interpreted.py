"""Without numba the same functions are interpreted."""

import subprocess
import sys
from pathlib import Path

import pytest

import flighttune as ft
from flighttune.campaign.flying.rows import fly_runs

AGREES = 1e-12
"""Relative; compiled code may contract and reorder sums."""

FLY = """
import sys
sys.modules["numba"] = None
from test_interpreted import flown
print(*flown())
"""


def flown():
    """Two numbers of each of two flights of the batch."""
    rows = fly_runs(ft.plan_campaign(ft.load_campaign("kinematic_sweep")), range(2))
    return [*rows["chi.ITAE"].to_pylist(), *rows["gamma.peak_rad"].to_pylist()]


@pytest.mark.slow
def test_the_batch_flies_the_same_without_numba():
    done = subprocess.run(
        [sys.executable, "-c", FLY], cwd=Path(__file__).parent, stdout=subprocess.PIPE, check=True
    )

    interpreted = [float(value) for value in done.stdout.split()]
    assert len(interpreted) == 4
    assert interpreted == pytest.approx(flown(), rel=AGREES)
