"""How long `flighttune identify aerosonde` takes, from the shell, against its limit.

Run it with ``python benchmarks/bench_identify.py``; ``--json`` prints one object. Exits with 1
where the command takes longer than `LONGEST_S`. Beside it: the flights alone, against bare
integration steps of JSBSim.
"""

import json
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import running

from flighttune.vehicles.identification.fit import DT, identify_plant
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.jsbsim.trim import trim

LONGEST_S = 10.0
REPEATS = 1 if running.QUICK else 3


def command_s() -> float:
    """Return the time of the whole command, s."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "flighttune", "identify", "aerosonde", "--json",
             "--out", str(Path(folder) / "aerosonde.json")],
            check=True, capture_output=True,
        )  # fmt: skip
        return time.perf_counter() - began


def identification_s() -> tuple[float, float]:
    """Return the time of one condition, s, and of its steps flown without anything around, s."""
    condition, plant = FlightCondition(V_a=25.0), JSBSimPlant()
    began = time.perf_counter()
    found = identify_plant(partial(JSBSimPlant, "aerosonde"), condition, plant.limits)
    took = time.perf_counter() - began
    flown = (len(found.channels["phi"].flown) * DT + 40.0) * plant.config.inner_loop_rate
    fdm = Fdm(plant.config)
    trim(fdm, condition)
    began = time.perf_counter()
    for _ in range(round(flown)):
        fdm.run()
    return took, time.perf_counter() - began


def main() -> int:
    parser = running.options(__doc__)
    as_json = parser.parse_args().json

    whole = min(command_s() for _ in range(REPEATS))
    one, bare = min(identification_s() for _ in range(REPEATS))
    result = {
        "command_s": whole, "one_condition_s": one, "bare_steps_s": bare, "longest_s": LONGEST_S,
    }  # fmt: skip
    if as_json:
        print(json.dumps(result))
    else:
        print(
            f"flighttune identify aerosonde {whole:.2f} s (at most {LONGEST_S:g}); one condition "
            f"{one:.2f} s, of which bare steps of JSBSim {bare:.2f} s"
        )
    return 0 if whole <= LONGEST_S else 1


if __name__ == "__main__":
    running.end(main)
