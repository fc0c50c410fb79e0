"""Twelve runs in wind in one recording: every tab, looked at without a screen."""

import io
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from figures.screenshot import HeadlessViewer
from pictures import opened_recording
from PIL import Image

import flighttune as ft
from flighttune.recording.page import scenario_page
from flighttune.recording.record import write_recording

from .conftest import SCENARIO, fly
from .test_viewer import IN_TURBULENCE, LAPTOP, assert_fits, views_drawn

pytestmark = pytest.mark.soak

REFERENCE = Path(__file__).with_name("reference")
SMALL = (160, 100)
"""Size of a reference picture, pixels."""

ALIKE = 6.0
"""Mean difference (of 255) of a small picture from its reference that drivers may make."""


def one(plant, number):
    gains = ft.PIGains(K_P=(0.7 + 0.1 * number) * ft.PAPER_GAINS.K_P, K_I=ft.PAPER_GAINS.K_I)
    lag = 0.25 if plant != "kinematic" else 0.0
    run = fly(plant, f"set{number}", gains, seconds=8.0, lag=lag)
    t = run.signals.index.to_numpy()
    wind = {"wind_north": 3.0 + np.sin(t), "wind_east": np.cos(t), "wind_down": 0.1 * np.sin(t)}
    return replace(run, signals=run.signals.assign(**wind))


@pytest.fixture(scope="module")
def twelve():
    return [one(plant, k) for k in range(6) for plant in ("kinematic", "jsbsim:aerosonde")]


@pytest.fixture(scope="module")
def recording(twelve, tmp_path_factory):
    path = tmp_path_factory.mktemp("crowd") / "crowd.rrd"
    page = scenario_page(twelve, scenario=SCENARIO)
    write_recording(twelve, path, page=page, title="Twelve runs")
    return path


@pytest.fixture(scope="module")
def viewer(recording):
    with opened_recording(recording) as opened:
        yield opened


def test_a_laptop_shows_all_twelve_names_and_numbers_on_every_axis(viewer, recording, twelve):
    with HeadlessViewer(recording, size=LAPTOP) as opened:
        opened.show("Overview", at=0.0)
        assert_fits(opened, twelve, "Overview")


@pytest.mark.parametrize("tab", ["Aircraft", "Weather"])
def test_every_view_shows_something_and_nothing_is_complained_of(viewer, tab):
    assert list(viewer.tabs) == IN_TURBULENCE
    viewer.show(tab, at=3.0)
    views_drawn(viewer, tab)


@pytest.mark.parametrize("tab", ["Overview"])
def test_a_tab_looks_as_before(viewer, tab, tmp_path):
    viewer.show(tab, at=3.0)
    with Image.open(io.BytesIO(viewer.picture())) as picture:
        small = picture.convert("RGB").resize(SMALL, Image.Resampling.BOX)
    path = REFERENCE / f"{tab.lower()}.png"
    if os.environ.get("FLIGHTTUNE_NEW_PICTURES"):
        REFERENCE.mkdir(exist_ok=True)
        small.save(path, optimize=True)
    small.save(tmp_path / path.name)

    with Image.open(path) as known:
        apart = np.abs(np.asarray(small, dtype=int) - np.asarray(known.convert("RGB"), dtype=int))
    assert apart.mean() < ALIKE
