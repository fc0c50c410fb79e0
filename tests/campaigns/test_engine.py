"""Campaigns flown by real workers: every run once, as one process flies it."""

import json
import sys
import time

import psutil
import pytest
from dispersed import uniform
from flown_campaigns import (
    SPEED,
    Notes,
    bits,
    children,
    flown_here,
    one_worker,
    plan,
    table_flown,
    write_campaign,
)

import flighttune as ft
from flighttune.base.errors import StoppedError
from flighttune.campaigns.engine import pool

pytestmark = pytest.mark.slow

MANY_LOOKS = 2000
"""A pool that waits for nothing looks as often in a second, one that waits for flights in 400 s."""


KEYS = ("plant.airframe.mass_factor", "plant.airframe.actuator_lag_factor",
        "plant.airframe.coefficient_factors.Cm_alpha", "sensors.chi_noise_sd_deg",
        "sensors.V_a_noise_sd_mps")  # fmt: skip


@pytest.mark.soak
def test_every_run_is_there_once_with_the_bits_of_one_process(tmp_path, monkeypatch, capfd):
    """And neither this process nor one below it listens on an address."""
    monkeypatch.chdir(tmp_path)
    listening = set()

    def listen(progress):
        for process in [psutil.Process(), *children()] if progress.done else ():
            listening.update(x.status for x in process.net_connections())
        return False

    drawn = [SPEED, *(uniform(key, 0.95, 1.05) for key in KEYS)]
    ours, notes = plan("files", disperse=drawn), Notes(listen)
    alone = table_flown(ours)

    done = ft.run_campaign(ours, "out", workers=2, observer=notes)

    rows = ft.load("out").rows()
    assert bits(rows) == bits(alone)
    assert rows.schema.equals(alone.schema)
    assert (done.runs, done.completed + done.failed + done.crashed) == (24, 24)
    assert {*rows.column("plant").to_pylist()} == {"kinematic", "jsbsim:aerosonde"}
    success = rows.to_pandas().groupby(["plant", "gains"])["success"].agg(["size", "sum"])
    counted = {group["group"]: [group["runs"], group["succeeded"]] for group in done.by_group}
    assert counted == {" / ".join(names): [*both] for names, both in success.T.items()}
    assert capfd.readouterr() == ("", "")
    assert {path.name for path in tmp_path.iterdir()} == {"files", "out"}
    assert psutil.CONN_LISTEN not in listening
    assert not children()


@pytest.mark.soak
def test_each_phase_counts_its_own_runs_from_its_first_flight_on(tmp_path):
    ours, notes = plan(tmp_path, runs=4, wind="", aircraft=()), Notes()

    with one_worker(observer=notes) as workers:
        assert workers.progress.rate_per_s == 0.0
        time.sleep(0.1)
        ready = time.perf_counter()
        for doing in ("learning", "counting"):
            assert len(list(workers.rows(ours, range(4), doing=doing))) == 4

    shown = [(p.doing, p.done) for p in notes.seen]
    phases = [(doing, done) for doing in ("learning", "counting") for done in (0, 4)]
    assert [*dict.fromkeys(shown)] == [("starting", 0), *phases]
    assert {p.runs for p in notes.seen} == {4}
    assert workers.progress.flown / workers.progress.rate_per_s < time.perf_counter() - ready


@pytest.mark.soak
def test_flights_go_on_where_no_worker_is_counted(tmp_path, monkeypatch):
    """Some schedulers start a worker for a task that waits, and end it after the task."""
    monkeypatch.setattr(pool.Threads, "threads", lambda self: 0)
    notes = Notes(lambda progress: len(notes.seen) > MANY_LOOKS)

    with one_worker(observer=notes) as workers:
        rows = list(workers.rows(plan(tmp_path, runs=8, law=False), range(8)))

    assert len(rows) == 8


def test_a_process_that_cannot_start_is_said_in_one_line(tmp_path, monkeypatch):
    ours = plan(tmp_path, runs=4)
    monkeypatch.setattr(sys, "executable", "/no/such/python")

    with pytest.raises(ft.FlightTuneError, match=r"start, got: no such file"):
        ft.run_campaign(ours, tmp_path / "out")


def asking(folder, share, **settings):
    """A campaign whose gains `paper` succeed on every draw and whose gains `soft` on none."""
    file = write_campaign(folder, runs=1000, duration=5.0, wind="", aircraft=(), **settings)
    success = '[[success]]\ngains = "soft"\nat_most.chi.peak_deg = 1e-6\n'
    file.write_text(file.read_text().replace("[keep]", f"{success}[keep]"))
    return ft.plan_campaign(ft.load_campaign(file, until_sure=share))


@pytest.mark.soak
def test_a_campaign_ends_once_it_is_sure_and_resumed_to_the_same_bits(
    tmp_path, monkeypatch, address
):
    monkeypatch.setattr(pool, "FEW", 1)  # kinematic flights go to the workers
    ours, out = asking(tmp_path, 0.8), tmp_path / "out"
    stops = Notes(lambda progress: progress.done)

    first = ft.run_campaign(ours, out, workers=2, observer=stops)
    done = ft.run_campaign(ours, out, resume=True, scheduler=address)
    again = ft.run_campaign(ours, out, resume=True, workers=1)

    # The integral of (1.25 (1 - q))^n, half at q = 0 and half over 0 to 0.2, passes 2 / 0.05 at n
    # = 19. It is looked at every 12 draws, each of two gain sets.
    flown = 2 * 24
    assert (first.interrupted, first.sure) == (True, {})
    assert (done.runs, done.planned, done.flown) == (flown, 1000, flown - first.runs)
    assert done.sure == {"kinematic / paper": "yes", "kinematic / soft": "no"}
    assert (again.flown, again.sure) == (0, done.sure)
    assert bits(ft.load(out).rows()) == bits(table_flown(ours, range(flown)))
    assert (done.answer().status, ft.load(out).plan.campaign.until_sure) == (1, 0.8)

    page = ft.report(out)
    assert page.summary[0] == (
        "At least 80 % of the flights of kinematic / paper succeed. Fewer than 80 % of the flights "
        "of kinematic / soft succeed."
    )
    assert page.shown.values["interval"] == "any-time"
    assert any(
        f"ended after {flown} of 1000 flights by its own rule" in x for x in page.shown.notes
    )
    with pytest.raises(ft.InputError, match="`interval` must be any-time"):
        ft.report(out, interval="wilson")
    with pytest.raises(ft.InputError, match=r"until_sure: was 0\.8, is 0\.9"):
        ft.run_campaign(asking(tmp_path, 0.9), out, resume=True)


def test_a_campaign_that_is_not_sure_of_its_share_says_so(tmp_path):
    ours, out = asking(tmp_path, 0.5, keep="failures = 0\nworst = 0\nsample = 0"), tmp_path / "out"

    with flown_here():
        short = ft.run_campaign(ours, out, runs=10)
        done = ft.run_campaign(ours.with_runs(1000), out, resume=True)

    # With n of n the integral of (2 (1 - q))^n as above is 21 at n = 5 and 41 at n = 6. It is
    # looked at every 12 draws.
    assert (short.planned, short.interrupted) == (10, False)
    assert short.sure["kinematic / paper"] == ""
    assert "It is not sure whether at least 50 % of the flights" in short.answer().failure
    assert (done.sure["kinematic / paper"], done.sure["kinematic / soft"]) == ("yes", "no")
    rows = ft.load(out).rows()
    assert sorted(rows.column("run").to_pylist()) == list(range(2 * 12))
    succeeded = {group["group"]: group["succeeded"] for group in done.by_group}
    assert succeeded == {"kinematic / paper": 12, "kinematic / soft": 0}


def test_a_campaign_that_is_stopped_says_so_and_one_without_runs_is_refused(tmp_path):
    def stop(plan, runs, **options):
        raise StoppedError("the observer stopped the flights.")

    ours, out = plan(tmp_path, runs=4, wind="", aircraft=()), tmp_path / "out"
    with pytest.raises(ft.InputError, match="`runs` must be at least 1, got 0"):
        ft.run_campaign(ours, out, runs=0)

    with flown_here(stop):
        stopped = ft.run_campaign(ours, out)

    assert stopped.interrupted
    assert (stopped.runs, stopped.planned) == (0, 4)


@pytest.mark.parametrize(
    ("share", "top", "got"),
    [
        (1.0, "", r"`until_sure` must be less than 1, got 1"),
        (0.0, "", r"`until_sure` must be greater than 0, got 0"),
        (0.9, 'design = "sobol"', r"`until_sure` must be with independent draws.* got sobol"),
    ],
)
def test_a_share_that_cannot_be_asked_for_is_refused(tmp_path, share, top, got):
    with pytest.raises(ft.ScenarioError, match=rf"campaign\.toml: {got}"):
        asking(tmp_path, share, top=top)
    file = write_campaign(tmp_path, wind="", aircraft=())
    file.write_text(file.read_text().replace("[[success]]\nat_most.chi.peak_deg = 20.0", ""))
    with pytest.raises(ft.ScenarioError, match=r"campaign\.toml: `until_sure` .*\[\[success\]\]"):
        ft.load_campaign(file, until_sure=0.9)


@pytest.mark.soak
@pytest.mark.counts
def test_a_million_runs_wait_nowhere(tmp_path, address):
    ours = plan(tmp_path, runs=10**6, wind="", aircraft=(), duration=0.5)
    sizes = []

    def enough(progress):
        if progress.done:
            sizes.append((progress.done, psutil.Process().memory_info().rss))
        return progress.done > 8_000

    notes = Notes(enough)
    done = ft.run_campaign(ours, tmp_path / "out", scheduler=address, observer=notes)

    assert done.runs > 8_000
    assert sizes[-1][1] - sizes[0][1] < 60e6
    assert json.loads((tmp_path / "out" / "campaign.json").read_text())["plan"]["runs"] == 10**6
    assert (tmp_path / "out" / "campaign.json").stat().st_size < 20_000
