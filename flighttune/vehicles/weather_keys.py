"""``[wind]``, ``[gust]`` and ``[turbulence]`` of a scenario."""

import math
from itertools import pairwise
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator

from flighttune.base import quantities as q
from flighttune.base.gusts import BodyAxis
from flighttune.base.units import DEG
from flighttune.vehicles.plants.jsbsim.plant import LARGEST_SEED
from flighttune.vehicles.plants.weather import NED, Gust, Turbulence, TurbulenceModel, WindProfile

Seed: TypeAlias = Annotated[int, Field(ge=0, le=LARGEST_SEED)]


class WindLevelTable(q.Table):
    """``[[wind.level]]``: the wind at one height above sea level."""

    h_m: q.Height  # above sea level, rising; the wind is linear between levels
    speed_mps: q.WindSpeed
    from_deg: q.Course  # where it comes from, clockwise from north
    down_mps: q.Wind = 0.0


class WindTable(q.Table):
    """``[wind]``: steady wind, constant over height or given at levels."""

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
        """The wind over height, north, east and down, m/s."""
        if self.level is None:
            wind = _blowing(self.speed_mps or 0.0, self.from_deg or 0.0, self.down_mps)
            return WindProfile(((0.0, wind),))
        winds = ((x.h_m, _blowing(x.speed_mps, x.from_deg, x.down_mps)) for x in self.level)
        return WindProfile(tuple(winds))


def _blowing(speed: float, from_deg: float, down: float) -> NED:
    """Velocity of air that comes from `from_deg`, clockwise from north."""
    return -speed * math.cos(from_deg * DEG), -speed * math.sin(from_deg * DEG), down


class GustTable(q.Table):
    """``[gust]``: one 1-cosine gust, whose length is flown through at the initial airspeed."""

    axis: BodyAxis  # body axis at its beginning
    peak_mps: q.Wind
    start_s: q.Instant
    length_m: q.Length  # length of each flank, flown through at the initial airspeed
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


# Curve of Fig. 7 of MIL-F-8785C, and wind 20 ft above ground in m/s (15, 30, 45 kn).
INTENSITIES = {"light": (3, 7.7), "moderate": (4, 15.4), "severe": (6, 23.1)}


class TurbulenceTable(q.Table):
    """``[turbulence]``: Dryden turbulence by a word or by its two numbers."""

    intensity: Literal["light", "moderate", "severe"] | None = None
    # Curve of MIL-F-8785C, instead of an intensity
    severity: Annotated[int, Field(ge=1, le=7)] | None = None
    wind_20ft_mps: q.WindSpeed | None = None  # wind 20 ft above the ground, with the severity
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
