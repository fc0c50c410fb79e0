"""Memory of long counts: little more than the numbers that are kept of their flights."""

import hashlib
import tracemalloc
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from made_up import made_up_scenario
from made_up_band import LEARNED, count_of, plan_of_paper

import flighttune as ft
from flighttune.base.files import load
from flighttune.campaigns.engine.progress import CampaignProgress
from flighttune.claims import counting, shape
from flighttune.claims.band import RecordedSignals

WINDOWS, SIGNALS = 200, RecordedSignals(units={"cross_track": "m", "height_err": "m"})
FLIGHTS = 1000


@contextmanager
def at_most(most):
    """The block must take at most so many bytes."""
    tracemalloc.start()
    yield
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < most


def counted(scores):
    """A count of one signal of the paper's law."""
    measured = RecordedSignals(units={"chi_err": "rad"})
    plan = plan_of_paper(made_up_scenario()).with_runs(LEARNED + len(scores))
    return count_of(ft.Band, plan, measured, 1.0, scores)


class Rows:
    """Rows of flights, in the order in which workers answer; one did not complete."""

    def rows(self, plan, runs, *, doing, probes):
        for run in sorted(runs, key=lambda run: run % 7):
            numbers = [float(run)] * (4 * WINDOWS)
            yield {"run": run} | ({} if run == 40 else {"extremes": numbers})


def test_rows_of_counted_flights_are_not_kept():
    """A row of 800 numbers has eight times the bytes of its numbers in single precision."""
    kept = counting.Kept(measured=SIGNALS, edges=np.arange(WINDOWS + 1.0), windy=False)
    runs, wanted = range(30, 30 + FLIGHTS), np.zeros((FLIGHTS, 4 * WINDOWS), np.float32)

    pool: Any = Rows()
    plan: Any = None
    with at_most(1.5 * wanted.nbytes):
        extremes, wind, navigation = counting._flown(pool, plan, kept, runs)

    wanted[:] = np.array(runs)[:, None]
    wanted[10] = np.ravel([kept.lost])
    assert (extremes.reshape(FLIGHTS, -1) == wanted).all()
    assert wind.shape == navigation.shape == (FLIGHTS, 0)


def test_a_file_is_hashed_without_a_copy_of_it(tmp_path):
    data, file = np.random.default_rng(1).bytes(2**22), tmp_path / "count.npz"
    file.write_bytes(b'"format": "flighttune band 1"' + data + load.BLANK.encode())
    wanted = load.seal(file.read_bytes())

    with at_most(0.6 * len(data)):
        load.seal_end(file)
    assert load.sealed_bytes(file, "band file") == wanted
    assert hashlib.sha256(wanted[: -len(load.BLANK)]).hexdigest().encode() == wanted[-64:]


def test_numbers_of_a_count_are_not_there_twice(monkeypatch):
    """Flown in tens, they are put in their places."""
    monkeypatch.setattr(counting, "AT_A_TIME", 10)
    monkeypatch.setattr(shape, "PART", 10)
    count = counted(np.ones(FLIGHTS // 4))
    empty = replace(count, extremes=count.extremes[:0], wind=count.wind[:0])
    pool: Any = SimpleNamespace(progress=CampaignProgress())

    def flown(runs):
        none = np.zeros((len(runs), 0))
        return np.ones((len(runs), *count.extremes.shape[1:]), np.float32), none, none

    with at_most(1.5 * count.extremes.nbytes):
        again = counting._counted(empty, pool, flown, None, None)

    assert again.extremes.shape == count.extremes.shape
    assert (again.extremes == 1.0).all()
