"""Boxes of an aircraft's residual rates against the exact point mass behind its identified lag."""

from flighttune.conformance.boxes import RateBoxes, Windows
from flighttune.conformance.file import Conformance, load_conformance, save_conformance
from flighttune.conformance.residual import ConformantModel, residual_rates

__all__ = [
    "Conformance",
    "ConformantModel",
    "RateBoxes",
    "Windows",
    "load_conformance",
    "residual_rates",
    "save_conformance",
]
