"""What every table of a scenario file is made of."""

from typing import Annotated, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

Finite: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Inclination: TypeAlias = Annotated[float, Field(gt=-90.0, lt=90.0, allow_inf_nan=False)]
Matrix: TypeAlias = list[list[Finite]]


class Table(BaseModel):
    """A table of the file: unknown keys are refused, and it does not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
