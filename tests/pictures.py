"""Pictures of recordings in the headless viewer, and what is looked at in them."""

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from figures.screenshot import LAYOUTS, NEEDS_DRIVER, HeadlessViewer
from PIL import Image

import flighttune as ft

DEMANDED = os.environ.get("CI", "").lower() == "true"
"""Whether a machine that cannot draw fails the test instead of skipping it."""

FLAT = 3.0
"""Standard deviation of the pixels of a view that shows nothing but its ground."""


@contextmanager
def opened_recording(path: Path, *, tabs: bool = True) -> Iterator[HeadlessViewer]:
    """The viewer with the recording at `path`; the test is skipped where nothing can be drawn.

    With `tabs` also where this version of the viewer cannot be told which one to show.
    """
    if tabs:
        skip_without_tabs()
    try:
        opened = HeadlessViewer(path)
    except ft.RecordingError as error:
        if DEMANDED or NEEDS_DRIVER not in str(error):
            raise
        pytest.skip(str(error))
    with opened:
        yield opened


def skip_without_tabs() -> None:
    """Skip the test where the viewer cannot be told which tab to show."""
    if not LAYOUTS:
        pytest.skip("the client of Rerun 0.40 cannot choose a tab")


def pixels(png: bytes) -> np.ndarray:
    """Red, green and blue of a picture, shape (rows, columns, 3)."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
