"""Damaged logs of every kind end in one line or in a run: no fault, no hang, bounded memory."""

import random
import resource
import time
from contextlib import suppress

import numpy as np
import pytest
from fuzzing import NUMBERS, TEXTS, damaged
from log_files import sampled, write_csv, write_dataflash, write_tlog, write_ulog

import flighttune as ft

WRITERS = {"x.ulg": write_ulog, "x.bin": write_dataflash, "x.tlog": write_tlog, "x.csv": write_csv}
FEW, MANY = 12, 1200
GAPS = 20  # of so many logs that are read one is flown, which takes seconds
LONGEST_S = 60.0
MOST_KB = 1_300_000
"""Memory of a child, kB."""


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    (run,) = ft.fly("level_turn", "paper", changes={"flight.duration_s": 6.0, "expect": []}).runs[
        :1
    ]
    t, signals = sampled(run, noise=False, dropouts=False, late=False)
    return {name: write(folder / name, t, signals).read_bytes() for name, write in WRITERS.items()}


def changed_table(data, draw):
    """A table with one value of a row, or of all rows, in place of a number."""
    head, *rows = [line.split(",") for line in data.decode().splitlines()]
    other, column = str(draw.choice([*NUMBERS, *TEXTS])), draw.randrange(len(head))
    for row in draw.choice([rows, [draw.choice(rows)]]):
        row[column] = other
    lines = "\n".join(",".join(row) for row in [head, *rows])
    return lines.encode("utf-8", "surrogatepass")


def try_damages(originals, folder, count, seed):
    draw, read = random.Random(seed), 0
    for k in range(count):
        kind = draw.choice([*originals])
        path = folder / kind
        data = originals[kind]
        if kind.endswith(".csv") and draw.random() < 0.7:
            data = changed_table(data, draw)
        for _ in range(draw.choice([1, 1, 3, 20])):
            _, data = damaged(data, draw) if data else ("", data)
        path.write_bytes(data)
        began = time.monotonic()
        said = ""
        try:
            run = ft.load_log(path)
        except ft.InputError as error:
            said = str(error)
        else:
            read += 1
            assert np.isfinite(run.t).all(), (seed, k, kind)
            if read % GAPS == 1:
                with suppress(ft.FlightTuneError):
                    gap = ft.gap(run, aircraft="aerosonde")
                    assert gap.notes or np.isfinite(gap.explained), (seed, k, kind)
        assert "\n" not in said, (seed, k, kind)
        assert time.monotonic() - began < LONGEST_S, (seed, k, kind)
    return read


@pytest.mark.parametrize(
    "count",
    [pytest.param(FEW, marks=pytest.mark.soak), pytest.param(MANY, marks=pytest.mark.counts)],
)
def test_damaged_logs_are_refused_in_one_line_or_read(originals, tmp_path, count):
    read = try_damages(originals, tmp_path, count, seed=count)

    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    assert count == FEW or (read > count // 4 and most < MOST_KB)  # damage may matter little
