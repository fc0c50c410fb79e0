"""What every table of a scenario file is made of."""

from typing import Annotated, TypeAlias

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from flighttune.plants.jsbsim.plant import DEEPEST_GROUND, HIGHEST_GROUND, LARGEST_SEED

Finite: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Inclination: TypeAlias = Annotated[float, Field(gt=-90.0, lt=90.0, allow_inf_nan=False)]
Seed: TypeAlias = Annotated[int, Field(ge=0, le=LARGEST_SEED)]
Ground: TypeAlias = Annotated[float, Field(ge=-DEEPEST_GROUND, le=HIGHEST_GROUND)]
Matrix: TypeAlias = list[list[Finite]]
Name: TypeAlias = Annotated[str, Field(min_length=1, pattern=r"^[\w.*+-]+$")]


def _pair(value: object) -> object:
    if not (isinstance(value, list) and len(value) == 2):
        raise ValueError("must be a range [low, high]")
    return value


def _rising(value: list[float]) -> list[float]:
    if not value[0] < value[1]:
        raise ValueError("must be a range [low, high] with low below high")
    return value


RisingPair = BeforeValidator(_pair), AfterValidator(_rising)
Range: TypeAlias = Annotated[list[Finite], *RisingPair]
Speeds: TypeAlias = Annotated[list[Positive], *RisingPair]
Inclinations: TypeAlias = Annotated[list[Inclination], *RisingPair]


class Table(BaseModel):
    """A table of the file: unknown keys are refused, and it does not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
