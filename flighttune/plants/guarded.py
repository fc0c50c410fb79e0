"""A plant of the user's in the loop: where it fails the flight ends, in one line."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from flighttune.control.controller import FlightCondition
from flighttune.control.guarded import FAILURES, failure
from flighttune.errors import FlightTuneError, InputError, ScenarioError, TrimError
from flighttune.plants.base import COMMON_SIGNALS, Plant, Stop


class GuardedPlant:
    """A plant that ends the flight where it raises or shows a value that is not finite.

    Raises InputError if the signals do not begin with `COMMON_SIGNALS`.
    """

    def __init__(self, plant: Plant, name: str) -> None:
        self._plant, self._name = plant, name
        self.kind, self.signals, self.limits = plant.kind, tuple(plant.signals), plant.limits
        if self.signals[: len(COMMON_SIGNALS)] != COMMON_SIGNALS:
            raise InputError(f"`signals` must begin with {COMMON_SIGNALS}, got {self.signals}.")
        self._t, self._stop, self._last = 0.0, None, ()

    @classmethod
    def made(
        cls, label: str, maker: Callable[..., Plant] | None, parameters: Mapping[str, Any]
    ) -> "GuardedPlant":
        """A fresh plant of a class of the user's.

        Raises ScenarioError if it cannot be made.
        """
        name = f"plant {label}"
        if maker is None:
            raise InputError(f"`{name}` must be loaded before it is flown.")
        try:
            return cls(maker(**parameters), name)
        except FAILURES as error:
            raise ScenarioError(failure(name, error, 0.0)) from error

    def start(self, condition: FlightCondition) -> None:
        """Start the plant.

        Raises TrimError if it cannot, for whatever reason.
        """
        self._t, self._stop, self._last = 0.0, None, ()
        try:
            self._plant.start(condition)
        except FlightTuneError:
            raise
        except FAILURES as error:
            raise TrimError(failure(self._name, error, 0.0)) from error

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals`; the last ones where there are none, and end the flight.

        Raises TrimError if there are none at the start.
        """
        try:
            seen = tuple(map(float, self._plant.observe()))
            if len(seen) != len(self.signals) or not all(map(math.isfinite, seen)):
                raise ValueError(f"`observe` must return {len(self.signals)} finite numbers")
        except FAILURES as error:
            reason = failure(self._name, error, self._t)
            if not self._last:
                raise TrimError(reason) from error
            self._stop = Stop("plant_failed", reason)
            return self._last
        self._last = seen
        return seen

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float) -> Stop | None:
        """Fly on; return why the flight ended, if it did."""
        if self._stop is not None:
            return self._stop
        try:
            stop = self._plant.advance(phi_cmd, n_z_cmd, duration)
        except FAILURES as error:
            return Stop("plant_failed", failure(self._name, error, self._t))
        self._t += duration
        return stop
