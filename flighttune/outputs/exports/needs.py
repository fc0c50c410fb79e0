"""What an exported law needs of the estimates of an autopilot."""

from typing import NamedTuple

import numpy as np

from flighttune.base.units import DEG
from flighttune.control.gains import RATES, PIGains
from flighttune.flight import conditions
from flighttune.flight.entry import Entry
from flighttune.flight.models import loop_measures
from flighttune.routes.follow import RouteReference


class NoiseGain(NamedTuple):
    """Commands for fast errors of the estimates: the gain at high frequency."""

    roll: float  # roll command per error of the course, 1
    lift: float  # load-factor command per error of the path angle, 1/rad


def noise_gain(gains: PIGains, V_a: float, g: float, look_ahead: float | None = None) -> NoiseGain:
    """Noise gain of a law in level flight at `V_a` (m/s).

    With gains for the rates, ``(1 + k) (V_a/g) (K_P + 1/T)`` with the feedback k; ``1/T`` is that
    of a `look_ahead` T (s) along a route, which adds the rate of its reference.
    """
    per_rate, K_P = V_a / g, np.abs(np.diag(gains.K_P)[:2])
    if gains.inputs[:2] == RATES[:2]:
        K_P = K_P * per_rate
    aim = per_rate / look_ahead if look_ahead else 0.0
    roll, lift = ((1.0 + k) * (x + aim) for k, x in zip(gains.feedback, K_P.tolist(), strict=True))
    return NoiseGain(roll, lift)


def needs(entry: Entry) -> tuple[str, ...]:
    """Sentences on the estimates that an exported law uses, its noise gain and its delay margin."""
    scenario, gains = entry.scenario, entry.found_gains
    reference = conditions.reference_of(scenario)
    look_ahead = reference.look_ahead if isinstance(reference, RouteReference) else None
    gain = noise_gain(gains, scenario.flight.V_a_mps, scenario.flight.g_mps2, look_ahead)
    fed_back = [name for name, k in zip(("roll", "load factor"), gains.feedback, strict=True) if k]
    estimates = ["course and path angle over ground", "airspeed", *fed_back]
    said = [
        f"The law needs estimates of {', '.join(estimates[:-1])} and {estimates[-1]}, by an "
        "inertial filter: those of a receiver alone are too late.",
        f"An error of 1 deg of the course that changes fast moves the roll command by "
        f"{gain.roll:.3g} deg, and one of the path angle moves the load factor by "
        f"{gain.lift * DEG:.2g}.",
    ]
    margin = loop_measures(entry, {"delay_margin_s"}).get("delay_margin_s")
    if margin is not None and np.isfinite(margin):
        said.append(f"The linear loop bears {margin:.2g} s more delay than its model has.")
    return tuple(said)
