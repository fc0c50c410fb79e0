"""Every benchmark runs; a crash is no missed target."""

import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


def run(file, *options):
    return subprocess.run([sys.executable, file, *options], capture_output=True, text=True)


SHORT = "bench_feasible", "bench_gym", "bench_logs"
"""Benchmarks that take less than ten seconds so; a night tries the others."""


@pytest.mark.soak
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(file.stem, marks=[pytest.mark.counts] * (file.stem not in SHORT))
        for file in sorted(FOLDER.glob("bench_*.py"))
    ],
)
def test_a_benchmark_runs_in_its_quick_mode(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = run(FOLDER / f"{name}.py", "--quick")

    assert (ran.returncode, ran.stdout != "") == (0, True), ran.stderr


@pytest.mark.parametrize(
    ("body", "options", "said", "status"),
    [
        ("return 1", [], "missed", 1),
        ("return 1", ["--quick"], "ran", 0),
        ("return [].x", ["--quick"], "crashed (3)", 1),
    ],
)
def test_a_crash_is_said_to_be_one(body, options, said, status, tmp_path):
    for name in ("all.py", "running.py"):
        (tmp_path / name).write_text((FOLDER / name).read_text())
    (tmp_path / "bench_x.py").write_text(
        f"import running\n\ndef main():\n    {body}\n\nrunning.end(main)\n"
    )

    ran = run(tmp_path / "all.py", *options)

    assert ran.stdout.splitlines()[-1].endswith(f"  {said}")
    assert ran.returncode == status
