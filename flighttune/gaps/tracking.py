"""Errors of track of a log where it is straight, beside flights with errors of navigation."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.units import DEG
from flighttune.control.gains_keys import TUNED_FED_BACK
from flighttune.flight.fly import fly_alone
from flighttune.flight.load import check_scenario, chosen_entry, speed_protected
from flighttune.flight.loop.run import Run
from flighttune.flight.models import with_found_gains
from flighttune.flight.scenario.load import scenario_from
from flighttune.flight.scenario.schema import Scenario
from flighttune.logs.identify import flying
from flighttune.vehicles.aircraft.aircraft import load_aircraft
from flighttune.vehicles.plants.navigation import GRADES

# Signal of each error of track by its word; `_seen` at its end is that of the autopilot.
TRACKED = {"cross track": "cross_track", "height": "height_err"}

# Share of the time for a quantile of an error's size.
SHARE = 0.95

# A flight is straight from `SETTLED_S` after its course last turned faster than `TURNING` over
# `OVER_S`, and must be so for `MIN_STRAIGHT_S` in all.
TURNING, OVER_S, SETTLED_S, MIN_STRAIGHT_S = 3.0 * DEG, 2.0, 10.0, 20.0

# Length of the straight flights, s, and their number for each grade.
LEG_S, FLIGHTS = 120.0, 8


class Tracking(NamedTuple):
    """An error of track beside that of straight flights with a grade of navigation.

    Numbers are quantiles at `SHARE` of the error's size over a flight, m.
    """

    of: str  # word of the error
    log_m: float
    grade: str  # of navigation
    low_m: float  # smallest and largest of the flights, as the autopilot sees it
    high_m: float
    true_m: float  # largest of the flights at the true position


def straight(run: Run) -> npt.NDArray[np.bool_]:
    """Whether the vehicle flies, and has flown straight for a while, at each sample."""
    t, chi = run.t, run.signals["chi"].to_numpy(dtype=float)
    n = max(round(OVER_S / (t[1] - t[0])), 1)
    turned = np.full(len(t), np.inf)
    turned[n:] = np.abs(np.angle(np.exp(1j * (chi[n:] - chi[:-n])))) / OVER_S
    turning = ~(turned <= TURNING)  # NaN too
    last = np.maximum.accumulate(np.where(turning, t, -np.inf))
    return (t - last >= SETTLED_S) & flying(run)


def tracked(run: Run) -> dict[str, float]:
    """Quantile at `SHARE` of the size of each error of track that a log has where it is straight.

    Empty if the log is straight for less than `MIN_STRAIGHT_S`.
    """
    sizes = dict[str, float]()
    if "chi" not in run.signals or not {"V_a", "V_g"} & set(run.signals) or len(run.t) < 2:
        return sizes
    there = straight(run)
    for word, name in TRACKED.items():
        if name in run.signals:
            size = np.abs(run.signals[name].to_numpy(dtype=float)[there])
            size = size[np.isfinite(size)]
            if len(size) * (run.t[1] - run.t[0]) >= MIN_STRAIGHT_S:
                sizes[word] = float(np.quantile(size, SHARE))
    return sizes


def tracking(run: Run, aircraft: str, V_a: float, h: float) -> tuple[Tracking, ...]:
    """Errors of a log where it is straight, beside straight flights of an aircraft by grade.

    The flights are level at airspeed `V_a` (m/s) and height `h` (m) in light turbulence, with the
    aircraft's own gains. Empty if the log has no track, or is not straight for long enough.
    """
    logged = tracked(run)
    if not logged:
        return ()
    rows = []
    for grade in GRADES:
        sizes = np.array([_sizes(_leg(aircraft, V_a, h, grade, seed)) for seed in range(FLIGHTS)])
        low, high = (ends.tolist() for ends in (sizes.min(axis=0), sizes.max(axis=0)))
        rows += [
            Tracking(word, logged[word], grade, low[i][0], high[i][0], high[i][1])
            for i, word in enumerate(TRACKED)
            if word in logged
        ]
    return tuple(sorted(rows, key=lambda row: row.of))


def _leg(aircraft: str, V_a: float, h: float, grade: str, seed: int) -> Scenario:
    """A straight and level leg with a grade of navigation."""
    leg = {"north_m": V_a * LEG_S, "east_m": 0.0}
    scenario = scenario_from(
        {
            "title": f"a straight leg by {grade}",
            "seed": seed,
            "law": ["exact"],
            "gains": [TUNED_FED_BACK],
            "flight": {"V_a_mps": V_a, "h_m": h, "duration_s": 2.0 * LEG_S},
            "route": {"waypoint": [{"north_m": 0.0, "east_m": 0.0}, leg]},
            "controller": {"feed_forward": True, **speed_protected(load_aircraft(aircraft))},
            "tuning": {"identified": aircraft},
            "plant": [{"kind": "jsbsim", "aircraft": aircraft}],
            "turbulence": {"intensity": "light"},
            "navigation": {"grade": grade},
        }
    )
    check_scenario(scenario, scenario.title)
    return with_found_gains(scenario)


def _sizes(leg: Scenario) -> FloatArray:
    """Quantiles of the errors of track on a leg, as seen and true, shape (errors, 2)."""
    run = fly_alone(chosen_entry(leg, None), compiled=False)
    if run.status != "completed":
        raise InputError(f"{leg.title}: {run.outcome}")
    signals = run.signals[run.t >= SETTLED_S]
    names = [[f"{name}_seen", name] for name in TRACKED.values()]
    return np.array([[signals[x].abs().quantile(SHARE) for x in pair] for pair in names])
