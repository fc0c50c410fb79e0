"""A flight of ours behind known lags, which the tests write as logs."""

import numpy as np
import pytest
from log_files import LOAD, ROLL, sampled

import flighttune as ft

LASTS = 150.0  # s: of the flight


@pytest.fixture(scope="session")
def flight():
    """Steps of course and path angle of many sizes at 50 Hz, on a lagged plant."""
    random = np.random.default_rng(7)

    def steps(size, every, sign=1.0):
        for k in range(int((LASTS - 10.0) / every)):
            sign = -sign
            change = float(sign * size * (0.4 + 0.6 * random.random()))
            yield {"shape": "step", "start_s": 2.0 + every * k, "change_deg": change}

    scenario = {
        "title": "Logged",
        "gains": [{"name": "mine", "K_P": [[1.0, 0], [0, 2.0]], "K_I": [[0.05, 0], [0, 0.2]]}],
        "flight": {"V_a_mps": 22.0, "duration_s": LASTS},
        "reference": {"chi_deg": [*steps(50.0, 7.0)], "gamma_deg": [*steps(8.0, 5.0)]},
        "limits": {"phi_deg": [-45, 45], "n_z": [0.3, 2.0]},
        "controller": {"rate_hz": 50.0, "feed_forward": True},
        "plant": [
            {
                "kind": "point_mass_lag",
                "roll_lag_rad_s": ROLL.natural_frequency,
                "roll_damping": ROLL.damping,
                "roll_delay_s": ROLL.delay,
                "n_z_lag_rad_s": LOAD.natural_frequency,
                "n_z_delay_s": LOAD.delay,
            }
        ],
    }
    (run,) = ft.fly(ft.scenario_from(scenario)).runs
    assert run.status == "completed", run.outcome
    return run


@pytest.fixture(scope="session")
def clean(flight):
    """Times and signals of the flight at 25 Hz, without faults of a log."""
    return sampled(flight, noise=False, dropouts=False, late=False)
