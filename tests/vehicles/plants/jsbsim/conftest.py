"""Flights of the Aerosonde, and copies of its folder that can be broken."""

import math
import re
import shutil
from contextlib import suppress

import numpy as np
import pytest
from airframes import of_this_model
from places import SHIPPED_AIRCRAFT

import flighttune as ft


class Flight:
    """Signals of one flight as arrays over time, and why it ended."""

    def __init__(self, names, rows, dt, stop):
        self.signals = dict(zip(names, np.array(rows).T, strict=True))
        self.t = dt * np.arange(len(rows))
        self.stop = stop

    def __getitem__(self, name):
        return self.signals[name]


@pytest.fixture
def fly():
    def fly(
        command, *, duration, dt=0.02, aircraft="aerosonde", weather=None, ground=0.0, seed=0,
        throttle_max=None, **condition,
    ):  # fmt: skip
        """Fly `command` (a function of the signals now, or a constant) from `condition`."""
        plant = ft.loop.JSBSimPlant(
            aircraft, weather=weather, ground=ground, seed=seed, throttle_max=throttle_max
        )
        plant.start(ft.loop.FlightCondition(**{"V_a": 25.0} | condition))
        rows, stop = [plant.observe()], None
        for _ in range(round(duration / dt)):
            now = dict(zip(plant.signals, rows[-1], strict=True))
            phi_cmd, n_z_cmd = command(now) if callable(command) else command
            stop = plant.advance(phi_cmd, n_z_cmd, dt)
            rows.append(plant.observe())
            if stop is not None:
                break
        return Flight(plant.signals, rows, dt, stop)

    return fly


@pytest.fixture
def holding_gamma():
    """Command `phi_cmd` with the load factor that keeps the flight-path angle in that bank."""

    def holding(phi_cmd):
        return lambda now: (phi_cmd, math.cos(now["gamma"]) / math.cos(now["phi"]))

    return holding


@pytest.fixture
def changed_aircraft(tmp_path):
    def changed(file, pattern, replacement, *, aircraft="aerosonde"):
        """Return a copy of an aircraft's folder with one text in `file` replaced."""
        folder = tmp_path / "copy"
        if not folder.exists():
            shutil.copytree(SHIPPED_AIRCRAFT / aircraft, folder)
        text, count = re.subn(pattern, replacement, (folder / file).read_text(), count=1)
        assert count == 1, f"{pattern} is not in {file}"
        (folder / file).write_text(text)
        with suppress(ft.FlightTuneError):  # of a file that is broken on purpose
            of_this_model(folder)
        return folder

    return changed
