"""An aircraft's folder: its ``aircraft.toml``, read once and checked."""

import tomllib
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, PrivateAttr, ValidationError

from flighttune.errors import InputError, ScenarioError
from flighttune.plants.jsbsim.aircraft_tables import (
    Actuators,
    AircraftTable,
    Channels,
    CommandLimits,
    Design,
    Envelope,
    Finite,
    LimitProperties,
    PropertyName,
    Wrapping,
)
from flighttune.plants.jsbsim.off_nominal import OffNominal
from flighttune.shipped import aircraft_folder


class AircraftConfig(AircraftTable):
    """One aircraft as its ``aircraft.toml`` describes it, in SI and radians.

    Attributes
    ----------
    title, source : str
        What it is and where its numbers come from.
    model : str
        Name of JSBSim's main file, without ``.xml``.
    wrapping : Wrapping or None
        For a model that comes with JSBSim.
    settings : mapping of str to float
        Values of JSBSim properties for the whole flight, in JSBSim's units.
    envelope, limits, actuators, channels, limit_properties, design
        Tables of the file.
    gains : mapping of str to float
        Gains of the inner loop by JSBSim property, in the units the file gives beside them.
    """

    title: str
    source: str
    model: Annotated[str, Field(pattern=r"^[\w.-]+$")]
    wrapping: Wrapping | None = None
    settings: dict[PropertyName, Finite] = Field(default_factory=dict)
    envelope: Envelope
    limits: CommandLimits
    actuators: Actuators
    channels: Channels
    limit_properties: LimitProperties
    design: Design | None = None
    gains: dict[PropertyName, Finite]
    _folder: Path = PrivateAttr()
    _off_nominal: OffNominal | None = PrivateAttr(default=None)

    @property
    def folder(self) -> Path:
        """Folder the aircraft was read from."""
        return self._folder

    @property
    def file(self) -> Path:
        """The ``aircraft.toml`` itself."""
        return self._folder / "aircraft.toml"

    @property
    def off_nominal(self) -> OffNominal | None:
        """How the aircraft differs from its files; None where it does not."""
        return self._off_nominal

    def with_off_nominal(self, off_nominal: OffNominal | None) -> Self:
        """Return the aircraft off the nominal. Whether it can be is seen when JSBSim loads it."""
        changed = self.model_copy()
        changed._off_nominal = off_nominal
        return changed

    def with_throttle_max(self, throttle_max: float) -> Self:
        """Return the aircraft with another upper stop of the throttle.

        Raises
        ------
        InputError
            If it does not lie between the stops of the aircraft.
        """
        low, high = self.actuators.throttle
        if not low < throttle_max <= high:
            raise InputError(
                f"`throttle_max` must lie above {low:g} and up to {high:g}, got {throttle_max}."
            )
        actuators = self.actuators.model_copy(update={"throttle": (low, throttle_max)})
        return self.model_copy(update={"actuators": actuators})


def load_aircraft(aircraft: str | Path) -> AircraftConfig:
    """Return the aircraft of a name, or of a folder that holds an ``aircraft.toml``.

    Parameters
    ----------
    aircraft : str or Path
        Name of a shipped aircraft; a Path, or a str with a separator, is a folder.

    Raises
    ------
    InputError
        If there is no such aircraft.
    ScenarioError
        If its ``aircraft.toml`` cannot be used; the message names file and key.
    """
    if isinstance(aircraft, str) and Path(aircraft).name == aircraft:
        folder = aircraft_folder(aircraft)
    else:
        folder = Path(aircraft).resolve()
    file = folder / "aircraft.toml"
    try:
        found = file.stat()
    except OSError as error:
        raise InputError(f"{file}: must be a readable file, got {error.strerror}.") from error
    return _read(file, (found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_size))


@lru_cache(maxsize=32)
def _read(file: Path, stamp: tuple[int, ...]) -> AircraftConfig:
    """The aircraft of a file, read anew when the file was written to."""
    del stamp
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{file}: must be a readable file, got {error.strerror}.") from error
    except ValueError as error:
        raise ScenarioError(f"{file}: must be TOML, got {error}.") from error
    try:
        config = AircraftConfig.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(f"{file}: {_first_problem(error)}") from error
    config._folder = file.parent
    return config


def _first_problem(error: ValidationError) -> str:
    problem = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in problem["loc"])
    says = problem["msg"].removeprefix("Value error, ")
    return f"`{key}`: {says}, got {problem['input']!r}."
