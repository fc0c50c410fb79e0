"""The pictures of docs/logs.md: what is identified from a log of our own, and the gap to a model.

``python docs/figures/log.py`` flies a Cessna of 1.2 times its mass in wind, writes its flight as a
table at 25 Hz with noise, and draws log_fit.svg and log_gap.svg, in two minutes.
"""

import sys
import tempfile
from pathlib import Path

import flighttune as ft
from flighttune.logs.identify import LogIdentification

DOCS = Path(__file__).parents[1]
sys.path.append(str(DOCS.parent / "tests"))


def flight() -> ft.Run:
    """Three minutes of turns and climbs."""
    turns = [90.0, -40.0, 70.0, -30.0, 60.0, -50.0]
    scenario = {
        "title": "Turns and climbs of a heavy Cessna",
        "gains": [{"name": "mine", "K_P": [[1.0, 0], [0, 2.0]], "K_I": [[0.05, 0], [0, 0.2]]}],
        "flight": {"V_a_mps": 50.0, "h_m": 800.0, "duration_s": 180.0},
        "reference": {
            "chi_deg": [
                {"shape": "step", "start_s": 2.0 + 6.5 * k, "change_deg": turns[k % 6]}
                for k in range(26)
            ],
            "gamma_deg": [
                {"shape": "step", "start_s": 4.0 + 5.0 * k, "change_deg": (-1.0) ** k * (3 + k % 3)}
                for k in range(34)
            ],
        },
        "limits": {"phi_deg": [-40, 40], "n_z": [0.4, 1.8]},
        "controller": {"rate_hz": 50.0, "feed_forward": True},
        "wind": {"speed_mps": 6.0, "from_deg": 240.0},
        "plant": [{"kind": "jsbsim", "aircraft": "c172p", "airframe": {"mass_factor": 1.2}}],
    }
    (run,) = ft.fly(ft.scenario_from(scenario)).runs
    return run


def main() -> None:
    """Write the log, identify it, and draw."""
    from log_files import sampled, write_csv  # of the tests

    with tempfile.TemporaryDirectory() as folder:
        log = write_csv(Path(folder) / "flight.csv", *sampled(flight()))
        found = ft.identify(log)
        assert isinstance(found, LogIdentification)
        gap = ft.gap(log, aircraft="c172p")
    print(found, gap, sep="\n\n")
    found.sheet().save(DOCS / "log_fit.svg")
    gap.sheet().save(DOCS / "log_gap.svg")


if __name__ == "__main__":
    main()
