"""The folder of a campaign: who may fly into it, what is there meanwhile, what is not trusted."""

import hashlib
import io
import json
import os
import shutil
import socket
from dataclasses import replace

import duckdb
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import answer, flighttune
from dispersed import AEROSONDE, campaign_of, plan_of, rows_of, tables_of, uniform

import flighttune as ft

pytestmark = pytest.mark.slow

RUNS = 12
START = uniform("flight.chi_deg", 10.0, 30.0)
SPEED = uniform("flight.V_a_mps", 24.0, 26.0)


def short(plants=({"kind": "kinematic"},), seconds=0.5, **tables):
    made = tables_of(plants, **tables)
    made["flight"]["duration_s"] = seconds
    return made


class Notes(ft.CampaignObserver):
    """Writes down what it sees and hears, and stops a campaign once `until` says so."""

    def __init__(self, until=lambda progress: False):
        self.seen, self.heard, self.stopped, self.until = [], [], False, until

    def see(self, progress):
        self.seen.append((progress.doing, progress.done, progress.runs, progress.sentence))
        self.stopped = self.stopped or self.until(progress)

    def hear(self, sentence):
        self.heard.append(sentence)


@pytest.fixture(scope="module")
def plan():
    return plan_of(short(), START, SPEED, runs=RUNS)


@pytest.fixture(scope="module")
def whole(plan, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "out"
    ft.run_campaign(plan.with_runs(4), out)
    ft.run_campaign(plan, out, resume=True)
    table = ft.load(out).rows()
    for part in parts(out):  # their number depends on the clock
        part.unlink()
    for span in (table.slice(0, 4), table.slice(4)):
        with_part(out, span)
    return out


@pytest.fixture(scope="module")
def rows(plan):
    return rows_of(plan)


@pytest.fixture
def out(tmp_path, whole):
    return shutil.copytree(whole, tmp_path / "out")


def parts(out):
    return sorted((out / "runs").iterdir())


def there(out):
    return ft.load(out).rows().drop_columns(["wall_s"])


def with_part(out, table, first=None, runs=None):
    """Add a file of rows to a folder, with the name that it must have or another."""
    first = table.column("run")[0].as_py() if first is None else first
    file = io.BytesIO()
    pq.write_table(table, file)
    digest = hashlib.sha256(file.getvalue()).hexdigest()[:16]
    stop = first + (runs or len(table))
    path = out / "runs" / f"part-{first:010d}-{stop:010d}-{digest}.parquet"
    path.write_bytes(file.getvalue())
    return path


def sealed(out, change):
    """Change the description of a campaign and seal it again, as its own program would."""
    file = out / "campaign.json"
    tables = json.loads(file.read_text())
    change(tables)
    file.write_text(json.dumps(tables))


@pytest.mark.soak
def test_a_campaign_flown_in_two_parts_has_the_rows_of_one(whole, rows, plan):
    assert [path.name[:27] for path in parts(whole)] == [
        "part-0000000000-0000000004-", "part-0000000004-0000000012-",
    ]  # fmt: skip
    assert there(whole).equals(rows)
    assert ft.load(whole).plan.sha256 == plan.sha256
    assert ft.load(whole).plan.parameters().equals(plan.parameters())


def test_pandas_and_duckdb_read_the_rows_without_this_program(whole, rows):
    found = pd.read_parquet(whole / "runs").sort_values("run", ignore_index=True)
    sql = f"SELECT count(*), count(DISTINCT run), sum(success) FROM '{whole}/runs/*.parquet'"

    assert found.drop(columns="wall_s").equals(rows.to_pandas())
    assert duckdb.sql(sql).fetchall()[0] == (RUNS, RUNS, sum(rows["success"].to_pylist()))


def test_what_was_flown_is_counted_in_the_answer_by_group(plan, tmp_path):
    notes = Notes()
    done = ft.run_campaign(plan, tmp_path / "out", observer=notes)
    rows = ft.load(tmp_path / "out").rows().to_pandas()

    assert (done.planned, done.runs, done.flown, done.kept) == (RUNS, RUNS, RUNS, 0)
    assert (done.completed, done.failed, done.crashed) == (RUNS, 0, 0)
    assert (done.succeeded, done.statuses) == (rows["success"].sum(), {"completed": RUNS})
    assert done.rate_per_s == pytest.approx(RUNS / done.wall_s)
    assert (done.interrupted, done.endings, done.sure) == (False, [], {})
    for group, name in zip(done.by_group, ("paper", "soft"), strict=True):
        mine = rows[rows["gains"] == name]
        assert (group["group"], group["runs"]) == (f"kinematic / {name}", 6)
        assert (group["completed"], group["succeeded"]) == (6, mine["success"].sum())
    assert notes.seen[0][:3] == ("starting", 0, RUNS)
    assert notes.seen[-1][1:3] == (RUNS, RUNS)
    said = notes.seen[-1][3]
    assert f"{RUNS} of {RUNS} runs" in said
    assert "failed" not in said


def test_a_finished_campaign_needs_nobody(out):
    nobody = "tcp://127.0.0.1:1"

    done = ft.run_campaign(ft.load(out).plan, out, scheduler=nobody, resume=True)

    assert (done.flown, done.runs, done.interrupted) == (0, RUNS, False)


@pytest.mark.parametrize("after", [0, 1])
def test_a_campaign_that_is_stopped_keeps_what_was_flown_and_goes_on(tmp_path, after):
    plan = plan_of(short(), START, SPEED, runs=300)
    stops = Notes(lambda progress: progress.done >= after)

    first = ft.run_campaign(plan, tmp_path / "out", observer=stops)
    part = first.runs
    second = ft.run_campaign(plan, tmp_path / "out", resume=True)

    assert first.interrupted
    assert part == 0 if after == 0 else 0 < part < 300
    assert "interrupted" in json.dumps(first.answer().values)
    assert (second.flown, second.runs, second.interrupted) == (300 - part, 300, False)
    assert there(tmp_path / "out").equals(rows_of(plan))


def test_a_campaign_can_grow_and_not_shrink(out, plan):
    longer, unfinished = plan.with_runs(RUNS + 6), out / ".writing/.flighttune-killed"
    unfinished.parent.mkdir()
    unfinished.write_bytes(b"of a campaign that was killed")

    done = ft.run_campaign(longer, out, resume=True)

    assert (done.flown, done.planned) == (6, RUNS + 6)
    assert not unfinished.parent.exists()
    assert there(out).equals(rows_of(longer))
    with pytest.raises(ft.InputError, match=r"`runs` .*18.*12"):
        ft.run_campaign(plan, out, resume=True)


@pytest.mark.parametrize("kept", [(0, 4, 8, 12), (2, 5, 6, 9), (0, 1, 11, 12)])
def test_runs_that_are_missing_anywhere_are_flown_and_no_others(tmp_path, whole, plan, rows, kept):
    out = shutil.copytree(whole, tmp_path / "out")
    table = ft.load(whole).rows()
    for part in parts(out):
        part.unlink()
    for first, stop in (kept[:2], kept[2:]):
        with_part(out, table.slice(first, stop - first))
    left = RUNS - sum(kept[1::2]) + sum(kept[::2])

    done = ft.run_campaign(plan, out, resume=True)

    assert done.flown == left
    assert there(out).equals(rows)


REFUSED = {
    "not resumed": (lambda out, plan: {"plan": plan, "resume": False}, "got one of 12 runs"),
    "another seed": (lambda out, plan: {"plan": plan.with_seed(4)}, r"seed: was 1, is 4"),
    "a longer flight": (
        lambda out, plan: {"plan": plan_of(short(seconds=1.0), START, SPEED, runs=RUNS)},
        r"scenario\.flight\.duration_s: was 0\.5, is 1\.0",
    ),
    "no runs": (lambda out, plan: {"plan": plan, "runs": 0}, "`runs` must be at least 1, got 0"),
    "what a plan has": (lambda out, plan: {"plan": plan, "navigation": "rtk"}, "must be absent"),
    "no worker": (lambda out, plan: {"plan": plan, "workers": 0}, "`workers` .* at least 1, got 0"),
    "too many": (lambda out, plan: {"plan": plan, "workers": 10**5}, r"at most \d+, 16 for each"),
    "both": (
        lambda out, plan: {"plan": plan, "workers": 2, "scheduler": "tcp://127.0.0.1:1"},
        "`workers` must not be given with `scheduler`",
    ),
    "no address": (lambda out, plan: {"plan": plan, "scheduler": ""}, "tcp://HOST:PORT, got ''"),
    "no port": (lambda out, plan: {"plan": plan, "scheduler": "localhost"}, "tcp://HOST:PORT"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_go_on_is_refused_with_what_is_different(out, plan, case):
    asked, words = REFUSED[case]
    options = {"resume": True, **asked(out, plan)}

    with pytest.raises(ft.InputError, match=words):
        ft.run_campaign(options.pop("plan"), out, **options)


def test_more_of_a_hypercube_is_refused_as_its_draws_depend_on_their_number(tmp_path):
    cube = plan_of(short(), START, design="latin_hypercube", runs=RUNS)
    ft.run_campaign(cube, tmp_path / "out")

    with pytest.raises(ft.InputError, match=r"`runs` .*stay with latin_hypercube.*12.* 13"):
        ft.run_campaign(cube.with_runs(RUNS + 1), tmp_path / "out", resume=True)


def test_a_campaign_goes_on_with_the_tuned_gains_it_began_with_and_with_no_others(tmp_path):
    plan = plan_of(short(gains=["paper", "tuned"]), START, runs=8)
    out = tmp_path / "out"
    ft.run_campaign(plan.with_runs(4), out)

    def times(name, factor):
        gains = plan.gain_sets[name]
        other = replace(gains, K_P=gains.K_P * factor)
        return replace(plan, gain_sets={**plan.gain_sets, name: other})

    for name, factor in (("paper", 1.0 + 1e-15), ("tuned", 1.0 + 3e-6)):
        with pytest.raises(ft.InputError, match=rf"gains .*{name}\.K_P: "):
            ft.run_campaign(times(name, factor).with_runs(8), out, resume=True)
    ft.run_campaign(times("tuned", 1.0 + 3e-7), out, resume=True)
    assert there(out).equals(rows_of(plan))


EDITED = {
    "a value": (lambda tables: tables["plan"]["gains"].update(paper=None), "its hash differs"),
    "an old format": (lambda tables: tables.update(format=1), "must be 3, got 1: fly the campaign"),
    "a new format": (lambda tables: tables.update(format=99), "`format` must be 3, got 99"),
    "nothing left": (lambda tables: tables.pop("plan"), "its hash differs"),
    "no hash": (lambda tables: tables.pop("sha256"), "its hash differs"),
}


@pytest.mark.parametrize("case", EDITED)
def test_a_description_that_was_edited_is_refused(out, plan, case):
    change, words = EDITED[case]
    sealed(out, change)

    for use in (ft.load, lambda out: ft.run_campaign(plan, out, resume=True)):
        with pytest.raises(ft.RecordingError, match=rf"campaign\.json: .*{words}"):
            use(out)


@pytest.mark.parametrize("how", ["cut", "another byte", "empty"])
def test_a_damaged_file_is_told_of_and_its_runs_are_flown_again(out, plan, rows, how):
    part, notes = parts(out)[0], Notes()
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes({"cut": bytes(data[:-100]), "another byte": bytes(data), "empty": b""}[how])
    with pytest.raises(ft.RecordingError, match=r"is damaged or was changed.*--resume"):
        ft.load(out).rows()

    done = ft.run_campaign(plan, out, resume=True, observer=notes)

    assert done.flown == 4
    assert there(out).equals(rows)
    (said,) = notes.heard
    assert str(part) in said


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda table: (table, None), "got run 0 in"),
        (lambda table: (table.slice(2, 4), None), r"got run 2 in \S*part-0"),
        (lambda table: (table, 12), "must have the 4 runs of its name, got 12"),
        (lambda table: (pa.table({"x": [1, 2, 3, 4]}), 12), "must have the same columns"),
    ],
)
def test_rows_that_are_there_twice_or_not_those_of_their_name_are_refused(out, made, words):
    table, first = made(ft.load(out).rows())
    with_part(out, table, first, first and 4)

    with pytest.raises(ft.RecordingError, match=words):
        ft.load(out).rows(["run"])


def test_a_folder_of_another_or_that_cannot_be_written_is_one_line(tmp_path, plan):
    seen = []

    def another(progress):
        with pytest.raises(ft.InputError, match=f"process {os.getpid()} on {socket.gethostname()}"):
            ft.run_campaign(plan, tmp_path / "out", resume=True)
        seen.append(progress.done)
        return False

    ft.run_campaign(plan, tmp_path / "out", observer=Notes(another))
    assert seen
    (tmp_path / "mine" / "runs").mkdir(parents=True)
    (tmp_path / "mine" / "runs" / "mine.parquet").write_bytes(b"")
    with pytest.raises(ft.InputError, match=r"runs/ without campaign\.json"):
        ft.run_campaign(plan, tmp_path / "mine")
    with pytest.raises(ft.FlightTuneError, match="must be writable"):
        ft.run_campaign(plan, tmp_path / "mine" / "runs" / "mine.parquet" / "out")


def test_the_hash_in_a_report_sees_every_bit_but_the_time_flights_took(tmp_path, whole):
    table = ft.load(whole).rows()
    ITAE, success = (table.column(name)[3].as_py() for name in ("chi.ITAE", "success"))
    found = {}
    for name, value in (
        ("", None), ("wall_s", 99.0), ("chi.ITAE", np.nextafter(ITAE, 9.0)), ("gamma.ITAE", None),
        ("success", not success),
    ):  # fmt: skip
        changed = table
        if name:
            values = table.column(name).to_pylist()
            values[3] = value
            field, place = table.schema.field(name), table.schema.get_field_index(name)
            changed = table.set_column(place, field, pa.array(values, field.type))
        out = shutil.copytree(whole, tmp_path / f"of-{name}")
        for part in parts(out):
            part.unlink()
        with_part(out, changed)
        found[name] = answer("report", out)["sha256"]
    assert found[""] == found["wall_s"]
    assert len({*found.values()}) == 4


def test_a_row_that_differs_from_its_flight_is_named_with_both_values(out):
    table = ft.load(out).rows()
    values = table.column("chi.ITAE").to_pylist()
    values[2] = np.nextafter(values[2], 9.0)
    place = table.schema.get_field_index("chi.ITAE")
    forged = table.set_column(place, "chi.ITAE", pa.array(values))
    for part in parts(out):
        part.unlink()
    with_part(out, forged)

    first, third = ft.refly(out, 1), ft.refly(out, 2)

    assert (first.equal, third.equal) == (True, False)
    ((differs,),) = (run.differences for run in third.runs)
    assert differs.what == "chi.ITAE"
    assert not ft.refly(out, count=RUNS).equal
    for bad in ({"count": 0}, {"run": 3, "count": 2}):
        with pytest.raises(
            ft.InputError, match="`count` must be at least 1, and absent with `run`"
        ):
            ft.refly(out, **bad)
    with pytest.raises(ft.FlightTuneError, match="`run` must be one that was flown, got 40 of 12"):
        ft.refly(out, 40)


def test_signals_are_kept_of_failures_the_worst_and_a_sample(tmp_path):
    keep = {"failures": 3, "worst": 2, "sample": 2, "worst_by": "gamma.ITAE"}
    bound = {"at_most": {"chi": {"peak_deg": 20.0}}}
    lost = {
        "key": "flight.gamma_deg",
        "distribution": "choice",
        "values": [10.0, 1e9],
        "weights": [9.0, 1.0],
    }
    plan = plan_of(short(), START, SPEED, lost, runs=40, keep=keep, success=[bound])

    done = ft.run_campaign(plan, tmp_path / "out", workers=1)

    found = ft.load(tmp_path / "out")
    rows = found.rows().to_pandas()
    flown = rows[rows["status"] == "completed"]
    worst = flown["gamma.ITAE"].sort_values(ascending=False, kind="stable").index[:2]
    failures = flown.index[~flown["success"].to_numpy(bool)][:3]
    assert len(flown) < 40
    assert {*worst, *failures} <= {*found.kept} <= {*flown.index}
    assert 5 <= len(found.kept) == done.kept <= 7
    for run in found.kept:
        (flight,) = ft.load(tmp_path / "out" / "signals" / f"run-{run:010d}.parquet").runs
        assert flight.status == rows["status"][run]
        assert np.abs(flight.signals["chi_err"]).max() == pytest.approx(
            rows["chi.peak_rad"][run], rel=1e-12
        )
    more = ft.run_campaign(plan, tmp_path / "out", runs=60, resume=True, workers=1)
    again = ft.load(tmp_path / "out")
    assert len({*again.kept} & {*failures}) == 3
    assert more.kept == len(again.kept) <= 7


def asking(share, runs=1000, **keys):
    """Gains `paper` succeed on every draw, and `soft` on none."""
    none = {"gains": "soft", "at_most": {"chi": {"peak_deg": 1e-6}}}
    return plan_of(short(), START, runs=runs, until_sure=share, success=[none], **keys)


@pytest.mark.parametrize(
    ("share", "draws"),
    # with n of n the integral of (2 (1 - q))^n, half at q = 0 and half over 0 to 0.5, is above 40
    # from n = 6 on, and that of (1.25 (1 - q))^n from 19; it is looked at every 12 draws
    [(0.8, 24), pytest.param(0.98, 1000, marks=pytest.mark.counts)],
)
def test_a_campaign_ends_once_it_is_sure_and_goes_on_to_the_same(tmp_path, share, draws):
    plan, out = asking(share, runs=600), tmp_path / "out"

    short = ft.run_campaign(plan, out, runs=10)
    done = ft.run_campaign(plan, out, resume=True)
    again = ft.run_campaign(plan, out, resume=True)

    assert (short.planned, short.interrupted, short.sure["kinematic / paper"]) == (10, False, "")
    assert "It is not sure whether at least" in short.answer().failure
    assert f"{100 * share:g} %" in short.answer().failure
    assert done.sure["kinematic / soft"] == "no"
    assert done.sure["kinematic / paper"] == "yes"
    assert done.runs < 600
    if share < 0.9:
        assert done.runs == 2 * draws
    assert (again.flown, again.sure) == (0, done.sure)
    assert done.answer().status == 1
    page = ft.report(out)
    assert page.shown.values["interval"] == "any-time"
    assert page.shown.values["sure"] == done.sure
    with pytest.raises(ft.InputError, match="`interval` must be any-time"):
        ft.report(out, interval="wilson")
    with pytest.raises(ft.InputError, match=rf"until_sure: was {share}, is 0\.9\b"):
        ft.run_campaign(asking(0.9, runs=600), out, resume=True)


@pytest.mark.parametrize(
    ("share", "keys", "got"),
    [
        (1.0, {}, r"`until_sure` must be less than 1, got 1"),
        (0.0, {}, r"`until_sure` must be greater than 0, got 0"),
        (0.9, {"design": "sobol"}, r"`until_sure` must be with independent draws.* got sobol"),
    ],
)
def test_a_share_that_cannot_be_asked_for_is_refused(share, keys, got):
    with pytest.raises(ft.ScenarioError, match=got):
        asking(share, **keys)
    with pytest.raises(
        ft.ScenarioError, match=r"`until_sure` .*\[\[success\]\], got no requirement"
    ):
        campaign_of(ft.scenario_from(short()), START, until_sure=0.9)


@pytest.mark.soak
def test_a_dry_run_shows_plan_cost_and_room_and_writes_nothing(tmp_path):
    found = answer(
        "campaign", "first_campaign", "--dry-run", "--workers", 3, "--runs", 4002, cwd=tmp_path
    )

    assert (found["runs"], found["draws"], found["design"]) == (4002, 1001, "random")
    assert found["notes"][0] == "4002 flights = 1000.5 draws, each by 2 gain sets on 2 plants"
    assert all(group["run_s"] > 0.0 for group in found["groups"])
    assert found["wall_s"] == pytest.approx(found["core_s"] / 3, rel=1e-12)
    assert found["rows_bytes"] > 4002 * 45
    assert found["signals_bytes"] > 10_000
    assert found["disperse"][0]["key"] == "flight.V_a_mps"
    assert not list(tmp_path.iterdir())


@pytest.mark.soak
def test_a_campaign_counts_what_compiled_code_and_jsbsim_flew(tmp_path):
    """Flights of 310 s are compiled from the first on; those that decide are flown again."""
    pytest.importorskip("numba")
    plan = plan_of(short((AEROSONDE,), 310.0, gains=["paper"]), START, runs=3)
    with ft.in_jsbsim():
        by_jsbsim = ft.run_campaign(plan, tmp_path / "out", runs=1, workers=1)
    done = ft.run_campaign(plan, tmp_path / "out", resume=True, workers=1)

    assert (by_jsbsim.compiled.flights, by_jsbsim.compiled.by_jsbsim) == (0, 1)
    assert (done.compiled.flights, done.compiled.by_jsbsim) == (2, 1)
    assert done.answer().values["compiled"]["flights"] == 2
    report = ft.report(tmp_path / "out").answer()
    assert report.values["compiled"] == done.answer().values["compiled"]
    assert "Compiled flights: 2, of which JSBSim flew" in " ".join(report.notes)
    assert ft.refly(tmp_path / "out", count=3).equal


def test_nobody_at_the_address_is_one_line(tmp_path):
    nobody = "--scheduler", "tcp://127.0.0.1:1", "--out", tmp_path / "out"

    _, said = flighttune("campaign", "first_campaign", *nobody, status=2)

    assert "tcp://127.0.0.1:1: no scheduler answers there: " in said.splitlines()[-1]
    assert not (tmp_path / "out").exists()
