"""Weather on a JSBSim aircraft: a start in wind from a trim in still air, and the air after it."""

from collections.abc import Callable, Iterator
from itertools import count
from typing import TypeAlias

from flighttune.base.units import FT
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.weather import NED, REFRESH, Gust, Turbulence, Weather, wind_at

# JSBSim's names of `GustNumbers` after the first
_GUST = {
    "rise": "startup-duration-sec",
    "hold": "steady-duration-sec",
    "fall": "end-duration-sec",
    "size": "magnitude-ft_sec",
    "ahead": "X-velocity-ft_sec",
    "right": "Y-velocity-ft_sec",
    "down": "Z-velocity-ft_sec",
}

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
    numbers = gust.numbers(rate)._asdict()
    first = numbers.pop("first")
    settings = {_GUST[name]: value for name, value in numbers.items()}
    settings["frame"] = 1.0  # that of the body
    for name, value in settings.items():
        fdm.writer(f"atmosphere/cosine-gust/{name}")(value)
    begin = fdm.writer("atmosphere/cosine-gust/start")

    def steps() -> Iterator[bool]:
        for k in count(1):
            if k == first:
                begin(1.0)
            yield run()

    return steps().__next__


def _changing(fdm: Fdm, weather: Weather, rate: float, run: Run) -> Run:
    """Return a step that writes the wind of its end before it is flown."""
    (write_north, write_east, write_down), h_ft = wind_writers(fdm), fdm.reader("position/h-sl-ft")
    h_start, numbers = h_ft(), weather.numbers

    def blowing(t: float, h: float) -> NED:
        north, east, down = wind_at(numbers, t, h * FT + fdm.ground)
        return north / FT, east / FT, down / FT

    def steps() -> Iterator[bool]:
        h_last, (north, east, down) = h_start, blowing(0.0, h_start)  # ft/s, as JSBSim has it
        for k in count(REFRESH, REFRESH):
            h = h_ft()
            # The wind is needed at the end of the next steps, whose height is extrapolated.
            n, e, d = blowing(k / rate, 2.0 * h - h_last)
            d_north, d_east = (n - north) / REFRESH, (e - east) / REFRESH
            d_down, h_last = (d - down) / REFRESH, h
            for _ in range(REFRESH):
                # Written out: a loop over three components takes as long as all the rest.
                north, east, down = north + d_north, east + d_east, down + d_down
                write_north(north)
                write_east(east)
                write_down(down)
                yield run()

    return steps().__next__
