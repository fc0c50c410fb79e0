"""Words and units of the keys of a scenario, as a reader sees them."""

import re
import tomllib
from pathlib import Path

from flighttune.base.signals import SIGNALS

_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
WORDS = {name: signal.word for name, signal in SIGNALS.items() if signal.word} | _TABLES["words"]
UNIT_OF_SUFFIX = _TABLES["unit_of_suffix"]


def key_words(key: str) -> str:
    """A dispersed quantity in words, by its key: ``flight.chi_deg`` is the initial course."""
    words: list[str] = []
    owner = ""
    for part in re.split(r"\.(?![^\[]*\])", key):  # a dot in a label does not count
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


def unit_of_key(key: str) -> str:
    """Unit of a value by the end of its key; empty without one."""
    last = key.rpartition(".")[2]
    return next((unit for end, unit in UNIT_OF_SUFFIX.items() if last.endswith(end)), "")
