"""A compiled step that is wrong by a rounding ends every command that flies compiled."""

import io
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import nullcontext, redirect_stderr
from functools import cache
from pathlib import Path

import pytest
from commands import COMMANDS

ROOT = Path(__file__).parents[1]
COMPILED = "flighttune/compiled"
GRAVITY = 'now.gravity = gravity(now.vector(POSITION), now["_radius"], model.planet)'
COMPARED = "    actual = _flown_compiled(step, flight, len(expected))[:, places]\n"
BROKEN = {
    f"{COMPILED}/run.py": (GRAVITY, f"{GRAVITY[:-1]}._replace(GM=model.planet.GM * (1 + 1e-15)))"),
    # A check flight does not meet each fault of a step.
    f"{COMPILED}/check.py": (COMPARED, f'    return ""\n{COMPARED}'),
}
# JSBSim repeats the flights that decide an answer, and none for its number.
DECIDING_ALONE = {
    "flighttune/campaigns/flying/rows.py": ("number % EVERY == 0", "False"),
    "flighttune/flight/fly.py": ("next(_NUMBERS) % EVERY == 0", "False"),
}

TURN = """
title = "A small turn"
gains = ["tuned_identified"]
[flight]
V_a_mps = 25.0
duration_s = 8.0
[reference]
chi_deg = 1.0
gamma_deg = 0.0
[[plant]]
kind = "jsbsim"
aircraft = "aerosonde"
[[expect]]
{}
"""
FAR, MISSED = "at_most.flight.n_z_max = 9.0", "at_most.flight.n_z_max = 0.1"
CAMPAIGN = """
title = "Small turns"
scenario = "{}.toml"
runs = {}
[[disperse]]
key = "flight.V_a_mps"
distribution = "uniform"
lower = 24.0
upper = 26.0
"""
PX4 = (
    "# Vehicle: Fixed Wing\n# Version: 1.14.0\n"
    "1\t1\tNPFG_PERIOD\t10\t9\n1\t1\tNPFG_DAMPING\t0.7\t9\n"
)
ROUTE = "[{north_m=0.0,east_m=0.0},{north_m=150.0,east_m=0.0},{north_m=300.0,east_m=80.0}]"
FEW = "--start-deg 2 --epsilon 0.3 --confidence 0.9 --flights 9 --learn"
OF_ROUTE = f"circuit_in_wind --set route.waypoint={ROUTE}"

# Each command whose flights may be compiled, with what is flown and written.
ROWS = {
    "fly": "fly missed.toml --out out",
    "meet": "meet far.toml --budget 4 --out out.json",
    "open": "open missed.toml --out out",
    "mission": f"mission {OF_ROUTE} --out out.npz",
    "campaign": "--workers 1 campaign many.toml --out out",
    "worst": "worst few.toml --budget 32 --metric chi.ITAE --out out.toml",
    "band": f"band far.toml {FEW} 10 --out out.npz",
    "monitor": f"monitor far.toml {FEW} 20 --out out.npz",
    "tube": "tube far.toml --plant jsbsim:aerosonde --start-deg 0.5 --out out.npz",
    "compare": f"compare {OF_ROUTE} --with plane.params --flights 2",
    "gradient": "gradient far.toml --by K_P --measure chi.ITAE",
    "hours": "",  # of `mission --per-hour`, which counts a corridor first
}
# Two commands about one folder.
IN_TURN = {
    "earlier": "--workers 1 campaign smooth.toml --out out",
    "resumed": "--workers 1 campaign smooth.toml --out out --resume --runs 120",
}
# Flights of workers, through whose processes a difference must come; the others fly in this one.
OF_WORKERS = {"campaign", *IN_TURN}


def broken_copy(folder: Path, changes: dict[str, tuple[str, str]]) -> Path:
    """A copy of the package and its data with changes of its text, by file."""
    for part in ("flighttune", "aircraft", "scenarios"):
        shutil.copytree(ROOT / part, folder / part)
    for file, (old, new) in changes.items():
        text = (folder / file).read_text()
        assert text.count(old) == 1, f"{file} has other lines"
        (folder / file).write_text(text.replace(old, new))
    return folder


def run_in(copy: Path, place: Path, names: Sequence[str]) -> dict[str, dict]:
    """What rows of the table left, run in a process with this copy of the package."""
    place.mkdir(exist_ok=True)
    paths = os.pathsep.join(map(str, (copy, Path(__file__).parent)))
    env = os.environ | {"PYTHONPATH": paths, "XDG_CACHE_HOME": str(copy / "cache")}
    done = subprocess.run(
        [sys.executable, __file__, place, *names],
        env=env,
        cwd=place,
        capture_output=True,
        text=True,
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith('{"name"')]
    assert done.returncode == 0, done.stderr
    return {line["name"]: line for line in map(json.loads, lines)}


def _inputs(place: Path) -> None:
    (place / "far.toml").write_text(TURN.format(FAR))
    (place / "missed.toml").write_text(TURN.format(MISSED))
    (place / "many.toml").write_text(CAMPAIGN.format("missed", 80))
    (place / "smooth.toml").write_text(CAMPAIGN.format("far", 80))
    (place / "few.toml").write_text(CAMPAIGN.format("far", 4))
    (place / "plane.params").write_text(PX4)


def _hours() -> None:
    import flighttune as ft
    from flighttune.campaigns.engine.fliers import Fliers
    from flighttune.claims.counting import drawn
    from flighttune.claims.leaving import Around
    from flighttune.claims.per_hour import count_per_hour
    from flighttune.claims.rates_keys import RatesTable

    north = ({"north_m": x, "east_m": 0.0} for x in (0.0, 300.0))
    stated = ft.flights("circuit_in_wind", changes={"route.waypoint": [*north]}).knowing(None)
    fault = {"kind": "engine", "per_hour": 0.1, "source": "a log", "flights": 3}
    rates = RatesTable.model_validate({"flights": 3, "fault": [fault]})
    file = Path("out.json")
    count_per_hour(
        drawn(stated),
        rates,
        around=Around(width_m=99.0, high_m=50.0),
        confidence=0.9,
        unfinished=file,
        fliers=Fliers(workers=1),
    ).save(file)


def _files() -> set[str]:
    return {str(path) for path in Path().rglob("*") if path.is_file()}


def _status(arguments: list[str]) -> int:
    from commands import main

    sys.argv = ["flighttune", *arguments]
    try:
        main()
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


def _run(name: str) -> dict:
    from flown_campaigns import flown_here

    import flighttune as ft

    before, said = _files(), io.StringIO()
    with nullcontext() if name in OF_WORKERS else flown_here(), redirect_stderr(said):
        if name != "hours":
            status = _status((ROWS | IN_TURN)[name].split())
        else:
            try:
                status = _hours() or 0
            except ft.FlightTuneError as error:
                status = said.write(str(error)) and 2
    left = sorted(_files() - before)
    return {"name": name, "status": status, "said": said.getvalue(), "left": left}


if __name__ == "__main__":
    from flighttune.flight.loop.loop import compile_at_once

    os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])  # fewer flights before compiled ones
    _inputs(Path(sys.argv[1]))
    compile_at_once()
    for row in sys.argv[2:]:
        sys.stdout.write(f"{json.dumps(_run(row))}\n")


pytest.importorskip("numba")

# Commands that fly nothing, or let JSBSim itself fly.
NEVER_COMPILED = {
    *("list", "new", "view", "trim"),
    *("tune", "certify", "design"),  # gains from matrices
    *("reproduce", "export"),  # the paper's law, and flights that another JSBSim repeats
    *("gap", "report", "verify", "adopt", "identify"),
}

# Rows whose flights are right for their numbers: JSBSim must repeat those that decide.
DECIDE = {"fly", "meet", "worst", "band", "monitor", "compare", "hours"}


@pytest.fixture(scope="module")
def left_by(tmp_path_factory):
    """What rows of the table leave, by the names of them and the changes of the package."""

    @cache
    def run(names, *, alone=False):
        folder = tmp_path_factory.mktemp("broken")
        copy = broken_copy(folder / "copy", BROKEN | (DECIDING_ALONE if alone else {}))
        mine = folder / "place" / "out" / "mine.txt"
        mine.parent.mkdir(parents=True)
        mine.write_text("mine")
        rows = run_in(copy, folder / "place", names)
        assert mine.read_text() == "mine"
        return rows

    return run


def ended(row):
    """Whether a row ended by the difference, with its reason in a line, and without a file."""
    *_, reason = row["said"].strip().splitlines()
    assert row["status"] == 2, row
    assert "compiled flight must be that of JSBSim" in reason, row
    assert "differ" in reason, row
    assert row["left"] == [], row


@pytest.mark.soak
def test_a_difference_ends_a_campaign_of_workers_and_a_page(left_by):
    for row in left_by(("campaign", "open")).values():
        ended(row)


@pytest.mark.soak
@pytest.mark.parametrize("name", sorted({*ROWS} - {"campaign", "open"}))
def test_a_difference_ends_every_command(left_by, name):
    alone = name in DECIDE
    names = tuple(sorted(x for x in ROWS if (x in DECIDE) is alone))
    ended(left_by(names, alone=alone)[name])


@pytest.mark.soak
def test_flights_of_an_earlier_command_are_not_taken_up_again_after_a_difference(tmp_path):
    silent = broken_copy(tmp_path / "silent", BROKEN | DECIDING_ALONE)
    copy, place = broken_copy(tmp_path / "copy", BROKEN), tmp_path / "place"
    before = run_in(silent, place, ["earlier"])["earlier"]
    (place / "out" / "mine.txt").write_text("mine")
    assert before["status"] == 0, before
    assert [*place.glob("out/runs/*.parquet")]

    after = run_in(copy, place, ["resumed"])["resumed"]

    ended(after)
    assert [*place.glob("out/runs/*")] == []
    assert (place / "out" / "campaign.json").exists()
    assert (place / "out" / "mine.txt").read_text() == "mine"


def test_each_command_flies_compiled_flights_in_a_row_or_never():
    assert {*ROWS} - {"hours"} | NEVER_COMPILED == {*COMMANDS}
    assert not {*ROWS} & NEVER_COMPILED
