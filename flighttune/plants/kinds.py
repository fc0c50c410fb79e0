"""Kinds of plants, and what differs between them for the rooms above."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from flighttune.plants.point_mass import TurnLaw


class PlantKind(NamedTuple):
    """One kind of plant that a scenario can name."""

    keys: frozenset[str] = frozenset()  # keys of ``[[plant]]`` that only this kind takes
    required: tuple[str, ...] = ()  # keys that it cannot do without
    turn: TurnLaw = "exact"  # how a point mass of the kind turns, as `turn_rates` has it
    # Its model in a tube, in words; None where its flights cannot be enclosed
    enclosed: str | None = None
    batched: bool = False  # whether the compiled kernel flies it


_LAGS = tuple(f"{channel}_{key}" for channel in ("roll", "n_z") for key in ("lag_rad_s", "delay_s"))

PLANT_KINDS: Mapping[str, PlantKind] = MappingProxyType(
    {
        "kinematic": PlantKind(turn="paper", enclosed="the paper's law", batched=True),
        "point_mass": PlantKind(enclosed="the exact point mass"),
        "point_mass_lag": PlantKind(
            keys=frozenset({*_LAGS, "roll_damping", "n_z_damping"}),
            required=("roll_lag_rad_s", "n_z_lag_rad_s"),
            enclosed="the exact point mass behind lags",
        ),
        "jsbsim": PlantKind(
            keys=frozenset({"aircraft", "throttle_max", "airframe"}),
            required=("aircraft",),
            enclosed="the exact point mass behind the identified lag",
        ),
        "python": PlantKind(
            keys=frozenset({"module", "class_", "parameters", "sha256"}), required=("name",)
        ),
    }
)
