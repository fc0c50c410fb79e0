"""Boxes of an aircraft's residual rates, the count of flights behind them, and their file."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import Field

from flighttune.aircraft.aircraft import files_hash
from flighttune.arrays import FloatArray, check_at_least, read_only_vector
from flighttune.claims.boxes import RateBoxes
from flighttune.claims.count import allowed_outside, counted_scale
from flighttune.claims.distribution import ROUNDING_DEG, STARTS, Distribution, flown_values
from flighttune.control.gains import PIGains
from flighttune.errors import InputError
from flighttune.files.seal import BLANK, seal, sealed_bytes
from flighttune.files.value import STRICT, read, tables_of
from flighttune.files.whole import write_text
from flighttune.gaps.residual import RESIDUALS, ConformantModel
from flighttune.present.tables import number
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable

# Rad by which the ends of a range are rounded where it is added to a start.
ROUNDING_RAD = 1e-14

# Relative difference of gains below which they are the same: tuning repeats to 1e-9.
SAME_GAINS = 1e-6

Count: TypeAlias = Annotated[int, Field(ge=0, le=10**9)]


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conformance:
    """Boxes of the residual rates of one aircraft under one gain set, and what was counted."""

    aircraft: str  # name or folder
    gains_name: str
    gains: PIGains
    model: ConformantModel  # model whose rates are subtracted; the same for all flights
    learned: RateBoxes  # the smallest around the training flights
    boxes: RateBoxes  # those learned, at the scale that the scores ask for
    # `epsilon` and `confidence`: probability and confidence of the claim, in (0, 1)
    epsilon: float
    confidence: float
    scores: FloatArray  # of the fresh flights that were completed: `RateBoxes.score` in `learned`
    not_completed: Annotated[int, Field(ge=0, le=10**7)]  # other fresh flights: outside
    # With the seed of the campaign the numbers of the draws determine them: draws from 0 on are
    # training flights, those after them are fresh.
    training: Count
    seed: Count
    distribution: Distribution
    aircraft_sha256: str  # of the files of the aircraft
    identified_sha256: str  # of its identified model
    campaign_sha256: str  # of the plan that was flown

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune conformance 6"
    UNITS: ClassVar[Mapping[str, str]] = {
        "model": "V_a in m/s, g in m/s^2; lags of roll and load factor, in rad/s and s",
        "boxes": "lowest and highest values by window, in columns " + ", ".join(RESIDUALS),
        "distribution": "keys of the scenario, in the units of their names",
    }

    def __post_init__(self) -> None:
        object.__setattr__(self, "scores", read_only_vector("scores", self.scores))
        check_at_least(1, training=self.training)
        if self.gains.K.shape != (2, 4):
            raise InputError(f"`gains` must have 2 rows and columns, got {self.gains.K_P.shape}.")
        boxes = self.boxes
        least = boxes_at_scale(self.learned, self.all_scores, self.epsilon, self.confidence)
        if boxes.windows != least.windows or not (
            (boxes.low <= least.low).all() and (boxes.high >= least.high).all()
        ):
            raise InputError(
                "`boxes` must be at least as wide as those `learned` at the scale that the "
                f"`scores` ask for, {self.counted[0]:.4g}, got narrower ones."
            )

    @property
    def all_scores(self) -> FloatArray:
        """Scores of all fresh flights; infinite of those that were not completed."""
        return np.append(self.scores, np.full(self.not_completed, np.inf))

    @property
    def counted(self) -> tuple[float, int]:
        """Scale of the boxes, and number of fresh flights outside: see `counted_scale`."""
        return counted_scale(self.all_scores, self.epsilon, self.confidence)

    @property
    def sentence(self) -> str:
        """The claim in words, with the distribution it is about."""
        return (
            f"of {len(self.all_scores)} fresh flights {self.counted[1]} left the boxes: a new one "
            f"leaves them with probability at most {number(self.epsilon)}, confidence "
            f"{self.confidence:.10g}, if it is of "
            + self.distribution.sentence(f"{self.aircraft} with {self.gains_name}")
        )

    def probability(
        self, scenario: Scenario, plant: PlantTable, start: float
    ) -> CountedProbability:
        """Probability counted for a tube from starts within `start` (rad) of a scenario's.

        It speaks of flights where the tube is from all starts counted, and these are the only
        difference between the flights. Otherwise it speaks of the residual rates alone: most
        flights do not even start inside a tube from one start.
        """
        starts = self.distribution.start_range(scenario, plant)
        from_all = starts is not None and start >= starts - ROUNDING_RAD
        of = "flight" if from_all else "residual_rates"
        return CountedProbability(of=of, at_most=self.epsilon, confidence=self.confidence)

    def check(
        self, scenario: Scenario, plant: PlantTable, gains: PIGains, start: float = 0.0
    ) -> None:
        """Refuse a scenario whose flights the boxes do not cover.

        `plant`: the aircraft of the scenario that flies. `start` (rad): distance of the starts from
        the scenario's course and path angle. Raises InputError if aircraft, gains, manoeuvre,
        limits, controller, starts or air differ; one line that names the key.
        """
        if plant.aircraft is None or files_hash(plant.aircraft) != self.aircraft_sha256:
            raise InputError(
                f"conformance: `aircraft` must be {self.aircraft} with the files it was flown "
                f"with, got {plant.aircraft or plant.kind}."
            )
        for name in ("K_P", "K_I"):
            mine, theirs = getattr(self.gains, name), getattr(gains, name)
            if not np.allclose(mine, theirs, rtol=SAME_GAINS, atol=0.0):
                raise InputError(
                    f"conformance: `{name}` must be that of {self.gains_name}, {mine.tolist()}, "
                    f"got {theirs.tolist()}."
                )
        if why := self.distribution.difference(scenario, plant):
            raise InputError(f"conformance: must be of the flights of the scenario: {why}.")
        flight = flown_values(scenario, plant)
        for key in STARTS if start else ():
            low, *_, high = self.distribution.dispersed.get(key, 2 * [flight[key]])
            most = min(flight[key] - low, high - flight[key])
            if math.degrees(start) > most + ROUNDING_DEG:
                raise InputError(
                    f"conformance: `start` must be at most {most:.4g} deg from `{key}`, as in the "
                    f"flights counted, got {math.degrees(start):.4g} deg."
                )


def boxes_at_scale(
    learned: RateBoxes, scores: FloatArray, epsilon: float, confidence: float
) -> RateBoxes:
    """The boxes at the scale of `counted_scale`; InputError if too many scores are infinite."""
    scale, _ = counted_scale(scores, epsilon, confidence)
    if math.isinf(scale):
        most = allowed_outside(len(scores), epsilon, confidence)
        raise InputError(
            f"`not_completed` must be at most {most} of {len(scores)} fresh flights for `epsilon` "
            f"{epsilon:g} and `confidence` {confidence:.10g}, got {np.sum(np.isinf(scores))}."
        )
    return learned.scaled(scale)


def save_conformance(conformance: Conformance, path: str | Path) -> None:
    """Write a conformance as JSON with its SHA-256, whole or not at all.

    Raises OutputError if the file cannot be written.
    """
    tables = {**conformance_tables(conformance), "seal": BLANK}
    text = f"{json.dumps(tables, indent=1, ensure_ascii=False)}\n"
    write_text(Path(path), seal(text.encode()).decode())


def conformance_tables(conformance: Conformance) -> dict[str, Any]:
    """Everything as plain values, as it is in the file, with the claim in words."""
    return {**tables_of(conformance), "sentence": conformance.sentence}


def load_conformance(path: str | Path) -> Conformance:
    """Read a conformance as `save_conformance` writes it.

    Raises InputError if the file cannot be read, is not as it was written, does not hold a
    conformance, or claims more than what was counted supports; the message names file and key.
    """
    sealed_bytes(Path(path), "conformance file", "make it again with flighttune conform")
    conformance = read(path, Conformance, beside=("sentence", "seal"))
    try:
        _ = conformance.sentence
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: `distribution` must be that of a campaign.") from error
    return conformance
