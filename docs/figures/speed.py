"""Write docs/speed.md from what benchmarks print: python docs/figures/speed.py FOLDER.

FOLDER keeps the output of each benchmark in a file; those that are there are not run again. All
of them take twenty minutes on two cores that do nothing else.
"""

import json
import platform
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import flighttune

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "speed.md"

LOOPS = {
    "still air": "closed loop, {signals} signals at 50 Hz, still air",
    "gust and turbulence": "closed loop with gust and turbulence",
    "all weather": ("closed loop with gust, turbulence, and changing wind"),
    "route, all in": "300 s of the route `circuit`: load, trim, fly, table and metrics",
}
ROWS = {
    "still air": "a campaign row: build, load, trim, fly 20 s, measure",
    "airframe dispersed": "such a row with the airframe dispersed",
}
PEERS = {
    "SciPy loop": "SciPy's Lyapunov solver",
    "cvxpy + Clarabel, a problem a loop": "the paper's program by cvxpy and Clarabel",
}

ENVIRONMENTS = {
    "aircraft alone": "the aircraft alone, started once",
    "jsbgym": "jsbgym (60 Hz, no inner loop)",
    "gymnasium_jsbsim": "gymnasium-jsbsim, likewise",
}


def printed(name: str, folder: Path) -> str:
    """What a benchmark prints, from `folder` or by running it."""
    file = folder / f"{name}.json"
    if not file.exists():
        bench = ROOT / "benchmarks" / f"bench_{name}.py"
        ran = subprocess.run(
            [sys.executable, bench, "--json"], capture_output=True, text=True, check=False
        )
        file.write_text(ran.stdout)
    return file.read_text()


def figures(name: str, folder: Path) -> dict[str, Any]:
    """The object that a benchmark prints."""
    return json.loads(printed(name, folder))


def table(rows: list[tuple[str, ...]]) -> str:
    """Rows of a table, joined."""
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def times(ratio: float, bar: float) -> str:
    """A ratio of times, and whether it misses its bar."""
    return f"{ratio:.2f} times{', missed' if ratio > bar else ''}"


def ratios(folder: Path) -> list[tuple[str, ...]]:
    """Every ratio against a peer, with its bar."""
    loop, campaign = figures("jsbsim", folder), figures("campaign", folder)
    theory, recording = figures("theory", folder), figures("recording", folder)
    gym = figures("gym", folder)
    busy = re.search(r"(\d+) times the processor time; at least (\d+)", printed("batch", folder))
    assert busy is not None
    rows = [
        (
            what.format(signals=loop["signals"]),
            "bare steps",
            times(loop["ratios"][name], loop["highest_ratio"][name]),
            f"{loop['highest_ratio'][name]:g}",
        )
        for name, what in LOOPS.items()
    ]
    rows += [
        (
            what,
            "bare steps",
            times(campaign["ratios"][name], campaign["highest_ratio"][name]),
            f"{campaign['highest_ratio'][name]}",
        )
        for name, what in ROWS.items()
    ]
    name = "kinematic, 100 Hz"
    rows += [
        (
            "a row of kinematic draws, 100 Hz",
            "its flight, compiled",
            times(campaign["ratios"][name], campaign["highest_ratio"][name]),
            f"{campaign['highest_ratio'][name]:g}",
        )
    ]
    rows += [
        (
            "R_K and I_K of many gain sets ([4 states](cost.svg))",
            peer,
            f"{theory['peers'][name]['ratio']:.0f} times as fast",
            "",
        )
        for name, peer in PEERS.items()
    ]
    rows += [
        (
            "batched kinematic flights",
            "python-control, by processor time",
            f"{busy[1]} times as fast",
            busy[2],
        ),
        (
            "a recording written by columns",
            "logged step by step",
            f"{recording['steps_over_columns']:.2g} times as fast",
            "",
        ),
    ]
    rows += [
        (
            "`FlightEnv`, the Cessna at 10 actions/s",
            ENVIRONMENTS[name],
            f"{ratio:.2f} times the steps a second",
            f"{gym['targets'][name]:g}",
        )
        for name, ratio in gym["ratios"].items()
    ]
    return rows


def main() -> None:
    """Write the page."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    campaign, jsbsim = figures("campaign", folder), figures("jsbsim", folder)
    tuning, theory = figures("tuning", folder), figures("theory", folder)
    scaling = figures("campaign_scaling", folder)
    flights = campaign["kinematic_flights"]
    kinematic = [
        (
            rate,
            f"{1e5 / flights * busy:.0f} s",
            f"{campaign['most_s_of_100000']:g} s" if rate == "50 Hz" else "",
        )
        for rate, busy in campaign["kinematic_processor_s_over_cores"].items()
    ]
    seconds = dict(tuning["seconds"])
    margins = seconds.pop("margins")
    named = re.search(r"^model name\s*: (.*)", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    text = TEXT.format(
        version=flighttune.__version__,
        python=platform.python_version(),
        processor=named[1] if named else platform.machine(),
        ratios=table(ratios(folder)),
        bare=f"{jsbsim['bare_us_a_step']:.1f}",
        kinematic=table(kinematic),
        flights=flights,
        tuned=f"{min(seconds.values()):.2g} to {max(seconds.values()):.2g}",
        margins=f"{margins:.2g}",
        workers=f"{1.0 / scaling['shares']['by processor time']:.2f}",
        million=f"{theory['million_s']:.1f}",
    )
    PAGE.write_text(text, encoding="utf-8")


TEXT = """\
# Speed

How long do flights, campaigns and commands take, and against what? `make bench` measures each
ratio against a named peer in the same run, and ends with exit status 1 if one misses.
The figures are of
flighttune {version} with Python {python} on two cores of {processor}. Bare steps are
`fdm.run()` of the same aircraft and time. The default law is compiled in a process that flies more
than five minutes; bars are set for a slower interpreter.

| what | against | measured | bar |
|---|---|--:|--:|
{ratios}

A step of JSBSim takes {bare} µs here.
One million gain sets take {million} s of one core.

Tuning, the diagnosis of the printed limits and a frontier of 25 points take {tuned} s each, margins
{margins} s (`python benchmarks/bench_tuning.py`).

A command may take three times as long as the import of its libraries, plus its own work; `campaign
first_campaign` three times as long as `fly paper` (`python benchmarks/bench_commands.py`).

## Campaigns

100,000 kinematic flights of 20 s by `campaign`, all in, by processor time over the cores
({flights} flown and scaled):

| rate of the controller | measured | bar |
|---|--:|--:|
{kinematic}

Two workers take {workers} times the processor time of two plain processes for the same rows
(`python benchmarks/bench_campaign_scaling.py`).
"""


if __name__ == "__main__":
    main()
