"""``[tuning]`` of a scenario."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from flighttune.base import quantities as q
from flighttune.base.arrays import FloatArray

TuningModel: TypeAlias = Literal["kinematic", "identified"]

Weights: TypeAlias = Annotated[list[q.PositiveGain], Field(min_length=2, max_length=2)]

# Keys for the kinematic model.
KINEMATIC_ALONE = "I_star", "lag_rad_s", "sample_delay", "state_scaling", "structure"

# Objectives behind the identified inner loop, under a bound on the sensitivity
SHAPED = "decay", "E_K", "rms"


class TuningTable(q.Table):
    """``[tuning]``: objective and bounds of the gains named ``tuned``."""

    # Bound of I_K, s^2, on the kinematic model; may be infinite: no bound
    I_star: Annotated[float, Field(gt=0.0)] = 5.0
    # Bound of E_K, s^2, the largest error under a disturbance; none if left out
    E_star: Annotated[float, Field(gt=0.0)] | None = None
    # identified: behind the inner loop; tuned_identified always uses it
    model: TuningModel = "kinematic"
    # An aircraft, or a file of `identify`; the aircraft of the first jsbsim plant if left out
    identified: q.PathName | None = None
    # true: the worst case over all conditions of the file, instead of the nearest condition
    robust: bool = False
    # First-order bandwidths of phi and n_z before the kinematic law; none if left out
    lag_rad_s: Annotated[list[q.Bandwidth], Field(min_length=2, max_length=2)] | None = None
    sample_delay: bool = False  # true: half a sample of delay on the kinematic model
    # Range of lags of the inner loop, s: maximise the slowest decay behind them instead of R_K, as
    # `tune --lag` does; not for tuned_identified. None if left out
    lag_s: Annotated[list[q.TimeConstant], Field(min_length=2, max_length=2)] | None = None
    input_limits: bool = False  # true: the first command stays inside the limits
    structure: Literal["full", "decoupled"] = "full"
    gain_max: q.PositiveGain | None = None  # largest entry; 1000 if left out
    roll_rate: bool = False  # true: the rate limit of roll can follow, on the identified model
    # true: gains that the rate limit of the load factor can follow, on the identified model
    lift_rate: bool = False
    # One divisor for each state (x', e) in R_K and I_K; ones if left out
    state_scaling: list[q.Scale] | None = None
    # Largest R_K, smallest quadratic cost of the first error, fastest decay, smallest E_K, or
    # smallest rms error in the turbulence; the last three on the identified model
    objective: Literal["R_K", "cost", "decay", "E_K", "rms"] = "R_K"
    feedback: bool = False  # true: gains on measured roll and load factor too, with decay and rms
    # With rms: gains for light gusts and the estimation errors of this grade of [navigation]: the
    # smallest rms errors under `command_rate_max`. None if left out: in gusts alone
    navigation: Literal["rtk", "standard", "poor"] | None = None
    # Largest rms rates of roll (deg/s) and of the load factor (1/s), with `navigation`; a fixed
    # share of the rate limits if left out
    command_rate_max: Annotated[list[q.PositiveRate], Field(min_length=2, max_length=2)] | None = (
        None
    )
    # Bound for each channel, with decay, E_K and rms; 1.4 if left out, at most 1.66
    sensitivity_max: Annotated[float, Field(gt=1.0)] | None = None
    error_weights: Weights | None = None  # weights of chi and gamma, with cost; ones if left out
    command_weights: Weights | None = None  # of phi and n_z, with cost; 0.1 if left out
    R_min: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.0  # minimum R_K, 1/s, with cost
    starts: Annotated[int, Field(ge=1, le=1000)] = 12

    @property
    def weights(self) -> tuple[FloatArray, FloatArray] | None:
        """Weights of errors and commands; None if R_K is maximised."""
        if self.objective != "cost":
            return None
        errors, commands = self.error_weights or [1.0, 1.0], self.command_weights or [0.1, 0.1]
        return np.array(errors), np.array(commands)

    @model_validator(mode="before")
    @classmethod
    def _model_of_objective(cls, values: Any) -> Any:
        shaped = isinstance(values, Mapping) and values.get("objective") in SHAPED
        return {"model": "identified", **values} if shaped else values

    @model_validator(mode="after")
    def _keys_of_model_and_objective(self) -> "TuningTable":
        shaped = self.objective in SHAPED
        if self.objective not in ("decay", "rms"):
            self.must_lack('without objective = "decay" or "rms"', "feedback")
        if self.objective != "rms":
            self.must_lack('without objective = "rms"', "navigation")
        if self.navigation is None:
            self.must_lack("without `navigation`", "command_rate_max")
        if shaped and self.model != "identified":
            raise ValueError(
                f'`model` must be "identified" or absent with objective = "{self.objective}", got '
                f'"{self.model}"'
            )
        if not shaped:
            self.must_lack('without objective = "decay", "E_K" or "rms"', "sensitivity_max")
        if self.model == "identified":
            keys = KINEMATIC_ALONE if shaped else (*KINEMATIC_ALONE, "objective")
            self.must_lack("with model identified", *keys)
        if self.objective != "cost":
            cost_keys = "error_weights", "command_weights", "R_min"
            self.must_lack('without objective = "cost"', *cost_keys)
        else:
            self.must_lack('with objective = "cost"', "lag_s")
        if self.lag_s is not None:
            self.must_lack("with `lag_s`", "lag_rad_s")
            if self.lag_s[0] > self.lag_s[1]:
                raise ValueError(f"`lag_s` must have its low end first, got {self.lag_s}")
        return self
