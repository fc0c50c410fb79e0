"""The log of an hour against its library: all of `load_log` over reading the same fields alone.

Run it with ``python benchmarks/bench_logs.py``; ``--json`` prints one object. Exit status 1 if a
ratio is above `MAX_RATIO`. The logs are written here, by the writers of the tests.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import running
from pymavlink.DFReader import DFReader_binary
from pymavlink.mavutil import mavlogfile
from pyulog import ULog

import flighttune as ft

sys.path.append(str(Path(__file__).parents[1] / "tests"))

from log_files import write_csv, write_dataflash, write_tlog, write_ulog

SECONDS = 30.0 if running.QUICK else 3600.0
RATE = 25.0
MAX_RATIO = {"ulg": 4.0, "bin": 2.0, "tlog": 2.0, "csv": 15.0}
"""Time of `load_log` over that of the library.

Pandas reads a table in 0.05 s. The reader is confined in a copy of the process, which takes 0.2 s,
and the checks of units and signs take as much.
"""

TOPICS = {
    "ulg": [
        *("vehicle_attitude", "vehicle_attitude_setpoint", "vehicle_local_position"),
        *("airspeed_validated", "vehicle_acceleration", "vehicle_status"),
    ],
    "bin": ["ATT", "XKF1", "IMU", "ARSP", "MSG"],
    "tlog": ["ATTITUDE", "NAV_CONTROLLER_OUTPUT", "LOCAL_POSITION_NED", "VFR_HUD", "HEARTBEAT"],
}


def hour() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times and signals of an aircraft that turns and climbs to and fro."""
    t = np.arange(round(SECONDS * RATE)) / RATE
    chi, gamma = 1.5 * np.sin(0.1 * t), 0.1 * np.sin(0.07 * t)
    V_a = 22.0 + np.sin(0.3 * t)
    rates = V_a * np.array([np.cos(gamma) * np.cos(chi), np.cos(gamma) * np.sin(chi), -gamma])
    north, east, down = np.cumsum(rates, axis=1) / RATE
    phi = 0.4 * np.cos(0.1 * t)
    n_z = 1.0 / np.cos(phi)
    return t, {
        "chi": chi,
        "gamma": gamma,
        "V_a": V_a,
        "phi": phi,
        "phi_cmd": phi,
        "n_z": n_z,
        "n_z_cmd": n_z,
        "north": north,
        "east": east,
        "down": down,
    }


def by_pymavlink(log, topics: list[str]) -> None:
    """Collect every number of these messages, as one does by hand."""
    rows = {topic: [] for topic in topics}
    while (message := log.recv_match(type=topics)) is not None:
        rows[message.get_type()].append(list(message.to_dict().values()))


PEERS = {
    "ulg": (write_ulog, lambda path: ULog(str(path), TOPICS["ulg"])),
    "bin": (write_dataflash, lambda path: by_pymavlink(DFReader_binary(str(path)), TOPICS["bin"])),
    "tlog": (write_tlog, lambda path: by_pymavlink(mavlogfile(str(path)), TOPICS["tlog"])),
    "csv": (write_csv, pd.read_csv),
}


def seconds(task) -> float:
    """Wall time of a task, s."""
    began = time.perf_counter()
    task()
    return time.perf_counter() - began


def main() -> int:
    """Write the logs, read each by its library and by us, and print times and ratios."""
    wanted = running.options(__doc__).parse_args()
    t, signals = hour()
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind, (write, peer) in PEERS.items():
            path = write(Path(folder) / f"hour.{kind}", t, signals)
            size, alone = path.stat().st_size / 1e6, seconds(lambda p=path, read=peer: read(p))
            ours = seconds(lambda p=path: ft.load_log(p))
            found[kind] = {"MB": size, "library_s": alone, "ours_s": ours, "ratio": ours / alone}
    if wanted.json:
        print(json.dumps(found))
    else:
        print(f"{'log':6}{'MB':>8}{'library':>10}{'load_log':>10}{'ratio':>8}")
        for kind, row in found.items():
            times = f"{row['library_s']:8.2f} s{row['ours_s']:8.2f} s{row['ratio']:8.2f}"
            print(f"{kind:6}{row['MB']:8.1f}{times}")
    over = [kind for kind, row in found.items() if row["ratio"] > MAX_RATIO[kind]]
    for kind in over:
        got = found[kind]["ratio"]
        print(f"{kind} must take at most {MAX_RATIO[kind]:g} times, got {got:.1f}", file=sys.stderr)
    return int(bool(over))


if __name__ == "__main__":
    running.end(main)
