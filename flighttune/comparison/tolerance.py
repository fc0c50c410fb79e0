"""Tolerances of metrics for regression checks."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator

from flighttune.comparison.compare import BETTER_IF, Comparison, better
from flighttune.errors import InputError
from flighttune.metrics import CHANNELS, FLIGHT_METRICS, METRICS
from flighttune.mistakes import validated
from flighttune.table_file import toml_tables

DISTANCE = "max_distance_m"
STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Tolerance(BaseModel):
    """Largest change ``|b - a|`` of a metric: ``absolute + relative |a|``."""

    model_config = STRICT

    absolute: float = Field(default=0.0, ge=0.0)  # unit of the metric
    relative: float = Field(default=0.0, ge=0.0)
    only_worse: bool = False  # whether an improvement may be of any size

    @model_validator(mode="after")
    def _is_given(self) -> "Tolerance":
        if not {"absolute", "relative"} & self.model_fields_set:
            raise ValueError("must give `absolute` or `relative`")
        return self

    def allows(self, name: str, a: float, b: float) -> bool:
        """Whether metric `name` may go from `a` to `b`; both missing is no change."""
        if math.isnan(a) and math.isnan(b):
            return True
        if self.only_worse and better(name, a, b) == "b":
            return True
        return abs(b - a) <= self.largest_change(a)

    def largest_change(self, a: float) -> float:
        """Largest change from `a`."""
        return self.absolute + self.relative * abs(a)


def _tables(name: str, metrics: Mapping[str, str], **more: Any) -> type[BaseModel]:
    """A model with an optional tolerance for each metric."""
    fields: dict[str, Any] = dict.fromkeys(metrics, (Tolerance, None))
    return create_model(name, __config__=STRICT, **fields, **more)


ToleranceFile = _tables(
    "ToleranceFile",
    {**BETTER_IF, DISTANCE: "m"},
    **dict.fromkeys(CHANNELS, (_tables("OfChannel", METRICS), None)),
    flight=(_tables("OfFlight", FLIGHT_METRICS), None),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """One metric that is out of tolerance."""

    run_a: str
    run_b: str
    channel: str
    name: str
    # `a` and `b` (unit of the metric): zero and the distance for ``max_distance_m``, times flown
    # for ``duration_s``.
    a: float
    b: float
    allowed: float  # largest change of it

    @property
    def sentence(self) -> str:
        """The limit and the value that exceeds it."""
        return (
            f"{self.run_b}: {self.channel} {self.name} must be within {self.allowed:.4g} of "
            f"{self.a:.6g}, got {self.b:.6g}."
        )


def load_tolerances(path: str | Path) -> dict[str, Tolerance]:
    """Read a tolerance file.

    `path`: TOML: a table each metric with ``absolute`` and ``relative`` (they add) and
    ``only_worse``. A metric stands for all its channels, or inside a table ``[chi]``, ``[gamma]``
    or ``[flight]`` for one, which goes before. ``max_distance_m`` takes ``absolute``. Returns
    tolerance by metric, or by ``channel.metric``. Raises InputError if the file cannot be read, or
    a metric or an option is unknown.
    """
    path = Path(path)
    tolerances: dict[str, Tolerance] = {}
    for key, value in validated(ToleranceFile, toml_tables(path), str(path)):
        own = {"": value} if isinstance(value, Tolerance) else dict(value or ())
        for name, tolerance in own.items():
            if tolerance is not None:
                tolerances[f"{key}.{name}" if name else key] = tolerance
    if not tolerances:
        raise InputError(
            f"{path}: the file must hold a tolerance for at least one metric, got none."
        )
    return tolerances


def violations(comparison: Comparison, tolerances: Mapping[str, Tolerance]) -> list[Violation]:
    """Every metric of a comparison that changed by more than its tolerance.

    `tolerances` are those of `load_tolerances`; a metric without one is not checked. A run that
    ended early where the first one was completed violates any tolerance.
    """
    broken = []
    for row in comparison.metrics.to_dict(orient="records"):
        name, a, b = str(row["name"]), float(row["a"]), float(row["b"])
        limit = tolerances.get(f"{row['channel']}.{name}", tolerances.get(name))
        if limit is not None and not limit.allows(name, a, b):
            values = {key: row[key] for key in ("run_a", "run_b", "channel", "name", "a", "b")}
            broken.append(Violation(**values, allowed=limit.largest_change(a)))
    apart = tolerances.get(DISTANCE)
    for pair in comparison.pairs:
        flight = {"run_a": pair.a.label, "run_b": pair.b.label, "channel": "flight"}
        if pair.a.status == "completed" != pair.b.status:
            a, b = pair.durations
            broken.append(Violation(**flight, name="duration_s", a=a, b=b, allowed=0.0))
        if apart is not None and (b := pair.max_distance) > apart.absolute:
            broken.append(Violation(**flight, name=DISTANCE, a=0.0, b=b, allowed=apart.absolute))
    return broken
