"""Weather on a JSBSim aircraft: a start in wind from a trim in still air, and the air after it."""

import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import TypeAlias

from flighttune.base.units import FT
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.weather import NED, Gust, Turbulence, Weather

_AXES = {"ahead": "X", "right": "Y", "down": "Z"}

# Integration steps between two instants at which a changing wind is computed.
_REFRESH = 4

_NED = ("north", "east", "down")

# Flies one integration step; false where JSBSim ends the run.
Run: TypeAlias = Callable[[], bool]


def wind_writers(fdm: Fdm) -> list[Callable[[float], bool]]:
    """Return functions that set the wind of `fdm` (ft/s), north, east and down, from now on."""
    # JSBSim resets its ``wind-*`` properties in every evaluation, and adds gust and turbulence to
    # ``gust-*``.
    return [fdm.writer(f"atmosphere/gust-{axis}-fps") for axis in _NED]


def carry_along(fdm: Fdm, wind: NED) -> None:
    """Put `fdm`, in steady flight in still air, into the same flight in a steady `wind` (m/s)."""
    # Velocity through the air, attitude, rates and accelerations stay; the velocity over ground is
    # that of the still air plus `wind` (m/s).
    ground = [fdm.reader(f"velocities/v-{axis}-fps")() for axis in _NED]
    for axis, write, still, moved in zip("ned", wind_writers(fdm), ground, wind, strict=True):
        write(moved / FT)
        fdm.writer(f"ic/v{axis}-fps")(still + moved / FT)
    fdm.evaluate()


def weather_step(fdm: Fdm, weather: Weather, rate: float) -> Run:
    """Let `weather` begin, and return a function that flies one step in it, at `rate` (1/s)."""
    if weather.turbulence is not None:
        _begin_turbulence(fdm, weather.turbulence)
    step = fdm.run
    if weather.gust is not None:
        step = _gusty(fdm, weather.gust, rate, step)
    if weather.changes:
        step = _changing(fdm, weather, rate, step)
    return step


def _begin_turbulence(fdm: Fdm, turbulence: Turbulence) -> None:
    # JSBSim turns the axes of its turbulence with the heading of the wind in `wind-*`. Evaluations
    # leave 1e-13 m/s of rounding there, which would turn them anywhere; without it they are north
    # and east. The heading comes last: JSBSim keeps the one it computed before.
    for axis in _NED:
        fdm.writer(f"atmosphere/wind-{axis}-fps")(0.0)
    fdm.writer("atmosphere/psiw-rad")(0.0)
    fdm.writer("atmosphere/turb-type")({"milspec": 3.0, "tustin": 4.0}[turbulence.model])
    milspec = "atmosphere/turbulence/milspec"
    fdm.writer(f"{milspec}/windspeed_at_20ft_AGL-fps")(turbulence.wind_20ft / FT)
    fdm.writer(f"{milspec}/severity")(float(turbulence.severity))


def _gusty(fdm: Fdm, gust: Gust, rate: float, run: Run) -> Run:
    settings = {
        "startup-duration-sec": gust.rise,
        "steady-duration-sec": gust.hold,
        "end-duration-sec": gust.rise,
        "magnitude-ft_sec": abs(gust.peak) / FT,
        "frame": 1.0,  # that of the body
        f"{_AXES[gust.axis]}-velocity-ft_sec": math.copysign(1.0, gust.peak),
    }
    for name, value in settings.items():
        fdm.writer(f"atmosphere/cosine-gust/{name}")(value)
    begin = fdm.writer("atmosphere/cosine-gust/start")
    first = max(1, round(gust.start * rate))

    def steps() -> Iterator[bool]:
        for k in count(1):
            if k == first:
                begin(1.0)
            yield run()

    return steps().__next__


def _changing(fdm: Fdm, weather: Weather, rate: float, run: Run) -> Run:
    """Return a step that writes the wind of its end before it is flown."""
    (write_north, write_east, write_down), h_ft = wind_writers(fdm), fdm.reader("position/h-sl-ft")
    h_start = h_ft()

    def wind_at(t: float, h: float) -> NED:
        north, east, down = weather.deterministic(t, h * FT + fdm.ground)
        return north / FT, east / FT, down / FT

    # The wind is exact at instants `_REFRESH` steps apart, and linear in between.
    def steps() -> Iterator[bool]:
        h_last, (north, east, down) = h_start, wind_at(0.0, h_start)  # ft/s, as JSBSim has it
        for k in count(_REFRESH, _REFRESH):
            h = h_ft()
            # The wind is needed at the end of the next steps, whose height is extrapolated.
            n, e, d = wind_at(k / rate, 2.0 * h - h_last)
            d_north, d_east = (n - north) / _REFRESH, (e - east) / _REFRESH
            d_down, h_last = (d - down) / _REFRESH, h
            for _ in range(_REFRESH):
                # Written out: a loop over three components takes as long as all the rest.
                north, east, down = north + d_north, east + d_east, down + d_down
                write_north(north)
                write_east(east)
                write_down(down)
                yield run()

    return steps().__next__
