"""The tables of a scenario file: units at the end of each key, values in SI by a method."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    model_validator,
)

from flighttune.base import quantities as q
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files.table import abridged
from flighttune.base.units import DEG, G_PAPER
from flighttune.base.words import listed
from flighttune.control.exact_law import Priority
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.law import DEFAULT, Law, law_kinds, made_law, plain_laws
from flighttune.control.limits import AntiWindup, Limits
from flighttune.control.linear_model import Envelope
from flighttune.flight import metrics
from flighttune.flight.loop import disturbance, run
from flighttune.routes.segments import Reference, Segment
from flighttune.vehicles.aircraft.aircraft import AircraftConfig, OffNominal, load_aircraft
from flighttune.vehicles.identification.file import IdentifiedAircraft, load_identified
from flighttune.vehicles.plants.base import PLANT_KINDS, PlantKind, goes_by, plant_label
from flighttune.vehicles.plants.jsbsim.plant import DEEPEST_GROUND, HIGHEST_GROUND, LARGEST_SEED
from flighttune.vehicles.plants.sensors import Sensors
from flighttune.vehicles.plants.weather import NED, Gust, Turbulence, TurbulenceModel, WindProfile

Seed: TypeAlias = Annotated[int, Field(ge=0, le=LARGEST_SEED)]
Ground: TypeAlias = Annotated[float, Field(ge=-DEEPEST_GROUND, le=HIGHEST_GROUND)]

Name: TypeAlias = Annotated[
    str, Field(min_length=1, pattern=r"^[\w.*+-]+$"), AfterValidator(q.short)
]


class FlightTable(q.Table):
    """``[flight]``: start and length of the manoeuvre, and gravity of the kinematic law.

    In steady wind the flight starts along its course and path angle over ground; with
    ``start = "heading"`` it starts along them through the air.
    """

    V_a_mps: q.Airspeed
    h_m: q.Height = 1000.0  # above sea level
    chi_deg: q.Course = 0.0
    gamma_deg: q.Inclination = 0.0
    phi_deg: q.Inclination = 0.0
    n_z: q.LoadFactor | None = None  # command at the start; that of steady flight if left out
    # Whether the angles are those over ground or, with heading, through the air
    start: Literal["course", "heading"] = "course"
    duration_s: q.Duration = 20.0
    ground_m: Ground = 0.0  # height of the ground above sea level
    g_mps2: q.Gravity = G_PAPER  # of the kinematic law


def _with_zero(rates: tuple[float, float]) -> tuple[float, float]:
    if not rates[0] <= 0.0 <= rates[1]:
        raise ValueError("must be a range of rates that includes zero")
    return rates


Rates: TypeAlias = q.PositiveRate | Annotated[q.AngularRates, AfterValidator(_with_zero)]


class LimitsTable(q.Table):
    """``[limits]`` of the commands; without any, all plants have those of the first aircraft."""

    # No limit but the aircraft's own if left out, as for every limit
    phi_deg: q.Angles | None = None
    phi_rate_dps: Rates | None = None  # a number (both ways) or a range
    n_z: q.LoadFactors | None = None
    n_z_rate_per_s: Rates | None = None  # a number (both ways) or a range
    # Where the airspeed is followed; a plant that is no aircraft has it at any airspeed
    n_x: q.LoadFactors | None = None
    n_x_rate_per_s: Rates | None = None  # a number (both ways) or a range

    @lru_cache(maxsize=64)  # noqa: B019 - equal tables share it
    def limits(self, *, airspeed: bool = False) -> Limits:
        """Limits of (phi, n_z), and n_x with an `airspeed`, in rad, 1, s; inf by default."""
        m = 3 if airspeed else 2
        lower, upper = _ends(*(self.phi_deg, self.n_z, self.n_x)[:m])
        rates = self.phi_rate_dps, self.n_z_rate_per_s, self.n_x_rate_per_s
        rate_lower, rate_upper = _ends(*rates[:m])
        return Limits(lower=lower, upper=upper, rate_lower=rate_lower, rate_upper=rate_upper)


def _ends(*limits: float | tuple[float, float] | None) -> list[FloatArray]:
    """Lower and upper ends of (phi in deg, n_z, ...), in rad and 1."""
    ranges = [math.inf if limit is None else limit for limit in limits]
    pairs = [limit if isinstance(limit, tuple) else (-limit, limit) for limit in ranges]
    pairs[0] = pairs[0][0] * DEG, pairs[0][1] * DEG
    return [np.array(ends) for ends in zip(*pairs, strict=True)]


class ControllerTable(q.Table):
    """``[controller]``: sample rate and options of the discrete MIMO-PI."""

    rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)] = 50.0
    anti_windup: AntiWindup = "conditional"
    # Of back_calculation; found from the gains if left out
    tracking_time_s: q.TimeConstant | None = None
    feed_forward: bool = False  # of the load factor of the reference
    schedule: bool = False  # true: gains proportional to the airspeed
    # true: the path angle of an aircraft gives way where its airspeed falls towards 0.875 of that
    # of [flight]; where the law follows the airspeed it gives way anyway
    speed_priority: bool | None = None


class EnvelopeTable(q.Table):
    """``[envelope]``: ranges of flight over which ``certify --envelope`` looks for one proof."""

    V_a_mps: q.Airspeeds
    gamma_deg: q.Inclinations
    phi_deg: q.Inclinations
    n_z: q.LoadFactors

    def envelope(self) -> Envelope:
        """The ranges in m/s, rad and 1."""
        gamma, phi = ((low * DEG, high * DEG) for low, high in (self.gamma_deg, self.phi_deg))
        return Envelope(V_a=self.V_a_mps, gamma=gamma, phi=phi, n_z=self.n_z)


class StepTable(q.Table):
    """A jump of a reference."""

    shape: Literal["step"]
    start_s: q.Instant = 0.0  # before the end of the flight, as for every segment
    change_deg: q.Course

    def segment(self) -> Segment:
        """The segment in s and rad."""
        return Segment(self.start_s, (0.0,), jumps=(self.change_deg * DEG,))


class RampTable(q.Table):
    """A steady change of a reference, kept afterwards."""

    shape: Literal["ramp"]
    start_s: q.Instant = 0.0
    duration_s: q.Duration
    rate_dps: q.AngularRate
    roll_in_s: q.Instant = 0.0  # time over which the rate rises, and falls: the ramp is planned

    @model_validator(mode="after")
    def _roll_in_fits(self) -> "RampTable":
        most = min(self.duration_s, 2.0 * self.start_s)
        if self.roll_in_s > most:
            raise ValueError(
                f"`roll_in_s` must be at most {most:g} s, which is `duration_s` or twice `start_s` "
                f"(half of it lies before the ramp), got {self.roll_in_s:g} s"
            )
        return self

    def segment(self) -> Segment:
        """The segment in s and rad."""
        breaks, rate = (0.0, self.duration_s), self.rate_dps * DEG
        return Segment(self.start_s, breaks, rates=(rate,), roll_in=self.roll_in_s)


class DoubletTable(q.Table):
    """A pulse up and its opposite, each `width_s` long."""

    shape: Literal["doublet"]
    start_s: q.Instant = 0.0
    width_s: q.Duration  # of each half
    amplitude_deg: q.Course

    def segment(self) -> Segment:
        """The segment in s and rad."""
        width, amplitude = self.width_s, self.amplitude_deg * DEG
        jumps = (amplitude, -2.0 * amplitude, amplitude)
        return Segment(self.start_s, (0.0, width, 2.0 * width), jumps=jumps)


SegmentTable: TypeAlias = Annotated[
    StepTable | RampTable | DoubletTable, Field(discriminator="shape")
]


class AirspeedStepTable(q.Table):
    """A jump of the airspeed's reference."""

    shape: Literal["step"]
    start_s: q.Instant = 0.0
    change_mps: q.Finite

    def segment(self) -> Segment:
        """The segment in s and m/s."""
        return Segment(self.start_s, (0.0,), jumps=(self.change_mps,))


class AirspeedRampTable(q.Table):
    """A steady change of the airspeed's reference, kept afterwards."""

    shape: Literal["ramp"]
    start_s: q.Instant = 0.0
    duration_s: q.Duration
    rate_mps2: q.Finite

    def segment(self) -> Segment:
        """The segment in s and m/s."""
        return Segment(self.start_s, (0.0, self.duration_s), rates=(self.rate_mps2,))


class AirspeedDoubletTable(q.Table):
    """A pulse up and its opposite, each `width_s` long."""

    shape: Literal["doublet"]
    start_s: q.Instant = 0.0
    width_s: q.Duration
    amplitude_mps: q.Finite

    def segment(self) -> Segment:
        """The segment in s and m/s."""
        width, size = self.width_s, self.amplitude_mps
        return Segment(self.start_s, (0.0, width, 2.0 * width), jumps=(size, -2.0 * size, size))


AirspeedSegment: TypeAlias = Annotated[
    AirspeedStepTable | AirspeedRampTable | AirspeedDoubletTable, Field(discriminator="shape")
]


class ReferenceTable(q.Table):
    """``[reference]``: a constant a channel, or segments that add to the value of ``[flight]``."""

    chi_deg: q.Course | list[SegmentTable]
    gamma_deg: q.Inclination | list[SegmentTable]
    # Airspeed that the law holds by n_x; every plant holds that of [flight] if left out
    V_mps: q.Airspeed | list[AirspeedSegment] | None = None
    # feasible: the fastest change to the constants that the aircraft can fly
    shape: Literal["feasible"] | None = None
    # Share of limits and rates that is left to the feedback; 0.2 if left out
    margin: Annotated[float, Field(ge=0.0, le=0.9)] | None = None
    # Start of the feasible change; that of the flight if left out
    chi_from_deg: q.Course | None = None
    # Start of the feasible change; that of the flight if left out
    gamma_from_deg: q.Inclination | None = None

    @model_validator(mode="after")
    def _of_one_shape(self) -> "ReferenceTable":
        for key in ("margin", "chi_from_deg", "gamma_from_deg"):
            if self.shape is None and getattr(self, key) is not None:
                raise ValueError(f"`{key}` of [reference] must be given with shape feasible only")
        for key in ("chi_deg", "gamma_deg"):
            if self.shape is not None and isinstance(getattr(self, key), list):
                raise ValueError(f"`{key}` of [reference] must be a number with shape feasible")
        if self.shape is not None and self.V_mps is not None:
            raise ValueError("`V_mps` of [reference] must be absent with shape feasible")
        return self

    @property
    def segments(self) -> list[tuple[str, SegmentTable | AirspeedSegment]]:
        """Key and table of each segment."""
        values = [(key, getattr(self, key)) for key in ("chi_deg", "gamma_deg", "V_mps")]
        return [(key, x) for key, value in values if isinstance(value, list) for x in value]

    @property
    def ramps_in(self) -> list[tuple[str, RampTable]]:
        """Key and table of each ramp that rolls in."""
        return [(key, x) for key, x in self.segments if isinstance(x, RampTable) and x.roll_in_s]

    @property
    def batched(self) -> bool:
        """Whether the compiled kernel flies it: no search, no plan, no airspeed."""
        return self.shape is None and self.V_mps is None and not self.ramps_in

    def steepest(self, flight: FlightTable) -> tuple[float, float]:
        """Time (s) and value (deg) of the steepest path angle asked for, up or down."""
        if not isinstance(self.gamma_deg, list):
            return 0.0, self.gamma_deg
        duration = flight.duration_s
        inside = {t for table in self.gamma_deg for t in table.segment().times if t < duration}
        ends = np.array(sorted({0.0, duration, *inside}))
        # Between two breaks the sum is straight; it may jump at a break, or just beside it.
        before, between = np.nextafter(ends[1:], 0.0), 0.5 * (ends[1:] + ends[:-1])
        t = np.concatenate([ends, before, between])
        _, gamma = self.reference(flight).sampled(t)
        most = int(np.argmax(np.abs(gamma)))
        return float(t[most]), float(gamma[most]) / DEG

    def airspeeds(self, flight: FlightTable) -> tuple[float, float]:
        """Lowest and highest airspeed asked for in a flight, m/s."""
        reference, duration = self.reference(flight), flight.duration_s
        ends = [t for s in reference.V_segments for t in s.times if t < duration]
        values = reference.airspeed(np.array([0.0, duration, *ends]))
        assert values is not None  # it has an airspeed
        return float(values[0].min()), float(values[0].max())

    def reference(self, flight: FlightTable) -> Reference:
        """The reference in s, rad and m/s, from the start of a flight on."""
        stated: tuple[Any, ...] = self.chi_deg, self.gamma_deg, self.V_mps
        starts = flight.chi_deg, flight.gamma_deg, flight.V_a_mps
        (chi, on_chi), (gamma, on_gamma), (V, on_V) = (
            (start, tuple(x.segment() for x in own)) if isinstance(own, list) else (own, ())
            for own, start in zip(stated, starts, strict=True)
        )
        return Reference(
            chi=chi * DEG,
            gamma=gamma * DEG,
            chi_segments=on_chi,
            gamma_segments=on_gamma,
            g=flight.g_mps2,
            V=V,
            V_segments=on_V,
        )


class OwnTable(q.Table):
    """A law or plant, which may be a class of the user's: the class itself is in no file."""

    model_config = ConfigDict(serialize_by_alias=True)

    module: Annotated[str, Field(min_length=1)] | None = None  # file with the class, of kind python
    # Name of the class in that file
    class_: Annotated[str, Field(min_length=1)] | None = Field(default=None, alias="class")
    parameters: dict[str, Any] | None = None  # what the class is made with
    sha256: str | None = None  # of the file when the scenario was read; filled in
    _maker: Callable[..., Any] | None = PrivateAttr(None)

    @property
    def maker(self) -> Callable[..., Any] | None:
        """The class of the user's, once it is loaded or given from Python."""
        return self._maker

    @property
    @abstractmethod
    def family(self) -> PlantKind | type[Law]:
        """Keys, labels and defaults of its kind."""

    @property
    def of_the_user(self) -> bool:
        """Whether a class of the user's flies."""
        return "module" in self.family.keys

    def made_by(self, maker: Callable[..., Any]) -> Self:
        """The table with the class of the user's."""
        table = self.model_copy()
        table._maker = maker
        return table


def _check_keys(table: q.Table, kind: str, kinds: Mapping[str, PlantKind | type[Law]]) -> None:
    """Refuse keys of other kinds, and that a key is missing that a kind cannot do without."""
    for key in sorted(table.model_fields_set - kinds[kind].keys):
        if others := " or ".join(name for name, other in kinds.items() if key in other.keys):
            raise ValueError(f"`{key.removesuffix('_')}` must be given with kind {others} only")
    for key in kinds[kind].required:
        if getattr(table, key) is None:
            raise ValueError(f"`{key}` must be given with kind {kind}")
    if len({"module", "class_"} & table.model_fields_set) == 1:
        raise ValueError("`module` and `class` must be given together")


if TYPE_CHECKING:
    Kind: TypeAlias = str
    LawKind: TypeAlias = str
else:
    Kind, LawKind = Literal[tuple(PLANT_KINDS)], Literal[tuple(law_kinds())]


class PlantTable(OwnTable):
    """``[[plant]]``: what flies, with the keys of its kind."""

    # kinematic: the paper's law; point_mass: exact; point_mass_lag: exact, behind an inner loop;
    # jsbsim: an aircraft of six degrees of freedom; python: a class of your own
    kind: Kind
    # A name of `flighttune list`, or a folder with an aircraft.toml
    aircraft: q.PathName | None = None
    name: Name | None = None  # tells plants of one kind and aircraft apart
    # Of a weaker engine; the aircraft's own if left out
    throttle_max: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    throttle_max_from_s: q.Instant | None = None  # when that begins to hold; the start if left out
    airframe: OffNominal | None = None  # off-nominal properties
    roll_lag_rad_s: q.Bandwidth | None = None  # natural frequency
    roll_damping: q.Damping | None = None  # ratio of a lag of second order; first order if left out
    roll_delay_s: q.Delay | None = None  # none if left out
    n_z_lag_rad_s: q.Bandwidth | None = None  # natural frequency
    n_z_damping: q.Damping | None = None  # ratio of a lag of second order; first order if left out
    n_z_delay_s: q.Delay | None = None  # none if left out
    n_x_lag_rad_s: q.Bandwidth | None = None  # natural frequency, where the airspeed is followed
    n_x_damping: q.Damping | None = None  # ratio of a lag of second order; first order if left out
    n_x_delay_s: q.Delay | None = None  # none if left out
    # Aircraft or model file whose nominal condition gives the lags in place of these keys
    identified: q.PathName | None = None

    @model_validator(mode="after")
    def _keys_of_the_kind(self) -> Self:
        _check_keys(self, self.kind, PLANT_KINDS)
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
        """Description of its kind for the other rooms."""
        return PLANT_KINDS[self.kind]

    @cached_property
    def config(self) -> AircraftConfig:
        """The aircraft, read once."""
        assert self.aircraft is not None  # of a plant that is one
        return load_aircraft(self.aircraft)

    @cached_property
    def identified_model(self) -> IdentifiedAircraft:
        """The model identified of the aircraft, read once."""
        name = self.aircraft or self.identified
        assert name is not None  # of a plant that has one
        return load_identified(name)

    @property
    def label(self) -> str:
        """Name of the plant in tables, plots and files."""
        return plant_label(self.kind, self.aircraft, self.name)

    def lags(self) -> tuple[InnerLag, InnerLag] | None:
        """Lag of roll and of load factor; None for a plant without lags."""
        if self.identified is not None:  # of the nominal condition
            return self.identified_model.conditions[0].lags
        if self.roll_lag_rad_s is None:
            return None
        return self._lag("roll"), self._lag("n_z")

    def thrust_lag(self) -> InnerLag:
        """Lag of n_x of a plant with lags; an InputError says that it is missing."""
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


# Laws that a scenario can name without a table.
LAWS = plain_laws()


def flown_aircraft(plants: Iterable[PlantTable]) -> list[str]:
    """Names of the aircraft that plants are, or whose lags they have."""
    names = (
        Path(plant.aircraft).name if plant.aircraft else plant.identified_model.aircraft
        for plant in plants
        if plant.aircraft or plant.identified
    )
    return list(dict.fromkeys(names))


class LawTable(OwnTable):
    """``[[law]]``: what turns errors into commands, with the keys of its kind."""

    name: Name
    # paper; exact: the inversion of the point mass; autopilot: the guidance of PX4 or ArduPilot,
    # with parameters of their names; python: a class of your own
    kind: LawKind
    priority: Priority | None = None  # which channel gives way at the limits, of the exact law
    # Least share of lift that is kept, of the exact law
    lift_floor: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    # Rate at which errors are brought back without overshoot, of the exact law
    braking: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    # Whether a law of your own flies every gain set; once, with the first, if left out
    takes_gains: bool | None = None

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

    @cached_property
    def law(self) -> Law:
        """The law, with defaults where the table does not say."""
        options = {key: getattr(self, key) for key in self.family.keys}
        return made_law(self.kind, self.name, **options, maker=self.maker)


@cache
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


class SensorsTable(q.Table):
    """``[sensors]``: errors of course, flight-path angle and airspeed, measured minus true."""

    chi_bias_deg: q.Angle = 0.0
    chi_noise_sd_deg: q.AngularSpread = 0.0  # standard deviation, drawn from the seed
    gamma_bias_deg: q.Angle = 0.0
    gamma_noise_sd_deg: q.AngularSpread = 0.0  # standard deviation, drawn from the seed
    V_a_bias_mps: q.Wind = 0.0
    V_a_noise_sd_mps: q.WindSpeed = 0.0  # standard deviation, drawn from the seed
    noise_time_constant_s: q.TimeConstant | None = None  # of all three; white noise if left out

    def sensors(self, seed: int) -> Sensors:
        """The errors in rad and m/s, their noise drawn from the scenario's `seed`."""
        bias = self.chi_bias_deg * DEG, self.gamma_bias_deg * DEG, self.V_a_bias_mps
        sd = self.chi_noise_sd_deg * DEG, self.gamma_noise_sd_deg * DEG, self.V_a_noise_sd_mps
        time_constant = self.noise_time_constant_s or 0.0
        return Sensors(bias=bias, noise_sd=sd, time_constant=time_constant, seed=seed)


# Curve of Fig. 7 of MIL-F-8785C, and wind 20 ft above ground in m/s (15, 30, 45 kn).
INTENSITIES = {"light": (3, 7.7), "moderate": (4, 15.4), "severe": (6, 23.1)}


class WindLevelTable(q.Table):
    """``[[wind.level]]``: the wind at one height above sea level."""

    h_m: q.Height  # above sea level, rising from level to level; the wind is linear between them
    speed_mps: q.WindSpeed
    from_deg: q.Course  # where it comes from, clockwise from north
    down_mps: q.Wind = 0.0


class WindTable(q.Table):
    """``[wind]``: steady wind, the same at all heights or given at levels."""

    speed_mps: q.WindSpeed | None = None
    from_deg: q.Course | None = None  # where it comes from, clockwise from north
    down_mps: q.Wind = 0.0
    level: Annotated[list[WindLevelTable], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _one_or_levels(self) -> "WindTable":
        if self.level is None:
            if self.speed_mps is None or self.from_deg is None:
                raise ValueError("`speed_mps` and `from_deg` must be given, or levels")
            return self
        self.must_lack("where there are levels", "down_mps", "from_deg", "speed_mps")
        heights = [level.h_m for level in self.level]
        if any(a >= b for a, b in pairwise(heights)):
            raise ValueError(f"`level` must rise in h_m, got {heights}")
        return self

    def profile(self) -> WindProfile:
        """The wind over height in m/s, north, east and down."""
        if self.level is None:
            wind = _blowing(self.speed_mps or 0.0, self.from_deg or 0.0, self.down_mps)
            return WindProfile(((0.0, wind),))
        winds = ((x.h_m, _blowing(x.speed_mps, x.from_deg, x.down_mps)) for x in self.level)
        return WindProfile(tuple(winds))


class GustTable(q.Table):
    """``[gust]``: one 1-cosine gust, its length flown through at the airspeed of the start."""

    axis: Literal["ahead", "right", "down"]  # body axis when it begins
    peak_mps: q.Wind
    start_s: q.Instant
    length_m: q.Length  # of each flank, flown through at the airspeed of the start
    hold_s: q.Instant = 0.0

    def gust(self, V_a: float) -> Gust:
        """The gust in seconds at the airspeed `V_a` (m/s)."""
        return Gust(
            axis=self.axis,
            peak=self.peak_mps,
            start=self.start_s,
            rise=self.length_m / V_a,
            hold=self.hold_s,
        )


class TurbulenceTable(q.Table):
    """``[turbulence]``: Dryden turbulence by a word, or by the two numbers behind it."""

    intensity: Literal["light", "moderate", "severe"] | None = None
    # Curve of MIL-F-8785C, in place of an intensity
    severity: Annotated[int, Field(ge=1, le=7)] | None = None
    wind_20ft_mps: q.WindSpeed | None = None  # wind 20 ft above the ground, beside the severity
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
        severity, wind = INTENSITIES[self.intensity or "light"]
        if self.severity is not None and self.wind_20ft_mps is not None:
            severity, wind = self.severity, self.wind_20ft_mps
        return Turbulence(severity=severity, wind_20ft=wind, model=self.model)


class DisturbanceTable(q.Table):
    """``[disturbance]``: the paper's sinusoid on the rates of the kinematic law."""

    chi_amplitude: q.OscillationRate = 0.0  # rad/s, as that of gamma
    chi_omega_rad_s: q.Oscillation = 0.0
    gamma_amplitude: q.OscillationRate = 0.0
    gamma_omega_rad_s: q.Oscillation = 0.0
    # square: switches between the amplitudes where the sinusoid changes its sign
    wave: Literal["square"] | None = None
    chi_phase_deg: q.Angle | None = None
    gamma_phase_deg: q.Angle | None = None
    as_wind: bool = False  # true: JSBSim plants fly in the oscillating wind that is equivalent
    # air: chi and gamma of JSBSim plants are those of the path through the air
    path: Literal["ground", "air"] = "ground"
    # Rising times at which a constant amplitude changes its sign
    chi_switch_s: list[q.Instant] | None = None
    # Rising times at which a constant amplitude changes its sign
    gamma_switch_s: list[q.Instant] | None = None

    @model_validator(mode="after")
    def _switches_alone(self) -> "DisturbanceTable":
        for channel in ("chi", "gamma"):
            name = f"{channel}_switch_s"
            if (times := getattr(self, name)) is None:
                continue
            keys = "wave", "as_wind", f"{channel}_omega_rad_s", f"{channel}_phase_deg"
            self.must_lack(f"with {name}: the amplitude is constant", *keys)
            for before, after in pairwise([0.0, *times]):
                if not after > before:
                    raise ValueError(
                        f"`{name}` must be positive and rise, got {after:g} s after {before:g} s"
                    )
        return self

    @model_validator(mode="after")
    def _wind_swings(self) -> "DisturbanceTable":
        for channel in ("chi", "gamma") if self.as_wind else ():
            still = not getattr(self, f"{channel}_omega_rad_s")
            if still and getattr(self, f"{channel}_amplitude"):
                raise ValueError(
                    f"`{channel}_omega_rad_s` must be positive with as_wind: a constant rate takes "
                    "a wind that grows without end"
                )
        if self.as_wind:
            phases = "chi_phase_deg", "gamma_phase_deg"
            self.must_lack("with as_wind: the wind is that of a sine", "wave", *phases)
        if self.path == "air" and not self.as_wind:
            raise ValueError('`path` must be "ground" without as_wind, got "air"')
        return self

    def sinusoid(self) -> disturbance.Sinusoid:
        """The disturbance as a function of time."""
        return disturbance.Sinusoid.of_table(self.model_dump())

    def last_switches(self) -> list[tuple[str, float]]:
        """Key and last time (s) of each list of switching times."""
        times = {key: getattr(self, key) for key in ("chi_switch_s", "gamma_switch_s")}
        return [(f"[disturbance] `{key}`", each[-1]) for key, each in times.items() if each]


def _blowing(speed: float, from_deg: float, down: float) -> NED:
    """Velocity of air that comes from `from_deg`, clockwise from north."""
    return -speed * math.cos(from_deg * DEG), -speed * math.sin(from_deg * DEG), down


# Gains tuned on the model that ``[tuning]`` names.
TUNED = "tuned"

# Gains tuned on the identified model, whichever ``[tuning]`` names.
TUNED_IDENTIFIED = "tuned_identified"

# Gains of the exact law on the identified model: roll and load factor fed back, least errors in
# turbulence.
TUNED_FED_BACK = "tuned_fed_back"

# Those above, the best first.
TUNED_FOR_AIRCRAFT = TUNED_FED_BACK, TUNED_IDENTIFIED


def default_gains(names: Sequence[str]) -> str:
    """The gain set flown where none is asked for: one tuned for the aircraft, or the first."""
    sets = {name.rpartition(":")[2]: name for name in reversed(names)}
    return next((sets[name] for name in TUNED_FOR_AIRCRAFT if name in sets), names[0])


TuningModel: TypeAlias = Literal["kinematic", "identified"]


Weights: TypeAlias = Annotated[list[q.PositiveGain], Field(min_length=2, max_length=2)]


# Keys of the kinematic model.
KINEMATIC_ALONE = "I_star", "lag_rad_s", "sample_delay", "state_scaling", "structure"

# Aims of gains behind the identified inner loop, under a bound on the sensitivity
SHAPED = "decay", "E_K", "rms"


class TuningTable(q.Table):
    """``[tuning]``: what the gains named ``tuned`` are best at, within which bounds."""

    # Bound of I_K, s^2, on the kinematic model; may be infinite: no bound
    I_star: Annotated[float, Field(gt=0.0)] = 5.0
    # Bound of E_K, s^2, the largest error of a disturbance; none if left out
    E_star: Annotated[float, Field(gt=0.0)] | None = None
    # With identified behind the inner loop; tuned_identified is always tuned on that
    model: TuningModel = "kinematic"
    # An aircraft, or a file of `identify`; the aircraft of the first jsbsim plant if left out
    identified: q.PathName | None = None
    # true: the worst case over all conditions of that file, in place of the nearest
    robust: bool = False
    # Of phi and n_z, first order, before the kinematic law; none if left out
    lag_rad_s: Annotated[list[q.Bandwidth], Field(min_length=2, max_length=2)] | None = None
    sample_delay: bool = False  # true: half a sample of delay on the kinematic model
    # Smallest and largest lag of the inner loop, s: the slowest decay behind lags between them is
    # made fastest in place of R_K, as by `tune --lag`; not for tuned_identified. None if left out
    lag_s: Annotated[list[q.TimeConstant], Field(min_length=2, max_length=2)] | None = None
    input_limits: bool = False  # true: the first command stays inside the limits
    structure: Literal["full", "decoupled"] = "full"
    gain_max: q.PositiveGain | None = None  # largest entry; 1000 if left out
    roll_rate: bool = False  # true: what the rate limit of roll can follow, on the identified model
    # true: what the rate limit of the load factor can follow, on the identified model
    lift_rate: bool = False
    # One number a state (x', e), by which R_K and I_K divide it; ones if left out
    state_scaling: list[q.Scale] | None = None
    # Largest R_K, least quadratic cost of the first error, fastest decay, least E_K, or least rms
    # of the errors in the turbulence; the last three on the identified model
    objective: Literal["R_K", "cost", "decay", "E_K", "rms"] = "R_K"
    feedback: bool = False  # true: gains on measured roll and load factor too, with decay and rms
    # Of each channel, with decay, E_K and rms; 1.4 if left out, at most 1.66
    sensitivity_max: Annotated[float, Field(gt=1.0)] | None = None
    error_weights: Weights | None = None  # of chi and gamma, with cost; ones if left out
    command_weights: Weights | None = None  # of phi and n_z, with cost; 0.1 each if left out
    R_min: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.0  # least R_K, 1/s, with cost
    starts: Annotated[int, Field(ge=1, le=1000)] = 12

    @cached_property
    def identified_model(self) -> IdentifiedAircraft:
        """The model that `identified` names, read once."""
        assert self.identified is not None  # else it is that of an aircraft
        return load_identified(self.identified)

    @property
    def weights(self) -> tuple[FloatArray, FloatArray] | None:
        """Weights of errors and commands; None where R_K is maximised."""
        if self.objective != "cost":
            return None
        errors, commands = self.error_weights or [1.0, 1.0], self.command_weights or [0.1, 0.1]
        return np.array(errors), np.array(commands)

    @model_validator(mode="before")
    @classmethod
    def _model_of_objective(cls, values: Any) -> Any:
        shaped = isinstance(values, Mapping) and values.get("objective") in SHAPED
        return {"model": "identified", **values} if shaped else values

    @model_validator(mode="after")
    def _keys_of_model_and_objective(self) -> "TuningTable":
        shaped = self.objective in SHAPED
        if self.objective not in ("decay", "rms"):
            self.must_lack('without objective = "decay" or "rms"', "feedback")
        if shaped and self.model != "identified":
            raise ValueError(
                f'`model` must be "identified" or absent with objective = "{self.objective}", got '
                f'"{self.model}"'
            )
        if not shaped:
            self.must_lack('without objective = "decay", "E_K" or "rms"', "sensitivity_max")
        if self.model == "identified":
            keys = KINEMATIC_ALONE if shaped else (*KINEMATIC_ALONE, "objective")
            self.must_lack("with model identified", *keys)
        if self.objective != "cost":
            cost_keys = "error_weights", "command_weights", "R_min"
            self.must_lack('without objective = "cost"', *cost_keys)
        else:
            self.must_lack('with objective = "cost"', "lag_s")
        if self.lag_s is not None:
            self.must_lack("with `lag_s`", "lag_rad_s")
            if self.lag_s[0] > self.lag_s[1]:
                raise ValueError(f"`lag_s` must have its low end first, got {self.lag_s}")
        return self


def _square(rows: list[list[float]]) -> list[list[float]]:
    if [len(row) for row in rows] not in ([2, 2], [3, 3, 3]):
        raise ValueError(
            "must have 2 rows (phi, n_z) of 2 numbers (chi, gamma), or 3 of 3 with n_x and V"
        )
    return rows


Feedback: TypeAlias = Annotated[
    list[Annotated[float, Field(ge=0.0, lt=1.0)]], Field(min_length=2, max_length=2)
]

GainMatrix: TypeAlias = Annotated[list[list[q.Gain]], AfterValidator(_square)]


def on_aircraft(names: Iterable[str]) -> str:
    """Aircraft in words."""
    return listed([f"the {name}" for name in names]) or "the law alone"


class TunedFor(q.Table):
    """``[gains.tuned_for]``: what gains were tuned for."""

    aircraft: list[q.PathName]  # none: the law alone
    V_a_mps: list[q.Airspeed]  # none: any airspeed
    # Sentences on what their model assumes; none if left out
    assumed: list[str] | None = None

    @property
    def words(self) -> str:
        """``the c172p at 50 m/s``."""
        ends = dict.fromkeys(f"{end(self.V_a_mps):.6g}" for end in (min, max) if self.V_a_mps)
        return on_aircraft(self.aircraft) + f" at {' to '.join(ends)} m/s" * bool(ends)

    def unlike(self, aircraft: Iterable[str], airspeeds: Sequence[float]) -> bool:
        """Whether a flight has another of the aircraft, or an airspeed beyond these."""
        low, high = min(self.V_a_mps, default=0.0), max(self.V_a_mps, default=math.inf)
        other = self.aircraft and {*aircraft} - {*self.aircraft}
        return bool(other) or min(airspeeds) < low or max(airspeeds) > high


class GainsTable(q.Table):
    """``[[gains]]`` as numbers: rows phi, n_z (or their rates), columns chi, gamma."""

    name: Name
    K_P: GainMatrix
    K_I: GainMatrix
    # paper, or exact, whose rows are rates in 1/s and 1/s^2; exact if left out where no other
    # flies. Other laws get them mapped
    law: Literal["paper", "exact"] | None = None
    feedback: Feedback | None = None  # gains of the exact law on measured roll and load factor
    tuned_for: TunedFor | None = None  # as `tune` and `meet` write it

    def gains(self, law: str = DEFAULT) -> PIGains:
        """The gains as a value; `law` is whose they are where the table does not say."""
        return PIGains.from_lists(self.K_P, self.K_I, self.law or law, self.feedback)


Subject: TypeAlias = Literal["chi", "gamma", "V", "flight", "loop", "cross_track", "height_err"]
# Rows of time (s) and bound, of ``within``.
Row: TypeAlias = Annotated[list[q.NotNegative], Field(min_length=2, max_length=2)]
Within: TypeAlias = Annotated[list[Row], Field(min_length=1, max_length=20)]
Bound: TypeAlias = Annotated[
    Annotated[q.Finite, Tag("number")] | Annotated[Within, Tag("rows")],
    Discriminator(lambda value: "rows" if isinstance(value, list) else "number"),
]
Bounds: TypeAlias = dict[Subject, dict[str, Bound]]

CHANNEL_MEASURES = (*metrics.METRICS, "peak_rad")
MEASURES_OF = {
    "flight": (*metrics.FLIGHT_METRICS,),
    "loop": (*metrics.LOOP_METRICS,),
    metrics.AIRSPEED: (*metrics.AIRSPEED_METRICS,),
    **dict.fromkeys(metrics.OFF_ROUTE, ()),
}


class ExpectTable(q.Table):
    """Requirements for the runs of one plant, of one gain set, of both, or for all runs.

    Bounds are grouped by ``chi``, ``gamma`` (measures of the channel, and ``peak_rad``, the largest
    error), ``V`` (the same of an airspeed that is followed, in m/s, and its lowest value
    ``min_mps``), ``flight`` and ``loop`` (indicators and margins on the model of ``[tuning]``); a
    measure in rad may be given in deg under that ending, one in rad/s under ``_dps``. ``band_deg``
    beside ``settling_s`` is the error within which a response counts as settled, in place of 5 % of
    the commanded change. ``at_most.chi.within = [[0, 90], [4, 6], [6, 1]]`` is an envelope of the
    error over time: 90 deg, 6 deg from 4 s and 1 deg from 6 s after the end of a change (``gamma``
    likewise, ``V`` in m/s, and on a route ``cross_track`` and ``height_err`` in m, from the start);
    the largest ratio of error to envelope must be at most 1. Bounds include that a flight follows
    its reference to the end.
    """

    plant: Annotated[str, Field(min_length=1)] | None = None  # a label, or a kind for all of it
    gains: Annotated[str, Field(min_length=1)] | None = None  # all if left out
    status: run.RunStatus | None = None  # completed if left out
    at_most: Bounds = Field(default_factory=dict)  # bounds by channel, flight or loop, and measure
    at_least: Bounds = Field(default_factory=dict)  # likewise

    @model_validator(mode="after")
    def _measures_exist(self) -> "ExpectTable":
        if not (self.status or self.at_most or self.at_least):
            raise ValueError("`status`, `at_most` or `at_least` must be given")
        for sense, bounds in (("at_most", self.at_most), ("at_least", self.at_least)):
            for subject, limits in bounds.items():
                measures = MEASURES_OF.get(subject, CHANNEL_MEASURES)
                for name, bound in limits.items():
                    if name == "within":
                        _check_envelope(subject, sense, bound)
                    elif isinstance(bound, list):
                        raise ValueError(f"`{subject}.{name}` must be a number, got {bound}")
                    elif name == "band_deg":
                        if "settling_s" in limits and subject in metrics.CHANNELS and bound > 0.0:
                            continue
                        raise ValueError(
                            f"`{subject}.band_deg` must be positive and beside `settling_s` of a "
                            f"channel, got {bound:g}"
                        )
                    elif in_rad(name) not in measures:
                        raise ValueError(
                            f"`{subject}.{name}` must be one of {', '.join((*measures, 'within'))} "
                            "(or _deg in place of _rad)"
                        )
                    elif sense == "at_most" and bound < 0.0 and in_rad(name) not in metrics.SIGNED:
                        raise ValueError(f"`{subject}.{name}` must be at least 0, got {bound:g}")
        return self

    def meant(self, plant: str, gains: str) -> bool:
        """Whether the requirements apply to a run of this plant and these gains."""
        return goes_by(plant, self.plant) and self.gains in (None, gains)


def _check_envelope(subject: str, sense: str, rows: Any) -> None:
    if sense == "at_least" or subject not in metrics.ENVELOPES:
        raise ValueError(f"`within` must be under at_most.{' or '.join(metrics.ENVELOPES)}")
    times, bounds = zip(*rows, strict=True) if isinstance(rows, list) else ((), (0.0,))
    if [*times] != [0.0, *sorted({*times} - {0.0})] or min(bounds) <= 0.0:
        raise ValueError(
            f"`{subject}.within` must be rows of time [s] and bound, times rising from 0 and "
            f"bounds positive, got {abridged(rows)}"
        )


def in_rad(measure: str) -> str:
    """Name of a measure with ``_deg`` replaced by ``_rad``, and ``_dps`` by ``_rad_s``."""
    for ending, si in (("_deg", "_rad"), ("_dps", "_rad_s")):
        if measure.endswith(ending):
            return measure.removesuffix(ending) + si
    return measure
