"""`flighttune verify`: recordings that fly again to the same bits, and some that do not."""

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import flighttune
from made_up import run_file, run_folder, shortened

import flighttune as ft

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("refly")
    ft.record(ft.fly(shortened("paper", 3.0)), found, name="short")
    return found


def rewritten(folder, path, *, change):
    """A folder with the same runs, the last one changed."""
    *runs, last = ft.load(folder).runs
    return run_folder(path, *runs, change(last))


def with_gains(run, K_P):
    gains = replace(run.provenance.gains, K_P=K_P)
    return replace(run, provenance=replace(run.provenance, gains=gains))


def with_sample(run, t, signal, value):
    signals = run.signals.copy()
    signals.loc[t, signal] = value
    return replace(run, signals=signals)


@pytest.mark.soak
def test_the_last_bit_of_one_sample_is_found(folder, tmp_path):
    run = ft.load(folder).runs[-1]
    t, was = run.signals.index[77], run.signals["phi"].iloc[77]
    path = rewritten(
        folder,
        tmp_path / "changed",
        change=lambda run: with_sample(run, t, "phi", np.nextafter(was, 9.0)),
    )

    out, err = flighttune("verify", path, "--json", status=1)
    (changed,) = [run for run in json.loads(out)["runs"] if not run["equal"]]

    assert changed["run"] == run.label
    assert changed["differences"] == [
        {"what": "phi", "t": t, "recorded": float(np.nextafter(was, 9.0)), "reflown": was}
    ]
    assert err.startswith(f"flighttune: {path}: {run.label}: phi differs at t = 1.54 s: ")
    assert err.count("\n") == 1


def test_other_gains_are_told_before_what_came_of_them(folder, tmp_path):
    path = rewritten(folder, tmp_path / "gains", change=lambda run: with_gains(run, np.eye(2)))

    assert "K_P[0][0] differs: " in flighttune("verify", path, status=1)[1]


def test_a_run_of_fewer_samples_differs_in_their_number(folder, tmp_path):
    run = ft.load(folder).runs[0]
    path = run_file(tmp_path / "short.parquet", replace(run, signals=run.signals.iloc[:40]))

    assert "samples differs: " in flighttune("verify", path, status=1)[1]


def test_a_run_that_is_not_of_its_scenario_cannot_fly_again(folder, tmp_path):
    run = ft.load(folder).runs[0]
    strange = replace(run, provenance=replace(run.provenance, plant="ladder"))
    path = run_file(tmp_path / "strange.parquet", strange)

    _, err = flighttune("verify", path, status=2)

    assert err.startswith(f"flighttune: {path}: ladder / paper: ")


def test_runs_of_a_recording_are_not_drawn(folder):
    with pytest.raises(ft.InputError, match="`count` must be absent"):
        ft.refly(folder, count=2)
