"""``[tuning]``: which gains are looked for, and on which model."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator

from flighttune.scenario.table import Positive, Table
from flighttune.tuning.tune import Method

TUNED = "tuned"
"""Gains tuned on the model that ``[tuning]`` names."""

TUNED_IDENTIFIED = "tuned_identified"
"""Gains tuned on the identified model, whichever ``[tuning]`` names."""

INPUTS = 2

TuningModel: TypeAlias = Literal["kinematic", "identified"]


class TuningTable(Table):
    """``[tuning]``: what the gains named ``tuned`` maximise R_K under, and on which model.

    On the kinematic law ``lag_rad_s`` puts a first-order lag of (phi, n_z) between command and
    aircraft, and ``sample_delay`` the half sample by which a sampled command is late on average.
    R_K and I_K are those of the state divided by ``state_scaling`` (s = (x', e); ones by default).

    On the identified model lag, delay, sampling and scaling come from ``identified`` (the name of
    an aircraft or a model file; by default the aircraft of the first jsbsim plant) and from the
    controller, R_K is not bounded by I_K, and each channel is tuned by itself. ``robust`` maximises
    the smallest R_K over all conditions of the file instead of taking the nearest one.
    """

    I_star: Annotated[float, Field(gt=0.0)] = 5.0
    model: TuningModel = "kinematic"
    identified: Annotated[str, Field(min_length=1)] | None = None
    robust: bool = False
    lag_rad_s: Annotated[list[Positive], Field(min_length=INPUTS, max_length=INPUTS)] | None = None
    sample_delay: bool = False
    input_limits: bool = False
    structure: Literal["full", "decoupled"] = "full"
    gain_max: Positive | None = None
    state_scaling: list[Positive] | None = None
    method: Method = "gradient"
    starts: Annotated[int, Field(ge=1, le=1000)] = 12

    @model_validator(mode="after")
    def _of_the_kinematic_law(self) -> "TuningTable":
        foreign = {"I_star", "lag_rad_s", "sample_delay", "state_scaling", "structure", "method"}
        changed = [
            name
            for name in sorted(foreign & self.model_fields_set)
            if getattr(self, name) != type(self).model_fields[name].default
        ]
        if self.model == "identified" and changed:
            raise ValueError(f"`{changed[0]}` must be absent with model identified")
        return self
