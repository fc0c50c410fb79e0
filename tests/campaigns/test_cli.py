"""``campaign`` as a user meets it: stdout, stderr, an exit status, and Ctrl-C."""

import json
import os
import pty
import signal
import subprocess
import sys
from contextlib import suppress

import pytest
from commands import answer, flighttune
from flown_campaigns import (
    bits,
    children,
    flying,
    gone,
    some_parts,
    table_flown,
    wait_until,
    write_campaign,
)
from fuzzing import first_or_all

import flighttune as ft

# real clusters, processes that are killed
pytestmark = pytest.mark.slow

RUNS = 80
SEARCHES = [
    "worst first_campaign --budget 100000",
    "band random_starts",
    "meet paper_identified --campaign robust_tuning",
]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return write_campaign(tmp_path_factory.mktemp("files"), runs=RUNS)


@pytest.mark.soak
def test_one_json_object_says_what_was_flown(tmp_path, file, address):
    out = tmp_path / "out"

    done = answer("campaign", file, "--runs", 8, "--scheduler", address, "--out", out)

    assert done.keys() >= {"runs", "completed", "failed", "crashed", "wall_s", "rate_per_s"}
    assert (done["runs"], done["planned"], done["crashed"]) == (8, 8, 0)
    assert done["completed"] + done["failed"] == 8
    assert done["dataset"] == str(out)
    assert done["rate_per_s"] == pytest.approx(8 / done["wall_s"], rel=1e-12)
    success = ft.load(out).rows().column("success").to_pylist()
    assert (len(success), sum(success)) == (8, done["succeeded"])

    _, said = flighttune("campaign", file, "--out", out, status=2)
    assert said.startswith(f"flighttune: {out}: must not hold a campaign, got one of 8 runs")


@pytest.mark.soak
def test_gains_of_a_file_are_flown_by_workers_elsewhere_resumed_and_kept(
    tmp_path, address, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    file, out, gains = write_campaign(tmp_path, runs=4), tmp_path / "out", tmp_path / "mine.json"
    gains.write_text('{"K_P": [[2, 0], [0, 2]], "K_I": [[1, 0], [0, 1]]}')
    chosen = "--gains", "mine.json", "--set", "flight.V_a_mps=26.5", "--out", out
    command = "campaign", file, *chosen, "--scheduler", address

    answer(*command, "--runs", 8)
    resumed = answer(*command, "--runs", 12, "--resume")
    as_long = answer(*command, "--resume")
    gains.unlink()
    again = answer("verify", out, "--run", 11, cwd=tmp_path)

    assert (resumed["runs"], resumed["flown"]) == (12, 4)
    assert (as_long["runs"], as_long["flown"]) == (12, 0)
    assert again["equal"]
    assert again["runs"][0]["run"] == "run 11: kinematic / mine, draw 5"
    assert ft.load(out).plan.scenario.flight.V_a_mps == 26.5


@pytest.mark.soak
def test_a_bar_shows_how_far_it_is_where_someone_watches(tmp_path, file, address):
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "flighttune", "campaign", str(file), "--runs", "8",
               "--scheduler", address, "--out", str(tmp_path)]  # fmt: skip
    terminal = {"stderr": theirs, "env": {**os.environ, "COLUMNS": "120", "TERM": "xterm"}}
    seen = b""
    with subprocess.Popen(command, stdout=subprocess.PIPE, **terminal) as process:
        os.close(theirs)
        with suppress(OSError):  # the other end is closed
            while chunk := os.read(ours, 4096):
                seen += chunk
        assert process.wait() == 0
    os.close(ours)
    assert b"flying" in seen
    assert b"of 8 runs" in seen


@pytest.mark.soak
def test_ctrl_c_ends_it_and_resume_goes_on(tmp_path, file, address):
    out = tmp_path / "out"
    with flying(file, "--out", out, "--workers", 2, "--json") as command:
        some_parts(out)
        command.suspend()  # so that it cannot have flown everything before the signal comes
        below = children(command)
        os.killpg(command.pid, signal.SIGINT)
        command.resume()
        assert command.wait(timeout=240) == 130
        wait_until(lambda: gone(below))
        shown, said = command.communicate()
    there = ft.load(out).rows()
    assert json.loads(shown)["interrupted"]
    assert "Traceback" not in said
    assert said.splitlines()[-1] == (
        f"flighttune: {file}: interrupted, {len(there)} of {RUNS} runs are in {out}; go on with "
        "the same command and --resume"
    )

    ours = ft.plan_campaign(ft.load_campaign(file))
    ft.run_campaign(ours, out, scheduler=address, resume=True)
    assert bits(ft.load(out).rows()) == bits(table_flown(ours))


@pytest.mark.soak
@pytest.mark.parametrize("command", first_or_all(SEARCHES))
def test_ctrl_c_ends_a_search_which_says_that_it_keeps_nothing(tmp_path, command):
    with flying(command=command.split(), cwd=tmp_path) as process:
        before = []
        while "runs" not in (line := process.stderr.readline()):  # that flights have begun
            assert line, before
            before.append(line)
        os.killpg(process.pid, signal.SIGINT)
        shown, said = process.communicate(timeout=240)

    assert (process.returncode, shown) == (130, "")
    assert "kept" not in "".join(before)
    assert said.splitlines()[-1] == (
        "flighttune: interrupted: its flights are not kept, and nothing is written"
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.soak
def test_a_dry_run_shows_plan_cost_and_room_and_writes_nothing(tmp_path, file):
    found = answer("campaign", file, "--dry-run", "--workers", 3, "--runs", 4002, cwd=tmp_path)

    assert (found["runs"], found["draws"], found["design"]) == (4002, 1001, "random")
    assert found["notes"][0] == ("4002 flights = 1000.5 draws, each by 2 gain sets on 2 plants")
    plants = [group["plant"] for group in found["groups"]]
    assert plants == ["jsbsim:aerosonde", "jsbsim:aerosonde", "kinematic", "kinematic"]
    assert all(group["run_s"] > 0.0 for group in found["groups"])
    assert found["disperse"][0]["key"] == "flight.V_a_mps"
    assert found["wall_s"] == pytest.approx(found["core_s"] / 3, rel=1e-12)
    assert found["rows_bytes"] > 4002 * 45
    assert found["signals_bytes"] > 10_000
    assert found["keep"]["failures"] == 2
    assert not list(tmp_path.iterdir())


def test_nobody_at_the_address_is_one_line(tmp_path, file):
    nobody = "--scheduler", "tcp://127.0.0.1:1", "--out", tmp_path / "out"

    _, said = flighttune("campaign", file, *nobody, status=2)

    assert "tcp://127.0.0.1:1: no scheduler answers there: " in said.splitlines()[-1]
