"""What the file of a count holds besides its flights: shape, plan and claim."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import AfterValidator, Field

from flighttune.base.arrays import FloatArray
from flighttune.base.files.table import STRICT
from flighttune.claims.shape import MIN_LEARNED
from flighttune.gaps.watch import SignalModel

# The class of each kind of count, as module:class, by what `of` says in its file.
KINDS: Mapping[str | None, str] = {
    None: "flighttune.claims.band:Band",
    "residual": "flighttune.claims.residual:Residual",
    "turn_back": "flighttune.claims.turn_back:TurnBack",
    "monitor": "flighttune.claims.monitor:Monitor",
}

# Axis of the windows.
Over: TypeAlias = Literal["time", "along"]


def _kind(of: str | None) -> str | None:
    """A kind of count that there is."""
    if of not in KINDS:
        raise ValueError(f"must be {', '.join(map(str, KINDS))}")
    return of


Of: TypeAlias = Annotated[str | None, AfterValidator(_kind)]

Probability: TypeAlias = Annotated[float, Field(gt=0.0, lt=1.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """The shape of a band, the flights that it is about, and its claim."""

    of: Of = None
    signals: Annotated[dict[str, str], Field(min_length=1)]  # units by name
    # (1 or 10, windows, signals): the middle of the band, by the terms of the wind
    coefficients: FloatArray
    half: FloatArray  # (windows, signals): half-width at scale 1
    predicted_from: Literal["wind"] | None  # what the middle is predicted from
    # of the campaign; its runs are the flights learned from, and those to be counted first
    plan: dict[str, Any]
    learned: Annotated[
        int, Field(ge=MIN_LEARNED, le=10**9)
    ]  # number of draws that the shape was learned from
    epsilon: float
    confidence: float  # of each claim at each number of flights
    fences: tuple[dict[str, Any], ...] = ()  # GeoJSON in which flights were counted
    # Epsilon and confidence that the count was planned with, where the claim has others
    planned: tuple[Probability, Probability] | None = None
    until_sure: bool = False  # it is counted until a fence is answered, and claims no bounds
    # Flights after which it ends if none is outside, 0 if it does not end before the number planned
    early: Annotated[int, Field(ge=0, lt=10**9)] = 0
    models: tuple[SignalModel, ...] = ()  # of a monitor, which the first half of `learned` taught

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune band 2"
    UNITS: ClassVar[Mapping[str, str]] = {"half": "as in signals"}

    @property
    def kind(self) -> Any:
        """The class of the count, which is imported on first use."""
        module, _, name = KINDS[self.of].partition(":")
        return getattr(import_module(module), name)
