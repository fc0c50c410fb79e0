"""Property tests judge results, not the clock, and try the same cases every time."""

import gc
import os

from hypothesis import settings

from flighttune.shipped import TRUST_AIRCRAFT

settings.register_profile("here", deadline=None, derandomize=True, database=None)
settings.load_profile("here")

# The aircraft of the tests are ours: a trial of each copy would cost 0.3 s.
os.environ[TRUST_AIRCRAFT] = "1"
os.environ.pop("COLUMNS", None)  # a worker of xdist has the width of a terminal there is not


def pytest_configure():
    """No search for garbage while tests are collected, nor later among what stays to the end."""
    gc.disable()


def pytest_collection_finish():
    gc.freeze()
    gc.enable()
