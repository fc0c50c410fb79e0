"""The path through the air in place of the path over ground, as air data would tell it."""

import math

from flighttune.plants.base import COMMON_SIGNALS, FlightCondition, Plant, WrappedPlant

OVER_GROUND = ("chi_ground", "gamma_ground")
"""Names of course and flight-path angle over ground where `chi` and `gamma` are through the air."""

_CHI, _GAMMA = COMMON_SIGNALS.index("chi"), COMMON_SIGNALS.index("gamma")
_MOTION = ("V_g", "wind_north", "wind_east", "wind_down")


class AirPathPlant(WrappedPlant):
    """A plant whose `chi` and `gamma` are those of its velocity through the air.

    Its controller steers that path, and its errors are errors of it; position stays that over
    ground. ``docs/weather.md`` tells where this makes a wind the same as a rate of the path.

    `plant`: a plant that was not flown before and shows ground speed and wind. Kind and limits are
    those of the plant; `signals` has `OVER_GROUND` at its end.
    """

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant, OVER_GROUND)
        self._places = tuple(plant.signals.index(name) for name in _MOTION)
        self._chi = math.nan

    def start(self, condition: FlightCondition) -> None:
        """Put the aircraft into `condition` at t = 0, as the plant does."""
        super().start(condition)
        self._chi = condition.chi

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians; `chi` is continuous."""
        seen = self._observe()
        chi, gamma = seen[_CHI], seen[_GAMMA]
        V_g, w_north, w_east, w_down = (seen[place] for place in self._places)
        north, east = V_g * math.cos(chi) - w_north, V_g * math.sin(chi) - w_east
        up = V_g * math.tan(gamma) + w_down
        self._chi += math.remainder(math.atan2(east, north) - self._chi, math.tau)
        return (self._chi, math.atan2(up, math.hypot(north, east)), *seen[2:], chi, gamma)
