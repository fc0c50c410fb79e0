"""What all tests share: settings of property tests, aircraft that are trusted, garbage left alone.

Property tests judge results, not the clock, and try the same cases every time.
"""

import gc
import os

from hypothesis import settings

from flighttune.files.shipped import TRUST_AIRCRAFT

settings.register_profile("here", deadline=None, derandomize=True, database=None)
settings.load_profile("here")

# The aircraft of the tests are ours: a trial of each copy would cost 0.3 s.
os.environ[TRUST_AIRCRAFT] = "1"
os.environ.pop("COLUMNS", None)  # a worker of xdist has the width of a terminal there is not


def pytest_configure(config):
    """No search for garbage while tests are collected, which xdist leaves to its workers."""
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        gc.disable()


def pytest_collection_finish():
    """What has been collected stays to the end: no search among it either."""
    gc.freeze()
    gc.enable()
