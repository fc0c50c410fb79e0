"""The path of a real flight as a scenario, which an aircraft can fly beside the log."""

import math

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.units import DEG_PER_RAD
from flighttune.control.gains_keys import TUNED_FED_BACK
from flighttune.flight.load import check_scenario, speed_protected
from flighttune.flight.loop.run import Run
from flighttune.flight.models import with_found_gains
from flighttune.flight.scenario.load import scenario_from
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.aircraft.aircraft import load_aircraft

# Smallest time between two points of the path, s, and maximum number of points.
STEP_S, MAX_POINTS = 1.0, 300

# Longest log that is followed, s: over a longer one wind and speed change.
LONGEST_S = 600.0

NO_HEIGHT = 1000.0  # m: height of a log without heights


def followed(log: Run, aircraft: str) -> Scenario:
    """A scenario in which an aircraft follows the course and path angle of a log.

    They are the commanded ones, or the flown ones of a log without commands. The airspeed is the
    median of the log, and the air is calm.
    """
    if not 0.0 < log.duration <= LONGEST_S:
        raise InputError(
            f"{log.provenance.gains_name}: the log must last at most {LONGEST_S:g} s to be "
            f"followed, got {log.duration:.0f} s: name a part, such as FILE@100:200."
        )
    times = np.linspace(0.0, log.duration, min(MAX_POINTS, 1 + math.ceil(log.duration / STEP_S)))
    course = np.unwrap(_sampled(log, times, "chi_ref", "chi"))
    starts = {"chi_deg": course, "gamma_deg": _sampled(log, times, "gamma_ref", "gamma")}
    flight = {
        "V_a_mps": float(np.median(_sampled(log, times, "V_a", "V_g"))),
        "h_m": float(_sampled(log, times, "h")[0]) if "h" in log.signals else NO_HEIGHT,
        "duration_s": float(log.duration),
        **{key: DEG_PER_RAD * float(angle[0]) for key, angle in starts.items()},
    }
    scenario = scenario_from(
        {
            "title": f"the path of {log.provenance.gains_name}",
            "law": ["exact"],
            "gains": [TUNED_FED_BACK],
            "flight": flight,
            "reference": {key: _ramps(times, angle) for key, angle in starts.items()},
            "controller": {"feed_forward": True, **speed_protected(load_aircraft(aircraft))},
            "tuning": {"identified": aircraft},
            "plant": [{"kind": "jsbsim", "aircraft": aircraft}],
        }
    )
    check_scenario(scenario, scenario.title)
    return with_found_gains(scenario)


def _sampled(log: Run, times: FloatArray, *names: str) -> FloatArray:
    """The first of these signals that the log has, at `times`; gaps are interpolated."""
    for name in names:
        if name in log.signals:
            values = log.signals[name].to_numpy()
            there = np.isfinite(values)
            if there.any():
                angle = np.unwrap(values[there]) if name.startswith("chi") else values[there]
                return np.interp(times, log.t[there] - log.t[0], angle)
    raise InputError(
        f"{log.provenance.gains_name}: the log must have {' or '.join(names)}, got neither."
    )


def _ramps(times: FloatArray, angle: FloatArray) -> list[dict[str, object]]:
    """Segments of a reference that passes through the angles at the times."""
    rates = DEG_PER_RAD * np.diff(angle) / np.diff(times)
    return [
        {"shape": "ramp", "start_s": start, "duration_s": step, "rate_dps": rate}
        for start, step, rate in zip(
            times[:-1].tolist(), np.diff(times).tolist(), rates.tolist(), strict=True
        )
        if rate
    ]
