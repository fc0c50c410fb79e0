"""``[[disperse]]`` and ``[[correlation]]``: which keys of the scenario are drawn, and how."""

import math
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from flighttune.campaign.planning.distributions import (
    Choice,
    Distribution,
    Grid,
    LogNormal,
    Normal,
    Uniform,
    Value,
)
from flighttune.scenario.table import Finite, NotNegative, Positive, Table

Kind: TypeAlias = Literal["normal", "log_normal", "uniform", "choice", "grid"]
Acts: TypeAlias = Literal["sets", "adds", "multiplies"]
Key: TypeAlias = Annotated[str, Field(min_length=1)]
Number: TypeAlias = bool | int | float

NEEDED = {
    "normal": ("mean", "sd"),
    "log_normal": ("median", "sd_log"),
    "uniform": ("lower", "upper"),
    "choice": ("values",),
    "grid": (),
}
"""Keys that a distribution must have."""

POSSIBLE = {
    "normal": ("lower", "upper"),
    "choice": ("weights",),
    "grid": ("values", "lower", "upper", "count"),
}
"""Keys that it may have besides."""

MOST_POINTS = 10_000
"""Values of one grid key."""

MOST_SD = 8.0
"""How far from the mean the bounds of a truncated normal distribution may begin."""


class DisperseTable(Table):
    """``[[disperse]]``: one key of the scenario that differs from draw to draw.

    What is drawn is the key's value, is added to the scenario's own or multiplies it.
    """

    key: Key
    distribution: Kind
    acts: Acts = "sets"
    mean: Finite | None = None
    sd: Positive | None = None
    median: Positive | None = None
    sd_log: Positive | None = None
    lower: Finite | None = None
    upper: Finite | None = None
    values: Annotated[list[bool | int | float | str], Field(min_length=1)] | None = None
    weights: list[NotNegative] | None = None
    count: Annotated[int, Field(ge=2, le=MOST_POINTS)] | None = None

    @model_validator(mode="after")
    def _keys_of_the_distribution(self) -> "DisperseTable":
        kind = self.distribution
        for name in NEEDED[kind]:
            if getattr(self, name) is None:
                raise ValueError(f"`{name}` must be given with distribution {kind}, got nothing")
        given = self.model_fields_set - {"key", "distribution", "acts"}
        for name in sorted(given - {*NEEDED[kind], *POSSIBLE.get(kind, ())}):
            raise ValueError(f"`{name}` must be absent with distribution {kind}")
        ladder = (self.lower, self.upper, self.count)
        if kind == "grid" and (None in ladder) == (self.values is None):
            raise ValueError(
                "`values` must be given with distribution grid, or `lower`, `upper` and `count` in "
                "their place"
            )
        if kind == "grid" and self.values is not None and given & {"lower", "upper", "count"}:
            raise ValueError("`lower`, `upper` and `count` must be absent where `values` are given")
        return self

    @model_validator(mode="after")
    def _numbers_fit(self) -> "DisperseTable":
        low, high = self.lower, self.upper
        if low is not None and high is not None and not low < high:
            raise ValueError(f"`lower` must be below `upper`, got {low:g} and {high:g}")
        self._check_truncation()
        values, weights = self.values or [], self.weights
        if len({_sort(value) for value in values}) > 1:
            raise ValueError(
                f"`values` must be all numbers, all strings or all booleans, got {values}"
            )
        if weights is not None and (len(weights) != len(values) or not sum(weights) > 0.0):
            raise ValueError(
                f"`weights` must be as many numbers as `values`, {len(values)}, and not all "
                f"zero, got {weights}"
            )
        if self.acts != "sets" and values and _sort(values[0]) != "number":
            raise ValueError(f"`values` must be numbers with `acts` {self.acts!r}, got {values}")
        return self

    def _check_truncation(self) -> None:
        """Refuse bounds so far out in the tail that nothing of the distribution lies between."""
        if self.distribution != "normal" or self.mean is None or self.sd is None:
            return
        low = -math.inf if self.lower is None else self.lower
        high = math.inf if self.upper is None else self.upper
        if low > self.mean + MOST_SD * self.sd or high < self.mean - MOST_SD * self.sd:
            raise ValueError(
                f"`mean` must lie within {MOST_SD:g} `sd` of what `lower` and `upper` leave, "
                f"got {self.mean:g}"
            )

    def of(self) -> Distribution:
        """The distribution as a value."""
        values = tuple(self.values or ())
        match self.distribution:
            case "normal":
                low = -math.inf if self.lower is None else self.lower
                high = math.inf if self.upper is None else self.upper
                return Normal(_given(self.mean), _given(self.sd), low, high)
            case "log_normal":
                return LogNormal(_given(self.median), _given(self.sd_log))
            case "uniform":
                return Uniform(_given(self.lower), _given(self.upper))
            case "choice":
                return Choice(values, tuple(self.weights or [1.0] * len(values)))
            case "grid":
                return self.grid()

    def grid(self) -> Grid:
        """The values of a grid."""
        return Grid(tuple(self.values or self._ladder()))

    def _ladder(self) -> tuple[float, ...]:
        steps = np.linspace(_given(self.lower), _given(self.upper), int(_given(self.count)))
        return tuple(steps.tolist())


class CorrelationTable(Table):
    """``[[correlation]]``: rank correlation of two keys that are drawn."""

    keys: Annotated[list[Key], Field(min_length=2, max_length=2)]
    rank: Annotated[float, Field(gt=-1.0, lt=1.0)]

    @model_validator(mode="after")
    def _of_two_keys(self) -> "CorrelationTable":
        if self.keys[0] == self.keys[1]:
            raise ValueError(f"[[correlation]] `keys` must be two, got {self.keys[0]!r} twice")
        return self


def _sort(value: Value) -> str:
    if isinstance(value, bool):
        return "boolean"
    return "string" if isinstance(value, str) else "number"


def _given(value: float | None) -> float:
    """A number that the checks of the table have found."""
    if value is None:
        raise ValueError("a number that a checked table must have is not there")
    return value
