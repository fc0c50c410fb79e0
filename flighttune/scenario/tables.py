"""The tables of a scenario file: units at the end of each key, values in SI by a method."""

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    field_validator,
    model_validator,
)

from flighttune.aircraft.off_nominal import OffNominal
from flighttune.arrays import FloatArray
from flighttune.control.controller import AntiWindup
from flighttune.control.envelope import Envelope
from flighttune.control.exact_law import Priority
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.law import DEFAULT, Law, law_kinds, made_law, plain_laws
from flighttune.control.limits import Limits
from flighttune.metrics import FLIGHT_METRICS, METRICS
from flighttune.plants.base import PLANT_KINDS, PlantKind
from flighttune.plants.jsbsim.plant import DEEPEST_GROUND, HIGHEST_GROUND, LARGEST_SEED
from flighttune.plants.label import goes_by, plant_label
from flighttune.plants.sensors import Sensors
from flighttune.plants.weather import NED, Gust, Turbulence, TurbulenceModel, WindProfile
from flighttune.quantities import (
    Airspeed,
    Angle,
    AngularRate,
    AngularSpread,
    Bandwidth,
    Course,
    Damping,
    Delay,
    Duration,
    Factor,
    Finite,
    GainMatrix,
    Gravity,
    Height,
    Inclination,
    Instant,
    Length,
    LoadFactor,
    Oscillation,
    OscillationRate,
    PositiveGain,
    PositiveRate,
    Scale,
    Shift,
    TimeConstant,
    Wind,
    WindSpeed,
)
from flighttune.simulate.disturbance import Sinusoid
from flighttune.simulate.reference import Reference, Segment, doublet, ramp, step
from flighttune.simulate.run import RunStatus
from flighttune.tuning.problem import Method
from flighttune.units import DEG, G_PAPER

Seed: TypeAlias = Annotated[int, Field(ge=0, le=LARGEST_SEED)]
Ground: TypeAlias = Annotated[float, Field(ge=-DEEPEST_GROUND, le=HIGHEST_GROUND)]


# Longest name of gains, a plant or an aircraft's folder: together they name a file.
MAX_BYTES = 80

# Longest part of a path on any file system.
MAX_BYTES_OF_PART = 255


def _short(value: str) -> str:
    *above, name = (len(part.encode()) for part in ("", *Path(value).parts))
    if name > MAX_BYTES or max(above, default=0) > MAX_BYTES_OF_PART or "\0" in value:
        raise ValueError(f"must be a name of at most {MAX_BYTES} bytes, it has {name}")
    return value


Name: TypeAlias = Annotated[
    str, Field(min_length=1, pattern=r"^[\w.*+-]+$"), AfterValidator(_short)
]

# Longest name of something that ships, or longest path.
PathName: TypeAlias = Annotated[str, Field(min_length=1, max_length=4096), AfterValidator(_short)]


def _pair(value: object) -> object:
    if not (isinstance(value, list) and len(value) == 2):
        raise ValueError("must be a range [low, high]")
    return value


def _rising(value: list[float]) -> list[float]:
    if not value[0] < value[1]:
        raise ValueError("must be a range [low, high] with low below high")
    return value


RisingPair = BeforeValidator(_pair), AfterValidator(_rising)
LoadFactors: TypeAlias = Annotated[list[LoadFactor], *RisingPair]
Rolls: TypeAlias = Annotated[list[Angle], *RisingPair]
Rates: TypeAlias = Annotated[list[AngularRate], *RisingPair]
Airspeeds: TypeAlias = Annotated[list[Airspeed], *RisingPair]
Inclinations: TypeAlias = Annotated[list[Inclination], *RisingPair]


class Table(BaseModel):
    """A table of the file: unknown keys are refused, and it does not change."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, validate_by_name=True, serialize_by_alias=True
    )


class FlightTable(Table):
    """``[flight]``: start and length of the manoeuvre, and gravity of the kinematic law."""

    V_a_mps: Airspeed
    h_m: Height = 1000.0
    chi_deg: Course = 0.0
    gamma_deg: Inclination = 0.0
    phi_deg: Inclination = 0.0
    n_z: LoadFactor | None = None
    duration_s: Duration = 20.0
    ground_m: Ground = 0.0
    g_mps2: Gravity = G_PAPER


class LimitsTable(Table):
    """``[limits]`` of the commands; what is absent is not limited.

    A rate is one number (both ways) or a range.
    """

    phi_deg: Rolls | None = None
    phi_rate_dps: PositiveRate | Rates | None = None
    n_z: LoadFactors | None = None
    n_z_rate_per_s: PositiveRate | Rates | None = None

    @field_validator("phi_rate_dps", "n_z_rate_per_s")
    @classmethod
    def _includes_zero(cls, value: float | list[float] | None) -> float | list[float] | None:
        if isinstance(value, list) and not value[0] <= 0.0 <= value[1]:
            raise ValueError("must be a range of rates that includes zero")
        return value

    def limits(self) -> Limits:
        """The limits in rad, 1 and seconds; infinite where the file gives none."""
        lower, upper = _bounds(self.phi_deg, self.n_z)
        rate_lower, rate_upper = _bounds(self.phi_rate_dps, self.n_z_rate_per_s)
        return Limits(lower=lower, upper=upper, rate_lower=rate_lower, rate_upper=rate_upper)


def _bounds(*limits: float | list[float] | None) -> FloatArray:
    """Lower and upper bounds of (phi in deg, n_z) as rows, in rad and 1."""
    ranges = []
    for limit in limits:
        if limit is None:
            ranges.append([-np.inf, np.inf])
        else:
            ranges.append(limit if isinstance(limit, list) else [-limit, limit])
    return np.array(ranges).T * [DEG, 1.0]


class ControllerTable(Table):
    """``[controller]``: sample rate and options of the discrete MIMO-PI."""

    rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)] = 50.0
    anti_windup: AntiWindup = "conditional"
    tracking_time_s: TimeConstant | None = None
    feed_forward: bool = False
    schedule: bool = False


class EnvelopeTable(Table):
    """``[envelope]``: ranges of flight over which ``certify --envelope`` looks for one proof."""

    V_a_mps: Airspeeds
    gamma_deg: Inclinations
    phi_deg: Inclinations
    n_z: LoadFactors

    def envelope(self) -> Envelope:
        """The ranges in m/s, rad and 1."""
        return Envelope(
            V_a=(self.V_a_mps[0], self.V_a_mps[1]),
            gamma=(self.gamma_deg[0] * DEG, self.gamma_deg[1] * DEG),
            phi=(self.phi_deg[0] * DEG, self.phi_deg[1] * DEG),
            n_z=(self.n_z[0], self.n_z[1]),
        )


class StepTable(Table):
    """A jump of a reference."""

    shape: Literal["step"]
    start_s: Instant = 0.0
    change_deg: Course

    def segment(self) -> Segment:
        """The segment in s and rad."""
        return step(start=self.start_s, change=self.change_deg * DEG)


class RampTable(Table):
    """A steady change of a reference, kept afterwards."""

    shape: Literal["ramp"]
    start_s: Instant = 0.0
    duration_s: Duration
    rate_dps: AngularRate

    def segment(self) -> Segment:
        """The segment in s and rad."""
        return ramp(start=self.start_s, duration=self.duration_s, rate=self.rate_dps * DEG)


class DoubletTable(Table):
    """A pulse up and its opposite, each `width_s` long."""

    shape: Literal["doublet"]
    start_s: Instant = 0.0
    width_s: Duration
    amplitude_deg: Course

    def segment(self) -> Segment:
        """The segment in s and rad."""
        return doublet(start=self.start_s, width=self.width_s, amplitude=self.amplitude_deg * DEG)


SegmentTable: TypeAlias = Annotated[
    StepTable | RampTable | DoubletTable, Field(discriminator="shape")
]


class ReferenceTable(Table):
    """``[reference]``: a constant a channel, or segments that add to the value of ``[flight]``.

    With the shape ``feasible`` the constants are the end of the fastest change that keeps `margin`
    of every limit for the feedback. It begins at `chi_from_deg` and `gamma_from_deg`, by default
    where the flight does.
    """

    chi_deg: Course | list[SegmentTable]
    gamma_deg: Inclination | list[SegmentTable]
    shape: Literal["feasible"] | None = None
    margin: Annotated[float, Field(ge=0.0, le=0.9)] | None = None
    chi_from_deg: Course | None = None
    gamma_from_deg: Inclination | None = None

    @model_validator(mode="after")
    def _of_one_shape(self) -> "ReferenceTable":
        for key in ("margin", "chi_from_deg", "gamma_from_deg"):
            if self.shape is None and getattr(self, key) is not None:
                raise ValueError(f"`{key}` of [reference] must be given with shape feasible only")
        for key in ("chi_deg", "gamma_deg"):
            if self.shape is not None and isinstance(getattr(self, key), list):
                raise ValueError(f"`{key}` of [reference] must be a number with shape feasible")
        return self

    def starts(self) -> Iterator[tuple[str, float]]:
        """Table and start (s) of each segment."""
        for key, segments in (("chi_deg", self.chi_deg), ("gamma_deg", self.gamma_deg)):
            for segment in segments if isinstance(segments, list) else ():
                yield f"reference.{key}", segment.start_s

    def steepest(self, start_deg: float, duration: float) -> tuple[float, float]:
        """Time (s) and value (deg) of the steepest path angle asked for, up or down.

        `start_deg` is the path angle of ``[flight]``; `duration` is in s.
        """
        segments = self.gamma_deg if isinstance(self.gamma_deg, list) else []
        inside = {t for table in segments for t in table.segment().times if t < duration}
        ends = np.array(sorted({0.0, duration, *inside}))
        # Between two breaks the sum is straight; it may jump at a break, or just beside it.
        before, between = np.nextafter(ends[1:], 0.0), 0.5 * (ends[1:] + ends[:-1])
        t = np.concatenate([ends, before, between])
        _, gamma = self.reference(chi_deg=0.0, gamma_deg=start_deg).sampled(t)
        most = int(np.argmax(np.abs(gamma)))
        return float(t[most]), float(gamma[most]) / DEG

    def reference(self, *, chi_deg: float, gamma_deg: float) -> Reference:
        """The reference in s and rad, for a flight that starts at `chi_deg` and `gamma_deg`."""
        (chi, chi_segments), (gamma, gamma_segments) = (
            (start * DEG, tuple(table.segment() for table in value))
            if isinstance(value, list)
            else (value * DEG, ())
            for value, start in ((self.chi_deg, chi_deg), (self.gamma_deg, gamma_deg))
        )
        return Reference(
            chi=chi, gamma=gamma, chi_segments=chi_segments, gamma_segments=gamma_segments
        )


class AirframeTable(Table):
    """``[plant.airframe]``: factors on an aircraft of jsbsim, and the shift of its CG."""

    mass_factor: Factor = 1.0
    cg_aft_m: Shift = 0.0
    cg_right_m: Shift = 0.0
    cg_down_m: Shift = 0.0
    ixx_factor: Factor = 1.0
    iyy_factor: Factor = 1.0
    izz_factor: Factor = 1.0
    ixz_factor: Factor = 1.0
    lift_factor: Factor = 1.0
    drag_factor: Factor = 1.0
    side_force_factor: Factor = 1.0
    roll_moment_factor: Factor = 1.0
    pitch_moment_factor: Factor = 1.0
    yaw_moment_factor: Factor = 1.0
    coefficient_factors: dict[Annotated[str, Field(min_length=1)], Factor] = Field(
        default_factory=dict
    )
    thrust_factor: Factor = 1.0
    actuator_lag_factor: Factor = 1.0

    def off_nominal(self) -> OffNominal | None:
        """The same as a value; None where nothing is off the nominal."""
        value = OffNominal(
            **{name: getattr(self, f"{name}_factor") for name in OffNominal.SCALED},
            cg_shift=(self.cg_aft_m, self.cg_right_m, self.cg_down_m),
            coefficients=tuple(self.coefficient_factors.items()),
        )
        return None if value.is_nominal else value


class OwnTable(Table):
    """A law or plant, which may be a class of the user's: the class itself is in no file."""

    module: Annotated[str, Field(min_length=1)] | None = None
    class_: Annotated[str, Field(min_length=1)] | None = Field(default=None, alias="class")
    parameters: dict[str, Any] | None = None
    sha256: str | None = None
    _maker: Callable[..., Any] | None = PrivateAttr(None)

    @property
    def maker(self) -> Callable[..., Any] | None:
        """The class of the user's, once it is loaded or given from Python."""
        return self._maker

    @property
    def family(self) -> PlantKind | type[Law]:
        """Description of its kind for the other rooms."""
        raise NotImplementedError

    @property
    def of_the_user(self) -> bool:
        """Whether a class of the user's flies."""
        return "module" in self.family.keys

    def made_by(self, maker: Callable[..., Any]) -> Self:
        """The table with the class of the user's."""
        table = self.model_copy()
        table._maker = maker
        return table


def _check_keys(table: Table, kind: str, kinds: Mapping[str, PlantKind | type[Law]]) -> None:
    """Refuse keys of other kinds, and that a key is missing that a kind cannot do without."""
    for key in sorted(table.model_fields_set - kinds[kind].keys):
        others = " or ".join(name for name, other in kinds.items() if key in other.keys)
        if others:
            raise ValueError(f"`{key.removesuffix('_')}` must be given with kind {others} only")
    for key in kinds[kind].required:
        if getattr(table, key) is None:
            raise ValueError(f"`{key}` must be given with kind {kind}")
    if len({"module", "class_"} & table.model_fields_set) == 1:
        raise ValueError("`module` and `class` must be given together")


class PlantTable(OwnTable):
    """``[[plant]]``: what flies.

    ``kinematic`` is the paper's law, ``point_mass`` the exact point mass, ``point_mass_lag`` the
    same behind the lag of an inner loop, ``jsbsim`` an aircraft of six degrees of freedom,
    ``python`` a class of the user's: ``class`` in the file ``module``. A channel's lag is of first
    order, or of second order where a damping ratio is given. A name tells a plant from another one
    of the same kind and aircraft.
    """

    kind: Literal["kinematic", "point_mass", "point_mass_lag", "jsbsim", "python"]
    aircraft: PathName | None = None
    name: Name | None = None
    throttle_max: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    airframe: AirframeTable | None = None
    roll_lag_rad_s: Bandwidth | None = None
    roll_damping: Damping | None = None
    roll_delay_s: Delay | None = None
    n_z_lag_rad_s: Bandwidth | None = None
    n_z_damping: Damping | None = None
    n_z_delay_s: Delay | None = None

    @model_validator(mode="after")
    def _keys_of_the_kind(self) -> Self:
        _check_keys(self, self.kind, PLANT_KINDS)
        return self

    @property
    def family(self) -> PlantKind:
        """Description of its kind for the other rooms."""
        return PLANT_KINDS[self.kind]

    @property
    def label(self) -> str:
        """Name of the plant in tables, plots and files."""
        return plant_label(self.kind, self.aircraft, self.name)

    def lags(self) -> tuple[InnerLag, InnerLag] | None:
        """Lag of roll and of load factor; None for a plant without lags."""
        if self.roll_lag_rad_s is None:
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


if TYPE_CHECKING:
    LawKind: TypeAlias = str
else:
    LawKind = Literal[tuple(law_kinds())]

# Laws that a scenario can name without a table.
LAWS = plain_laws()


class LawTable(OwnTable):
    """``[[law]]``: what turns errors into commands.

    ``paper`` is the paper's law, ``exact`` the inversion of the point mass, ``python`` a class of
    the user's: ``class`` in the file ``module``, made with ``parameters``. ``sha256`` is that of
    the file as it was when the scenario was read.
    """

    name: Name
    kind: LawKind
    priority: Priority | None = None
    lift_floor: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    braking: Annotated[float, Field(gt=0.0, le=100.0)] | None = None

    @model_validator(mode="after")
    def _keys_of_the_kind(self) -> Self:
        _check_keys(self, self.kind, law_kinds())
        if self.name in LAWS and self.name != self.kind:
            raise ValueError(f"`name` of [[law]] must not be {self.name!r} with kind {self.kind}")
        return self

    @property
    def family(self) -> type[Law]:
        """Class of its kind."""
        return law_kinds()[self.kind]

    def law(self) -> Law:
        """The law, with defaults where the table does not say."""
        options = {key: getattr(self, key) for key in self.family.keys}
        return made_law(self.kind, self.name, **options, maker=self.maker)


def law_named(name: str) -> LawTable:
    """One of `LAWS` as it is by default."""
    return LawTable.model_validate({"name": name, "kind": name})


def _law_tables(value: object) -> object:
    """Names of laws among tables, or one name alone, as tables."""
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list):
        return value
    for law in value:
        if isinstance(law, str) and law not in LAWS:
            raise ValueError(f"`law` must name {' or '.join(LAWS)}, got {law!r}")
    return [law_named(law) if isinstance(law, str) else law for law in value]


Laws: TypeAlias = Annotated[list[LawTable], Field(min_length=1), BeforeValidator(_law_tables)]


class SensorsTable(Table):
    """``[sensors]``: bias and noise of course, flight-path angle and airspeed."""

    chi_bias_deg: Angle = 0.0
    chi_noise_sd_deg: AngularSpread = 0.0
    gamma_bias_deg: Angle = 0.0
    gamma_noise_sd_deg: AngularSpread = 0.0
    V_a_bias_mps: Wind = 0.0
    V_a_noise_sd_mps: WindSpeed = 0.0
    noise_time_constant_s: TimeConstant | None = None

    def sensors(self, seed: int) -> Sensors:
        """The errors in rad and m/s, their noise drawn from the scenario's `seed`."""
        return Sensors(
            bias=(self.chi_bias_deg * DEG, self.gamma_bias_deg * DEG, self.V_a_bias_mps),
            noise_sd=(
                self.chi_noise_sd_deg * DEG,
                self.gamma_noise_sd_deg * DEG,
                self.V_a_noise_sd_mps,
            ),
            time_constant=self.noise_time_constant_s or 0.0,
            seed=seed,
        )


# Curve of Fig. 7 of MIL-F-8785C, and wind 20 ft above ground in m/s (15, 30, 45 kn).
INTENSITIES = {"light": (3, 7.7), "moderate": (4, 15.4), "severe": (6, 23.1)}


class WindLevelTable(Table):
    """``[[wind.level]]``: the wind at one height above sea level."""

    h_m: Height
    speed_mps: WindSpeed
    from_deg: Course
    down_mps: Wind = 0.0


class WindTable(Table):
    """``[wind]``: steady wind, the same at all heights or given at levels."""

    speed_mps: WindSpeed | None = None
    from_deg: Course | None = None
    down_mps: Wind = 0.0
    level: Annotated[list[WindLevelTable], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _one_or_levels(self) -> "WindTable":
        fields = {name: field.default for name, field in type(self).model_fields.items()}
        constant = {name for name, default in fields.items() if getattr(self, name) != default}
        constant -= {"level"}
        if self.level is not None:
            if constant:
                raise ValueError(f"`{min(constant)}` must be absent where there are levels")
            heights = [level.h_m for level in self.level]
            if any(a >= b for a, b in pairwise(heights)):
                raise ValueError(f"`level` must rise in h_m, got {heights}")
        elif self.speed_mps is None or self.from_deg is None:
            raise ValueError("`speed_mps` and `from_deg` must be given, or levels")
        return self

    def profile(self) -> WindProfile:
        """The wind over height in m/s, north, east and down."""
        if self.level is not None:
            return WindProfile(
                tuple((x.h_m, _blowing(x.speed_mps, x.from_deg, x.down_mps)) for x in self.level)
            )
        wind = _blowing(self.speed_mps or 0.0, self.from_deg or 0.0, self.down_mps)
        return WindProfile(((0.0, wind),))


class GustTable(Table):
    """``[gust]``: one 1-cosine gust, its length flown through at the airspeed of the start."""

    axis: Literal["ahead", "right", "down"]
    peak_mps: Wind
    start_s: Instant
    length_m: Length
    hold_s: Instant = 0.0

    def gust(self, V_a: float) -> Gust:
        """The gust in seconds at the airspeed `V_a` (m/s)."""
        return Gust(
            axis=self.axis,
            peak=self.peak_mps,
            start=self.start_s,
            rise=self.length_m / V_a,
            hold=self.hold_s,
        )


class TurbulenceTable(Table):
    """``[turbulence]``: Dryden turbulence by a word, or by the two numbers behind it."""

    intensity: Literal["light", "moderate", "severe"] | None = None
    severity: Annotated[int, Field(ge=1, le=7)] | None = None
    wind_20ft_mps: WindSpeed | None = None
    model: TurbulenceModel = "tustin"

    @model_validator(mode="after")
    def _word_or_numbers(self) -> "TurbulenceTable":
        numbers = (self.severity is not None, self.wind_20ft_mps is not None)
        if numbers not in ((True, True), (False, False)) or all(numbers) == bool(self.intensity):
            raise ValueError(
                "`intensity` must be given, or both `severity` and `wind_20ft_mps` in its place"
            )
        return self

    def turbulence(self) -> Turbulence:
        """The turbulence by its numbers."""
        if self.severity is not None and self.wind_20ft_mps is not None:
            severity, wind = self.severity, self.wind_20ft_mps
        else:
            severity, wind = INTENSITIES[self.intensity or "light"]
        return Turbulence(severity=severity, wind_20ft=wind, model=self.model)


class DisturbanceTable(Table):
    """``[disturbance]``: the paper's sinusoid on the kinematic law, amplitudes in rad/s.

    A square wave switches between the amplitudes where the sinusoid changes its sign; with a list
    of times the amplitude is constant, and changes its sign at each of them.
    """

    chi_amplitude: OscillationRate = 0.0
    chi_omega_rad_s: Oscillation = 0.0
    gamma_amplitude: OscillationRate = 0.0
    gamma_omega_rad_s: Oscillation = 0.0
    wave: Literal["square"] | None = None
    chi_phase_deg: Angle | None = None
    gamma_phase_deg: Angle | None = None
    as_wind: bool = False
    path: Literal["ground", "air"] = "ground"
    chi_switch_s: list[Instant] | None = None
    gamma_switch_s: list[Instant] | None = None

    @model_validator(mode="after")
    def _switches_alone(self) -> "DisturbanceTable":
        for channel in ("chi", "gamma"):
            name = f"{channel}_switch_s"
            times = getattr(self, name)
            if times is None:
                continue
            for key in ("wave", "as_wind", f"{channel}_omega_rad_s", f"{channel}_phase_deg"):
                if getattr(self, key):
                    raise ValueError(
                        f"`{key}` must be absent with {name}: the amplitude is constant"
                    )
            for before, after in pairwise([0.0, *times]):
                if not after > before:
                    raise ValueError(
                        f"`{name}` must be positive and rise, got {after:g} s after {before:g} s"
                    )
        return self

    @model_validator(mode="after")
    def _wind_swings(self) -> "DisturbanceTable":
        for channel in ("chi", "gamma"):
            still = not getattr(self, f"{channel}_omega_rad_s")
            if self.as_wind and still and getattr(self, f"{channel}_amplitude"):
                raise ValueError(
                    f"`{channel}_omega_rad_s` must be positive with as_wind: a constant rate takes "
                    "a wind that grows without end"
                )
        for key in ("wave", "chi_phase_deg", "gamma_phase_deg"):
            if self.as_wind and getattr(self, key) is not None:
                raise ValueError(f"`{key}` must be absent with as_wind: the wind is that of a sine")
        if self.path == "air" and not self.as_wind:
            raise ValueError('`path` must be "ground" without as_wind, got "air"')
        return self

    def sinusoid(self) -> Sinusoid:
        """The disturbance as a function of time."""
        return Sinusoid(
            chi_amplitude=self.chi_amplitude,
            chi_omega=self.chi_omega_rad_s,
            gamma_amplitude=self.gamma_amplitude,
            gamma_omega=self.gamma_omega_rad_s,
            chi_phase=(self.chi_phase_deg or 0.0) * DEG,
            gamma_phase=(self.gamma_phase_deg or 0.0) * DEG,
            square=self.wave == "square",
            chi_switches=None if self.chi_switch_s is None else tuple(self.chi_switch_s),
            gamma_switches=None if self.gamma_switch_s is None else tuple(self.gamma_switch_s),
        )

    def last_switches(self) -> Iterator[tuple[str, float]]:
        """Key and last time (s) of each list of switching times."""
        for key in ("chi_switch_s", "gamma_switch_s"):
            if times := getattr(self, key):
                yield key, times[-1]


def _blowing(speed: float, from_deg: float, down: float) -> NED:
    """Velocity of air that comes from `from_deg`, clockwise from north."""
    return -speed * math.cos(from_deg * DEG), -speed * math.sin(from_deg * DEG), down


# Gains tuned on the model that ``[tuning]`` names.
TUNED = "tuned"

# Gains tuned on the identified model, whichever ``[tuning]`` names.
TUNED_IDENTIFIED = "tuned_identified"

INPUTS = 2

TuningModel: TypeAlias = Literal["kinematic", "identified"]


class TuningTable(Table):
    """``[tuning]``: what the gains named ``tuned`` maximise R_K under, and on which model.

    On the kinematic law ``lag_rad_s`` puts a first-order lag of (phi, n_z) between command and
    aircraft, and ``sample_delay`` the half sample by which a sampled command is late on average.
    R_K and I_K are those of the state divided by ``state_scaling`` (s = (x', e); ones by default).

    On the identified model lag, delay, sampling and scaling come from ``identified`` (the name of
    an aircraft or a model file; by default the aircraft of the first jsbsim plant) and from the
    controller, R_K is not bounded by I_K, and each channel is tuned by itself. ``robust`` maximises
    the smallest R_K over all conditions of the file instead of taking the nearest one.
    ``roll_rate`` bounds the gain from course to roll by what the rate limit of roll can follow.
    """

    I_star: Annotated[float, Field(gt=0.0)] = 5.0  # may be infinite: no bound
    model: TuningModel = "kinematic"
    identified: PathName | None = None
    robust: bool = False
    lag_rad_s: Annotated[list[Bandwidth], Field(min_length=INPUTS, max_length=INPUTS)] | None = None
    sample_delay: bool = False
    input_limits: bool = False
    structure: Literal["full", "decoupled"] = "full"
    gain_max: PositiveGain | None = None
    roll_rate: bool = False
    state_scaling: list[Scale] | None = None
    method: Method = "gradient"
    starts: Annotated[int, Field(ge=1, le=1000)] = 12

    @model_validator(mode="after")
    def _of_the_kinematic_law(self) -> "TuningTable":
        foreign = {"I_star", "lag_rad_s", "sample_delay", "state_scaling", "structure", "method"}
        changed = [
            name
            for name in sorted(foreign & self.model_fields_set)
            if getattr(self, name) != type(self).model_fields[name].default
        ]
        if self.model == "identified" and changed:
            raise ValueError(f"`{changed[0]}` must be absent with model identified")
        return self


class GainsTable(Table):
    """Gains given as numbers: rows phi, n_z (or their rates); columns chi, gamma.

    ``law`` says whose they are: the paper's, or the exact law's in 1/s and 1/s^2. By default the
    exact law's where the scenario flies no other, else the paper's. Other laws get them mapped.
    """

    name: Name
    K_P: GainMatrix
    K_I: GainMatrix
    law: Literal["paper", "exact"] | None = None

    @field_validator("K_P", "K_I")
    @classmethod
    def _two_by_two(cls, value: list[list[float]]) -> list[list[float]]:
        if [len(row) for row in value] != [INPUTS] * INPUTS:
            raise ValueError("must have 2 rows (phi, n_z) of 2 numbers (chi, gamma)")
        return value

    def gains(self, law: str = DEFAULT) -> PIGains:
        """The gains as a value; `law` is whose they are where the table does not say."""
        return PIGains.from_lists(self.K_P, self.K_I, self.law or law)


Subject: TypeAlias = Literal["chi", "gamma", "flight"]
Bounds: TypeAlias = dict[Subject, dict[str, Finite]]

CHANNEL_MEASURES = (*METRICS, "peak_rad")


class ExpectTable(Table):
    """Requirements for the runs of one plant, of one gain set, of both, or for all runs.

    Bounds are grouped by ``chi``, ``gamma`` (measures of the channel, and ``peak_rad``, the largest
    error) and ``flight``; a measure in rad may be given in deg under that ending.
    """

    plant: Annotated[str, Field(min_length=1)] | None = None
    gains: Annotated[str, Field(min_length=1)] | None = None
    status: RunStatus | None = None
    at_most: Bounds = Field(default_factory=dict)
    at_least: Bounds = Field(default_factory=dict)

    @model_validator(mode="after")
    def _measures_exist(self) -> "ExpectTable":
        if not (self.status or self.at_most or self.at_least):
            raise ValueError("`status`, `at_most` or `at_least` must be given")
        for bounds in (self.at_most, self.at_least):
            for subject, limits in bounds.items():
                measures = FLIGHT_METRICS if subject == "flight" else CHANNEL_MEASURES
                for name in limits:
                    if in_rad(name) not in measures:
                        raise ValueError(
                            f"`{subject}.{name}` must be one of {', '.join(measures)} "
                            "(or _deg in place of _rad)"
                        )
        return self

    def meant(self, plant: str, gains: str) -> bool:
        """Whether the requirements apply to a run of this plant and these gains."""
        return goes_by(plant, self.plant) and self.gains in (None, gains)


def in_rad(measure: str) -> str:
    """Name of a measure with ``_deg`` replaced by ``_rad``."""
    return f"{measure.removesuffix('_deg')}_rad" if measure.endswith("_deg") else measure
