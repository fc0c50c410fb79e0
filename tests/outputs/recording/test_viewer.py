"""The recording as the viewer draws it, without a screen: no complaint, and no view empty."""

import numpy as np
import pytest
from pictures import FLAT, opened_recording, pixels, skip_without_tabs

import flighttune as ft
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.drawing import palette

pytestmark = pytest.mark.slow

SAME_COLOUR = 14
"""Largest difference of a channel (of 255) between a colour and a pixel drawn in it."""

FEWEST_PIXELS = 25
"""Pixels of its own colour that a line which is not hidden has at least."""

ERRORS = ("chi error [deg]", "gamma error [deg]")
NEVER_HIDDEN = {"Course chi [deg]", *ERRORS}
HAS_COLOUR = {
    "Course chi [deg]": palette.NEUTRAL,
    "Path angle [deg]": palette.NEUTRAL,
    "Roll phi [deg]": palette.LIMIT,
    "n_z [1]": palette.LIMIT,
}
SCENE = "Paths and aircraft"

TABS = ["Overview", "Tracking", "Aircraft and air", "Law", "Scenario and metrics"]


@pytest.fixture(scope="module")
def flown():
    return ft.fly(ft.load_scenario("paper"))


@pytest.fixture(scope="module")
def recording(flown, tmp_path_factory):
    return ft.record(flown, tmp_path_factory.mktemp("viewer"), name="paper").recording


@pytest.fixture(scope="module")
def first_shown(recording):
    """The viewer, its first picture, and what it complains of by then."""
    with opened_recording(recording, tabs=False) as opened:
        yield opened, opened.picture(), opened.complaints()


@pytest.fixture(scope="module")
def viewer(first_shown):
    skip_without_tabs()
    return first_shown[0]


def count(picture, colour):
    """Pixels in a colour."""
    return int((np.abs(picture - np.array(palette.rgb(colour))).max(axis=2) <= SAME_COLOUR).sum())


def assert_all_drawn(runs, picture, where):
    for label, style in run_styles(runs).items():
        assert count(picture, style.colour) >= FEWEST_PIXELS, f"{label} is not in {where}"


@pytest.mark.soak
def test_every_version_of_the_viewer_draws_what_it_opens_with(flown, first_shown, tmp_path):
    _, window, complaints = first_shown
    (tmp_path / "window.png").write_bytes(window)

    assert_all_drawn(flown.runs, pixels(window), "the window")
    assert complaints == []


@pytest.mark.soak
def test_it_has_the_tabs_in_order_and_refuses_others(viewer):
    assert list(viewer.tabs) == TABS
    with pytest.raises(ft.RecordingError, match="Overview"):
        viewer.show("Weather")


def views_drawn(opened, tab):
    """Pictures of the views of a tab by their names; none is empty or lacks what it names."""
    views = {name: pixels(opened.picture(view)) for name, view in opened.views(tab).items()}
    for name, picture in views.items():
        assert picture.std() > FLAT, f"{name} is empty"
        if colour := HAS_COLOUR.get(name):
            assert count(picture, colour) >= FEWEST_PIXELS, f"{name} lacks its reference or limits"
    assert opened.complaints() == []
    return views


@pytest.mark.soak
def test_no_view_is_empty_and_nothing_is_complained_of(viewer, flown):
    viewer.show("Overview", at=4.4)
    views = views_drawn(viewer, "Overview")

    for name in views.keys() & {*NEVER_HIDDEN, SCENE}:
        assert_all_drawn(flown.runs, views[name], name)


@pytest.mark.soak
def test_the_aircraft_move_in_both_cameras(viewer):
    views = viewer.views("Overview")
    scenes = [view for name, view in views.items() if name == SCENE or name.startswith("Behind")]
    seen = []
    for at in (0.0, 20.0):
        viewer.show("Overview", at=at)
        assert viewer.cursor == at
        seen.append([viewer.picture(view) for view in scenes])

    assert len(scenes) == 2
    for before, after in zip(*seen, strict=True):
        assert np.abs(pixels(before) - pixels(after)).max() > 0
    assert viewer.complaints() == []
