"""Recordings in a browser at the speed of the clock: they open with the layout they are sent with.

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
from pictures import opened_recording, pixels

import flighttune as ft

from .test_view import COMMAND, DISPLAYS, pair_of_ports

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
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("in_browser")
    names = ("paper", "circuit")
    flown = [ft.fly(ft.load_scenario(name)) for name in names]
    return [ft.record(flown[k], folder / names[k]).recording for k in range(2)]


@pytest.fixture(scope="module")
def overview(recordings):
    """The word as the viewer without a browser draws it."""
    with opened_recording(recordings[0], tabs=False) as opened:
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


@pytest.mark.counts
def test_recordings_open_in_a_browser_on_their_overview(recordings, overview, tmp_path):
    """One after the other."""
    with chromium_at_real_speed(SIZE) as tab:
        for place in (1, 0):
            with served(recordings[place]) as url:
                assert opens_with(tab, url, overview, tmp_path / f"{place}.png"), place
