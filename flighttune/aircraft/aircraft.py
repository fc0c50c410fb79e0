"""An aircraft's folder: its ``aircraft.toml``, read once and checked, in SI and radians."""

import hashlib
import math
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
)

from flighttune.aircraft.off_nominal import OffNominal
from flighttune.control.limits import Limits
from flighttune.errors import InputError, ScenarioError
from flighttune.mistakes import first_mistake
from flighttune.quantities import (
    Airspeed,
    Angle,
    Bandwidth,
    Finite,
    Gain,
    Height,
    LoadFactor,
    NotNegative,
    Positive,
    PositiveRate,
    TimeConstant,
)
from flighttune.shipped import aircraft_folder
from flighttune.table_file import toml_tables

_LEVEL = r"[A-Za-z_][A-Za-z0-9_.-]*(\[\d+\])?"
PROPERTY_NAME = rf"^{_LEVEL}(/{_LEVEL})*$"
"""Names JSBSim takes; it ends the process over any other."""


def _rising(interval: tuple[float, float]) -> tuple[float, float]:
    if not interval[0] < interval[1]:
        raise ValueError("must be [lower, upper] with lower < upper")
    return interval


FromDegrees = Annotated[Angle, AfterValidator(math.radians)]
Settling = Annotated[NotNegative, Field(le=60.0)]
Throttle = Annotated[Finite, Field(ge=0.0, le=1.0)]
Rising = Field(strict=False), AfterValidator(_rising)  # an array of a file is no tuple
Airspeeds = Annotated[tuple[Airspeed, Airspeed], *Rising]
LoadFactors = Annotated[tuple[LoadFactor, LoadFactor], *Rising]
Throttles = Annotated[tuple[Throttle, Throttle], *Rising]
Angles = Annotated[tuple[FromDegrees, FromDegrees], *Rising]
PropertyName = Annotated[str, Field(pattern=PROPERTY_NAME)]

INNER_LOOP = "inner-loop/"
"""What the properties of an aircraft begin with that are gains; each must have a value."""


class AircraftTable(BaseModel):
    """A table of the file: unknown keys are refused, and it does not change."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class FlightEnvelope(AircraftTable):
    """Where the model is valid: leaving it ends a flight.

    Attributes
    ----------
    alpha, theta : tuple of two floats, rad
        Angle of attack; pitch attitude.
    V_a : tuple of two floats, m/s
        Airspeed.
    n_z : tuple of two floats, 1
        Load factor.
    """

    alpha: Angles = Field(alias="alpha_deg")
    theta: Angles = Field(alias="theta_deg")
    V_a: Airspeeds = Field(alias="V_a_mps")
    n_z: LoadFactors


class CommandLimits(AircraftTable):
    """Limits of the inner loop on its commands.

    Attributes
    ----------
    phi : tuple of two floats, rad
        Roll command.
    phi_rate : float, rad/s
        Its rate.
    n_z : tuple of two floats, 1
        Load-factor command.
    n_z_rate : float, 1/s
        Its rate.
    """

    phi: Angles = Field(alias="phi_deg")
    phi_rate: Annotated[PositiveRate, AfterValidator(math.radians)] = Field(alias="phi_rate_dps")
    n_z: LoadFactors
    n_z_rate: PositiveRate = Field(alias="n_z_rate_per_s")

    def limits(self) -> Limits:
        """Return the limits of (phi, n_z) for the controller."""
        (phi_min, phi_max), (n_z_min, n_z_max) = self.phi, self.n_z
        rate = np.array([self.phi_rate, self.n_z_rate])
        return Limits(
            lower=np.array([phi_min, n_z_min]),
            upper=np.array([phi_max, n_z_max]),
            rate_lower=-rate,
            rate_upper=rate,
        )


class Actuators(AircraftTable):
    """Travel of surfaces (rad) and throttle (1), lower and upper stop."""

    aileron: Angles = Field(alias="aileron_deg")
    elevator: Angles = Field(alias="elevator_deg")
    rudder: Angles = Field(alias="rudder_deg")
    throttle: Throttles


class Channels(AircraftTable):
    """JSBSim properties by which the plant talks to the aircraft; the key says the unit."""

    phi_cmd_rad: PropertyName
    n_z_cmd: PropertyName
    V_a_cmd_mps: PropertyName
    engaged: PropertyName
    aileron_trim_rad: PropertyName
    elevator_trim_rad: PropertyName
    rudder_trim_rad: PropertyName
    throttle_trim: PropertyName
    aileron_law_rad: PropertyName
    elevator_law_rad: PropertyName
    rudder_law_rad: PropertyName
    throttle_law: PropertyName
    aileron_rad: PropertyName
    elevator_rad: PropertyName
    rudder_rad: PropertyName
    throttle: PropertyName
    thrust_lbf: PropertyName

    @property
    def trimmed(self) -> tuple[tuple[str, str], ...]:
        """Pairs of trim property and of the inner loop's output that adds to it."""
        return (
            (self.aileron_trim_rad, self.aileron_law_rad),
            (self.elevator_trim_rad, self.elevator_law_rad),
            (self.rudder_trim_rad, self.rudder_law_rad),
            (self.throttle_trim, self.throttle_law),
        )


class LimitProperties(AircraftTable):
    """JSBSim properties that take the command limits, in rad and s."""

    phi_min: PropertyName
    phi_max: PropertyName
    phi_rate: PropertyName
    n_z_min: PropertyName
    n_z_max: PropertyName
    n_z_rate: PropertyName
    throttle_max: PropertyName


class Wrapping(AircraftTable):
    """What is added to an aircraft of JSBSim's own set.

    Attributes
    ----------
    systems : tuple of str
        System files put in front of its flight control, in this order; paths from the folder.
    engine_settles : float, s
        Time the engine takes from any state to a steady one; 0 where JSBSim knows the steady state.
    """

    systems: Annotated[tuple[str, ...], Field(strict=False, max_length=100)]
    engine_settles: Settling = Field(alias="engine_settles_s", default=0.0)


class Design(AircraftTable):
    """Goals of ``flighttune design`` for the inner loop.

    Attributes
    ----------
    V_a, h : float, m/s and m
        Steady level flight that the airframe is linearised about.
    V_a_shown : tuple of float, m/s
        Airspeeds of the step responses.
    roll, n_z, speed : float, rad/s
        Bandwidth of roll, of load factor and of airspeed.
    roll_error : float, rad/s, or None
        Natural frequency of the roll error; by default 2.3 times the bandwidth of roll, at most
        half that of the actuator.
    roll_t90, n_z_t90 : float, s
        Longest time to 90 % of the step.
    roll_overshoot, n_z_overshoot : float, 1
        Largest overshoot as a share of the step.
    """

    V_a: Airspeed = Field(alias="V_a_mps")
    h: Height = Field(alias="h_m")
    V_a_shown: tuple[Airspeed, ...] = Field(
        strict=False, alias="V_a_shown_mps", min_length=1, max_length=20
    )
    roll: Bandwidth = Field(alias="roll_rad_s")
    n_z: Bandwidth = Field(alias="n_z_rad_s")
    speed: Bandwidth = Field(alias="speed_rad_s")
    roll_error: Bandwidth | None = Field(alias="roll_error_rad_s", default=None)
    roll_t90: TimeConstant = Field(alias="roll_t90_s")
    n_z_t90: TimeConstant = Field(alias="n_z_t90_s")
    roll_overshoot: Positive
    n_z_overshoot: Positive


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
    inner_loop_rate : float, 1/s
        Samples of the computer that runs the inner loop. JSBSim's steps are this or a whole
        fraction.
    settings : mapping of str to float
        Values of JSBSim properties for the whole flight, in JSBSim's units.
    envelope, limits, actuators, channels, limit_properties, design
        Tables of the file.
    gains : mapping of str to float
        Gains of the inner loop by JSBSim property, in the units the comments of the file give.
    """

    title: str
    source: str
    model: Annotated[str, Field(pattern=r"^[\w.-]+$", max_length=80)]
    wrapping: Wrapping | None = None
    inner_loop_rate: Annotated[Finite, Field(ge=20.0, le=2000.0)] = Field(
        alias="inner_loop_rate_hz", default=200.0
    )
    settings: dict[PropertyName, Finite] = Field(default_factory=dict)
    envelope: FlightEnvelope
    limits: CommandLimits
    actuators: Actuators
    channels: Channels
    limit_properties: LimitProperties
    design: Design | None = None
    gains: dict[PropertyName, Gain]
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
        """Return the aircraft off the nominal; JSBSim checks it when it loads the aircraft."""
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
        config = AircraftConfig.model_validate(toml_tables(file))
    except ValidationError as error:
        raise ScenarioError(f"{file}: {first_mistake(error)}") from error
    config._folder = file.parent
    return config


def files_hash(aircraft: str) -> str:
    """Hash of the names and contents of an aircraft's files.

    Raises
    ------
    InputError
        If there is no such aircraft.
    """
    folder = load_aircraft(aircraft).folder
    found = hashlib.sha256()
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        if file.suffix in (".xml", ".toml", ".json"):
            content = file.read_bytes()
            found.update(f"{file.relative_to(folder).as_posix()} {len(content)}\n".encode())
            found.update(content)
    return found.hexdigest()
