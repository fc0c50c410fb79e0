"""An off-nominal aircraft: factors on its properties and a shift of its centre of gravity."""

import math
from dataclasses import dataclass
from typing import ClassVar

from flighttune.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class OffNominal:
    """Differences of an aircraft from its files.

    Raises InputError if a factor is not positive, or a shift not finite.
    """

    INERTIAS: ClassVar[tuple[str, ...]] = ("ixx", "iyy", "izz", "ixz")
    AXES: ClassVar[tuple[str, ...]] = (
        *("lift", "drag", "side_force"),
        *("roll_moment", "pitch_moment", "yaw_moment"),
    )
    SCALED: ClassVar[tuple[str, ...]] = ("mass", *INERTIAS, *AXES, "thrust", "actuator_lag")
    """Attributes that are factors; the key of each has ``_factor`` at its end."""

    mass: float = 1.0  # factor on the whole mass; the centre of gravity and the inertias stay
    # m: shift of the centre of gravity: aft, right, down
    cg_shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # `ixx`, `iyy`, `izz` and `ixz`: factors on the inertias about the centre of gravity, body axes
    ixx: float = 1.0
    iyy: float = 1.0
    izz: float = 1.0
    ixz: float = 1.0
    # `lift`, `drag`, `side_force`, `roll_moment`, `pitch_moment` and `yaw_moment`: factors on
    # everything the aerodynamics give along and about one axis.
    lift: float = 1.0
    drag: float = 1.0
    side_force: float = 1.0
    roll_moment: float = 1.0
    pitch_moment: float = 1.0
    yaw_moment: float = 1.0
    # Factors on single aerodynamic functions of the model, by name or last part of it
    coefficients: tuple[tuple[str, float], ...] = ()
    thrust: float = 1.0  # factor on the thrust at each throttle
    actuator_lag: float = 1.0  # factor on the time constants of the surface actuators

    def __post_init__(self) -> None:
        factors = {f"{name}_factor": getattr(self, name) for name in self.SCALED}
        factors |= {f"coefficient_factors.{name}": f for name, f in self.coefficients}
        for key, factor in factors.items():
            if not (math.isfinite(factor) and factor > 0.0):
                raise InputError(f"`{key}` must be positive, got {factor}.")
        if not (len(self.cg_shift) == 3 and all(map(math.isfinite, self.cg_shift))):
            raise InputError(f"`cg_shift` must be three finite numbers, got {self.cg_shift} m.")

    @property
    def is_nominal(self) -> bool:
        """Whether nothing differs."""
        return not (self.loaded or self.scaled or self.scaled_coefficients)

    @property
    def loaded(self) -> bool:
        """Whether mass, centre of gravity or inertia differ."""
        return any(self.cg_shift) or any(
            getattr(self, name) != 1.0 for name in ("mass", *self.INERTIAS)
        )

    @property
    def scaled(self) -> dict[str, float]:
        """Factors other than 1 on aerodynamics as a whole, thrust and actuators, by attribute."""
        names = (name for name in self.SCALED if name not in ("mass", *self.INERTIAS))
        return {name: getattr(self, name) for name in names if getattr(self, name) != 1.0}

    @property
    def scaled_coefficients(self) -> dict[str, float]:
        """Factors on single aerodynamic functions, those of 1 too: each must have its function."""
        return dict(self.coefficients)
