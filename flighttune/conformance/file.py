"""Boxes of an aircraft's residual rates, the count of flights behind them, and their file."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flighttune.aircraft.aircraft import files_hash
from flighttune.conformance.boxes import SHORTEST_S, Over, RateBoxes, Windows
from flighttune.conformance.residual import COUNTED, ConformantModel
from flighttune.control.gains import PIGains
from flighttune.errors import InputError, ScenarioError
from flighttune.mistakes import first_mistake
from flighttune.present.numbers import number
from flighttune.quantities import (
    Airspeed,
    Bandwidth,
    Damping,
    Delay,
    Finite,
    Gravity,
    TimeConstant,
)
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.table_file import json_tables
from flighttune.whole_file import write_text

FORMAT = "flighttune conformance 3"
"""Readers refuse what they do not know."""

FLOWN_ALIKE = ("flight", "reference", "limits", "controller")
"""Tables of a scenario that must be those of the flights counted, but for what was dispersed."""

AIR_AND_AIRFRAME = ("disturbance", "wind", "gust", "turbulence", "sensors", "plant")
"""Tables that a scenario may leave out; keys that it does have must match those flights."""

NAMED = 5
"""Keys that are drawn and named in the sentence of a claim; all are in the file."""

LEAVES = "leaves them with probability at most"
"""Before the probability and its confidence, in the sentence of a claim."""

ROUNDING = 1e-6
"""Degrees by which the ends of a range may be rounded."""

SAME_GAINS = 1e-6
"""Relative difference of gains below which they are the same: tuning repeats to 1e-9."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """One count: boxes fitted to some flights, and fresh ones flown against them.

    Attributes
    ----------
    learned : int
        Flights the boxes were fitted to.
    counted : int
        Fresh flights.
    outside : int
        Those of them that left a box, or were not flown to their end.
    widened : float, 1
        Largest half width of a box over that of the smallest around the flights learned from.
    """

    learned: int
    counted: int
    outside: int
    widened: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """Which flights a count holds for.

    Attributes
    ----------
    title : str
        Of the campaign.
    air : str
        ``calm``, ``wind``, or the intensity of the turbulence.
    fixed : mapping of str to plain value
        Keys of the scenario that are the same in all flights, by dotted path.
    dispersed : mapping of str to list
        The lowest and the highest value of a key that is drawn, or all values where they are words.
    """

    title: str
    air: str
    fixed: Mapping[str, Any]
    dispersed: Mapping[str, list[Any]]

    @property
    def windy(self) -> bool:
        """Whether any of its flights has wind."""
        return any(key.startswith("wind.") for key in (*self.fixed, *self.dispersed))

    @property
    def sentence(self) -> str:
        """The distribution in words."""
        drawn = list(self.dispersed)
        if len(drawn) > NAMED:
            drawn[NAMED - 1 :] = [f"{len(drawn) - NAMED + 1} more keys"]
        keys = ", ".join(drawn) or "nothing"
        air = {"calm": "calm air", "wind": "steady wind"}.get(self.air, f"{self.air} turbulence")
        return f'"{self.title}", drawn at random ({keys}) in {air}'

    def difference(self, scenario: Scenario, plant: PlantTable) -> str | None:
        """Why no flight of the distribution can be one of this scenario; None if one can.

        Parameters
        ----------
        scenario : Scenario
        plant : PlantTable
            The aircraft flown.
        """
        own = flown_values(scenario, plant)
        for key in dict.fromkeys([*own, *self.fixed]):
            if key in self.dispersed:
                known = self.dispersed[key]
                words = any(isinstance(value, str) for value in known)
                if own[key] not in known if words else not known[0] <= own[key] <= known[-1]:
                    known_as = f"one of {known}" if words else f"{known[0]:g} to {known[-1]:g}"
                    return f"`{key}` must be {known_as}, got {own[key]!r}"
            elif key.split(".")[0] in FLOWN_ALIKE or key in own:
                if own.get(key) != self.fixed.get(key):
                    return f"`{key}` must be {self.fixed.get(key)!r}, got {own.get(key)!r}"
        return None


def flown_values(scenario: Scenario, plant: PlantTable) -> dict[str, Any]:
    """Keys of a scenario that determine a flight, by dotted path; the plant's table is ``plant``.

    Parameters
    ----------
    scenario : Scenario
    plant : PlantTable
    """
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conformance:
    """Boxes of the residual rates of one aircraft under one gain set, and what was counted.

    Attributes
    ----------
    aircraft : str
        Name or folder.
    gains_name : str
    gains : PIGains
    model : ConformantModel
        Model whose rates are subtracted; the same for all flights.
    boxes : RateBoxes
    epsilon, confidence : float, 1
        Of the claim.
    attempts : tuple of Attempt
        In order; the boxes are those of the last.
    distribution : Distribution
    sha256 : mapping of str to str
        Hashes of the ``aircraft`` (its files), the ``identified`` model and the ``campaign``.
    """

    aircraft: str
    gains_name: str
    gains: PIGains
    model: ConformantModel
    boxes: RateBoxes
    epsilon: float
    confidence: float
    attempts: tuple[Attempt, ...]
    distribution: Distribution
    sha256: Mapping[str, str]

    @property
    def holds(self) -> bool:
        """Whether none of the flights of the last attempt left the boxes."""
        return self.attempts[-1].outside == 0

    @property
    def air(self) -> str:
        """``calm``, ``wind``, or the intensity of the turbulence."""
        return self.distribution.air

    @property
    def sentence(self) -> str:
        """The claim, or why there is none, with the distribution it is about."""
        last, tries = self.attempts[-1], len(self.attempts)
        flights = f"flight of {self.distribution.sentence}"
        if not self.holds:
            return (
                f"of {last.counted} flights not used, {last.outside} left the boxes in the last of "
                f"{tries} counts: nothing is claimed of a {flights}"
            )
        before = f" (count {tries}, after {tries - 1} with flights outside)" if tries > 1 else ""
        return (
            f"of {last.counted} flights not used, none left the boxes{before}: a {flights} "
            f"{LEAVES} {number(self.epsilon)}, confidence {self.confidence:.10g}"
        )

    def check(
        self, scenario: Scenario, plant: PlantTable, gains: PIGains, start: float = 0.0
    ) -> None:
        """Refuse a scenario whose flights the boxes do not cover.

        Parameters
        ----------
        scenario : Scenario
        plant : PlantTable
            The aircraft of the scenario that flies.
        gains : PIGains
        start : float, rad
            How far flights start from the scenario's course and path angle.

        Raises
        ------
        InputError
            If aircraft, gains, manoeuvre, limits, controller, starts or air differ; one line that
            names the key.
        """
        if plant.aircraft is None or files_hash(plant.aircraft) != self.sha256["aircraft"]:
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
        for key in ("flight.chi_deg", "flight.gamma_deg") if start else ():
            low, *_, high = self.distribution.dispersed.get(key, 2 * [flight[key]])
            most = min(flight[key] - low, high - flight[key])
            if math.degrees(start) > most + ROUNDING:
                raise InputError(
                    f"conformance: `start` must be at most {most:.4g} deg from `{key}`, as in the "
                    f"flights counted, got {math.degrees(start):.4g} deg."
                )

    def as_dict(self) -> dict[str, Any]:
        """Everything as plain values, as written to the file."""
        last = self.attempts[-1]
        return {
            "format": FORMAT,
            "sentence": self.sentence,
            "aircraft": self.aircraft,
            "sha256": dict(self.sha256),
            "gains": {"name": self.gains_name, **self.gains.as_lists()},
            "model": self.model.as_dict(),
            "distribution": asdict(self.distribution),
            "epsilon": self.epsilon,
            "confidence": self.confidence,
            "flights_learned": last.learned,
            "flights_counted": last.counted,
            "outside": last.outside,
            "attempts": [asdict(one) for one in self.attempts],
            "boxes": {
                "over": self.boxes.windows.over,
                "window_s": self.boxes.windows.length,
                **{name: _pairs(self.boxes, i) for i, name in enumerate(COUNTED)},
            },
        }


def _pairs(boxes: RateBoxes, column: int) -> list[list[float]]:
    return np.column_stack([boxes.low[:, column], boxes.high[:, column]]).tolist()


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


Count = Annotated[int, Field(ge=0, le=10**9)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class _Hashes(_Table):
    aircraft: str
    identified: str
    campaign: str


class _Lag(_Table):
    order: Literal[1, 2, 3]
    natural_frequency: Bandwidth
    damping: Damping
    lag: TimeConstant
    delay: Delay


class _Model(_Table):
    V_a_mps: Airspeed
    g_mps2: Gravity
    phi: _Lag
    n_z: _Lag


class _Distribution(_Table):
    title: str
    air: str
    fixed: dict[str, Any]
    dispersed: dict[str, list[Any]]


class _Attempt(_Table):
    learned: Count
    counted: Count
    outside: Count
    widened: Annotated[float, Field(ge=1.0, allow_inf_nan=False)] = 1.0


Pair = Annotated[list[Finite], Field(min_length=2, max_length=2)]


class _Boxes(_Table):
    over: Over
    window_s: Annotated[float, Field(ge=SHORTEST_S, allow_inf_nan=False)]
    d_chi_rad_s: list[Pair]
    d_gamma_rad_s: list[Pair]
    roll_rad: list[Pair]
    roll_change_rad: list[Pair]
    chi_err_rad: list[Pair]
    gamma_err_rad: list[Pair]

    def value(self) -> RateBoxes:
        """The boxes as a value."""
        both = np.array([getattr(self, name) for name in COUNTED], dtype=float)
        windows = Windows(over=self.over, count=both.shape[1], length=self.window_s)
        return RateBoxes(windows=windows, low=both[:, :, 0].T, high=both[:, :, 1].T)


class _File(_Table):
    format: Literal["flighttune conformance 3"]
    aircraft: str
    sha256: _Hashes
    gains: GainsTable
    model: _Model
    distribution: _Distribution
    epsilon: Share
    confidence: Share
    attempts: Annotated[list[_Attempt], Field(min_length=1)]
    boxes: _Boxes


def save_conformance(found: Conformance, path: str | Path) -> None:
    """Write a conformance as JSON, whole or not at all.

    Parameters
    ----------
    found : Conformance
    path : str or Path

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    write_text(Path(path), json.dumps(found.as_dict(), indent=1) + "\n")


def load_conformance(path: str | Path) -> Conformance:
    """Read a conformance as `save_conformance` writes it.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    ScenarioError
        If the file cannot be read or does not hold one; the message names file and key.
    """
    try:
        read = _File.model_validate(json_tables(Path(path)))
        boxes = read.boxes.value()
    except ValidationError as error:
        raise ScenarioError(f"{path}: {first_mistake(error)}") from error
    except ScenarioError:  # is a ValueError too
        raise
    except ValueError as error:
        raise ScenarioError(f"{path}: `boxes` must have equal counts: {error}") from error
    return Conformance(
        aircraft=read.aircraft,
        gains_name=read.gains.name,
        gains=read.gains.gains(),
        model=ConformantModel.of(read.model.model_dump()),
        boxes=boxes,
        epsilon=read.epsilon,
        confidence=read.confidence,
        attempts=tuple(Attempt(**one.model_dump()) for one in read.attempts),
        distribution=Distribution(**read.distribution.model_dump()),
        sha256=read.sha256.model_dump(),
    )
