"""``[[plant]]`` of a scenario: a plant to fly."""

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from flighttune.base import quantities as q
from flighttune.base.errors import InputError
from flighttune.base.kind_keys import OwnTable, check_keys
from flighttune.control.inner_loop import InnerLag
from flighttune.vehicles.aircraft.aircraft import AircraftConfig, OffNominal, load_aircraft
from flighttune.vehicles.identification.file import IdentifiedAircraft, load_identified
from flighttune.vehicles.plants.base import PLANT_KINDS, PlantKind, plant_label

if TYPE_CHECKING:
    Kind: TypeAlias = str
else:
    Kind = Literal[tuple(PLANT_KINDS)]


class PlantTable(OwnTable):
    """``[[plant]]``: a plant to fly, with the keys of its kind."""

    # kinematic: the paper's law; point_mass: exact; point_mass_lag: exact, behind an inner loop;
    # jsbsim: an aircraft of six degrees of freedom; python: a class of your own
    kind: Kind
    # A name of `flighttune list`, or a folder with an aircraft.toml
    aircraft: q.PathName | None = None
    name: q.Name | None = None  # distinguishes plants of one kind and aircraft
    # Maximum throttle of a weaker engine; the aircraft's own if left out
    throttle_max: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    throttle_max_from_s: q.Instant | None = None  # time from which it holds; the start if left out
    airframe: OffNominal | None = None  # off-nominal properties
    roll_lag_rad_s: q.Bandwidth | None = None  # natural frequency
    roll_damping: q.Damping | None = None  # ratio of a lag of second order; first order if left out
    roll_delay_s: q.Delay | None = None  # none if left out
    n_z_lag_rad_s: q.Bandwidth | None = None  # natural frequency
    n_z_damping: q.Damping | None = None  # ratio of a lag of second order; first order if left out
    n_z_delay_s: q.Delay | None = None  # none if left out
    n_x_lag_rad_s: q.Bandwidth | None = None  # natural frequency, if the airspeed is followed
    n_x_damping: q.Damping | None = None  # ratio of a lag of second order; first order if left out
    n_x_delay_s: q.Delay | None = None  # none if left out
    # Aircraft or model file whose nominal condition gives the lags instead of these keys
    identified: q.PathName | None = None

    @model_validator(mode="after")
    def _keys_of_the_kind(self) -> Self:
        check_keys(self, self.kind, PLANT_KINDS)
        if self.throttle_max_from_s and self.throttle_max is None:
            raise ValueError("`throttle_max` must be given beside `throttle_max_from_s`")
        if self.kind == "point_mass_lag":
            if self.identified is not None:
                self.must_lack("beside `identified`", *sorted(self.family.keys - {"identified"}))
            for key in ("roll_lag_rad_s", "n_z_lag_rad_s"):
                if self.identified is None and getattr(self, key) is None:
                    raise ValueError(f"`{key}` must be given with kind {self.kind}")
        return self

    @property
    def family(self) -> PlantKind:
        """Description of its kind."""
        return PLANT_KINDS[self.kind]

    @cached_property
    def config(self) -> AircraftConfig:
        """The aircraft, read once."""
        assert self.aircraft is not None  # only an aircraft has it
        return load_aircraft(self.aircraft)

    @cached_property
    def identified_model(self) -> IdentifiedAircraft:
        """The identified model of the aircraft, read once."""
        name = self.aircraft or self.identified
        assert name is not None  # only a plant with a model has it
        return load_identified(name)

    @property
    def label(self) -> str:
        """Name of the plant in tables, plots and files."""
        return plant_label(self.kind, self.aircraft, self.name)

    def lags(self) -> tuple[InnerLag, InnerLag] | None:
        """Lag of roll and of load factor; None for a plant without lags."""
        if self.identified is not None:  # lags of the nominal condition
            return self.identified_model.conditions[0].lags
        if self.roll_lag_rad_s is None:
            return None
        return self._lag("roll"), self._lag("n_z")

    def thrust_lag(self) -> InnerLag:
        """Lag of n_x of a plant with lags; InputError if it is missing."""
        if self.identified is not None:
            return self.identified_model.conditions[0].thrust_lag
        if self.n_x_lag_rad_s is None:
            raise InputError(
                "[plant] `n_x_lag_rad_s` must be given where the airspeed is followed."
            )
        return self._lag("n_x")

    def _lag(self, key: str) -> InnerLag:
        damping = getattr(self, f"{key}_damping")
        return InnerLag(
            natural_frequency=getattr(self, f"{key}_lag_rad_s"),
            delay=getattr(self, f"{key}_delay_s") or 0.0,
            order=1 if damping is None else 2,
            damping=1.0 if damping is None else damping,
        )


def flown_aircraft(plants: Iterable[PlantTable]) -> list[str]:
    """Names of the aircraft of plants, or of their lags."""
    names = (
        Path(plant.aircraft).name if plant.aircraft else plant.identified_model.aircraft
        for plant in plants
        if plant.aircraft or plant.identified
    )
    return list(dict.fromkeys(names))
