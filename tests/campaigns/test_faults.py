"""Faults that are made, not played: afterwards every run is there once, with the same bits."""

import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import psutil
import pytest
from commands import answer
from dispersed import one_of
from flown_campaigns import (
    CIRCULAR,
    DOUBLING,
    SPEED,
    Notes,
    aircraft_with,
    bits,
    children,
    dask_cluster,
    dask_worker,
    flyers,
    flying,
    gone,
    last_line,
    plan,
    some_parts,
    wait_until,
    write_campaign,
)
from fuzzing import first_or_all

import flighttune as ft

# real clusters, processes that are killed
pytestmark = pytest.mark.slow

RUNS, WORKERS = 80, 2


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return write_campaign(tmp_path_factory.mktemp("files"), runs=RUNS)


@pytest.fixture(scope="module")
def ours(file):
    return ft.plan_campaign(ft.load_campaign(file))


@pytest.fixture(scope="module")
def undisturbed(ours, tmp_path_factory):
    """Rows as one process flies them."""
    return alone(ours, tmp_path_factory.mktemp("alone"))


def alone(plan, folder):
    ft.run_campaign(plan, folder / "alone", workers=1)
    return bits(rows_of(folder / "alone"))


def rows_of(out):
    return ft.load(out).rows()


@pytest.mark.counts
@pytest.mark.parametrize(
    ("functions", "limit", "status", "reason"),
    [
        pytest.param(
            *(CIRCULAR, 60.0, "crashed", "the flight ended the process that flew it: SIGSEGV"),
            marks=pytest.mark.counts,
        ),
        (DOUBLING, 2.0, "timed_out", "the flight must end within 2 s of wall time"),
    ],
    ids=["overflows JSBSim's stack", "stays in JSBSim for ever"],
)
def test_a_run_that_ends_its_process_is_one_row(
    tmp_path, address, functions, limit, status, reason
):
    mass = "plant.airframe.mass_factor"
    aircraft = aircraft_with(tmp_path / "aircraft", functions)
    ours = plan(
        tmp_path, runs=11, law=False, aircraft=(aircraft,),
        top=f"time_limit_s = {limit}\ngains = ['paper']",
        disperse=[SPEED, one_of(mass, 1.0, 1.05) | {"weights": [0.9, 0.1]}],
    )  # fmt: skip
    (poison,) = (run for run in range(11) if ours.parameters()[mass][ours.draw_of(run)] > 1.0)

    done = ft.run_campaign(ours, tmp_path / "out", scheduler=address)

    rows = rows_of(tmp_path / "out")
    assert rows.column("run").to_pylist() == list(range(11))
    crashed = rows.take([poison]).to_pylist()[0]
    assert (crashed["status"], crashed["success"]) == (status, False)
    assert reason in crashed["reason"]
    if poison:
        assert bits(rows.slice(0, poison)) == alone(ours.with_runs(poison), tmp_path)
    assert done.statuses == {"completed": 10, status: 1}
    assert (done.crashed, done.failed) == ((1, 0) if status == "crashed" else (0, 1))


@pytest.mark.soak
def test_a_campaign_that_is_stopped_goes_on_and_a_process_killed_in_mid_chunk_costs_nothing(
    tmp_path, ours, undisturbed
):
    out, killed = tmp_path / "out", []

    def kill_one(progress):
        if progress.done > first.runs and not killed:
            killed.append(flyers(psutil.Process())[0])
            killed[0].kill()
        return False

    stops = Notes(lambda progress: progress.done > 0)
    first = ft.run_campaign(ours, out, workers=1, observer=stops)

    there = rows_of(out).column("run").to_pylist()
    assert first.interrupted
    assert 0 < first.runs == len({*there}) == len(there) < RUNS
    assert len(children()) <= 1  # kept for the next campaign

    second = ft.run_campaign(ours, out, workers=2, resume=True, observer=Notes(kill_one))

    assert gone(killed)
    assert (second.flown, second.crashed) == (RUNS - first.runs, 0)
    assert bits(rows_of(out)) == undisturbed


@pytest.mark.counts
def test_the_scheduler_gone_is_one_line_and_the_rest_is_flown_here(
    tmp_path, file, ours, undisturbed
):
    out = tmp_path / "out"
    with (
        dask_cluster(tmp_path) as (scheduler_address, scheduler),
        flying(file, "--out", out, "--scheduler", scheduler_address) as command,
    ):
        some_parts(out)
        scheduler.kill()
        assert command.wait(timeout=240) == 2
        assert last_line(command) == (
            f"flighttune: {scheduler_address}: the connection to the scheduler is lost; what has "
            "been flown is kept, go on with the same command and --resume"
        )
    assert 0 < len(rows_of(out)) < RUNS

    ft.run_campaign(ours, out, workers=2, resume=True)

    assert bits(rows_of(out)) == undisturbed


@pytest.mark.soak
def test_a_cluster_without_a_worker_is_told_and_the_flights_go_on_when_one_comes(tmp_path, ours):
    noted = Notes()
    with dask_cluster(tmp_path, workers=0) as (address, _), ThreadPoolExecutor(1) as thread:
        running = thread.submit(
            ft.run_campaign,
            ours.with_runs(8),
            tmp_path / "out",
            scheduler=address,
            observer=noted,
            resume=False,
        )
        (said,) = wait_until(lambda: [*noted.heard])
        assert f"{address}: no worker is there" in said
        wait_until(lambda: noted.seen[-1].workers == 0)
        assert noted.seen[-1].sentence.endswith("no worker is there")
        with dask_worker(tmp_path):
            running.result(240.0)
    assert len(rows_of(tmp_path / "out")) == 8
    assert len(noted.heard) == 2
    assert "a worker is there" in noted.heard[1]


@pytest.mark.counts
def test_the_main_process_killed_leaves_no_worker_and_whole_files(
    tmp_path, file, ours, undisturbed, address
):
    out, scratch = tmp_path / "out", tmp_path / "scratch"
    scratch.mkdir()
    environment = {**os.environ, "TMPDIR": str(scratch)}
    with flying(file, "--out", out, "--workers", "2", env=environment) as command:
        some_parts(out)
        command.suspend()  # so that it cannot have flown everything before it is killed
        below = children(command)
        assert len(list(scratch.iterdir())) == len(below) == 2
        command.kill()
        wait_until(lambda: gone(below))
    assert not list(scratch.iterdir())
    assert 0 < len(rows_of(out)) < RUNS

    ft.run_campaign(ours, out, scheduler=address, resume=True)

    assert bits(rows_of(out)) == undisturbed
    assert not (out / ".writing").exists()


@pytest.mark.soak
@pytest.mark.parametrize(
    ("functions", "said"),
    [
        (CIRCULAR, "SIGSEGV"),
        pytest.param(DOUBLING, "longer than `time_limit_s`", marks=pytest.mark.counts),
    ],
)
def test_an_aircraft_whose_undispersed_flight_does_not_end_is_one_line(tmp_path, functions, said):
    aircraft = aircraft_with(tmp_path / "aircraft", functions.replace("24.9", "0.1"))
    ours = plan(tmp_path, runs=4, law=False, aircraft=(aircraft,), top="time_limit_s = 1.0")
    began = time.monotonic()

    with pytest.raises(ft.FlightTuneError, match=f"undispersed flights .*{said}"):
        ft.run_campaign(ours, tmp_path / "out", workers=1)
    assert time.monotonic() - began < 120.0  # 11 s and two starts of a process; was twice 120 s


@pytest.mark.counts
@pytest.mark.parametrize(
    "end", [psutil.Process.kill, psutil.Process.suspend], ids=["dies", "hangs"]
)
def test_a_worker_of_a_cluster_that_is_lost_costs_no_run(
    tmp_path, ours, undisturbed, monkeypatch, end
):
    # The scheduler, and not the campaign, decides after how long without a sign a worker is lost.
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL", "5s")
    lost = []

    def lose(progress):
        if progress.done and not lost:
            started = psutil.Process().children()
            lost.extend(p for p in started if {"dask", "worker"} <= {*p.cmdline()})
            for process in (*children(lost[0]), lost[0]):
                end(process)
        return False

    with dask_cluster(tmp_path, workers=2) as (scheduler_address, _):
        done = ft.run_campaign(
            ours, tmp_path / "out", scheduler=scheduler_address, observer=Notes(lose)
        )

    assert len(lost) == 2
    assert done.crashed == 0
    assert bits(rows_of(tmp_path / "out")) == undisturbed


@pytest.mark.soak
def test_an_aircraft_that_is_another_one_now_is_one_line(tmp_path):
    aircraft = aircraft_with(tmp_path / "aircraft", "")
    ours = plan(tmp_path, runs=4, law=False, aircraft=(aircraft,))
    file = tmp_path / "aircraft" / "aerosonde.xml"
    file.write_text(file.read_text().replace("-38.21", "-38.22"))

    with pytest.raises(ft.FlightTuneError, match=r"files of aircraft .*planned"):
        ft.run_campaign(ours, tmp_path / "out", workers=1)


# Flights of 14 s on the lags of an aircraft, in any wind.
LAGS = """
title = "bend"
gains = ["paper"]
flight = { V_a_mps = 25.0, duration_s = 14.0, h_m = 500.0 }
controller = { rate_hz = 10.0, feed_forward = true }
plant = [{ kind = "point_mass_lag", identified = "aerosonde" }]
[limits]
phi_deg = [-42.0, 47.0]
phi_rate_dps = 55.0
n_z = [-1.8, 2.1]
n_z_rate_per_s = 2.0
[[route.waypoint]]
north_m = 0.0
east_m = 0.0
[[route.waypoint]]
north_m = 100.0
east_m = 0.0
[[route.waypoint]]
north_m = 200.0
east_m = 80.0
"""
DRAWN = """
title = "drawn"
scenario = "bend"
runs = 12
[[disperse]]
key = "wind.speed_mps"
distribution = "uniform"
lower = 0.0
upper = 3.0
[[disperse]]
key = "wind.from_deg"
distribution = "uniform"
lower = 0.0
upper = 359.0
[keep]
failures = 0
worst = 0
sample = 0
"""
STEP = """
title = "step"
gains = ["paper"]
flight = { V_a_mps = 25.0, chi_deg = 20.0, duration_s = 8.0 }
reference = { chi_deg = 0.0, gamma_deg = 0.0 }
controller = { feed_forward = true }
plant = [{ kind = "point_mass_lag", identified = "aerosonde" }]
expect = [{ at_most.chi.MO_deg = 0.5 }, { at_most.chi.settling_s = 1.0 }]
[limits]
phi_deg = [-45.0, 45.0]
phi_rate_dps = 60.0
n_z = [-1.0, 2.5]
n_z_rate_per_s = 2.0
"""
# Commands that keep what they have flown, what goes on with it, and where it is.
KEEPING = {
    "campaign": ("campaign drawn.toml --out out", "--resume", "out/runs/*"),
    "compare": ("compare drawn.toml --with plane.params --flights 8", "", "runs/*unfinished*"),
    "meet": ("meet step.toml --start paper --budget 30", "", "runs/*unfinished*"),
    "meet --with": ("meet drawn.toml --with plane.params --flights 2 --budget 118", "",
                    "runs/*unfinished*"),
}  # fmt: skip
OF_TIME = {"wall_s", "rate_per_s", "flown", "dataset", "compiled", "notes"}


@pytest.mark.soak
@pytest.mark.parametrize("number", first_or_all([signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
@pytest.mark.parametrize(
    "verb", [pytest.param(x, marks=[pytest.mark.counts] * x.startswith("meet")) for x in KEEPING]
)
def test_a_command_that_is_ended_goes_on_to_the_same_answer(tmp_path, verb, number):
    words, more, kept = KEEPING[verb]
    command = [*words.split(), "--workers", "1"]
    folders = [tmp_path / name for name in ("whole", "ended")]
    for folder in folders:
        folder.mkdir()
        for name, text in (("bend.toml", LAGS), ("drawn.toml", DRAWN), ("step.toml", STEP)):
            (folder / name).write_text(text)
        (folder / "plane.params").write_text("# Version: 1.14.0\n1\t1\tNPFG_PERIOD\t60\t9\n")
    with flying(command=command, cwd=folders[1]) as process:
        wait_until(lambda: [x for x in folders[1].glob(kept) if x.stat().st_size > 2000])
        process.send_signal(number)
        assert process.wait(timeout=240) != 0
    there = [x.stat().st_size for x in folders[1].glob(kept)]

    resumed = answer(*command, *more.split(), cwd=folders[1], status=None)

    whole = answer(*command, cwd=folders[0], status=None)
    assert there
    assert {k: x for k, x in resumed.items() if k not in OF_TIME} == {
        k: x for k, x in whole.items() if k not in OF_TIME
    }
    if verb == "campaign":
        assert resumed["flown"] < whole["flown"] == resumed["runs"]
        assert bits(rows_of(folders[1] / "out")) == bits(rows_of(folders[0] / "out"))
    else:
        assert not [*folders[1].glob(kept)]
