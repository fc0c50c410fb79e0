"""Files of an adopted aircraft: its ``aircraft.toml``, and the turn as a scenario."""

from collections.abc import Mapping, Sequence
from typing import Any

import tomlkit

from flighttune.control.gains import PAPER_GAINS

TURN = "turn.toml"

SOURCE = "flighttune adopt"  # marks an aircraft that `adopt` may write over

TUNED, PAPER = "tuned_identified", "paper_scaled"  # gain sets of the turn

PAPER_SPEED = 25.0  # airspeed of the paper's gains, m/s: gains of the same loop grow with airspeed

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
    """The text of an ``aircraft.toml``, with what was done to the model as comments."""
    document = tomlkit.document()
    document.update({key: tables[key] for key in ("title", "source", "model")})
    for note in notes:
        document.add(tomlkit.comment(note))
    for name, comment in _COMMENTS.items():
        if tables.get(name):
            table = tomlkit.table()
            table.comment(comment)
            for key, value in _rounded(tables[name]).items():
                table[key] = tomlkit.inline_table() | value if isinstance(value, dict) else value
            document.add(tomlkit.nl())
            document[name] = table
    return tomlkit.dumps(document)


def turn_text(aircraft: str, V_a: float, h: float, limits: Mapping[str, Any]) -> str:
    """The text of a scenario: a turn of 20 deg with a climb of 3 deg, both as a step.

    `aircraft` is the folder that the scenario stands in, `limits` are those of its
    ``aircraft.toml``, `V_a` is in m/s and `h` in m.
    """
    K_P, K_I = (V_a / PAPER_SPEED * getattr(PAPER_GAINS, key) for key in ("K_P", "K_I"))
    scenario = {
        "title": "A turn of 20 deg with a climb of 3 deg",
        "verifies": "gains tuned on the identified aircraft against those of the paper, scaled "
        "with airspeed",
        "source": SOURCE,
        "gains": [TUNED, {"name": PAPER, "K_P": K_P.tolist(), "K_I": K_I.tolist()}],
        "flight": {"V_a_mps": V_a, "h_m": h, "duration_s": 40.0},
        "reference": {"chi_deg": 20.0, "gamma_deg": 3.0},
        "limits": limits,
        "controller": {"feed_forward": True},
        "tuning": {"model": "identified", "roll_rate": True},
        "plant": [{"kind": "jsbsim", "aircraft": f"../{aircraft}"}],
    }
    return tomlkit.dumps(_rounded(scenario))


def _rounded(value: Any) -> Any:
    """Plain values of TOML, floats to five digits."""
    if isinstance(value, Mapping):
        return {key: _rounded(entry) for key, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_rounded(entry) for entry in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value
