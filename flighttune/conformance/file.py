"""Boxes of an aircraft's residual rates, the count of flights behind them, and their file."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import Field

from flighttune.aircraft.aircraft import files_hash
from flighttune.arrays import FloatArray, check_at_least, read_only_vector
from flighttune.conformance.boxes import RateBoxes
from flighttune.conformance.residual import RESIDUALS, ConformantModel
from flighttune.control.gains import PIGains
from flighttune.errors import InputError
from flighttune.guarantee.count import allowed_outside, counted_scale
from flighttune.present.tables import number
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.seal import BLANK, seal, sealed_bytes
from flighttune.value_file import STRICT, read, tables_of
from flighttune.whole_file import write_text

# Tables of a scenario that must be those of the flights counted, but for what was dispersed.
FLOWN_ALIKE = ("flight", "reference", "route", "limits", "controller")

# Tables that a scenario may leave out; keys that it does have must match those flights.
AIR_AND_AIRFRAME = ("disturbance", "wind", "gust", "turbulence", "sensors", "plant")

# Keys that are drawn and named in the sentence of a claim; all are in the file.
MAX_NAMED_KEYS = 5

# Keys of the start of a flight.
STARTS = ("flight.chi_deg", "flight.gamma_deg")

# Distributions whose stated range holds every draw, not all but a few in 1e9.
BOUNDED = ("uniform", "choice")

# Degrees by which the ends of a range may be rounded.
ROUNDING_DEG = 1e-6

# Rad by which the ends of a range are rounded where it is added to a start.
ROUNDING_RAD = 1e-14

# Relative difference of gains below which they are the same: tuning repeats to 1e-9.
SAME_GAINS = 1e-6

Count: TypeAlias = Annotated[int, Field(ge=0, le=10**9)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """Distribution of the flights that a count holds for."""

    title: str  # title of the campaign
    air: str  # ``calm``, ``wind``, or the intensity of the turbulence
    fixed: dict[str, Any]  # keys of the scenario that are the same in all flights, by dotted path
    # The lowest and the highest value of a key that is drawn, or all values where they are words
    dispersed: dict[str, Annotated[list[Any], Field(min_length=1)]]
    # `disperse` and `correlation`: the tables of these names in the campaign, which say how keys
    # are drawn.
    disperse: list[dict[str, Any]]
    correlation: list[dict[str, Any]]

    @property
    def windy(self) -> bool:
        """Whether any of its flights has wind."""
        return any(key.startswith("wind.") for key in (*self.fixed, *self.dispersed))

    @property
    def sentence(self) -> str:
        """The distribution in words."""
        drawn = list(self.dispersed)
        if len(drawn) > MAX_NAMED_KEYS:
            drawn[MAX_NAMED_KEYS - 1 :] = [f"{len(drawn) - MAX_NAMED_KEYS + 1} more keys"]
        keys = ", ".join(drawn) or "nothing"
        air = {"calm": "calm air", "wind": "steady wind"}.get(self.air, f"{self.air} turbulence")
        if self.windy and self.air not in ("calm", "wind"):
            air = f"wind and {air}"
        return f'"{self.title}", drawn at random ({keys}) in {air}'

    def start_range(self, scenario: Scenario, plant: PlantTable) -> float | None:
        """Distance of its starts from a scenario's course and path angle, rad.

        None unless its flights are those of the scenario in calm air in all but their starts, which
        are drawn within as much to either side in both angles.
        """
        own, drawn = flown_values(scenario, plant), set(self.dispersed)
        alike = drawn <= set(STARTS) and {*own} == {*self.fixed} | drawn and self.air == "calm"
        if not alike or any(table.get("distribution") not in BOUNDED for table in self.disperse):
            return None
        ranges = ((own[key], self.dispersed.get(key, [own[key]])) for key in STARTS)
        away = [abs(end - start) for start, ends in ranges for end in (ends[0], ends[-1])]
        return math.radians(max(away)) if max(away) - min(away) <= ROUNDING_DEG else None

    def difference(self, scenario: Scenario, plant: PlantTable) -> str | None:
        """Why no flight of the distribution can be one of this scenario; None if one can."""
        own = flown_values(scenario, plant)
        for key in dict.fromkeys([*own, *self.fixed]):
            if key in self.dispersed:
                drawn = self.dispersed[key]
                words = any(isinstance(value, str) for value in drawn)
                if own[key] not in drawn if words else not drawn[0] <= own[key] <= drawn[-1]:
                    allowed = f"one of {drawn}" if words else f"{drawn[0]:g} to {drawn[-1]:g}"
                    return f"`{key}` must be {allowed}, got {own[key]!r}"
            elif key.split(".")[0] in FLOWN_ALIKE or key in own:
                if own.get(key) != self.fixed.get(key):
                    return f"`{key}` must be {self.fixed.get(key)!r}, got {own.get(key)!r}"
        return None


def flown_values(scenario: Scenario, plant: PlantTable) -> dict[str, Any]:
    """Keys of a scenario that determine a flight, by dotted path; the plant is in ``plant``."""
    tables = scenario.as_dict()
    tables["plant"] = plant.model_dump(mode="json", exclude_none=True, exclude={"name", "aircraft"})
    kept = {name: tables[name] for name in (*FLOWN_ALIKE, *AIR_AND_AIRFRAME) if name in tables}
    return dict(_leaves(kept, ""))


def _leaves(value: Any, above: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _leaves(item, f"{above}.{name}" if above else name)
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        for i, item in enumerate(value):
            yield from _leaves(item, f"{above}[{i}]")
    else:
        yield above, value


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
            f"of {len(self.all_scores)} fresh flights {self.counted[1]} left the boxes: a flight "
            f"of {self.distribution.sentence} leaves the boxes with probability at most "
            f"{number(self.epsilon)}, confidence {self.confidence:.10g}"
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
    return read(path, Conformance, beside=("sentence", "seal"))
