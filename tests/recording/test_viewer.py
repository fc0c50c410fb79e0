"""The recording as the viewer draws it, without a screen: no complaint, and no view empty."""

import io
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from flighttune.errors import RecordingError
from flighttune.flight import fly
from flighttune.palette import LIMIT, NEUTRAL, looks, rgb
from flighttune.recording.page import scenario_page
from flighttune.recording.plots import TABS
from flighttune.recording.rrd import write_recording
from flighttune.recording.screenshot import NEEDS_DRIVER, HeadlessViewer, screenshot
from flighttune.scenario import load_scenario

DEMANDED = os.environ.get("CI", "").lower() == "true"
"""Whether a machine that cannot draw fails the test instead of skipping it."""

FLAT = 3.0
"""Standard deviation of the pixels of a view that shows nothing but its ground."""

SAME_COLOUR = 14
"""Largest difference of a channel (of 255) between a colour and a pixel drawn in it."""

FEWEST_PIXELS = 25
"""Pixels of its own colour that a line which is not hidden has at least."""

LARGEST_PICTURE = 400_000
"""Bytes of a picture for the README."""

NEVER_HIDDEN = {"Course chi, reference grey [deg]", "Course error [deg]", "Path angle error [deg]"}
SCENE = "Paths and aircraft"

NOT_IN_CALM_FLIGHT = ("Weather", "Mismatch")
"""Tabs whose signals a flight in calm air does not have."""

EVERY_TAB = ["Overview", *TABS, "Certificate", "Eigenvalues", "Scenario and metrics"]


@pytest.fixture(scope="module")
def flown():
    return fly(load_scenario(Path(__file__).parents[2] / "scenarios" / "paper.toml"))


@pytest.fixture(scope="module")
def recording(flown, tmp_path_factory):
    page = scenario_page(
        flown.runs,
        scenario=flown.scenario.as_dict(),
        indicators={name: (found.R_K, found.I_K) for name, found in flown.indicators.items()},
        metrics=flown.metrics,
        flight=flown.flight,
    )
    path = tmp_path_factory.mktemp("viewer") / "paper.rrd"
    write_recording(flown.runs, path, page=page, title=flown.scenario.title)
    return path


@pytest.fixture(scope="module")
def viewer(recording):
    try:
        opened = HeadlessViewer(recording)
    except RecordingError as error:
        if DEMANDED or NEEDS_DRIVER not in str(error):
            raise
        pytest.skip(str(error))
    with opened:
        yield opened


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def count(picture, colour):
    return int((np.abs(picture - np.array(rgb(colour))).max(axis=2) <= SAME_COLOUR).sum())


def test_it_opens_at_the_start(viewer):
    assert viewer.cursor == 0.0


def test_the_tabs_are_in_order(viewer):
    calm = [tab for tab in EVERY_TAB if tab not in NOT_IN_CALM_FLIGHT]

    assert list(viewer.tabs) == calm


@pytest.mark.parametrize("at", [0.0, 4.4, 20.0])
@pytest.mark.parametrize("tab", EVERY_TAB)
def test_no_view_is_empty_and_nothing_is_complained_of(viewer, tab, at, flown, tmp_path):
    if tab in NOT_IN_CALM_FLIGHT:
        assert tab not in viewer.tabs
        return
    pairs = [(run.provenance.plant, run.provenance.gains_name) for run in flown.runs]

    viewer.show(tab, at=at)
    (tmp_path / "window.png").write_bytes(viewer.picture())
    views = {name: pixels(viewer.picture(view)) for name, view in viewer.views(tab).items()}

    assert viewer.complaints() == []
    for name, picture in views.items():
        assert picture.std() > FLAT, f"{name} is empty"
        if name in NEVER_HIDDEN or name == SCENE:
            for pair, look in looks(pairs).items():
                assert count(picture, look.colour) >= FEWEST_PIXELS, f"{pair} is not in {name}"
        if "reference grey" in name:
            assert count(picture, NEUTRAL) >= FEWEST_PIXELS
        if "limits red" in name:
            assert count(picture, LIMIT) >= FEWEST_PIXELS


def test_the_aircraft_move_in_both_cameras(viewer):
    views = viewer.views("Overview")
    scenes = [view for name, view in views.items() if name == SCENE or name.startswith("Behind")]
    seen = []
    for at in (0.0, 4.4, 20.0):
        viewer.show("Overview", at=at)
        assert viewer.cursor == at
        seen.append([pixels(viewer.picture(view)) for view in scenes])

    assert len(scenes) == 2
    for before, after in ((0, 1), (1, 2)):
        for a, b in zip(seen[before], seen[after], strict=True):
            assert np.abs(a - b).max() > 0
    assert viewer.complaints() == []


def test_the_whole_flight_is_in_the_picture(viewer, flown):
    viewer.show("Overview", at=0.0)
    picture = pixels(viewer.picture(viewer.views("Overview")[SCENE]))
    pairs = [(run.provenance.plant, run.provenance.gains_name) for run in flown.runs]
    drawn = np.zeros(picture.shape[:2], dtype=bool)
    for look in looks(pairs).values():
        drawn |= np.abs(picture - np.array(look.rgb)).max(axis=2) <= SAME_COLOUR
    rows, columns = np.nonzero(drawn)
    height, width = drawn.shape

    assert rows.min() > 0.05 * height
    assert rows.max() < 0.95 * height
    assert columns.min() > 0.03 * width
    assert columns.max() < 0.97 * width
    assert max(np.ptp(rows) / height, np.ptp(columns) / width) > 0.5


def test_a_tab_that_is_not_there_gives_one_line(viewer):
    with pytest.raises(RecordingError, match="the tab must be one of Overview, "):
        viewer.show("Weather")


@pytest.mark.usefixtures("viewer")
def test_a_single_run_and_a_page_alone_can_be_looked_at(four_runs, without_gains, tmp_path):
    for runs, tab, count in (([four_runs[0]], "Certificate", 2), ([without_gains], None, 1)):
        path = tmp_path / f"{len(runs[0].signals)}.rrd"
        write_recording(runs, path, page="# Page\n", title="Few")
        with HeadlessViewer(path) as opened:
            shown = tab or next(iter(opened.tabs))
            opened.show(shown)

            assert len(opened.views(shown)) == count
            assert opened.complaints() == []


@pytest.mark.usefixtures("viewer")
def test_a_picture_for_the_readme_is_small(recording, tmp_path):
    screenshot(recording, tmp_path / "flight.png", at=4.4, size=(1200, 800))

    with Image.open(tmp_path / "flight.png") as picture:
        assert picture.width == 1200
    assert (tmp_path / "flight.png").stat().st_size < LARGEST_PICTURE


@pytest.mark.usefixtures("viewer")
def test_a_viewer_that_breaks_off_gives_one_line(four_runs, tmp_path):
    path = tmp_path / "flight.rrd"
    write_recording(four_runs[:1], path, page="# \U0001f7e6\n", title="No such glyph")

    with (
        pytest.raises(RecordingError, match="No glyph for") as caught,
        HeadlessViewer(path) as opened,
    ):
        opened.show("Scenario and metrics")

    assert str(caught.value).startswith(f"{path}: the viewer must show it, got: ")
