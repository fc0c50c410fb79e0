"""The file of a count without its flights: shape, plan and claim."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import AfterValidator, Field

from flighttune.base.arrays import FloatArray
from flighttune.base.files.table import STRICT
from flighttune.claims.shape import MIN_LEARNED
from flighttune.gaps.watch import SignalModel

# The class of each kind of count, as module:class, by the value of `of` in its file.
KINDS: Mapping[str | None, str] = {
    None: "flighttune.claims.band:Band",
    "residual": "flighttune.claims.residual:Residual",
    "turn_back": "flighttune.claims.turn_back:TurnBack",
    "monitor": "flighttune.claims.monitor:Monitor",
}

# Axis of the windows.
Over: TypeAlias = Literal["time", "along"]


def _kind(of: str | None) -> str | None:
    """An existing kind of count."""
    if of not in KINDS:
        raise ValueError(f"must be {', '.join(map(str, KINDS))}")
    return of


Of: TypeAlias = Annotated[str | None, AfterValidator(_kind)]

Probability: TypeAlias = Annotated[float, Field(gt=0.0, lt=1.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """The shape of a band, its flights, and its claim."""

    of: Of = None
    signals: Annotated[dict[str, str], Field(min_length=1)]  # units by name
    # (1 or 10, windows, signals): coefficients of the middle of the band, by wind term
    coefficients: FloatArray
    half: FloatArray  # (windows, signals): half-width at scale 1
    predicted_from: Literal["wind"] | None  # quantity that predicts the middle
    # plan of the campaign; its runs are the learning flights and the first counted flights
    plan: dict[str, Any]
    learned: Annotated[
        int, Field(ge=MIN_LEARNED, le=10**9)
    ]  # number of draws for learning the shape
    epsilon: float
    confidence: float  # confidence of each claim at each number of flights
    fences: tuple[dict[str, Any], ...] = ()  # fences, as GeoJSON, that have been counted
    # Epsilon and confidence of the plan, if the claim has others
    planned: tuple[Probability, Probability] | None = None
    until_sure: bool = False  # the count ends with the answer about a fence, and claims no bounds
    # Flights after which the count ends if none is outside; 0: only after the planned number
    early: Annotated[int, Field(ge=0, lt=10**9)] = 0
    models: tuple[SignalModel, ...] = ()  # models of a monitor, from the first half of `learned`

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune band 2"
    UNITS: ClassVar[Mapping[str, str]] = {"half": "as in signals"}

    @property
    def kind(self) -> Any:
        """The class of the count, which is imported on first use."""
        module, _, name = KINDS[self.of].partition(":")
        return getattr(import_module(module), name)
