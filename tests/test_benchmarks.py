"""Every benchmark runs; a crash is no missed target."""

import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


SHORT = "bench_feasible", "bench_gym", "bench_logs"
"""Benchmarks that take less than ten seconds so; a night tries the others."""


@pytest.mark.counts
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(file.stem, marks=[pytest.mark.counts] * (file.stem not in SHORT))
        for file in sorted(FOLDER.glob("bench_*.py"))
    ],
)
def test_a_benchmark_runs_in_its_quick_mode(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = [sys.executable, FOLDER / f"{name}.py", "--quick"]
    ran = subprocess.run(command, capture_output=True, text=True)

    assert (ran.returncode, ran.stdout != "") == (0, True), ran.stderr
