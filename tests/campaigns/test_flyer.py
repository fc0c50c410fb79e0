"""The process that flies: what is told where it cannot start, and what it keeps."""

import fcntl
import gc
import sys
import tempfile
import weakref
from contextvars import copy_context

import pytest

import flighttune as ft
from flighttune.campaigns.engine import server
from flighttune.campaigns.engine.flyer import Flyer, work_of


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
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(ft.loop.PlantError):
            Flyer()

    assert [left.exists(), used.exists(), other.exists()] == [False, True, True]


def test_a_process_keeps_nothing_of_the_plans_before():
    class Left:
        """Garbage that only a collection finds."""

    gc.disable()
    try:
        left = Left()
        left.itself, kept = left, weakref.ref(left)
        gc.freeze()  # as after the plan before
        del left
        server.prepared.cache_clear()
        server.warm.cache_clear()
        work = work_of(ft.plan_campaign(ft.load_campaign("first_campaign"), runs=1), {})
        copy_context().run(server.warm, work)  # a process takes over the permission of its command
    finally:
        gc.unfreeze()
        gc.enable()
        server.prepared.cache_clear()
        server.warm.cache_clear()

    assert kept() is None
