"""What every table of a scenario file is made of."""

from typing import Annotated, TypeAlias

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Finite: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Inclination: TypeAlias = Annotated[float, Field(gt=-90.0, lt=90.0, allow_inf_nan=False)]
Matrix: TypeAlias = list[list[Finite]]


def _rising(value: list[float]) -> list[float]:
    if not value[0] < value[1]:
        raise ValueError("must be a range [low, high] with low below high")
    return value


RisingPair = Field(min_length=2, max_length=2), AfterValidator(_rising)
Range: TypeAlias = Annotated[list[Finite], *RisingPair]
Speeds: TypeAlias = Annotated[list[Positive], *RisingPair]
Inclinations: TypeAlias = Annotated[list[Inclination], *RisingPair]


class Table(BaseModel):
    """A table of the file: unknown keys are refused, and it does not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
