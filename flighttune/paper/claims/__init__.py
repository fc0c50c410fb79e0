"""Every checkable sentence of the abstract and of section 5.

To add one, put the sentence into ``claims.toml`` and the function that checks it, under the same
name, into the module of its section.
"""

import tomllib
from pathlib import Path

from flighttune.paper.claims import abstract, disturbances, gain_family, oscillator, star
from flighttune.paper.claims.base import Claim, uncheckable

SECTIONS = {
    "abstract": abstract,
    "oscillator": oscillator,
    "star": star,
    "gain_family": gain_family,
    "disturbances": disturbances,
}

TEXT = Path(__file__).with_name("claims.toml")

# In the order of the paper.
CLAIMS = tuple(
    Claim(
        id=name,
        checks=uncheckable
        if "missing" in entry
        else getattr(SECTIONS[section], name.replace("-", "_")),
        **entry,
    )
    for section, entries in tomllib.loads(TEXT.read_text(encoding="utf-8")).items()
    for name, entry in entries.items()
)
