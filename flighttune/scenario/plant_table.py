"""``[[plant]]``: what flies, from the paper's law to the full aircraft."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from flighttune.control.inner_loop import InnerLag
from flighttune.plants.label import plant_label
from flighttune.scenario.airframe_table import AirframeTable
from flighttune.scenario.table import Name, NotNegative, Positive, Table

LAG_KEYS = ("roll", "n_z")
"""First word of the keys of a channel's lag."""


class PlantTable(Table):
    """``[[plant]]``: what flies.

    ``kinematic`` is the paper's law, ``point_mass`` the exact point mass, ``point_mass_lag`` the
    same behind the lag of an inner loop, ``jsbsim`` an aircraft of six degrees of freedom. A
    channel's lag is of first order, or of second order where a damping ratio is given. A name tells
    a plant from another one of the same kind and aircraft.
    """

    kind: Literal["kinematic", "point_mass", "point_mass_lag", "jsbsim"]
    aircraft: Annotated[str, Field(min_length=1)] | None = None
    name: Name | None = None
    throttle_max: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    airframe: AirframeTable | None = None
    roll_lag_rad_s: Positive | None = None
    roll_damping: Positive | None = None
    roll_delay_s: NotNegative | None = None
    n_z_lag_rad_s: Positive | None = None
    n_z_damping: Positive | None = None
    n_z_delay_s: NotNegative | None = None

    @model_validator(mode="after")
    def _aircraft_of_jsbsim(self) -> "PlantTable":
        if (self.kind == "jsbsim") != (self.aircraft is not None):
            raise ValueError("`aircraft` must be given with kind jsbsim, and only there")
        for key in ("throttle_max", "airframe"):
            if getattr(self, key) is not None and self.aircraft is None:
                raise ValueError(f"`{key}` must be given with kind jsbsim only")
        return self

    @model_validator(mode="after")
    def _lag_of_point_mass(self) -> "PlantTable":
        lagged = self.kind == "point_mass_lag"
        given = self.model_fields_set - {"kind", "aircraft", "name", "throttle_max", "airframe"}
        if given and not lagged:
            raise ValueError(f"`{min(given)}` must be given with kind point_mass_lag only")
        for key in LAG_KEYS:
            if lagged and getattr(self, f"{key}_lag_rad_s") is None:
                raise ValueError(f"`{key}_lag_rad_s` must be given with kind point_mass_lag")
        return self

    @property
    def label(self) -> str:
        """Name of the plant in tables, plots and files."""
        return plant_label(self.kind, self.aircraft, self.name)

    def lags(self) -> tuple[InnerLag, InnerLag] | None:
        """Lag of roll and of load factor; None where there is none."""
        if self.kind != "point_mass_lag":
            return None
        return self._lag("roll"), self._lag("n_z")

    def _lag(self, key: str) -> InnerLag:
        damping = getattr(self, f"{key}_damping")
        return InnerLag(
            natural_frequency=getattr(self, f"{key}_lag_rad_s"),
            delay=getattr(self, f"{key}_delay_s") or 0.0,
            order=1 if damping is None else 2,
            damping=1.0 if damping is None else damping,
        )
