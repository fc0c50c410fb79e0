"""An aircraft's folder: its ``aircraft.toml``, read once and checked, and its off-nominal forms."""

import hashlib
import json
import math
import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, PrivateAttr

from flighttune.base import quantities as q
from flighttune.base.errors import InputError, printable
from flighttune.base.files.budget import SEALED, file_bytes
from flighttune.base.files.shipped import aircraft_folder
from flighttune.base.files.table import hash_of, json_tables, stamp, toml_tables, validated
from flighttune.base.files.whole import UNFINISHED, check_whole, write_text
from flighttune.base.units import DEG
from flighttune.base.words import told_apart
from flighttune.control.controller import FlightCondition
from flighttune.control.limits import Limits

SURFACES = ("aileron", "elevator", "rudder")

# Axes of the aerodynamics by the names of their factors; the first word is JSBSim's name.
AXES = ("lift", "drag", "side_force", "roll_moment", "pitch_moment", "yaw_moment")

StuckAngle = Annotated[q.Finite, Field(ge=-90.0, le=90.0)]


class Fault(q.Table):
    """``[plant.airframe.fault]``: a failure in flight, sudden and lasting to the end."""

    from_s: q.Instant
    cg_aft_m: q.Shift = 0.0  # shift of the centre of gravity by a sliding tenth of the mass
    lift_factor: q.Factor = 1.0
    drag_factor: q.Factor = 1.0
    throttle_factor: q.Factor = 1.0  # factor on the throttle command
    actuator_lag_factor: q.Factor = 1.0
    V_a_bias_mps: q.Wind = 0.0  # measured minus true airspeed, for inner and outer loop
    # Positions of stuck surfaces
    aileron_stuck_deg: StuckAngle | None = None
    elevator_stuck_deg: StuckAngle | None = None
    rudder_stuck_deg: StuckAngle | None = None
    # Time of the flight at which it is ended: throttle closed and, with `cut`, elevator up and the
    # other surfaces at a stop; a stuck surface stays where it is
    ended_s: q.Instant | None = None
    ended_by: Literal["cut", "thrust"] = "cut"  # thrust: the surfaces stay under control

    @property
    def stuck(self) -> dict[str, float]:
        """Stuck surfaces with their positions, rad."""
        angles = {name: getattr(self, f"{name}_stuck_deg") for name in SURFACES}
        return {name: angle * DEG for name, angle in angles.items() if angle is not None}

    @property
    def factors(self) -> dict[str, float]:
        """Factors other than 1, by name."""
        return _other_than_one(self, "lift", "drag", "throttle", "actuator_lag")


class OffNominal(q.Table):
    """``[plant.airframe]``: differences of an aircraft from its files."""

    mass_factor: q.Factor = 1.0  # on mass alone; centre of gravity and inertias stay
    # Shift of the centre of gravity
    cg_aft_m: q.Shift = 0.0
    cg_right_m: q.Shift = 0.0
    cg_down_m: q.Shift = 0.0
    # Factors on the inertias about the centre of gravity, body axes
    ixx_factor: q.Factor = 1.0
    iyy_factor: q.Factor = 1.0
    izz_factor: q.Factor = 1.0
    ixz_factor: q.Factor = 1.0
    # Factors on all aerodynamics along and about one axis
    lift_factor: q.Factor = 1.0
    drag_factor: q.Factor = 1.0
    side_force_factor: q.Factor = 1.0
    roll_moment_factor: q.Factor = 1.0
    pitch_moment_factor: q.Factor = 1.0
    yaw_moment_factor: q.Factor = 1.0
    # Factors on single aerodynamic functions of the model, by name or its last part. Each must have
    # its function, even with a factor of 1.
    coefficient_factors: dict[Annotated[str, Field(min_length=1)], q.Factor] = Field(
        default_factory=dict
    )
    thrust_factor: q.Factor = 1.0  # factor on the thrust at each throttle
    actuator_lag_factor: q.Factor = 1.0  # factor on the time constants of the surface actuators
    fault: Fault | None = None

    @property
    def cg_shift(self) -> tuple[float, float, float]:
        """Shift of the centre of gravity, m: aft, right, down."""
        return self.cg_aft_m, self.cg_right_m, self.cg_down_m

    @property
    def slides(self) -> bool:
        """Whether a part of the mass slides in flight."""
        return self.fault is not None and self.fault.cg_aft_m != 0.0

    @property
    def loaded(self) -> bool:
        """Whether mass, centre of gravity or inertia differ at any time."""
        moved = self.slides or any(self.cg_shift)
        return moved or self.mass_factor != 1.0 or bool(self.inertia_factors)

    @property
    def inertia_factors(self) -> dict[str, float]:
        """Factors other than 1 on the inertias."""
        return _other_than_one(self, "ixx", "iyy", "izz", "ixz")

    @property
    def scaled(self) -> dict[str, float]:
        """Factors other than 1 on aerodynamics as a whole, thrust and actuators, by property."""
        return _other_than_one(self, *AXES, "thrust", "actuator_lag")


def _other_than_one(table: Fault | OffNominal, *names: str) -> dict[str, float]:
    factors = {name: getattr(table, f"{name}_factor") for name in names}
    return {name: factor for name, factor in factors.items() if factor != 1.0}


_LEVEL = r"[A-Za-z_][A-Za-z0-9_.-]*(\[\d+\])?"
# Names that JSBSim accepts; any other name ends the process.
PROPERTY_NAME = rf"^{_LEVEL}(/{_LEVEL})*$"

# Path of JSBSim's own properties in the tree that it shares with FlightGear.
OWN_TREE = "/fdm/jsbsim"


def absolute_name(name: str, base: str = OWN_TREE) -> str:
    """Path of a property from the root; its name may be relative to `base`."""
    # JSBSim accepts doubled slashes, dots, a final slash, and no slash after an index.
    levels = [] if name.startswith("/") else base.split("/")
    for level in name.replace("]", "]/").split("/"):
        if level == "..":
            levels = levels[:-1]
        elif level not in ("", "."):
            levels.append(level)
    return "/" + "/".join(filter(None, levels))


def property_name(name: str) -> str:
    """The name for an ``aircraft.toml`` of a name that JSBSim accepts."""
    return absolute_name(name).removeprefix(f"{OWN_TREE}/") if name else ""


def _through_zero(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] * ends[1] < 0.0:
        raise ValueError("must be one negative and one positive position")
    return ends


def _name_or_file(model: str) -> str:
    if "/" in model and not model.endswith(".xml"):
        raise ValueError("must be a name of JSBSim's own set, or a path that ends in .xml")
    return model


def _one_line(text: str) -> str:
    if printable(text) != text or "\n" in text:
        raise ValueError("must be one line of printable characters")
    return text


# Texts are printed and written to other files.
Text = Annotated[str, AfterValidator(_one_line)]
SurfaceAngle = Annotated[q.Finite, Field(gt=-math.pi, lt=math.pi)]
SurfaceAngles = Annotated[
    tuple[SurfaceAngle, SurfaceAngle], Field(strict=False), AfterValidator(_through_zero)
]
FromDegrees = Annotated[q.Angle, AfterValidator(math.radians)]
Throttle = Annotated[q.Finite, Field(ge=0.0, le=1.0)]
Angles = Annotated[tuple[FromDegrees, FromDegrees], *q.Rising]
PropertyName = Annotated[str, Field(pattern=PROPERTY_NAME)]
# A minus negates the property.
SourceName = Annotated[str, Field(pattern=PROPERTY_NAME.replace("^", "^-?", 1))]
DeclaredName = Annotated[str, Field(pattern=PROPERTY_NAME.replace("^", "^/?", 1))]


class FlightEnvelope(q.Table):
    """Range of validity of the model; leaving it ends a flight."""

    # `alpha` and `theta` (rad): angle of attack; pitch attitude
    alpha: Angles = Field(alias="alpha_deg")
    theta: Angles = Field(alias="theta_deg")
    V_a: q.Airspeeds = Field(alias="V_a_mps")  # m/s: airspeed
    n_z: q.LoadFactors  # load factor


class CommandLimits(q.Table):
    """Limits of the inner loop on its commands."""

    phi: Angles = Field(alias="phi_deg")  # rad: roll command
    # rad/s: rate of the roll command
    phi_rate: Annotated[q.PositiveRate, AfterValidator(math.radians)] = Field(alias="phi_rate_dps")
    n_z: q.LoadFactors  # load-factor command
    n_z_rate: q.PositiveRate = Field(alias="n_z_rate_per_s")  # 1/s: rate of the load-factor command
    # longitudinal load factor, and 1/s: its rate; without it the aircraft holds its airspeed itself
    n_x: q.LoadFactors | None = None
    n_x_rate: q.PositiveRate | None = Field(alias="n_x_rate_per_s", default=None)

    def limits(self, *, airspeed: bool = False) -> Limits:
        """Return the limits of (phi, n_z), or of (phi, n_z, n_x), for the controller."""
        ranges, rates = [self.phi, self.n_z], [self.phi_rate, self.n_z_rate]
        if airspeed and self.n_x is not None:
            ranges, rates = [*ranges, self.n_x], [*rates, self.n_x_rate or math.inf]
        lower, upper = np.transpose(ranges)
        rate = np.array(rates)
        return Limits(lower=lower, upper=upper, rate_lower=-rate, rate_upper=rate)


class Surface(q.Table):
    """A control surface: its travel, and the property of the model that moves it."""

    # rad: stops; positive: aileron rolls right, elevator trailing edge down, rudder trailing edge
    # left.
    travel: Angles = Field(alias="travel_deg")
    # Property of the model for the command, by default ``fcs/SURFACE-cmd-norm``. A property that
    # ends in ``-rad`` is the position itself.
    command: PropertyName | None = None
    # rad: positions at the commands -1 and +1, by default `travel`; the first is larger for a
    # command of the opposite sense.
    full: SurfaceAngles | None = Field(alias="full_rad", default=None)
    # Properties of the model's own flight control that the position replaces in its aerodynamics,
    # with a minus its negative. This bypasses a flight control that would change the position. A
    # property that two surfaces replace, such as an elevon, gets the sum of both.
    replaces: Annotated[tuple[SourceName, ...], Field(strict=False, max_length=20)] = ()


class Surfaces(q.Table):
    """The control surfaces."""

    aileron: Surface
    elevator: Surface
    rudder: Surface | None = None  # without a rudder, yaw is left to the airframe

    def named(self) -> Iterator[tuple[str, Surface]]:
        """Name and table of each existing surface, in the order of `SURFACES`."""
        surfaces = ((name, getattr(self, name)) for name in SURFACES)
        return ((name, surface) for name, surface in surfaces if surface is not None)


class Engines(q.Table):
    """The engines, with one common throttle command."""

    # Number of engines, each of which must push; 0 for a glider
    count: Annotated[int, Field(ge=0, le=32)] = 1
    # s: settling time of the engines; 0 if JSBSim knows the steady state
    settle: q.NotNegative = Field(alias="settle_s", default=0.0, le=60.0)
    # Lowest and highest throttle
    throttle: Annotated[tuple[Throttle, Throttle], *q.Rising] = (0.0, 1.0)
    # Property for the throttle of the first engine; the others have indices
    command: PropertyName = "fcs/throttle-cmd-norm"
    # Value of that property at full throttle
    full: q.Positive = 1.0
    # Property of a thrust that is an external force, lbf; by default each engine's thrust
    thrust: PropertyName | None = None


class Design(q.Table):
    """Goals of ``flighttune design`` for the inner loop."""

    # `V_a` and `h` (m/s and m): steady level flight for linearisation
    V_a: q.Airspeed = Field(alias="V_a_mps")
    h: q.Height = Field(alias="h_m")
    V_a_shown: tuple[q.Airspeed, ...] = Field(
        strict=False, alias="V_a_shown_mps", min_length=1, max_length=20
    )  # m/s: airspeeds of the step responses
    # `roll`, `n_z` and `speed` (rad/s): bandwidth of roll, of load factor and of airspeed
    roll: q.Bandwidth = Field(alias="roll_rad_s")
    n_z: q.Bandwidth = Field(alias="n_z_rad_s")
    speed: q.Bandwidth = Field(alias="speed_rad_s")
    # rad/s: natural frequency of the roll error; by default 2.3 times the bandwidth of roll, at
    # most half that of the actuator.
    roll_error: q.Bandwidth | None = Field(alias="roll_error_rad_s", default=None)
    # `roll_t90` and `n_z_t90` (s): longest time to 90 % of the step
    roll_t90: q.TimeConstant = Field(alias="roll_t90_s")
    n_z_t90: q.TimeConstant = Field(alias="n_z_t90_s")
    # `roll_overshoot` and `n_z_overshoot`: largest overshoot as a share of the step
    roll_overshoot: q.Positive
    n_z_overshoot: q.Positive


GAINS_FILE = "gains.json"


class InnerLoopGains(q.Table):
    """Gains of the inner loop, written by ``flighttune design`` beside ``aircraft.toml``."""

    format: Literal["flighttune inner-loop gains 1"] = "flighttune inner-loop gains 1"
    made_for: str  # hash of the model's files and of the aircraft's surfaces, engines and settings
    jsbsim: str  # version of flighttune that computed them
    # Gains by their names after ``ft/gains/``; surfaces in rad, rates in rad/s, throttle in 1
    gains: dict[PropertyName, q.Gain]

    @property
    def sha256(self) -> str:
        """Hash of the gains and of their basis."""
        return hash_of([self.made_for, self.gains])


class AircraftConfig(q.Table):
    """An aircraft as described by its ``aircraft.toml``, in SI and radians."""

    # Description of the aircraft, and source of its numbers
    title: Text
    source: Text
    # Name of an aircraft in JSBSim's own set, or path of a main file (``.xml``) relative to the
    # folder.
    model: Annotated[
        q.PathName,
        Field(pattern=r"^[^{}]+$", max_length=500),
        AfterValidator(_one_line),
        AfterValidator(_name_or_file),
    ]
    # 1/s: sample rate of the inner loop's computer. JSBSim's step is one sample or a whole fraction
    # of it.
    inner_loop_rate: Annotated[q.Finite, Field(ge=20.0, le=2000.0)] = Field(
        alias="inner_loop_rate_hz", default=200.0
    )
    # `surfaces`, `engines`, `envelope`, `limits` and `design`: tables of the file
    surfaces: Surfaces
    engines: Engines = Engines()
    # Values of JSBSim properties for the whole flight, in JSBSim's units
    settings: dict[PropertyName, q.Finite] = Field(default_factory=dict)
    # Values of properties of another simulator that the model refers to but that neither it nor
    # JSBSim defines.
    declared: dict[DeclaredName, q.Finite] = Field(default_factory=dict)
    # JSBSim's properties by the other simulator's properties that follow them, such as levers
    linked: dict[DeclaredName, SourceName] = Field(default_factory=dict)
    envelope: FlightEnvelope
    limits: CommandLimits
    design: Design | None = None
    _folder: Path = PrivateAttr()
    _gains: InnerLoopGains | None = PrivateAttr(default=None)
    _off_nominal: OffNominal | None = PrivateAttr(default=None)
    _fingerprint: str = PrivateAttr(default="")

    @property
    def folder(self) -> Path:
        """Folder of the aircraft."""
        return self._folder

    @property
    def file(self) -> Path:
        """The ``aircraft.toml`` itself."""
        return self._folder / "aircraft.toml"

    @property
    def gains(self) -> InnerLoopGains | None:
        """Gains of the inner loop; None before `design` has written them."""
        return self._gains

    @property
    def fingerprint(self) -> str:
        """Hash of the file's surfaces, engines and settings."""
        return self._fingerprint

    def with_gains(self, gains: InnerLoopGains) -> Self:
        """Return the aircraft with other inner-loop gains."""
        changed = self.model_copy()
        changed._gains = gains
        return changed

    @property
    def off_nominal(self) -> OffNominal | None:
        """Differences of the aircraft from its files; None without differences."""
        return self._off_nominal

    def with_off_nominal(self, off_nominal: OffNominal | None) -> Self:
        """Return the off-nominal aircraft; JSBSim checks it on loading."""
        changed = self.model_copy()
        changed._off_nominal = off_nominal
        return changed

    def with_throttle_max(self, throttle_max: float) -> Self:
        """Return the aircraft with a lower maximum throttle."""
        low, high = self.engines.throttle
        if not low < throttle_max <= high:
            raise InputError(
                f"`throttle_max` must lie above {low:g} and up to {high:g}, got {throttle_max}."
            )
        engines = self.engines.model_copy(update={"throttle": (low, throttle_max)})
        return self.model_copy(update={"engines": engines})


def load_aircraft(aircraft: str | Path) -> AircraftConfig:
    """Return the aircraft with a name, or from a folder with an ``aircraft.toml``."""
    folder = Path(aircraft).resolve()
    if os.path.isfile(folder) or (isinstance(aircraft, str) and Path(aircraft).name == aircraft):
        folder = aircraft_folder(str(aircraft))
    check_whole(folder)
    return _read(folder, stamp(folder / "aircraft.toml"), stamp(folder / GAINS_FILE))


@lru_cache(maxsize=32)
def _read(folder: Path, _stamp: tuple[int, ...], gains_stamp: tuple[int, ...]) -> AircraftConfig:
    """The aircraft of a folder, read again after a file has changed."""
    config = aircraft_from(toml_tables(folder / "aircraft.toml"), folder)
    if gains_stamp:
        gains = folder / GAINS_FILE
        config._gains = validated(InnerLoopGains, json_tables(gains), gains)
    return config


def aircraft_from(tables: dict[str, Any], folder: Path) -> AircraftConfig:
    """Return the aircraft that the tables of an ``aircraft.toml`` in `folder` describe."""
    config = validated(AircraftConfig, tables, folder / "aircraft.toml")
    config._folder = folder
    # Each start of a flight needs the fingerprint. Copies keep the file's fingerprint, because
    # their throttle is not part of the model.
    engines = {"count", "command", "full"}
    parts = {"surfaces": True, "settings": True, "declared": True, "linked": True}
    text = config.model_dump_json(include=parts | {"engines": engines}, exclude_defaults=True)
    config._fingerprint = hashlib.sha256(text.encode()).hexdigest()
    return config


def save_gains(gains: InnerLoopGains, folder: Path) -> Path:
    """Write the gains of an inner loop into an aircraft's folder, and return the file."""
    text = json.dumps(gains.model_dump(), indent=2, allow_nan=False) + "\n"
    return write_text(folder / GAINS_FILE, text)


def start_faults(
    config: AircraftConfig, condition: FlightCondition, ground: float
) -> Iterator[tuple[str, str]]:
    """Attributes of a condition outside the aircraft's envelope or limits, with reasons."""
    if not condition.h > ground:
        yield "h", f"must be above the ground at {ground:g} m, got {condition.h:g} m"
    for name, value, (low, high), unit, symbol in (
        ("V_a", condition.V_a, config.envelope.V_a, 1.0, " m/s"),
        ("phi", condition.phi, config.limits.phi, DEG, " deg"),
        ("n_z", condition.n_z_start, config.limits.n_z, 1.0, ""),
    ):
        if not low <= value <= high:
            allowed = f"{low / unit:g} to {high / unit:g}{symbol} ({config.file})"
            got, _ = told_apart(value / unit, (low if value < low else high) / unit)
            yield name, f"must lie in {allowed}, got {got}{symbol}"


def files_hash(aircraft: str) -> str:
    """Hash of the names and contents of an aircraft's files."""
    folder = load_aircraft(aircraft).folder
    digest = hashlib.sha256()
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        unfinished = any(part.startswith(UNFINISHED) for part in file.relative_to(folder).parts)
        if file.suffix in (".xml", ".toml", ".json") and not unfinished:
            content = file_bytes(file, SEALED)
            digest.update(f"{file.relative_to(folder).as_posix()} {len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()
