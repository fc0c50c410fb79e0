"""The process that flies: what is told where it cannot start, and what it keeps."""

import gc
import sys
import tempfile
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context

import psutil
import pytest

import flighttune as ft
from flighttune.base.files import whole
from flighttune.campaigns.engine import flyer
from flighttune.campaigns.engine.flyer import Flyer, work_of
from flighttune.campaigns.engine.server import _prepared, _warm
from flighttune.campaigns.flying.rows import Draw


def test_a_process_that_cannot_start_names_the_file_that_it_needs(tmp_path, monkeypatch):
    python = tmp_path / "python"
    python.touch(mode=0o600)  # no one may run it
    monkeypatch.setattr(sys, "executable", str(python))

    with pytest.raises(ft.loop.PlantError, match=f"^{python}: the process that flies must start"):
        Flyer()


def test_folders_of_killed_processes_are_removed_and_those_in_use_stay(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no python"))
    left, used, other = (
        tmp_path / name for name in ("flighttune-left", "flighttune-used", "somebody-else")
    )
    for folder in (left, used, other):
        folder.mkdir()
        (folder / "lock").touch()

    with (used / "lock").open() as file:
        whole.lock(file)
        with pytest.raises(ft.loop.PlantError):
            Flyer()

    assert [left.exists(), used.exists(), other.exists()] == [False, True, True]


@pytest.mark.soak
@pytest.mark.parametrize("again", [False, True], ids=["once", "each of them"])
def test_a_process_that_is_stopped_before_it_answers_ends_in_time(monkeypatch, again):
    """By a debugger, a freezer or a drive that hangs: it cannot end itself."""
    work = work_of(ft.plan_campaign(ft.load_campaign("first_campaign"), runs=2), {})
    monkeypatch.setattr(flyer, "PREPARE_S", 2.0 if again else 20.0)
    known = {*psutil.Process().children()}
    flying = Flyer()

    def stop():
        while not (new := {*psutil.Process().children()} - known):
            time.sleep(0.01)
        known.update(new)
        new.pop().suspend()

    stop()
    with ThreadPoolExecutor(2) as threads:
        answers = threads.submit(flying.fly, work, Draw((0,), None))
        if again:
            monkeypatch.setattr(flyer, "GRACE_S", 2.0)
            threads.submit(stop)
            with pytest.raises(ft.loop.PlantError, match="longer than `time_limit_s`"):
                answers.result(60.0)
        else:
            (row,) = answers.result(120.0)
            assert row["status"] == "completed"
    flying.end()


def test_a_process_keeps_nothing_of_the_plans_before():
    class Left:
        """Garbage that only a collection finds."""

    gc.disable()
    try:
        left = Left()
        left.itself, kept = left, weakref.ref(left)
        gc.freeze()  # as after the plan before
        del left
        _prepared.cache_clear()
        _warm.cache_clear()
        work = work_of(ft.plan_campaign(ft.load_campaign("first_campaign"), runs=1), {})
        copy_context().run(_warm, work)  # a process takes over the permission of its command
    finally:
        gc.unfreeze()
        gc.enable()
        _prepared.cache_clear()
        _warm.cache_clear()

    assert kept() is None
