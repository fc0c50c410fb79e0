"""Protocol of a plant: start from a flight condition, show signals, fly on under a command."""

from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

from flighttune.control.controller import FlightCondition
from flighttune.control.limits import Limits

StopStatus: TypeAlias = Literal[
    "diverged", "ground_contact", "left_envelope", "interrupted", "law_failed", "plant_failed"
]

COMMON_SIGNALS = ("chi", "gamma", "phi", "n_z", "V_a", "north", "east", "down")
"""Signals every plant shows first, in this order: SI, rad, position in local NED from the start."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Why a flight ended before its time.

    Attributes
    ----------
    status : str
        Such as ``diverged``, ``ground_contact`` or ``left_envelope``.
    reason : str
        A sentence with time and numbers.
    """

    status: StopStatus
    reason: str


class Plant(Protocol):
    """One aircraft that flies under roll and load-factor commands.

    A member of the family is used once: ``start``, then ``observe`` and ``advance`` in turn.

    Attributes
    ----------
    kind : str
        Name of the family member, as scenarios write it.
    signals : tuple of str
        Names of what ``observe`` returns; begins with `COMMON_SIGNALS`. A plant that shows ``h``
        and ``wind_north``, ``wind_east``, ``wind_down`` gives them to the controller.
    limits : Limits
        Limits of the plant itself on its commands (phi, n_z). Anti-windup works only in a
        controller that knows them.
    """

    @property
    def kind(self) -> str:
        """Name of the family member, as scenarios write it."""
        ...

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of what ``observe`` returns; begins with `COMMON_SIGNALS`."""
        ...

    @property
    def limits(self) -> Limits:
        """Limits of the plant itself on its commands."""
        ...

    def start(self, condition: FlightCondition, /) -> None:
        """Put the aircraft into `condition` at t = 0.

        Raises
        ------
        TrimError
            If there is no steady flight at `condition`.
        """
        ...

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians."""
        ...

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float, /) -> Stop | None:
        """Fly `duration` seconds with the command held; return why the flight ended, if it did.

        Parameters
        ----------
        phi_cmd : float, rad
            Roll command, right wing down positive.
        n_z_cmd : float, 1
            Load-factor command, lift over weight.
        duration : float, s
            Time to fly: the sample time of the controller.
        """
        ...


class WrappedPlant:
    """A plant flown as it is, for a subclass that shows further or other signals of it.

    `plant` was not flown before. Kind and limits are those of the plant; `signals` has at its end
    the `further` ones that the subclass shows.
    """

    def __init__(self, plant: Plant, further: tuple[str, ...]) -> None:
        self.kind, self.signals = plant.kind, plant.signals + further
        # Bound once: it is called at every sample.
        self._plant, self._observe = plant, plant.observe

    @property
    def limits(self) -> Limits:
        """Limits of the plant itself on its commands."""
        return self._plant.limits

    def start(self, condition: FlightCondition) -> None:
        """Put the aircraft into `condition` at t = 0, as the plant does."""
        self._plant.start(condition)

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float) -> Stop | None:
        """Fly `duration` seconds with the command held, as the plant does."""
        return self._plant.advance(phi_cmd, n_z_cmd, duration)
