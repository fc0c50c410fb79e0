"""What all tests share: settings of property tests, aircraft that are trusted, garbage left alone.

Property tests judge results, not the clock, and try the same cases every time.
"""

import gc
import os
from contextlib import chdir
from pathlib import Path

import pytest
from hypothesis import settings

from flighttune.base.processors import cores
from flighttune.campaigns.engine import flyer, pool
from flighttune.campaigns.engine.flyer import Flyer

settings.register_profile("here", deadline=None, derandomize=True, database=None)
settings.load_profile("here")

# The aircraft of the tests are ours: a trial of each copy would cost 0.3 s.
os.environ["FLIGHTTUNE_TRUST_AIRCRAFT"] = "1"
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


IDLE = []


class KeptFlyer(Flyer):
    """A flyer whose process flies for later tests too, which saves each five seconds of imports."""

    _clean = True

    def fly(self, work, draw):
        self._clean = False  # a process that is stopped may be about to answer
        answers = super().fly(work, draw)
        self._clean = True
        return answers

    def end(self):
        if self._clean and self._process.poll() is None:
            IDLE.append((self._process, self._pipe, self._scratch))
            return 0
        self._clean = True  # that of the process started in its place
        return self.end_process()

    def end_process(self):
        return super().end()

    def _start(self):
        if IDLE:
            self._process, self._pipe, self._scratch = IDLE.pop()
        else:
            with chdir(Path(__file__).parent):  # that of this test may be gone for later ones
                super()._start()


get_ready = flyer.get_ready
pool.Flyer = KeptFlyer
flyer.get_ready = lambda workers: None  # those that are kept are ready
pool.cores = lambda: 1  # the other workers of xdist use the other cores


@pytest.fixture
def own_workers(monkeypatch):
    """Workers as users have them: one for each core, whose processes end with the pool."""
    while IDLE:
        KeptFlyer().end_process()
    while (ready := flyer.take_ready()) is not None:  # a command before left it in its own folder
        ready.end()
    monkeypatch.setattr(pool, "Flyer", Flyer)
    monkeypatch.setattr(pool, "cores", cores)
    monkeypatch.setattr(flyer, "get_ready", get_ready)


@pytest.fixture(scope="session")
def counted():
    """A band of half a second of a turn, which 5 of its 29 flights leave; no test changes it."""
    from counted_turns import count

    return count()
