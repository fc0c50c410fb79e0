"""What all tests share: settings of property tests, aircraft that are trusted, garbage left alone.

Property tests judge results, not the clock, and try the same cases every time.
"""

import gc
import os

import pytest
from hypothesis import settings

settings.register_profile("here", deadline=None, derandomize=True, database=None)
settings.load_profile("here")

# The aircraft of the tests are ours: a trial of each copy would cost 0.3 s.
os.environ["FLIGHTTUNE_TRUST_AIRCRAFT"] = "1"
os.environ["PYTHON_CPU_COUNT"] = "1"  # the other workers of xdist use the other cores
os.environ.pop("COLUMNS", None)  # a worker of xdist has the width of a terminal there is not


def pytest_configure(config):
    """No search for garbage while tests are collected, which xdist leaves to its workers."""
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        gc.disable()


def pytest_ignore_collect(collection_path, config):
    """`make soak` runs a few tests of each tenth file: it imports only files that have any."""
    few = config.option.markexpr.startswith("soak") and collection_path.suffix == ".py"
    return True if few and "mark.soak" not in collection_path.read_text() else None


def pytest_collection_finish():
    """What has been collected stays to the end: no search among it either."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def counted():
    """A band of half a second of a turn, which 5 of its 29 flights leave; no test changes it."""
    from counted_turns import count

    return count()
