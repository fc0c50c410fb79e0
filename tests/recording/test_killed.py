"""A command that is killed while it writes a folder: what it leaves, and flying into it again."""

from dataclasses import replace
from pathlib import Path

import pytest

from flighttune.errors import OutputError, RecordingError
from flighttune.flight.fly import fly
from flighttune.recording.load import load_recording
from flighttune.recording.record import record
from flighttune.scenario import load_scenario, scenario_from

pytestmark = pytest.mark.slow


class Killed(BaseException):
    """Stands for SIGKILL: nothing after it is done, not even clearing up."""


@pytest.fixture(scope="module")
def flights():
    """A short flight of two gain sets, and the same with a longer one of them."""
    tables = load_scenario("paper").as_dict()
    tables |= {"plant": [{"kind": "kinematic"}], "gains": ["paper", "K1"], "expect": []}
    found = []
    for duration in (2.0, 3.0):
        tables["flight"] = {**tables["flight"], "duration_s": duration}
        found.append(fly(scenario_from(tables)))
    return found


STAGES = [
    *((name, "write_bytes", half) for name in ("paper", "K1", "rrd") for half in (0.0, 0.5, 1.0)),
    *((name, "replace", after) for name in ("rrd", "K1", "paper") for after in (0.0, 1.0)),
]


def killed(monkeypatch, flown, folder, name, step, part):
    """Record into `folder`, and end at a step of the file with `name` in its name."""
    real = getattr(Path, step)

    def stop(path, argument):
        if name not in path.name:
            return real(path, argument)
        if step == "write_bytes":
            real(path, argument[: int(part * len(argument))])
        elif part:
            real(path, argument)
        raise Killed

    with monkeypatch.context() as patched:
        patched.setattr(Path, step, stop)
        patched.setattr(Path, "unlink", lambda *_, **__: None)
        with pytest.raises(Killed):
            record(flown, folder, name="flight")


def durations(folder):
    return {run.duration for run in load_recording(folder).runs}


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: "-".join(map(str, stage)))
def test_a_folder_is_read_and_flown_into_again_after_a_kill(flights, stage, tmp_path, monkeypatch):
    _, flown = flights

    killed(monkeypatch, flown, tmp_path, *stage)

    if any(tmp_path.glob("[!.]*")):
        assert durations(tmp_path) == {3.0}
    else:
        with pytest.raises(RecordingError, match="must hold a recording, got none"):
            load_recording(tmp_path)
    record(flown, tmp_path, name="flight")
    assert durations(tmp_path) == {3.0}
    assert load_recording(tmp_path).missing == ()


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: "-".join(map(str, stage)))
def test_a_second_flight_that_is_killed_is_not_mixed_with_the_first(
    flights, stage, tmp_path, monkeypatch
):
    first, second = flights
    files = record(first, tmp_path, name="flight")

    killed(monkeypatch, second, tmp_path, *stage)

    found = load_recording(tmp_path)
    duration = load_recording(files.recording).runs[0].duration
    others = [
        path for path in files.signals.values() if load_recording(path).runs[0].duration != duration
    ]
    assert {run.duration for run in found.runs} == {duration}
    assert sorted(found.missing) == sorted(
        f"{path}: of another flight than flight.rrd, which was read" for path in others
    )
    record(second, tmp_path, name="flight")
    assert durations(tmp_path) == {3.0}
    assert load_recording(tmp_path).missing == ()


def test_a_recording_whose_runs_are_all_in_parquet_misses_nothing(flights, tmp_path):
    files = record(flights[0], tmp_path, name="flight")
    flown = flights[0].runs[0]
    never = replace(flown, signals=flown.signals.iloc[:0], status="no_gains", reason="infeasible")
    record(replace(flights[0], runs=(*flights[0].runs, never)), tmp_path, name="flight")

    found = load_recording(tmp_path)

    assert found.missing == ()
    assert len(found.runs) == len(files.signals) + 1


def test_a_damaged_parquet_file_beside_a_recording_is_said(flights, tmp_path):
    files = record(flights[0], tmp_path, name="flight")
    path = next(iter(files.signals.values()))
    path.write_bytes(path.read_bytes()[:-1])

    found = load_recording(tmp_path)

    assert len(found.runs) == len(files.signals)
    assert found.missing[0].startswith(f"{path}: must be a Parquet file as it was written")


def test_nothing_has_its_name_where_one_file_cannot_be_written(flights, tmp_path):
    (tmp_path / "flight.rrd").mkdir()

    with pytest.raises(OutputError, match=r"flight\.rrd: must be writable, got is a directory"):
        record(flights[0], tmp_path, name="flight")

    assert [path.name for path in tmp_path.iterdir()] == ["flight.rrd"]
