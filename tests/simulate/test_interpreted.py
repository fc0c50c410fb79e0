"""Without numba the same functions are interpreted."""

import subprocess
import sys

import pytest

AGREES = 1e-12
"""Relative; compiled code may contract and reorder sums."""

FLY = """
import sys
if sys.argv[1:]:
    sys.modules["numba"] = None
from flighttune.campaign.planning.load import load_campaign
from flighttune.campaign.planning.plan import plan_campaign
from flighttune.campaign.flying.rows import fly_runs
rows = fly_runs(plan_campaign(load_campaign("kinematic_sweep")), range(2))
print(*rows.column("chi.ITAE").to_pylist(), *rows.column("gamma.peak_rad").to_pylist())
"""


def flown(*without):
    done = subprocess.run(
        [sys.executable, "-c", FLY, *without], capture_output=True, text=True, check=True
    )
    return [float(value) for value in done.stdout.split()]


@pytest.mark.slow
def test_the_batch_flies_the_same_without_numba():
    compiled, interpreted = flown(), flown("numba")

    assert len(compiled) == 4
    assert interpreted == pytest.approx(compiled, rel=AGREES)
