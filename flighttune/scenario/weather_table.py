"""``[wind]``, ``[gust]``, ``[turbulence]``, ``[disturbance]``: what pushes on a flight."""

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from flighttune.plants.weather import Gust, Turbulence, TurbulenceModel, WindProfile
from flighttune.plants.wind import NED
from flighttune.scenario.table import Finite, NotNegative, Positive, Table
from flighttune.simulate.disturbance import Sinusoid
from flighttune.units import DEG

INTENSITIES = {"light": (3, 7.7), "moderate": (4, 15.4), "severe": (6, 23.1)}
"""Curve of Fig. 7 of MIL-F-8785C, and wind 20 ft above ground in m/s (15, 30, 45 kn)."""


class WindLevelTable(Table):
    """``[[wind.level]]``: the wind at one height above sea level."""

    h_m: Finite
    speed_mps: NotNegative
    from_deg: Finite
    down_mps: Finite = 0.0


class WindTable(Table):
    """``[wind]``: steady wind, the same at all heights or given at levels."""

    speed_mps: NotNegative | None = None
    from_deg: Finite | None = None
    down_mps: Finite = 0.0
    level: Annotated[list[WindLevelTable], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _one_or_levels(self) -> "WindTable":
        fields = {name: field.default for name, field in type(self).model_fields.items()}
        given = {name for name, default in fields.items() if getattr(self, name) != default}
        given -= {"level"}
        if self.level is not None:
            if given:
                raise ValueError(f"`{min(given)}` of [wind] must be absent where there are levels")
            heights = [level.h_m for level in self.level]
            if any(a >= b for a, b in pairwise(heights)):
                raise ValueError(f"`level` must rise in h_m, got {heights}")
        elif self.speed_mps is None or self.from_deg is None:
            raise ValueError("`speed_mps` and `from_deg` of [wind] must be given, or levels")
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
    peak_mps: Finite
    start_s: NotNegative
    length_m: Positive
    hold_s: NotNegative = 0.0

    def check_start(self, duration_s: float) -> None:
        """Refuse a gust that would begin when a flight of `duration_s` is over.

        Raises
        ------
        ValueError
            If it does; the message names table and key.
        """
        if self.start_s >= duration_s:
            raise ValueError(
                "[gust] `start_s` must lie before the end of the flight "
                f"(`duration_s` of [flight], {duration_s:g} s), got {self.start_s:g} s"
            )

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
    wind_20ft_mps: NotNegative | None = None
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
    """``[disturbance]``: the paper's sinusoid on the kinematic law, amplitudes in rad/s."""

    chi_amplitude: Finite = 0.0
    chi_omega_rad_s: NotNegative = 0.0
    gamma_amplitude: Finite = 0.0
    gamma_omega_rad_s: NotNegative = 0.0
    as_wind: bool = False
    path: Literal["ground", "air"] = "ground"

    @model_validator(mode="after")
    def _wind_swings(self) -> "DisturbanceTable":
        for channel in ("chi", "gamma"):
            still = not getattr(self, f"{channel}_omega_rad_s")
            if self.as_wind and still and getattr(self, f"{channel}_amplitude"):
                raise ValueError(
                    f"`{channel}_omega_rad_s` must be positive with as_wind: a constant rate takes "
                    "a wind that grows without end"
                )
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
        )


def check_air(
    disturbance: DisturbanceTable | None,
    wind: WindTable | None,
    unsteady: GustTable | TurbulenceTable | None,
    *,
    aircraft: bool,
) -> None:
    """Refuse air that the plants of a scenario cannot fly in.

    Parameters
    ----------
    disturbance, wind, unsteady
        Tables of the scenario; `unsteady` is its gust or turbulence.
    aircraft : bool
        Whether one of its plants is a jsbsim one.

    Raises
    ------
    ValueError
        If a sinusoid of the kinematic law is to disturb an aircraft, nobody meets the wind that
        the others replay, or an aircraft is to be steered through the air in other wind as well.
    """
    if disturbance and aircraft and not disturbance.as_wind:
        raise ValueError(
            "`disturbance` must be absent where a plant is jsbsim, or have `as_wind`: the "
            "sinusoid is a term of the kinematic law"
        )
    if disturbance and disturbance.path == "air" and (wind or unsteady):
        raise ValueError(
            '`path` of [disturbance] must be "ground" where there is other wind, which plants that '
            "are no aircraft meet over ground"
        )
    if unsteady and not aircraft:
        name = "gust" if isinstance(unsteady, GustTable) else "turbulence"
        raise ValueError(
            f"`{name}` must be absent without a jsbsim plant: the others replay its wind"
        )
    if wind and wind.level and not aircraft:
        raise ValueError("`level` of [wind] must be absent without a jsbsim plant")


def _blowing(speed: float, from_deg: float, down: float) -> NED:
    """Velocity of air that comes from `from_deg`, clockwise from north."""
    return -speed * math.cos(from_deg * DEG), -speed * math.sin(from_deg * DEG), down
