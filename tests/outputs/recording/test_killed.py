"""A command that is killed while it writes a folder: what it leaves, and flying into it again."""

from pathlib import Path

import pytest
from made_up import shortened

import flighttune as ft

pytestmark = pytest.mark.slow


class Killed(BaseException):
    """Stands for SIGKILL: nothing after it is done, not even clearing up."""


@pytest.fixture(scope="module")
def flights():
    """A short flight of two gain sets, and the same with a longer one of them."""
    changes = {"plant": [{"kind": "kinematic"}], "gains": ["paper", "K1"]}
    return [ft.fly(shortened("paper", seconds, **changes)) for seconds in (2.0, 3.0)]


# Before a file has its name there is what the step before it left.
STAGES = [
    *((name, "write_bytes", part) for name in ("paper", "K1", "rrd") for part in (0.5, 1.0)),
    *((name, "replace", 1.0) for name in ("rrd", "K1", "paper")),
]


def killed(monkeypatch, flown, folder, name, step, part):
    """Record into `folder`, and end at a step of the file with `name` in its name."""
    real = getattr(Path, step)

    def stop(path, argument):
        if name not in path.name:
            return real(path, argument)
        real(path, argument[: int(part * len(argument))] if step == "write_bytes" else argument)
        raise Killed

    with monkeypatch.context() as patched:
        patched.setattr(Path, step, stop)
        patched.setattr(Path, "unlink", lambda *_, **__: None)
        with pytest.raises(Killed):
            ft.record(flown, folder, name="flight")


def durations(folder):
    return {run.duration for run in ft.load(folder).runs}


@pytest.mark.counts
@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: "-".join(map(str, stage)))
def test_a_second_flight_that_is_killed_is_not_mixed_with_the_first(
    flights, stage, tmp_path, monkeypatch
):
    first, second = flights
    files = ft.record(first, tmp_path, name="flight")

    killed(monkeypatch, second, tmp_path, *stage)

    recording = ft.load(tmp_path)
    (duration,) = {run.duration for run in recording.runs}
    every = {path: ft.load(path).runs[0].duration for path in files.signals.values()}
    others = [path for path, other in every.items() if other != duration]
    is_ = "is" if len(others) == 1 else "are"
    lost = [f"{tmp_path}: {len(others)} of 2 runs {is_} missing"] if others else []
    assert sorted(recording.missing) == sorted(
        [*lost, *(f"{path}: of another flight" for path in others)]
    )
    ft.record(second, tmp_path, name="flight")
    assert durations(tmp_path) == {3.0}
    assert ft.load(tmp_path).missing == ()


def test_nothing_has_its_name_where_one_file_cannot_be_written(flights, tmp_path):
    (tmp_path / "flight.rrd").mkdir()

    with pytest.raises(ft.InputError, match=r"flight\.rrd: must be writable"):
        ft.record(flights[0], tmp_path, name="flight")

    assert [path.name for path in tmp_path.iterdir()] == ["flight.rrd"]
