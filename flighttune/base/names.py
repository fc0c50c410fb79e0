"""Symbols, words and units of signals and of the keys of a scenario, as a reader sees them."""

import re
import tomllib
from pathlib import Path

from flighttune.base.units import DEG_PER_RAD

_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
WORDS, UNIT_OF_SUFFIX = _TABLES["words"], _TABLES["unit_of_suffix"]

CHANNEL_SYMBOLS = {"chi": "χ", "gamma": "γ"}
OTHER_SYMBOLS = {"V": "V", "phi": "φ", "n_z": "n_z", "cross_track": "e_y", "height_err": "e_h"}
SYMBOLS = CHANNEL_SYMBOLS | OTHER_SYMBOLS
CHANNEL_NAMES = {"chi": "course", "gamma": "path angle"}
OTHER_WORDS = {"V": "airspeed", "cross_track": "cross track", "height_err": "height"}
CHANNEL_WORDS = CHANNEL_NAMES | OTHER_WORDS


def key_words(key: str) -> str:
    """A dispersed quantity in words, by its key: ``flight.chi_deg`` is the initial course."""
    words: list[str] = []
    owner = ""
    for part in re.split(r"\.(?![^\[]*\])", key):  # no dot of a label
        name, _, place = part.rstrip("]").partition("[")
        end = next((end for end in UNIT_OF_SUFFIX if name.endswith(end)), "")
        name = name.removesuffix(end).replace("V_a", "V-a").replace("n_z", "n-z")
        words += [WORDS.get(word.replace("-", "_"), word) for word in name.split("_")]
        place = str(int(place) + 1) if place.isdigit() else place
        if name == "plant" and place:
            owner = f" of plant {place}" if place.isdigit() else f" of {place}"
        elif place and key.startswith("limits"):
            words.append("minimum" if place == "1" else "maximum")
        elif place:
            words.append(place)
    if words[-1] in ("maximum", "minimum"):
        words.insert(0, words.pop())
    return " ".join(filter(None, words)) + owner


def shown_unit(unit: str) -> tuple[str, float]:
    """Unit that a reader sees for an SI unit, and the factor to it: degrees for radians."""
    if unit in ("rad", "rad/s"):
        return unit.replace("rad", "deg"), DEG_PER_RAD
    return unit, 1.0
