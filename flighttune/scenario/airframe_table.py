"""``[plant.airframe]``: how far an aircraft is from its nominal self."""

from typing import Annotated

from pydantic import Field

from flighttune.plants.jsbsim.off_nominal import OffNominal
from flighttune.scenario.table import Finite, Positive, Table


class AirframeTable(Table):
    """``[plant.airframe]``: factors on an aircraft of jsbsim, and the shift of its CG."""

    mass_factor: Positive = 1.0
    cg_aft_m: Finite = 0.0
    cg_right_m: Finite = 0.0
    cg_down_m: Finite = 0.0
    ixx_factor: Positive = 1.0
    iyy_factor: Positive = 1.0
    izz_factor: Positive = 1.0
    ixz_factor: Positive = 1.0
    lift_factor: Positive = 1.0
    drag_factor: Positive = 1.0
    side_force_factor: Positive = 1.0
    roll_moment_factor: Positive = 1.0
    pitch_moment_factor: Positive = 1.0
    yaw_moment_factor: Positive = 1.0
    coefficient_factors: dict[Annotated[str, Field(min_length=1)], Positive] = Field(
        default_factory=dict
    )
    thrust_factor: Positive = 1.0
    actuator_lag_factor: Positive = 1.0

    def off_nominal(self) -> OffNominal | None:
        """The same as a value; None where nothing is off the nominal."""
        value = OffNominal(
            **{name: getattr(self, f"{name}_factor") for name in OffNominal.SCALED},
            cg_shift=(self.cg_aft_m, self.cg_right_m, self.cg_down_m),
            coefficients=tuple(self.coefficient_factors.items()),
        )
        return None if value.is_nominal else value
