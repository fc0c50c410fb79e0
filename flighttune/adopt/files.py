"""Files of an adopted aircraft: its ``aircraft.toml``, and the turn as a scenario."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from flighttune.control.gains import PAPER_GAINS

TURN = "turn.toml"

SOURCE = "flighttune adopt"
"""What an adopted aircraft says of itself."""

TUNED, PAPER = "tuned_identified", "paper_scaled"
"""Gain sets of the turn."""

PAPER_SPEED = 25.0
"""Airspeed of the paper's gains, m/s: gains of the same loop grow with airspeed."""

_COMMENTS = {
    "surfaces": "stops in deg; positions at the commands -1 and +1 in rad",
    "engines": "time they take to a steady thrust",
    "settings": "JSBSim properties, for the whole flight",
    "declared": "properties of another simulator that the model refers to",
    "envelope": "leaving it ends a flight",
    "limits": "of the commands the inner loop follows",
    "design": "what `flighttune design` makes the gains for",
}


def aircraft_text(tables: Mapping[str, Any], notes: Sequence[str]) -> str:
    """The text of an ``aircraft.toml``.

    Parameters
    ----------
    tables : mapping
        Its tables.
    notes : sequence of str
        What was done to the model: comments.
    """
    lines = [f"{key} = {_value(tables[key])}" for key in ("title", "source", "model")]
    lines += [f"# {note}" for note in notes]
    for name, comment in _COMMENTS.items():
        if tables.get(name):
            lines += ["", f"[{name}]  # {comment}"]
            lines += [f"{_key(key)} = {_value(value)}" for key, value in tables[name].items()]
    return "\n".join(lines) + "\n"


def turn_text(aircraft: str, V_a: float, h: float, limits: Mapping[str, Any]) -> str:
    """The text of a scenario: a turn of 20 deg with a climb of 3 deg, both as a step.

    Parameters
    ----------
    aircraft : str
        Folder that the scenario stands in.
    V_a, h : float, m/s and m
    limits : mapping
        Those of the aircraft, as in its ``aircraft.toml``.
    """
    ranges = "\n".join(f"{key} = {_value(value)}" for key, value in limits.items())
    scale = V_a / PAPER_SPEED
    gains = {"name": PAPER} | {
        key: (scale * getattr(PAPER_GAINS, key)).tolist() for key in ("K_P", "K_I")
    }
    return f"""title    = "A turn of 20 deg with a climb of 3 deg"
verifies = "gains tuned on the identified aircraft against those of the paper, scaled with airspeed"
source   = "{SOURCE}"
gains    = ["{TUNED}", {_value(gains)}]

[flight]
V_a_mps    = {_value(V_a)}
h_m        = {_value(h)}
duration_s = 40.0

[reference]
chi_deg   = 20.0
gamma_deg = 3.0

[limits]
{ranges}

[controller]
feed_forward = true

[tuning]
model     = "identified"
roll_rate = true

[[plant]]
kind     = "jsbsim"
aircraft = {_value("../" + aircraft)}
"""


def _key(key: str) -> str:
    return key if key.replace("_", "").isalnum() else json.dumps(key)


def _value(value: Any) -> str:
    """A value of TOML; floats to five digits."""
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(key)} = {_value(one)}" for key, one in value.items())
        return f"{{ {inside} }}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float):
        return repr(float(f"{value:.5g}"))
    return json.dumps(value, ensure_ascii=False)
