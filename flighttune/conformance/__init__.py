"""What the exact point mass behind the identified lag leaves over of an aircraft's flights."""

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
