"""When a count ends, and what a number of flights outside supports then."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.words import at_most, number
from flighttune.campaigns.statistics.count import (
    LOOK,
    allowed_outside,
    counted_scale,
    flights_in_two_steps,
    fresh_flights,
    supported_epsilon,
    sure,
)
from flighttune.claims.about import About

# Numbers of flights at which a count is read, over the first of them.
DOUBLED = 2 ** np.arange(31)

# Flights counted before the answer is first judged; then twice, four times ... as many.
BATCH = 24

# What is said of a new flight and a fence where it is sure whether flights stay inside.
SURE = {
    "yes": "leaves the fence with probability at most",
    "no": "is not certainly inside the fence with probability above",
}


class Shared(NamedTuple):
    """Claims that share the probability of an error: each has its part of it (Bonferroni)."""

    corridor: bool  # whether bounds of the signals are claimed
    fences: int
    readings: int  # numbers of flights at which all of them may be read
    each: float  # confidence of a claim at one reading
    planned: tuple[float, float] | None  # epsilon and confidence of an earlier claim beside it

    @property
    def parts(self) -> list[tuple[int, str]]:
        """Numbers of parts into which the probability is divided, with what has them in words."""
        fences = "its fence" if self.fences == 1 else f"{self.fences} fences"
        claims = f"the band and {fences}" if self.corridor else fences
        numbers = {
            claims: self.corridor + self.fences,
            f"{self.readings} numbers of flights": self.readings,
        }
        return [(n, words) for words, n in numbers.items() if n > 1]

    @property
    def confidence(self) -> float:
        """Confidence of all claims together."""
        spent = 1.0 - self.each + (1.0 - self.planned[1] if self.planned else 0.0)
        return 1.0 - math.prod(n for n, _ in self.parts) * spent

    @property
    def words(self) -> str:
        """What shares the confidence, in brackets; empty for a single claim."""
        parts = " at ".join(words for _, words in self.parts)
        shared = [f"by {parts}"] if parts else []
        if self.planned:
            epsilon, confidence = self.planned
            shared.append(f"with the claim planned, {epsilon:g} at {confidence:.10g}")
        return f" (shared {' and '.join(shared)})" if shared else ""


def each_of(claims: int, confidence: float) -> float:
    """Confidence of each of some claims that share the probability of an error."""
    return 1.0 - (1.0 - confidence) / claims


class Supported(NamedTuple):
    """What flights outside a fence support."""

    epsilon: float  # smallest probability of leaving it that may be claimed
    claim: str  # what a new flight does, with its probability; empty if nothing is claimed
    lacks: str = ""  # why nothing is claimed


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending(ABC):
    """A rule, fixed before a flight is counted, by which a count ends."""

    flights: int  # planned
    epsilon: float
    confidence: float  # of each claim at each reading

    corridor: ClassVar[bool] = True  # whether it claims bounds of the signals
    words: ClassVar[str] = ""  # what is special about the confidence

    @staticmethod
    def of(about: About) -> "Ending":
        """The ending that a file states."""
        flights = about.plan["runs"] - about.learned
        rule: dict[str, Any] = {"epsilon": about.epsilon, "confidence": about.confidence}
        if about.until_sure:
            return AnyTime(flights=flights, **rule)
        return Fixed(flights=flights, early=about.early, **rule)

    @classmethod
    def enough(cls, flights: int | None, epsilon: float, confidence: float) -> Self:
        """It ends after `flights`, by default as many as `fresh_flights` asks for."""
        flights = fresh_flights(flights, epsilon, confidence)
        return cls(flights=flights, epsilon=epsilon, confidence=confidence)

    @property
    @abstractmethod
    def stated(self) -> dict[str, Any]:
        """The ending as fields of `About`, of which `of` makes it again."""

    @property
    def numbers(self) -> npt.NDArray[np.int64]:
        """Numbers of flights, each twice the last, to which the count may grow."""
        return self.flights * DOUBLED

    def readings(self, flights: int) -> tuple[int, ...]:
        """Numbers of flights, fixed beforehand, at which a count of `flights` may be read."""
        return tuple(self.numbers[self.numbers <= flights].tolist())

    def complete(self, flights: int) -> bool:
        """Whether a count of `flights` claims what it can."""
        return flights >= self.flights

    def expected(self, flights: int) -> int:
        """Flights after which a count that has come to `flights` probably ends."""
        del flights
        return self.flights

    @abstractmethod
    def looks(self) -> list[int]:
        """Numbers of flights, fewer than planned, after which the answer may be certain."""

    def allowed(self, flights: int) -> int:
        """How many may be outside, of `flights` or, if more, of those planned."""
        return allowed_outside(max(self.flights, flights), self.epsilon, self.confidence)

    @abstractmethod
    def decided(self, outside: Sequence[int], flights: int) -> bool:
        """Whether the answer is certain, with so many outside for each claim."""

    @abstractmethod
    def supported(self, outside: int, flights: int) -> Supported:
        """What is supported about a fence."""

    @abstractmethod
    def scale(self, scores: FloatArray) -> float:
        """Scale of the bounds; infinite if the count claims none."""

    def shared(self, about: About, flights: int) -> Shared:
        """The claims of a count of `flights` that share its confidence."""
        readings = max(1, len(self.readings(flights)))
        fences = len(about.fences)
        return Shared(self.corridor, fences, readings, self.confidence, about.planned)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fixed(Ending):
    """It ends after the flights planned, or sooner where more are outside than may be.

    In two steps it ends after the first `early` flights too, if none of them is outside.
    """

    early: int = 0  # 0 if it does not end so

    @classmethod
    def in_two_steps(cls, epsilon: float, confidence: float) -> Self:
        """The fewest flights of which none may be outside first, and then one."""
        early, flights = flights_in_two_steps(epsilon, confidence)
        return cls(flights=flights, epsilon=epsilon, confidence=confidence, early=early)

    @property
    def stated(self) -> dict[str, Any]:
        """The ending as fields of `About`, of which `of` makes it again."""
        return {"epsilon": self.epsilon, "confidence": self.confidence, "early": self.early}

    def complete(self, flights: int) -> bool:
        """Whether a count of `flights` claims what it can."""
        return flights >= self.flights or flights == self.early > 0

    def expected(self, flights: int) -> int:
        """Flights after which a count that has come to `flights` probably ends."""
        return self.early if flights < self.early else self.flights

    def looks(self) -> list[int]:
        """Numbers of flights, fewer than planned, after which the answer may be certain."""
        numbers = sorted({*(BATCH * DOUBLED).tolist(), self.early} - {0})
        return [n for n in numbers if n < self.flights]

    def allowed(self, flights: int) -> int:
        """How many may be outside, of `flights` or, if more, of those planned."""
        flights = max(self.flights, flights)
        return allowed_outside(flights, self.epsilon, self.confidence, self.early)

    def decided(self, outside: Sequence[int], flights: int) -> bool:
        """Whether one more is outside than may be, or none of the first `early`."""
        most = max(outside)
        return most > self.allowed(flights) or (flights == self.early and not most)

    def supported(self, outside: int, flights: int) -> Supported:
        """What is supported about a fence: a flight that was not flown counts as outside."""
        ended_early = flights == self.early and not outside
        planned = flights if ended_early else max(self.flights, flights)
        missing = planned - flights
        epsilon = supported_epsilon(outside + missing, planned, self.confidence, self.early)
        if missing:
            lacks = f", of {planned} planned: more may be outside than a yes allows"
            return Supported(epsilon, "", lacks)
        return Supported(epsilon, f"{SURE['yes']} {at_most(epsilon)}")

    def scale(self, scores: FloatArray) -> float:
        """Scale that a new flight exceeds with probability at most epsilon; else infinite."""
        if not self.complete(len(scores)):
            return math.inf
        scale, _ = counted_scale(scores, self.epsilon, self.confidence, self.early)
        return scale


@dataclass(frozen=True, slots=True, kw_only=True)
class AnyTime(Ending):
    """It ends as soon as it is sure whether flights leave a fence, and claims no bounds.

    Its rule is valid at any number of flights, so that all readings share no confidence.
    """

    corridor: ClassVar[bool] = False
    words: ClassVar[str] = " at any number of flights"

    @property
    def stated(self) -> dict[str, Any]:
        """The ending as fields of `About`, of which `of` makes it again."""
        return {"epsilon": self.epsilon, "confidence": self.confidence, "until_sure": True}

    def readings(self, flights: int) -> tuple[int, ...]:
        """No number is fixed beforehand."""
        del flights
        return ()

    def looks(self) -> list[int]:
        """Numbers of flights, fewer than planned, after which the answer may be certain."""
        return [*range(LOOK, self.flights, LOOK)]

    def decided(self, outside: Sequence[int], flights: int) -> bool:
        """Whether it is sure of a claim that flights keep it, or that they do not."""
        return any(sure(k, flights, self.epsilon, self.confidence) for k in outside)

    def supported(self, outside: int, flights: int) -> Supported:
        """What is supported about a fence: its epsilon where a yes is sure."""
        answer = sure(outside, flights, self.epsilon, self.confidence)
        epsilon = self.epsilon if answer == "yes" else 1.0
        if not answer:
            return Supported(epsilon, "", ": neither yes nor no is sure")
        return Supported(epsilon, f"{SURE[answer]} {number(self.epsilon)}")

    def scale(self, scores: FloatArray) -> float:
        """Infinite: it claims no bounds."""
        del scores
        return math.inf
