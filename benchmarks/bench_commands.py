"""How long commands take from key to answer, against importing the libraries that they need.

A command may take three times as long as ``python -c "import ..."`` of its libraries, plus its own
work: what the same command takes when it is run again in the same process. A small campaign may
take three times as long as ``fly paper``: both start, tune and fly, it forty flights.

Run it with ``python benchmarks/bench_commands.py``; ``--json`` prints one object. Every command is
a process of its own. They take turns, so that other work on the machine slows all of them, and the
fastest of each counts. Exits with 1 where a bar is missed.
"""

import json
import subprocess
import sys
import tempfile
import time

import running

REPEATS = 1 if running.QUICK else 5
FEW = ["--runs", "8"] if running.QUICK else []
TIMES_IMPORTS = 3.0
CAMPAIGN_TO_FLY = 3.0

TUNING = "numpy, pydantic, typer, rich, scipy.optimize, scipy.linalg"
FLYING = f"{TUNING}, pandas, pyarrow.parquet, jsbsim"
RECORDING = f"{FLYING}, rerun"
LIBRARIES = {
    "--help": "typer, rich",
    "list": "typer, rich, pydantic.type_adapter",  # Typer reads values with it
    "tune paper": TUNING,
    "certify paper": f"{TUNING}, cvxpy",
    "trim c172p": FLYING,
    "fly paper": RECORDING,
    "gap paper": RECORDING,
    "report": f"{FLYING}, cvxpy, jinja2",
}
"""Libraries of each command."""

if running.QUICK:
    LIBRARIES = {name: LIBRARIES[name] for name in ("fly paper", "report")}

AGAIN = """
import contextlib, io, sys, time
from flighttune.cli import main
sys.argv = ["flighttune", *sys.argv[1:]]
for _ in range(2):
    began = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        main()
print(time.perf_counter() - began)
"""
"""Run a command twice in one process and print how long it took the second time."""


def seconds(*arguments: str) -> float:
    """Time of one Python process, s."""
    began = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    return time.perf_counter() - began


def own_work(arguments: list[str]) -> float:
    """Time of a command that is run again in the same process, s."""
    shown = subprocess.run(
        [sys.executable, "-c", AGAIN, *arguments], check=True, capture_output=True, text=True
    )
    return float(shown.stdout.splitlines()[-1])


def measured(folder: str) -> tuple[dict[str, dict[str, float]], float]:
    """Shortest times of each command, of its imports and of its own work, s; of the campaign."""
    runs = f"{folder}/runs"
    seconds("-m", "flighttune", "fly", "paper", "--out", runs)
    more = {
        "fly paper": ["--out", f"{folder}/fly"],
        "gap paper": ["--out", f"{folder}/gap"],
        "report": [runs, "--out", f"{folder}/report.html"],
    }
    commands = {name: [*name.split(), *more.get(name, [])] for name in LIBRARIES}
    campaign, times = [], {name: [] for name in LIBRARIES}
    for turn in range(REPEATS):
        for name, arguments in commands.items():
            command = seconds("-m", "flighttune", *arguments)
            imports = seconds("-c", f"import {LIBRARIES[name]}")
            times[name].append((command, imports, own_work(arguments)))
        out = f"{folder}/campaign-{turn}"
        run = "-m", "flighttune", "campaign", "first_campaign", "--out", out
        campaign.append(seconds(*run, *FEW))
    kinds = "command_s", "imports_s", "own_work_s"
    fastest: dict[str, dict[str, float]] = {
        name: dict(zip(kinds, map(min, zip(*rows, strict=True)), strict=True))
        for name, rows in times.items()
    }
    return fastest, min(campaign)


def main() -> int:
    parser = running.options(__doc__)
    as_json = parser.parse_args().json

    with tempfile.TemporaryDirectory() as folder:
        rows, campaign_s = measured(folder)
    for row in rows.values():
        row["most_s"] = TIMES_IMPORTS * row["imports_s"] + row["own_work_s"]
    most_s = CAMPAIGN_TO_FLY * rows["fly paper"]["command_s"]
    rows["campaign first_campaign"] = {"command_s": campaign_s, "most_s": most_s}
    if as_json:
        print(json.dumps({"commands": rows}))
    else:
        for name, row in rows.items():
            verdict = "met" if row["command_s"] <= row["most_s"] else "MISSED"
            print(f"{name:27} {row['command_s']:6.2f} s (at most {row['most_s']:5.2f}: {verdict})")
    return int(any(row["command_s"] > row["most_s"] for row in rows.values()))


if __name__ == "__main__":
    running.end(main)
