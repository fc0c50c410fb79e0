"""What the tube of a flight depends on, as a hash."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from flighttune.control.gains import PIGains

WORDS = ("title", "verifies", "source", "seed", "gains", "expect", "tuning", "envelope")
"""Of a scenario, what a tube does not depend on."""


def flight_sha256(scenario: Mapping[str, Any], plant: str, gains: PIGains | None) -> str:
    """Hash of what the tube of a flight depends on.

    Parameters
    ----------
    scenario : mapping
        As written in TOML.
    plant : str
        Label of the plant.
    gains : PIGains or None
    """
    flown = {key: value for key, value in scenario.items() if key not in WORDS}
    of = {**flown, "label": plant, "gains": gains and gains.as_lists()}
    return hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()
