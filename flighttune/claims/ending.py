"""Rules that end a count, and the claims that it then supports."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.words import at_most, confidence_text, number
from flighttune.campaigns.statistics.count import (
    LOOK,
    OUTSIDE,
    allowed_outside,
    check_enough,
    counted_scale,
    flights_needed,
    supported_epsilon,
    sure,
)
from flighttune.claims.about import About

# Numbers of flights at which a count is read, relative to the first.
DOUBLED = 2 ** np.arange(31)

# Flights before the first judgement of the answer; then twice, four times ... this number.
BATCH = 24

# Words about a new flight and a fence, for a sure yes and a sure no.
SURE = {
    "yes": "leaves the fence with probability at most",
    "no": "is not certainly inside the fence with probability above",
}


class Shared(NamedTuple):
    """Claims that share the probability of an error by Bonferroni's rule."""

    corridor: bool  # whether bounds on the signals are claimed
    fences: int
    readings: int  # numbers of flights at which all claims may be read
    each: float  # confidence of a claim at one reading
    planned: tuple[float, float] | None  # epsilon and confidence of an earlier claim beside it

    @property
    def parts(self) -> list[tuple[int, str]]:
        """Numbers of equal parts of the probability, with their claims in words."""
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
        """The claims that share the confidence, in brackets; empty for a single claim."""
        parts = " at ".join(words for _, words in self.parts)
        shared = [f"by {parts}"] if parts else []
        if self.planned:
            epsilon, confidence = self.planned
            shared.append(f"with the claim planned, {epsilon:g} at {confidence_text(confidence)}")
        return f" (shared {' and '.join(shared)})" if shared else ""


def each_of(claims: int, confidence: float) -> float:
    """Confidence of each of some claims that share the probability of an error."""
    return 1.0 - (1.0 - confidence) / claims


class Supported(NamedTuple):
    """The claim that a number of flights outside a fence supports."""

    epsilon: float  # smallest probability of leaving the fence that may be claimed
    claim: str  # the event and its probability; empty without a claim
    lacks: str = ""  # reason for no claim


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending(ABC):
    """A rule, fixed before a flight is counted, by which a count ends."""

    flights: int  # planned
    epsilon: float
    confidence: float  # confidence of each claim at each reading

    corridor: ClassVar[bool] = True  # whether it claims bounds on the signals
    words: ClassVar[str] = ""  # addition about the confidence, in words

    @staticmethod
    def of(about: About) -> "Ending":
        """The ending in a file."""
        flights = about.plan["runs"] - about.learned
        rule: dict[str, Any] = {"epsilon": about.epsilon, "confidence": about.confidence}
        if about.until_sure:
            return AnyTime(flights=flights, **rule)
        return Fixed(flights=flights, early=about.early, **rule)

    @classmethod
    def enough(
        cls, flights: int | None, epsilon: float, confidence: float, *, outside: int = OUTSIDE
    ) -> Self:
        """End after `flights`, by default the smallest number of which `outside` may be outside."""
        if flights is None:
            flights = flights_needed(epsilon, confidence, outside)
        check_enough(flights, epsilon, confidence)
        return cls(flights=flights, epsilon=epsilon, confidence=confidence)

    @property
    @abstractmethod
    def stated(self) -> dict[str, Any]:
        """The ending as fields of `About`, which `of` reads."""

    @property
    def numbers(self) -> npt.NDArray[np.int64]:
        """Numbers of flights, each twice the last, to which the count may grow."""
        return self.flights * DOUBLED

    def readings(self, flights: int) -> tuple[int, ...]:
        """Numbers of flights, fixed beforehand, at which a count of `flights` may be read."""
        return tuple(self.numbers[self.numbers <= flights].tolist())

    def complete(self, flights: int) -> bool:
        """Whether a count of `flights` is complete for its claim."""
        return flights >= self.flights

    def expected(self, flights: int) -> int:
        """Probable final number of flights of a count that has `flights` so far."""
        del flights
        return self.flights

    @abstractmethod
    def looks(self) -> list[int]:
        """Numbers of flights below the planned number at which the answer is judged."""

    def allowed(self, flights: int) -> int:
        """Allowed number outside, of `flights` or, if larger, of the planned number."""
        return allowed_outside(max(self.flights, flights), self.epsilon, self.confidence)

    @abstractmethod
    def decided(self, outside: Sequence[int], flights: int) -> bool:
        """Whether the answer is certain, with these numbers outside, one for each claim."""

    @abstractmethod
    def supported(self, outside: int, flights: int) -> Supported:
        """The supported claim about a fence."""

    @abstractmethod
    def scale(self, scores: FloatArray) -> float:
        """Scale of the bounds; infinite if the count claims none."""

    def shared(self, about: About, flights: int) -> Shared:
        """Claims that share the confidence of a count of `flights`."""
        readings = max(1, len(self.readings(flights)))
        fences = len(about.fences)
        return Shared(self.corridor, fences, readings, self.confidence, about.planned)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fixed(Ending):
    """End after the planned flights, or as soon as too many are outside.

    In two steps, as in missions of 0.4.0, it also ends after the first `early` flights, if none of
    them is outside.
    """

    early: int = 0  # 0: one step

    @property
    def stated(self) -> dict[str, Any]:
        """The ending as fields of `About`, which `of` reads."""
        return {"epsilon": self.epsilon, "confidence": self.confidence, "early": self.early}

    def complete(self, flights: int) -> bool:
        """Whether a count of `flights` is complete for its claim."""
        return flights >= self.flights or flights == self.early > 0

    def expected(self, flights: int) -> int:
        """Probable final number of flights of a count that has `flights` so far."""
        return self.early if flights < self.early else self.flights

    def looks(self) -> list[int]:
        """Numbers of flights below the planned number at which the answer is judged."""
        numbers = sorted({*(BATCH * DOUBLED).tolist(), self.early} - {0})
        return [n for n in numbers if n < self.flights]

    def allowed(self, flights: int) -> int:
        """Allowed number outside, of `flights` or, if larger, of the planned number."""
        flights = max(self.flights, flights)
        return allowed_outside(flights, self.epsilon, self.confidence, self.early)

    def decided(self, outside: Sequence[int], flights: int) -> bool:
        """Whether too many are outside, or none of the first `early`."""
        most = max(outside)
        return most > self.allowed(flights) or (flights == self.early and not most)

    def supported(self, outside: int, flights: int) -> Supported:
        """The supported claim about a fence: a flight that was not flown counts as outside."""
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
    """End as soon as it is sure whether flights leave a fence, without bounds on signals.

    Its rule is valid at any number of flights, so readings do not share the confidence.
    """

    corridor: ClassVar[bool] = False
    words: ClassVar[str] = " at any number of flights"

    @property
    def stated(self) -> dict[str, Any]:
        """The ending as fields of `About`, which `of` reads."""
        return {"epsilon": self.epsilon, "confidence": self.confidence, "until_sure": True}

    def readings(self, flights: int) -> tuple[int, ...]:
        """Empty: no number is fixed beforehand."""
        del flights
        return ()

    def looks(self) -> list[int]:
        """Numbers of flights below the planned number at which the answer is judged."""
        return [*range(LOOK, self.flights, LOOK)]

    def decided(self, outside: Sequence[int], flights: int) -> bool:
        """Whether any claim is surely kept or surely not kept."""
        return any(sure(k, flights, self.epsilon, self.confidence) for k in outside)

    def supported(self, outside: int, flights: int) -> Supported:
        """The supported claim about a fence: its epsilon if a yes is sure."""
        answer = sure(outside, flights, self.epsilon, self.confidence)
        epsilon = self.epsilon if answer == "yes" else 1.0
        if not answer:
            return Supported(epsilon, "", ": neither yes nor no is sure")
        return Supported(epsilon, f"{SURE[answer]} {number(self.epsilon)}")

    def scale(self, scores: FloatArray) -> float:
        """Infinite, because it claims no bounds."""
        del scores
        return math.inf
