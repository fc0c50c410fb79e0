"""Campaigns flown by real workers: every run once, as one process flies it."""

import json
import sys
import time

import psutil
import pytest
from campaigns import SPEED, Notes, bits, children, plan
from dispersed import uniform

import flighttune as ft
from flighttune.campaign.engine import pool
from flighttune.campaign.flying.columns import table_of
from flighttune.campaign.flying.rows import fly_runs

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("own_workers")]


KEYS = ("plant.airframe.mass_factor", "plant.airframe.actuator_lag_factor",
        "plant.airframe.coefficient_factors.Cm_alpha", "sensors.chi_noise_sd_deg",
        "sensors.V_a_noise_sd_mps")  # fmt: skip


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
    alone = fly_runs(ours, range(ours.runs))

    done = ft.run_campaign(ours, "out", workers=2, observer=notes)

    rows = ft.load("out").rows()
    assert bits(rows) == bits(alone)
    assert rows.schema.equals(alone.schema)
    assert (done.runs, done.completed + done.failed + done.crashed) == (24, 24)
    assert {*rows.column("plant").to_pylist()} == {"kinematic", "jsbsim:aerosonde"}
    assert capfd.readouterr() == ("", "")
    assert {path.name for path in tmp_path.iterdir()} == {"files", "out"}
    assert psutil.CONN_LISTEN not in listening
    assert not children()


def test_many_kinematic_flights_are_shared_out_with_the_bits_of_a_few(tmp_path, monkeypatch):
    ours = plan(tmp_path, runs=300, wind="", aircraft=())
    few = fly_runs(ours, range(300))
    monkeypatch.setattr(pool, "FEW", 100)

    with pool.WorkerPool(2) as workers:
        many = workers.in_order(ours, range(300))
        started = len(children())

    assert bits(table_of(ours, many)) == bits(few)
    assert started == 2


def test_each_phase_counts_its_own_runs_from_its_first_flight_on(tmp_path):
    ours, notes = plan(tmp_path, runs=4, wind="", aircraft=()), Notes()

    with pool.WorkerPool(1, observer=notes) as workers:
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


def test_a_process_that_cannot_start_is_said_in_one_line(tmp_path, monkeypatch):
    ours = plan(tmp_path, runs=4)
    monkeypatch.setattr(sys, "executable", "/no/such/python")

    with pytest.raises(ft.FlightTuneError, match=r"start, got: no such file"):
        ft.run_campaign(ours, tmp_path / "out")


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
