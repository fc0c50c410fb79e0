"""How long commands take from key to answer, as ratios to ``flighttune --help`` in the same run.

A small campaign is compared to ``fly paper``: both start, tune and fly, it forty flights.

Run it with ``python benchmarks/bench_commands.py``; ``--json`` prints one object. Every command is
a process of its own. They take turns, so that other work on the machine slows all of them, and the
fastest of each counts. Exits with 1 where a ratio is above its bar.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time

REPEATS = 7
HELP = "--help"
FLY, CAMPAIGN = "fly paper", "campaign run first_campaign"
HIGHEST_RATIO = {
    "list": 2.0,
    "tune paper": 6.0,
    "certify paper": 6.0,
    "report of four runs": 12.0,
    "trim c172p": 25.0,
    "gap paper": 20.0,
}
HIGHEST_CAMPAIGN = 1.3
"""Of the time of `CAMPAIGN` over that of `FLY`."""


def seconds(arguments: list[str]) -> float:
    """Return the time of one command, s."""
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "flighttune", *arguments], check=True, capture_output=True
    )
    return time.perf_counter() - began


def fastest(folder: str) -> dict[str, float]:
    """Return the shortest time of each command, s; the report is one of ``fly paper``."""
    runs = f"{folder}/runs"
    seconds(["fly", "paper", "--out", runs])
    commands = {
        HELP: ["--help"],
        "list": ["list"],
        "tune paper": ["tune", "paper"],
        "certify paper": ["certify", "paper"],
        "report of four runs": ["report", runs, "--out", f"{folder}/report.html"],
        "trim c172p": ["trim", "c172p"],
        "gap paper": ["gap", "paper", "--out", f"{folder}/gap"],
    }
    times = []
    for turn in range(REPEATS):
        commands[FLY] = ["fly", "paper", "--out", f"{folder}/{turn}"]
        commands[CAMPAIGN] = [*CAMPAIGN.split(), "--out", f"{folder}/campaign-{turn}"]
        times.append({name: seconds(command) for name, command in commands.items()})
    return {name: min(once[name] for once in times) for name in commands}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one object")
    as_json = parser.parse_args().json

    with tempfile.TemporaryDirectory() as folder:
        took = fastest(folder)
    rows = {
        name: {"s": took[name], "ratio": took[name] / took[HELP], "highest": highest}
        for name, highest in HIGHEST_RATIO.items()
    }
    ratio = took[CAMPAIGN] / took[FLY]
    rows[CAMPAIGN] = {"s": took[CAMPAIGN], "ratio": ratio, "highest": HIGHEST_CAMPAIGN}
    if as_json:
        print(json.dumps({"help_s": took[HELP], "commands": rows}))
    else:
        print(f"flighttune --help: {took[HELP]:.3f} s")
        for name, row in rows.items():
            kept = "met" if row["ratio"] <= row["highest"] else "MISSED"
            print(
                f"{name:27} {row['s']:6.2f} s, {row['ratio']:5.1f} times "
                f"(at most {row['highest']:g}: {kept})"
            )
    return int(any(row["ratio"] > row["highest"] for row in rows.values()))


if __name__ == "__main__":
    sys.exit(main())
