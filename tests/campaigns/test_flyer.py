"""The process that flies: what is told where it cannot start."""

import sys

import pytest

import flighttune as ft
from flighttune.campaigns.engine.flyer import Flyer


def test_a_process_that_cannot_start_names_the_file_that_it_needs(tmp_path, monkeypatch):
    python = tmp_path / "python"
    python.touch(mode=0o600)  # no one may run it
    monkeypatch.setattr(sys, "executable", str(python))

    with pytest.raises(ft.loop.PlantError, match=f"^{python}: the process that flies must start"):
        Flyer()
