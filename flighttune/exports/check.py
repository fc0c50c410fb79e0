"""An exported folder, flown by JSBSim in a process of its own, against the flight of `fly`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flighttune.files.whole import write_text
from flighttune.plants.jsbsim.model_files import failure_of_python
from flighttune.simulate.run import Run

# Largest difference between two flights that are the same but for rounding, rad, 1 and m/s.
TOLERANCE = 1e-9

# Wall time after which JSBSim is stopped, s, and more for each second of flight; it takes 2 s.
TIME_LIMIT_S, TIME_LIMIT_PER_S = 60.0, 2.0

# Signals of a run by column of the file; the airspeed is compared where the flight follows one.
COLUMNS = {"chi": "chi_rad", "gamma": "gamma_rad", "phi": "phi_rad", "n_z": "n_z", "V_a": "V_a_mps"}


def differences(
    options: Sequence[str], csv: Path, start: float, run: Run
) -> tuple[dict[str, float], str]:
    """Largest difference (rad, 1, m/s) of a run's signals from JSBSim's `csv`; what differs."""
    import pandas as pd

    write_text(csv, "")  # so that no flight of before is compared
    time_limit = TIME_LIMIT_S + TIME_LIMIT_PER_S * (start + run.t[-1])
    if failure := failure_of_python("-m", "jsbsim.script", *options, time_limit=time_limit):
        return {}, f"JSBSim must fly it, but {failure}"
    try:
        written = pd.read_csv(csv, usecols=[*COLUMNS.values()], dtype=float)
    except ValueError:  # those of pandas are such errors
        return {}, f"JSBSim's {csv.name} cannot be read"
    if len(written) < len(run.t):
        return {}, f"JSBSim's flight ends after {len(written)} of {len(run.t)} samples"
    distances = {
        name: np.abs(written[column].to_numpy()[: len(run.t)] - run.signals[name].to_numpy())
        for name, column in COLUMNS.items()
        if name != "V_a" or "V_ref" in run.signals
    }
    # One of the two courses is modulo a turn.
    distances["chi"] = np.abs((distances["chi"] + np.pi) % (2.0 * np.pi) - np.pi)
    largest = {name: float(values.max()) for name, values in distances.items()}
    # With "not", because NaN is a difference too.
    first = {name: np.argmax(~(values <= TOLERANCE)) for name, values in distances.items()}
    if not (differing := [name for name, value in largest.items() if not value <= TOLERANCE]):
        return largest, ""
    name = min(differing, key=lambda name: (first[name], -distances[name][first[name]]))
    return largest, f"{name} differs first, at t = {run.t[first[name]]:g} s"
