"""An off-nominal aircraft: factors on its properties and a shift of its centre of gravity."""

from typing import Annotated, ClassVar

from pydantic import Field

from flighttune.quantities import Factor, Shift, Table


class OffNominal(Table):
    """``[plant.airframe]``: differences of an aircraft from its files."""

    AXES: ClassVar[tuple[str, ...]] = (
        *("lift", "drag", "side_force"),
        *("roll_moment", "pitch_moment", "yaw_moment"),
    )

    mass_factor: Factor = 1.0  # on the whole mass; the centre of gravity and the inertias stay
    # Shift of the centre of gravity
    cg_aft_m: Shift = 0.0
    cg_right_m: Shift = 0.0
    cg_down_m: Shift = 0.0
    # On the inertias about the centre of gravity, body axes
    ixx_factor: Factor = 1.0
    iyy_factor: Factor = 1.0
    izz_factor: Factor = 1.0
    ixz_factor: Factor = 1.0
    # On everything the aerodynamics give along and about one axis
    lift_factor: Factor = 1.0
    drag_factor: Factor = 1.0
    side_force_factor: Factor = 1.0
    roll_moment_factor: Factor = 1.0
    pitch_moment_factor: Factor = 1.0
    yaw_moment_factor: Factor = 1.0
    # On single aerodynamic functions of the model, by name or last part of it. Those of 1 count
    # too: each must have its function.
    coefficient_factors: dict[Annotated[str, Field(min_length=1)], Factor] = Field(
        default_factory=dict
    )
    thrust_factor: Factor = 1.0  # on the thrust at each throttle
    actuator_lag_factor: Factor = 1.0  # on the time constants of the surface actuators

    @property
    def cg_shift(self) -> tuple[float, float, float]:
        """Shift of the centre of gravity, m: aft, right, down."""
        return self.cg_aft_m, self.cg_right_m, self.cg_down_m

    @property
    def loaded(self) -> bool:
        """Whether mass, centre of gravity or inertia differ."""
        return any(self.cg_shift) or self.mass_factor != 1.0 or bool(self.inertia_factors)

    @property
    def inertia_factors(self) -> dict[str, float]:
        """Factors other than 1 on the inertias."""
        return self._other_than_one("ixx", "iyy", "izz", "ixz")

    @property
    def scaled(self) -> dict[str, float]:
        """Factors other than 1 on aerodynamics as a whole, thrust and actuators, by property."""
        return self._other_than_one(*self.AXES, "thrust", "actuator_lag")

    def _other_than_one(self, *properties: str) -> dict[str, float]:
        factors = {name: getattr(self, f"{name}_factor") for name in properties}
        return {name: factor for name, factor in factors.items() if factor != 1.0}
