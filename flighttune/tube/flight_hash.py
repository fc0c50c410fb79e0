"""Hash of everything that the tube of a flight depends on."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from flighttune.control.gains import PIGains

WORDS = ("title", "verifies", "source", "seed", "gains", "expect", "tuning", "envelope")
"""Tables of a scenario that a tube does not depend on."""


def flight_sha256(scenario: Mapping[str, Any], plant: str, gains: PIGains | None) -> str:
    """Hash of everything that the tube of a flight depends on."""
    flown = {key: value for key, value in scenario.items() if key not in WORDS}
    of = {**flown, "label": plant, "gains": None if gains is None else gains.as_lists()}
    return hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()
