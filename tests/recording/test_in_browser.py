"""A recording in a browser at the speed of the clock: it opens with the layout that it has.

The viewer makes a layout of its own while data stream in, unless the one of the recording is active
before. With virtual time data are there before the viewer looks, and either opens well.
"""

import os
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

import numpy as np
import pytest
from browser import chromium_at_real_speed
from fuzzing import first_or_all
from pictures import opened_recording, pixels

import flighttune as ft
from flighttune.recording.record import DISPLAYS

from .test_view import COMMAND, pair_of_ports

pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(sys.platform != "linux", reason="chromium is started by bash, with pipes"),
]

SIZE = (1000, 600)
WORD = np.s_[42:60, 28:86]
"""Rows and columns of the word *Overview* on the first tab in the viewer without a browser."""

SHIFT = 4  # pixels by which the browser may draw the word elsewhere
SAME_WORD = 0.9
"""Correlation of two drawings of one word, in any colours; with other text it is below 0.65."""

LONGEST_S, REST_S = 180.0, 2.0


@pytest.fixture(scope="module")
def overview(tmp_path_factory):
    """The word as the viewer without a browser draws it, on a recording of another flight."""
    flown = ft.fly(ft.load_scenario("paper_as_printed"))
    recording = ft.record(flown, tmp_path_factory.mktemp("overview")).recording
    with opened_recording(recording, tabs=False) as opened:
        return pixels(opened.picture()).mean(axis=2)[WORD]


@contextmanager
def served(recording):
    """Address of the page that `flighttune view` serves, while it runs."""
    port = pair_of_ports()
    environment = {name: os.environ[name] for name in os.environ if name not in DISPLAYS}
    command = [*COMMAND, str(recording), "--port", str(port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as running:
        try:
            yield running.stdout.readline().split()[1]
        finally:
            running.terminate()


def has_word(png, word):
    """Whether a picture has a word where the viewer without a browser has it."""
    grey, (rows, columns) = pixels(png).mean(axis=2), WORD
    shifts = [(i, j) for i in range(-SHIFT, SHIFT + 1) for j in range(-SHIFT, SHIFT + 1)]
    parts = [
        grey[rows.start + i : rows.stop + i, columns.start + j : columns.stop + j]
        for i, j in shifts
    ]
    alike = [abs(np.corrcoef(word.ravel(), part.ravel())[0, 1]) for part in parts if part.std() > 1]
    return max(alike, default=0.0) > SAME_WORD


def opens_with(tab, url, word, file):
    """Whether a page shows the word at last, and still does a while later."""
    end, png = time.monotonic() + LONGEST_S, b""
    while time.monotonic() < end:
        # A page that chromium does not draw is opened anew.
        with suppress(TimeoutError), tab(url) as picture:
            while time.monotonic() < end:
                time.sleep(1.0)
                if (png := picture()) and has_word(png, word):
                    time.sleep(REST_S)
                    file.write_bytes(picture() or png)
                    return has_word(file.read_bytes(), word)
    file.write_bytes(png)
    return False


# the longer one first, whose data stream in for longer
@pytest.mark.parametrize("name", first_or_all(["circuit", "paper"]))
def test_a_recording_opens_in_a_browser_on_its_overview(name, overview, tmp_path):
    recording = ft.record(ft.fly(ft.load_scenario(name)), tmp_path / name).recording
    with chromium_at_real_speed(SIZE) as tab, served(recording) as url:
        assert opens_with(tab, url, overview, tmp_path / f"{name}.png")
