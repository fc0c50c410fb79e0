"""Small campaigns for tests: flights of a second or two, in wind, on law and aircraft."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from copy import deepcopy
from pathlib import Path
from unittest import mock

import psutil
from airframes import changed_aerosonde

import flighttune as ft
from flighttune.base.files.table import toml_text
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.compiled import compiled_in
from flighttune.campaigns.flying.rows import fly_runs, rows_flown

SCENARIO = """
title = "A short turn in wind"
gains = ["paper", { name = "soft", K_P = [[0.5, 0.0], [0.0, 0.5]], K_I = [[0.1, 0.0], [0.0, 0.1]] }]
[flight]
V_a_mps = 25.0
gamma_deg = 5.0
duration_s = %g
[reference]
chi_deg = 10.0
gamma_deg = 0.0
[controller]
feed_forward = true
%s
%s
"""
WIND = "[wind]\nspeed_mps = 3.0\nfrom_deg = 250.0\n[turbulence]\nseverity = 3\nwind_20ft_mps = 7.7"
LAW = '[[plant]]\nkind = "kinematic"\n'
AIRCRAFT = '[[plant]]\nkind = "jsbsim"\naircraft = "{}"\n'
SPEED = {"key": "flight.V_a_mps", "distribution": "normal", "mean": 25.0, "sd": 0.5}

# JSBSim looks up a function by name when it evaluates it. In the first two a value hangs on itself,
# in the other each of sixty is twice the one before: both only on an aircraft of more than 11.3 kg.
HEAVY = "<gt><property>inertia/weight-lbs</property><value>24.9</value></gt>"
CIRCULAR = f"""
<function name="aero/downwash"><ifthen>{HEAVY}
  <property>aero/ground-effect</property><value>0</value></ifthen></function>
<function name="aero/ground-effect"><product>
  <property>aero/downwash</property><value>0.5</value></product></function>
"""
TWICE = "<property>aero/scale-{0}</property>" * 2
DOUBLING = "".join(
    f'<function name="aero/scale-{i}"><ifthen>{HEAVY}<sum>{TWICE.format(i - 1)}</sum>'
    "<value>0</value></ifthen></function>"
    for i in range(60, 0, -1)
)
DOUBLING += '<function name="aero/scale-0"><property>aero/alpha-rad</property></function>'


def write_campaign(
    folder, *, runs=24, seed=3, duration=1.0, wind=WIND, law=True, aircraft=("aerosonde",),
    top="", disperse=(SPEED,), keep="failures = 2\nworst = 1\nsample = 1",
):  # fmt: skip
    """Write a scenario and a campaign into a folder; return the campaign's file."""
    plants = (LAW if law else "") + "".join(map(AIRCRAFT.format, aircraft))
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    scenario = SCENARIO % (duration, wind, plants)
    (folder / "short_turn_in_wind.toml").write_text(scenario)
    file = folder / "campaign.toml"
    file.write_text(
        f'title = "Small"\nscenario = "short_turn_in_wind"\nseed = {seed}\nruns = {runs}\n{top}\n'
        f"{toml_text({'disperse': disperse})}\n"
        f"[[success]]\nat_most.chi.peak_deg = 20.0\n[keep]\n{keep}\n"
    )
    return file


def plan(folder, **settings):
    """The plan of a campaign written into a folder."""
    return ft.plan_campaign(ft.load_campaign(write_campaign(folder, **settings)))


def table_flown(plan, runs=None):
    """Rows of these runs of a plan, of all by default, flown in this process."""
    return fly_runs(plan, range(plan.runs) if runs is None else runs)


class Notes(ft.CampaignObserver):
    """An observer that writes everything down, and stops a campaign when `until` says so."""

    def __init__(self, until=lambda progress: False):
        self.seen, self.heard, self.stopped, self._until = [], [], False, until

    def see(self, progress):
        self.seen.append(deepcopy(progress))
        self.stopped = self.stopped or self._until(progress)

    def hear(self, sentence):
        self.heard.append(sentence)


def aircraft_with(folder, functions):
    """A copy of the Aerosonde in a folder, with more aerodynamic functions; its path."""
    added = f"<aerodynamics>{functions}"
    made = changed_aerosonde(Path(folder), lambda text: text.replace("<aerodynamics>", added))
    return str(made)


def bits(rows):
    """Rows as values that are equal only where every bit is; without the time flights took."""
    columns = rows.drop_columns(["wall_s"]).to_pydict()
    return [
        tuple(value.hex() if isinstance(value, float) else value for value in row)
        for row in zip(*columns.values(), strict=True)
    ]


def children(process=None):
    """All processes below one, this one by default; without dask's own and Python's cleaner."""
    found = []
    with suppress(psutil.NoSuchProcess):  # ended while it was asked
        for one in (process or psutil.Process()).children():
            line = " ".join(_command_line(one))
            if line and "-m dask" not in line and "resource_tracker" not in line:
                found += [one, *children(one)]
    return found


def _command_line(process):
    """A process's command line; empty of one that has ended."""
    try:
        return process.cmdline()
    except psutil.NoSuchProcess:
        return []


def wait_until(condition, seconds=240.0):
    """Wait until something holds, on a busy machine for minutes; return what it is."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "it never came to be"
        time.sleep(0.005)
    return found


def flyers(process):
    """The processes that fly below one."""
    server = "flighttune.campaigns.engine.server"
    return [p for p in children(process) if server in _command_line(p)]


def gone(processes):
    """Whether none of these processes is there any more."""
    return not any(_alive(process) for process in processes)


def _alive(process):
    """Whether a process runs; it may end while it is asked, which psutil raises."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@contextmanager
def dask_cluster(folder, workers=1, threads=1, path=None):
    """A real scheduler and workers, processes of their own: the address and the scheduler.

    Packages in the folder `path` are found by both before all others.
    """
    where = Path(folder) / "scheduler.json"
    with (
        dask_process(folder, path, "scheduler", "--port", "0") as scheduler,
        ExitStack() as started,
    ):
        wait_until(lambda: where.exists() and where.stat().st_size)
        for _ in range(workers):
            started.enter_context(dask_worker(folder, threads, path))
        yield json.loads(where.read_text())["address"], scheduler


def dask_worker(folder, threads=1, path=None):
    """A real worker of the scheduler of a folder, a process of its own for the block."""
    options = "--nthreads", str(threads), "--local-directory", folder
    return dask_process(folder, path, "worker", *options)


@contextmanager
def dask_process(folder, path, kind, *options):
    loopback = ["--host", "127.0.0.1", "--no-dashboard", "--dashboard-address", "127.0.0.1:0"]
    where = "--scheduler-file", Path(folder) / "scheduler.json"
    process = psutil.Popen(
        [sys.executable, "-m", "dask", kind, *loopback, *where, *options],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ if path is None else {**os.environ, "PYTHONPATH": str(path)},
    )
    try:
        yield process
    finally:
        below = children(process)
        process.kill()
        process.wait()
        for one in below:
            with suppress(psutil.NoSuchProcess):
                one.kill()


@contextmanager
def flying(*arguments, command=("campaign",), **options):
    """The command ``campaign``, or another, in a process group of its own for the block."""
    process = psutil.Popen(
        [sys.executable, "-m", "flighttune", *command, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **options,
    )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def last_line(process):
    """What an ended command said last on stderr; not more than its progress went before."""
    _, stderr = process.communicate(timeout=240)
    assert "Traceback" not in stderr
    return stderr.strip().splitlines()[-1]


def some_parts(out, count=1):
    """Wait until so many files of rows are there."""
    return wait_until(lambda: len(parts(out)) >= count and parts(out))


def parts(out):
    """The files of rows that are there."""
    return sorted((Path(out) / "runs").glob("*.parquet"))


@contextmanager
def flown_here(rows=rows_flown):
    """Fly in this process, without workers."""

    def flown(pool, plan, runs, doing="flying", **options):
        made = list(rows(plan, runs, **options))
        pool.progress.compiled += compiled_in(made)
        return made

    with mock.patch.object(WorkerPool, "rows", flown):
        yield WorkerPool(Fliers())


@contextmanager
def seen_here():
    """Fly in this process, without workers, while the observer sees each flight before it is kept.

    An observer that kills its process leaves what a kill leaves: `fuzzing.in_child` has a process.
    """

    def seen(pool, plan, runs, doing="flying", **options):
        pool.progress.doing = doing
        for row in rows_flown(plan, runs, **options):
            pool.observer.see(pool.progress)
            yield row
            pool.progress.flown += 1

    with mock.patch.object(WorkerPool, "rows", seen):
        yield


class Killer(ft.CampaignObserver):
    """Kills its process once it does something and so many flights are there.

    What it hears last is in a file.
    """

    def __init__(self, said, most, doing=""):
        self._most, self._doing, self.hear = most, doing, said.write_text

    def see(self, progress):
        if progress.doing.startswith(self._doing) and progress.flown >= self._most:
            os.kill(os.getpid(), signal.SIGKILL)
