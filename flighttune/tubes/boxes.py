"""Boxes of the residual signals of an aircraft, from a counted band, and what it covers."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.claims.band import Residual
from flighttune.claims.counted import SAME_GAINS
from flighttune.claims.distribution import ROUNDING_DEG, STARTS, flown_values
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.errors import InputError
from flighttune.present.answer import number
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.run import Bounds

# Rad by which the ends of a range are rounded where it is added to a start.
ROUNDING_RAD = 1e-14

# What the boxes of a tube are.
OF_RESIDUALS = "`boxes` must be of residual signals (`ft.residual`)"


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


@dataclass(frozen=True, kw_only=True, eq=False)
class AircraftBoxes:
    """Boxes counted for an aircraft's flights, at the k samples of one flight."""

    # Bounds on `RESIDUALS`: from each sample to the next on the residual rates of course and
    # flight-path angle, of any shape; on the roll seen minus that behind the lag, and its change
    # to the next sample.
    bounds: Bounds
    lags: tuple[InnerLag, ...]  # of roll and load factor, in the model whose rates were subtracted
    band_sha256: str  # of all that the file of the band holds

    @classmethod
    def of_band(cls, band: Residual, t: FloatArray) -> "AircraftBoxes":
        """The boxes of a count at the samples `t` (s) of a flight.

        Raises InputError if it is not of residual signals, or claims nothing.
        """
        if not (isinstance(band, Residual) and band.claims):
            got = "no claim" if isinstance(band, Residual) else f"a {type(band).__name__}"
            raise InputError(f"{OF_RESIDUALS}, got {got}.")
        model = band.flights.model
        assert model is not None  # of residual signals
        return cls(bounds=band.bounds(t), lags=model.lags, band_sha256=band.sha256)

    def difference(self, other: "AircraftBoxes") -> str | None:
        """Name of the first part that differs; None if none does."""
        if not np.array_equal(self.bounds.pairs, other.bounds.pairs):
            return "boxes"
        names = ("lags", "band_sha256")
        return next((x for x in names if getattr(self, x) != getattr(other, x)), None)


def check_covered(
    band: Residual, scenario: Scenario, plant: PlantTable, gains: PIGains, start: float
) -> None:
    """Refuse a scenario of which none of the flights of a band could be a flight.

    `plant`: the aircraft that flies. `start` (rad): distance of the starts from the scenario's
    course and path angle. Raises InputError if aircraft, gains, manoeuvre, limits, controller,
    starts or air differ; one line that names the key.
    """
    counted = band.flights
    aircraft = counted.scenario.plant_table(counted.plant).aircraft
    if plant.aircraft != aircraft or counted.changed:
        raise InputError(
            f"boxes: `aircraft` must be {aircraft} with the files it was flown with, got "
            f"{plant.aircraft or plant.kind}."
        )
    for name in ("K_P", "K_I"):
        mine, theirs = getattr(counted.gains, name), getattr(gains, name)
        if not np.allclose(mine, theirs, rtol=SAME_GAINS, atol=0.0):
            raise InputError(
                f"boxes: `{name}` must be that of {counted.gains_name}, {mine.tolist()}, got "
                f"{theirs.tolist()}."
            )
    if why := counted.distribution.difference(scenario, plant):
        raise InputError(f"boxes: must be of the flights of the scenario: {why}.")
    flight = flown_values(scenario, plant)
    for key in STARTS if start else ():
        low, *_, high = counted.distribution.dispersed.get(key, 2 * [flight[key]])
        most = min(flight[key] - low, high - flight[key])
        if math.degrees(start) > most + ROUNDING_DEG:
            raise InputError(
                f"boxes: `start` must be at most {most:.4g} deg from `{key}`, as in the flights "
                f"counted, got {math.degrees(start):.4g} deg."
            )
    if counted.distribution.windy and scenario.wind is None:
        raise InputError(
            "`wind` must be stated, as the flights counted had wind, got none: the path over "
            "ground begins elsewhere than that through the air."
        )


def probability_of(
    band: Residual, scenario: Scenario, plant: PlantTable, start: float
) -> CountedProbability:
    """Probability counted for a tube from starts within `start` (rad) of a scenario's.

    It speaks of flights where the tube is from all starts counted, and these are the only
    difference between the flights. Otherwise it speaks of the residual rates alone: most flights do
    not even start inside a tube from one start.
    """
    starts = band.flights.distribution.start_range(scenario, plant)
    from_all = starts is not None and start >= starts - ROUNDING_RAD
    subject = "flight" if from_all else "residual_rates"
    return CountedProbability(of=subject, at_most=band.about.epsilon, confidence=band.confidence)
