"""Who flew: answers and files count compiled flights, those flown again, and reasons of others."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from commands import flighttune
from flown_campaigns import aircraft_with, plan
from made_up import made_up_run

import flighttune as ft
from flighttune.campaigns.dataset import compiled_of
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.compiled import COMPILED, CompiledFlights, compiled_in
from flighttune.campaigns.flying.rows import rows_flown
from flighttune.flight.loop import loop

pytest.importorskip("numba")

FEW = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 9}
NONE_KEPT = "failures = 0\nworst = 0\nsample = 0"


@pytest.fixture
def compiled_at_once(monkeypatch):
    """Flights are compiled from the first sample on, and flown in this process."""

    def rows(pool, plan, runs, *, doing=None, **options):
        for row in rows_flown(plan, sorted(runs), **options):
            pool.progress.add([row])
            yield row

    monkeypatch.setattr(loop, "COMPILED_FROM", 0)
    monkeypatch.setattr(WorkerPool, "rows", rows)


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_at_once")
def test_rows_know_who_flew_them(tmp_path):
    ours = plan(tmp_path, runs=8)  # two of the four groups are of the aircraft

    compiled = compiled_in(rows_flown(ours, range(8)))
    with ft.in_jsbsim():
        by_jsbsim = compiled_in(rows_flown(ours, range(8)))

    # in a second none follows its reference: each misses a requirement, and is flown again
    assert compiled == CompiledFlights(flights=4, flown_again=4)
    assert by_jsbsim == CompiledFlights(by_jsbsim=4)


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_at_once")
def test_a_refused_aircraft_is_told_with_its_reason(tmp_path):
    heavy = aircraft_with(tmp_path / "own", '<function name="aero/noise"><random/></function>')
    reason = "the compiled step does not know <random> in a function"

    ours = plan(tmp_path, runs=4, aircraft=(heavy,), keep=NONE_KEPT)
    done = ft.run_campaign(ours, tmp_path / "out")

    assert done.compiled == CompiledFlights(by_jsbsim=2, reasons={reason: 2})
    assert f"JSBSim flew 2 itself: {reason} (2)." in done.answer().notes


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_at_once")
def test_a_campaign_counts_what_all_its_commands_flew(tmp_path):
    ours, out = plan(tmp_path, runs=8, keep=NONE_KEPT), tmp_path / "out"
    ft.run_campaign(ours.with_runs(4), out)
    with ft.in_jsbsim():
        done = ft.run_campaign(ours, out, resume=True)

    assert (done.compiled.flights, done.compiled.by_jsbsim) == (2, 2)
    assert compiled_of(ft.load(out).rows()) == done.compiled
    assert done.answer().values[COMPILED]["flights"] == 2
    report = ft.report(out).answer()
    assert report.values[COMPILED] == done.answer().values[COMPILED]
    assert "Compiled flights: 2, of which JSBSim flew" in " ".join(report.notes)


@pytest.mark.soak
@pytest.mark.usefixtures("compiled_at_once")
def test_a_band_by_both_makes_the_same_claim_and_says_who_flew(tmp_path):
    turn = ft.load_scenario("level_turn", changes={"flight.duration_s": 4.0}).as_dict()
    turn |= {"plant": [x for x in turn["plant"] if x["kind"] == "jsbsim"], "expect": []}
    files = [tmp_path / name for name in ("compiled.npz", "jsbsim.npz")]
    ft.band(ft.scenario_from(turn), start_deg=2.0, out=files[0], **FEW)
    with ft.in_jsbsim():
        ft.band(ft.scenario_from(turn), start_deg=2.0, out=files[1], **FEW)

    band, other = map(ft.load, files)

    assert band.sha256 == other.sha256
    arrays, others = map(np.load, files)
    for name in set(arrays) & set(others) - {COMPILED}:
        assert arrays[name].tobytes() == others[name].tobytes()
    assert band.compiled.flights == 19
    assert band.compiled.flown_again >= 1  # the nearest to leaving
    assert other.compiled == CompiledFlights(by_jsbsim=19)
    again = band.compiled.flown_again
    said = f"Compiled flights: 19, of which JSBSim flew {again} again."
    assert said in flighttune("band", files[0])[0]
    assert ft.verify(files[0], count=2).valid


@pytest.mark.parametrize("forged", ["[]", "{", '{"flights": -1}', '{"flights": 1.5}',
                                    '{"reasons": {"x": "y"}}', '{"other": 1}'])  # fmt: skip
def test_counts_that_are_none_are_refused(forged):
    with pytest.raises(ft.InputError, match="`compiled` must hold numbers of flights"):
        CompiledFlights.stated(forged)


def test_files_of_earlier_versions_have_no_counts():
    assert CompiledFlights.stated(None) == CompiledFlights()
    assert compiled_of(pa.table({"run": [0]})) == CompiledFlights()
    assert CompiledFlights().values == {}
    assert CompiledFlights().notes == []


def test_counts_are_added_and_read_as_they_were_written():
    near, other = "flights near the ground", "other laws"
    both = CompiledFlights(flights=9, flown_again=2, by_jsbsim=3, reasons={near: 1, other: 2})
    both += CompiledFlights(flights=1, by_jsbsim=4, reasons={near: 4})

    assert CompiledFlights.stated(json.dumps(json.loads(both.text))) == both
    assert both.notes == [
        f"Compiled flights: 10, of which JSBSim flew 2 again; JSBSim flew 7 itself: {near} (5) "
        f"and {other} (2)."
    ]


@pytest.mark.soak
@pytest.mark.parametrize("by_jsbsim", [False, True])
def test_processes_fly_as_their_command_says(tmp_path, monkeypatch, by_jsbsim):
    (tmp_path / "jsbsim").mkdir()
    ours = plan(tmp_path, runs=4, law=False, duration=310.0)  # compiled from the first flight on

    def fly():
        with WorkerPool(Fliers(workers=1)) as pool:
            rows = list(pool.rows(ours, [2, 3]))
        return pool.progress.compiled, [row["status"] for row in rows]

    if by_jsbsim:
        with ft.in_jsbsim():
            compiled, statuses = fly()
    else:
        compiled, statuses = fly()

    assert statuses == ["completed"] * 2
    assert (compiled.flights, compiled.by_jsbsim) == ((0, 2) if by_jsbsim else (2, 0))


def test_counts_of_compiled_flights_add_up_and_say_the_commonest_reasons():
    first = CompiledFlights(flights=5, flown_again=2, by_jsbsim=3, reasons={"a": 1, "b": 2})
    both = first + CompiledFlights(flights=1, flown_again=1, by_jsbsim=4, reasons={"a": 3, "c": 1})

    assert both == CompiledFlights(
        flights=6, flown_again=3, by_jsbsim=7, reasons={"a": 4, "b": 2, "c": 1}
    )
    (said,) = both.notes
    assert said.startswith(
        "Compiled flights: 6, of which JSBSim flew 3 again; JSBSim flew 7 itself: a (4), b (2)"
    )
    assert CompiledFlights(flights=2, flown_again=1).notes == [
        "Compiled flights: 2, of which JSBSim flew 1 again."
    ]
    assert CompiledFlights(by_jsbsim=2, reasons={"a": 2}).notes == ["JSBSim flew 2 itself: a (2)."]
    assert CompiledFlights(by_jsbsim=2).notes == []
    assert CompiledFlights.stated(both.text) == both


@pytest.mark.parametrize("again", [True, False])
def test_a_flight_is_compiled_and_perhaps_flown_again_or_of_jsbsim_for_a_reason(again):
    run = made_up_run({"h": [0.0]}, [0.0])
    runs = replace(run, compiled=True), replace(run, why_jsbsim="w"), run

    compiled, refused, plain = (CompiledFlights.of(run, again=again) for run in runs)

    assert compiled == CompiledFlights(flights=1, flown_again=int(again))
    assert refused == CompiledFlights(by_jsbsim=1, reasons={"w": 1})
    assert plain == CompiledFlights(by_jsbsim=1)
