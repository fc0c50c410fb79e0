"""Probability counted for the tube of an aircraft, of flights or of their residual rates."""

from dataclasses import dataclass
from typing import Literal

from flighttune.present.numbers import number


@dataclass(frozen=True, slots=True, kw_only=True)
class CountedProbability:
    """The probability that a flight of the distribution counted leaves a tube, or its boxes."""

    of: Literal["flight", "residual_rates"]  # a flight leaves the tube, or rates their boxes
    at_most: float
    confidence: float

    @property
    def sentence(self) -> str:
        """The probability in words."""
        chance = f"probability at most {number(self.at_most)}, confidence {self.confidence:.10g}"
        if self.of == "flight":
            return f"a flight of the distribution counted leaves the tube with {chance}"
        return (
            "the residual rates of a flight of the distribution counted leave their boxes with "
            f"{chance}"
        )
