"""Wind over time and height, a gust, turbulence, an oscillating wind.

The tables of a scenario check the numbers of a `Weather`.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from operator import mul
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from flighttune.base.arrays import FloatArray, set_read_only
from flighttune.base.errors import InputError
from flighttune.base.gusts import BodyAxis, GustNumbers
from flighttune.base.units import FT
from flighttune.control.controller import FlightCondition

NED: TypeAlias = tuple[float, float, float]

CALM: NED = (0.0, 0.0, 0.0)

# Signals of the wind that a plant met, m/s.
WIND = ("wind_north", "wind_east", "wind_down")

# Places in a row of `WindNumbers`: height (m) or angular frequency (rad/s), and a wind (m/s).
BY, NORTH, EAST, DOWN = range(1 + len(WIND))

# Integration steps from one computation of a changing wind to the next: linear in between.
REFRESH = 4


# Time (s), wind there (m/s) and its rate (m/s^2), constant until the next piece.
WindPiece: TypeAlias = tuple[float, NED, NED]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindRecord:
    """Wind met on a flight: linear between its samples, constant before and after them.

    Positive components are air that moves north, east and down.
    """

    t: FloatArray  # shape (n,), s: times of the samples, rising
    wind: FloatArray  # shape (n, 3), m/s
    _times: list[float] = field(init=False, repr=False)
    _pieces: tuple[WindPiece, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        set_read_only(self, t=(len(self.t),), wind=(len(self.t), len(WIND)))
        if not (len(self.t) and (np.diff(self.t) > 0.0).all()):
            raise InputError("`t` of a wind record must rise from sample to sample.")
        times, rates = self.t.tolist(), np.zeros_like(self.wind)
        rates[:-1] = np.diff(self.wind, axis=0) / np.diff(self.t)[:, None]
        winds = self.wind.tolist()
        pieces = zip(times, map(tuple, winds), map(tuple, rates.tolist()), strict=True)
        object.__setattr__(self, "_times", times)
        object.__setattr__(self, "_pieces", ((times[0], tuple(winds[0]), CALM), *pieces))

    @classmethod
    def steady(cls, wind: NED = CALM) -> "WindRecord":
        """The same wind throughout, m/s."""
        return cls(t=np.zeros(1), wind=np.array([wind]))

    def piece(self, t: float) -> WindPiece:
        """The linear piece in force from time `t` (s) on."""
        return self._pieces[bisect_right(self._times, t)]

    def at(self, t: float) -> NED:
        """Wind at time `t` (s), m/s, north, east and down."""
        t_0, (n, e, d), (n_dot, e_dot, d_dot) = self.piece(t)
        dt = t - t_0
        return n + n_dot * dt, e + e_dot * dt, d + d_dot * dt

    def knots(self, start: float, end: float) -> list[float]:
        """Times of samples strictly between `start` and `end`, s."""
        times = self._times
        first, last = bisect_right(times, start), bisect_right(times, end)
        return [t for t in times[first:last] if t < end]


def course_of(velocity: NED) -> tuple[float, float]:
    """Course, clockwise from north, and flight-path angle (rad), climb positive, of a velocity."""
    north, east, down = velocity
    return math.atan2(east, north), math.atan2(-down, math.hypot(north, east))


def velocity_along(V: float, chi: float, gamma: float) -> NED:
    """Velocity (north, east, down, unit of `V`) of speed `V` along course and path angle (rad)."""
    level = V * math.cos(gamma)
    return level * math.cos(chi), level * math.sin(chi), -V * math.sin(gamma)


def through_air(condition: FlightCondition, wind: NED) -> FlightCondition:
    """The condition with course and path angle through the air, for those over ground."""
    V_a, chi, gamma = condition.V_a, condition.chi, condition.gamma
    if wind == CALM:
        return condition
    # Wind triangle: the velocity over ground is that through the air, of length `V_a`, plus `wind`.
    path = velocity_along(1.0, chi, gamma)
    along = sum(map(mul, wind, path))
    across = math.dist(wind, [along * part for part in path])
    V_g = along + math.sqrt(max(0.0, V_a**2 - across**2))
    if not (across < V_a and V_g > 0.0):
        raise InputError(
            f"must let an airspeed of {V_a:g} m/s follow a course of {math.degrees(chi):g} deg and "
            f"a path angle of {math.degrees(gamma):g} deg over ground, got {across:.3g} m/s across "
            f"that path and {along:.3g} m/s along it"
        )
    north, east, down = (V_g * part - moved for part, moved in zip(path, wind, strict=True))
    chi_air, gamma_air = course_of((north, east, down))
    chi_air = chi + math.remainder(chi_air - chi, math.tau)
    return replace(condition, chi=chi_air, gamma=gamma_air)


WindRows: TypeAlias = Sequence[Sequence[float]] | FloatArray


class WindNumbers(NamedTuple):
    """Wind over height and time."""

    levels: WindRows  # a wind by height, rising
    # Amplitude of the cosine and of the sine of an oscillation, each by its frequency; or nothing
    swing: WindRows = ()


def wind_at(numbers: WindNumbers, t: float, h: float) -> NED:
    """Wind at time `t` (s) and height `h` (m above sea level), m/s; Numba compiles it too."""
    levels, swing = numbers
    i, above = 0, len(levels)
    while i < above:
        middle = (i + above) // 2
        if h < levels[middle][BY]:
            above = middle
        else:
            i = middle + 1
    if i in (0, len(levels)):
        level = levels[max(i - 1, 0)]
        n, e, d = level[NORTH], level[EAST], level[DOWN]
    else:
        low, high = levels[i - 1], levels[i]
        # Written out as `np.interp` computes it, which takes four times as long for one height.
        width, up = high[BY] - low[BY], h - low[BY]
        n = (high[NORTH] - low[NORTH]) / width * up + low[NORTH]
        e = (high[EAST] - low[EAST]) / width * up + low[EAST]
        d = (high[DOWN] - low[DOWN]) / width * up + low[DOWN]
    if len(swing):
        a, b = swing[0], swing[1]
        c, s = math.cos(a[BY] * t), math.sin(b[BY] * t)
        n += a[NORTH] * c + b[NORTH] * s
        e += a[EAST] * c + b[EAST] * s
        d += a[DOWN] * c + b[DOWN] * s
    return n, e, d


TurbulenceModel: TypeAlias = Literal["tustin", "milspec"]


@dataclass(frozen=True, slots=True)
class WindProfile:
    """Steady wind that changes with height: linear between levels, constant beyond them."""

    # m above sea level and m/s: heights, rising, and the wind there: air that moves north, east and
    # down.
    levels: tuple[tuple[float, NED], ...] = ((0.0, CALM),)

    @property
    def varies(self) -> bool:
        """Whether the wind changes with height."""
        return len({wind for _, wind in self.levels}) > 1

    def at(self, h: float) -> NED:
        """Wind at height `h` (m above sea level), m/s, north, east and down."""
        return Weather(wind=self).deterministic(0.0, h)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gust:
    """A 1-cosine gust: up over `rise`, held, and down again.

    ``peak/2 (1 - cos(pi t/rise))`` on the way up: section 3.7.1.3 of MIL-F-8785C with the gust
    length flown through at constant airspeed.
    """

    # Body axis at the start of the gust along which the air moves; then fixed to the Earth
    axis: BodyAxis
    peak: float  # m/s: largest speed; negative for the opposite direction
    # `start`, `rise` and `hold` (s): when it begins; length of each flank; time at the peak
    start: float
    rise: float
    hold: float = 0.0

    def numbers(self, rate: float) -> GustNumbers:
        """Its numbers in flights with `rate` steps per second."""
        sign = math.copysign(1.0, self.peak)
        return GustNumbers(
            first=float(max(1, round(self.start * rate))),
            rise=self.rise,
            hold=self.hold,
            fall=self.rise,
            size=abs(self.peak) / FT,
            **{axis: sign if axis == self.axis else 0.0 for axis in get_args(BodyAxis)},
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Turbulence:
    """Dryden turbulence of MIL-F-8785C as JSBSim makes it."""

    severity: int  # curve of Fig. 7 of the standard, 1 to 7: strength from 2000 ft above ground on.
    wind_20ft: float  # m/s: wind 20 ft above ground: sets the strength below 1000 ft
    # Filters: the standard's, made discrete by Tustin's rule; or first-order ones
    model: TurbulenceModel = "tustin"


def turbulence_scales(h: float) -> tuple[float, float]:
    """Scales of the Dryden gusts to the side and down at a height of `h` (m) above ground, m."""
    # MIL-F-8785C, sections 3.7.2 and 3.7.3, as JSBSim has them: by height below 1000 ft, 1750 ft
    # from 2000 ft on, a straight line between.
    feet = max(h / FT, 10.0)
    if feet >= 1000.0:
        scale = min(1000.0 + 0.75 * (feet - 1000.0), 1750.0)
        return scale * FT, scale * FT
    return feet / (0.177 + 0.000823 * feet) ** 1.2 * FT, feet * FT


@dataclass(frozen=True, slots=True, kw_only=True)
class OscillatingWind:
    """Two oscillations of the air, ``a cos(omega_a t) + b sin(omega_b t)``."""

    # `cosine` and `sine` (m/s): amplitudes a and b: north, east and down
    cosine: NED
    # `cosine_omega` and `sine_omega` (rad/s): angular frequencies
    cosine_omega: float
    sine: NED
    sine_omega: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Weather:
    """The weather of a flight; its parts add up."""

    wind: WindProfile = WindProfile()  # steady wind over height
    gust: Gust | None = None  # one gust
    turbulence: Turbulence | None = None  # from the start of the flight on
    oscillation: OscillatingWind | None = None  # wind that swings with time

    def deterministic(self, t: float, h: float) -> NED:
        """Wind without gust and turbulence at time `t` (s) and height `h` (m), m/s in NED."""
        return wind_at(self.numbers, t, h)

    @property
    def numbers(self) -> WindNumbers:
        """The wind without gust and turbulence, for `wind_at`."""
        levels, o = tuple((h, *wind) for h, wind in self.wind.levels), self.oscillation
        if o is None:
            return WindNumbers(levels)
        return WindNumbers(levels, ((o.cosine_omega, *o.cosine), (o.sine_omega, *o.sine)))

    @property
    def changes(self) -> bool:
        """Whether the wind without gust and turbulence changes during a flight."""
        return self.wind.varies or self.oscillation is not None
