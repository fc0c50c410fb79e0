"""What the engine of campaigns costs: two workers against two plain processes that only fly.

Run it with ``python benchmarks/bench_campaign_scaling.py``; ``--json`` prints one object.

Plain processes, as many as there are workers, call `fly_runs` at the same time, each for its share
of `RUNS` flights of 20 s of the Aerosonde on JSBSim, the airframe dispersed.
``flighttune campaign`` then flies the same into a folder by local workers. Both share memory
and caches in the same way, so that the ratio is that of the engine alone: the time of the slowest
plain process over that of the campaign. It is shown with the start and end of the workers, and from
the first row on.

Other work on the machine makes that worse, so processor time is shown too: of the flights in the
plain processes over that of all processes of the campaign, and how it is divided among these. Exits
with 1 where the ratio by the clock, start of the workers included, is below `LOWEST`.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as pq
import running

from flighttune.campaigns.engine.flyer import THREADS

RUNS, LOWEST = 24 if running.QUICK else 2000, 0.9
LOOK_S = 0.02 if running.QUICK else 0.5
CAMPAIGN = """
title = "Scaling"
scenario = "paper"
seed = 1
runs = {runs}
gains = ["paper"]
[[plant]]
kind = "jsbsim"
aircraft = "aerosonde"
[keep]
failures = 0
worst = 0
sample = 0
"""
DISPERSED = """
[[disperse]]
key = "{}"
distribution = "uniform"
lower = {}
upper = {}
"""
KEYS = (
    ("flight.V_a_mps", 24.0, 26.0),
    ("flight.gamma_deg", 30.0, 45.0),
    ("plant.airframe.mass_factor", 0.95, 1.05),
    ("plant.airframe.lift_factor", 0.95, 1.05),
)
PLAIN = """
import json, sys, time
from flighttune.campaigns.planning.source import load_campaign
from flighttune.campaigns.planning.plan import plan_campaign
from flighttune.campaigns.flying.rows import fly_runs, warm_up
plan = plan_campaign(load_campaign(sys.argv[1]))
warm_up(plan)
print("ready", flush=True)
sys.stdin.readline()
began, busy = time.perf_counter(), time.process_time()
fly_runs(plan, range(int(sys.argv[2]), int(sys.argv[3])))
print(json.dumps([time.perf_counter() - began, time.process_time() - busy]))
"""


def plain_processes(file: Path, runs: int, count: int) -> tuple[float, float]:
    """Time of all flights in warm processes that begin together: slowest clock, processor, s."""
    edges = [runs * i // count for i in range(count + 1)]
    environment = {**os.environ, **dict.fromkeys(THREADS, "1")}  # as the processes of the engine
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PLAIN, file, str(first), str(end)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        for first, end in pairwise(edges)
    ]
    for process in processes:
        assert process.stdout is not None
        if process.stdout.readline().strip() != "ready":
            raise SystemExit("a plain process did not come up")
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    times = [json.loads(process.communicate()[0]) for process in processes]
    return max(wall for wall, _ in times), sum(busy for _, busy in times)


def campaign(file: Path, out: Path, workers: int) -> dict[str, Any]:
    """What ``campaign`` says of itself, time from its first row on, and who took how much."""
    command = [sys.executable, "-m", "flighttune", "campaign", file, "--json",
               "--out", out, "--workers", str(workers)]  # fmt: skip
    began, first_row, busy = time.perf_counter(), None, {}
    process = psutil.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    while _flies_on(process):
        parts = list((out / "runs").glob("*.parquet"))
        if parts and first_row is None:
            first_row = time.perf_counter(), sum(pq.read_metadata(p).num_rows for p in parts)
        _note(process, busy)
    ended = time.perf_counter()
    said = json.loads(process.communicate()[0])
    if process.returncode or first_row is None or said["crashed"]:
        raise RuntimeError(f"not all flights could be flown: {said}")
    since, there = first_row
    shares: dict[str, float] = {}
    for who, used in busy.values():
        shares[who] = shares.get(who, 0.0) + used
    return {
        "command_s": ended - began,
        "wall_s": said["wall_s"],
        "from_first_row_s": (ended - since) * said["runs"] / (said["runs"] - there),
        "busy_s": shares,
        "files": len(list((out / "runs").iterdir())),
    }


def _flies_on(process: psutil.Popen) -> bool:
    """Wait for the end, but not longer than until it is time for another look."""
    try:
        process.wait(LOOK_S)
    except psutil.TimeoutExpired:
        return True
    return False


def _note(main: psutil.Process, busy: dict[int, tuple[str, float]]) -> None:
    """Note the processor time of every process of the campaign."""
    try:
        everyone = [main, *main.children(recursive=True)]
    except psutil.Error:
        return
    for process in everyone:
        try:
            line, used = " ".join(process.cmdline()), process.cpu_times()
        except psutil.Error:
            continue
        who = "main and scheduler" if process.pid == main.pid else "workers"
        who = "flights" if "campaign.engine.server" in line else who
        busy[process.pid] = who, used.user + used.system


def main() -> int:
    parser = running.options(__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scaling.toml"
        keys = "".join(DISPERSED.format(*key) for key in KEYS)
        file.write_text(CAMPAIGN.format(runs=asked.runs) + keys)
        wall, busy = plain_processes(file, asked.runs, asked.workers)
        flown = campaign(file, Path(folder) / "out", asked.workers)
    shares = {
        "with the start of the workers": wall / flown["wall_s"],
        "with the start of Python": wall / flown["command_s"],
        "from the first row on": wall / flown["from_first_row_s"],
        "by processor time": busy / sum(flown["busy_s"].values()),
    }
    kept = shares["with the start of the workers"] >= LOWEST
    if asked.json:
        result = {
            "runs": asked.runs, "workers": asked.workers, "plain_s": wall,
            "plain_busy_s": busy, **flown, "shares": shares, "lowest": LOWEST, "kept": kept,
        }  # fmt: skip
        print(json.dumps(result))
        return 0 if kept else 1
    print(
        f"{asked.runs} flights: {wall:.1f} s in {asked.workers} plain processes at once "
        f"({busy:.1f} s of processor), "
        f"{flown['wall_s']:.1f} s with {asked.workers} workers, {flown['files']} files"
    )
    for who, took in flown["busy_s"].items():
        print(f"  {who}: {took:.1f} s of processor")
    for name, share in shares.items():
        print(f"share of the plain processes {name}: {share:.3f}")
    print(f"at least {LOWEST} with the start of the workers: {'kept' if kept else 'not kept'}")
    return 0 if kept else 1


if __name__ == "__main__":
    running.end(main)
