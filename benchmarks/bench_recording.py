"""What a recording costs: columns against one call a step, and a long flight.

Run it with ``python benchmarks/bench_recording.py``; ``--json`` prints one object. Exit status 1 if
a limit is not kept.
"""

import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import rerun as rr
import running

from flighttune.base.signals import SIGNAL_UNITS
from flighttune.control.gains import PAPER_GAINS
from flighttune.flight.loop.run import Provenance, Run
from flighttune.flight.records.parquet import load_recording, parquet_bytes
from flighttune.outputs.recording.entities import TIMELINE
from flighttune.outputs.recording.record import write_recording

DT = 0.02
REPEATS = 1 if running.QUICK else 5
LIMITS = {"columns_600s_s": 1.0, "columns_600s_MB": 30.0}
"""Most that 600 s at 50 Hz with every signal (40 or more) may cost: s and MB."""

SCENARIO = {
    "flight": {"V_a_mps": 25.0, "g_mps2": 9.81},
    "limits": {"phi_deg": [-45.0, 45.0], "n_z": [-2.1, 2.1]},
}


def made_up(gains_name: str, seconds: float) -> Run:
    """Return a smooth flight with every signal that a run may hold."""
    t = np.arange(round((0.02 if running.QUICK else 1.0) * seconds / DT) + 1) * DT
    names = list(SIGNAL_UNITS)
    slow = np.linspace(0.01, 0.05, len(names))
    values = 0.3 * np.sin(2.0 * np.pi * slow * t[:, None] + np.arange(len(names)))
    signals = pd.DataFrame(values, columns=pd.Index(names), index=pd.Index(t, name="t"))
    signals["V_a"] = 25.0
    signals["north"] = 500.0 * np.sin(0.01 * t)
    signals["east"] = 25.0 * t / 3.0
    signals["down"] = -1.0 * t
    for name in ("phi_limited", "n_z_limited"):
        signals[name] = (signals[name] > 0.2).astype(float)
    made = Provenance(
        scenario=SCENARIO,
        plant="jsbsim:aerosonde",
        gains_name=gains_name,
        gains=PAPER_GAINS,
        seed=1,
        versions={},
        wall_s=0.0,
    )
    return Run(signals=signals, status="completed", reason="", provenance=made)


def by_steps(runs: list[Run], path: Path) -> None:
    """Log the signals of `runs` the plain way: one call a step and signal."""
    stream = rr.RecordingStream("flighttune-bench")
    stream.save(path)
    for run in runs:
        for t, row in zip(run.signals.index, run.signals.to_numpy(), strict=True):
            stream.set_time(TIMELINE, duration=float(t))
            for name, value in zip(run.signals.columns, row, strict=True):
                stream.log(f"{run.provenance.gains_name}/{name}", rr.Scalars(value))
    stream.disconnect()


def best(task, *, repeats: int = REPEATS) -> float:
    """Return the shortest of some wall times of `task`, s."""
    taken = []
    for _ in range(repeats):
        started = time.perf_counter()
        task()
        taken.append(time.perf_counter() - started)
    return min(taken)


def measured(folder: Path) -> dict[str, float]:
    """Return times (s), sizes (MB) and the ratio."""
    scenario = [made_up(f"gains{k}", 20.0) for k in range(4)]
    long = [made_up("gains", 600.0)]
    path = folder / "bench.rrd"

    def columns(runs: list[Run]) -> None:
        write_recording(runs, path, page="# Benchmark\n", title="Benchmark")

    started = time.perf_counter()
    columns(scenario)
    found = {"first_write_s": time.perf_counter() - started}
    found["columns_4x20s_s"] = best(lambda: columns(scenario))
    found["columns_4x20s_MB"] = path.stat().st_size / 1e6
    found["steps_4x20s_s"] = best(lambda: by_steps(scenario, folder / "steps.rrd"), repeats=1)
    found["steps_over_columns"] = found["steps_4x20s_s"] / found["columns_4x20s_s"]
    found["columns_600s_s"] = best(lambda: columns(long))
    found["columns_600s_MB"] = path.stat().st_size / 1e6
    half_an_hour = [made_up("gains", 1800.0)]
    found["columns_1800s_s"] = best(lambda: columns(half_an_hour), repeats=2)
    found["columns_1800s_MB"] = path.stat().st_size / 1e6
    dozen = [made_up(f"gains{k}", 60.0) for k in range(12)]
    found["columns_12x60s_s"] = best(lambda: columns(dozen), repeats=2)
    found["columns_12x60s_MB"] = path.stat().st_size / 1e6
    run = folder / "bench.parquet"
    found["parquet_600s_s"] = best(lambda: run.write_bytes(parquet_bytes(long[0])))
    found["parquet_600s_MB"] = run.stat().st_size / 1e6
    found["read_600s_s"] = best(lambda: load_recording(run))
    return found


def main() -> int:
    """Measure, print, and hold against the limits."""
    parser = running.options(__doc__)
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = measured(Path(folder))
    return running.judged(found, LIMITS, as_json=wanted.json)


if __name__ == "__main__":
    running.end(main)
