"""Protocol of a plant, its kinds and labels, and plants around another plant."""

import math
from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

from flighttune.base.errors import FlightTuneError, InputError, ScenarioError, TrimError
from flighttune.control.controller import FAILURES, FlightCondition, failure
from flighttune.control.limits import Limits


def plant_label(kind: str, aircraft: str | None = None, name: str | None = None) -> str:
    """Label of a plant: ``kind``, ``kind:aircraft``, and ``:name`` behind it where it has one."""
    # A plant of the user's is called by its name alone.
    if kind == "python" and name:
        return name
    return ":".join(part for part in (kind, Path(aircraft).name if aircraft else "", name) if part)


def goes_by(label: str, plant: str | None) -> bool:
    """Whether ``plant`` of a ``[[expect]]`` (a label, a kind, or None for all) is about a label."""
    return plant in (None, label, label.partition(":")[0])


def aircraft_of(label: str, tables: Sequence[Mapping[str, Any]]) -> str | None:
    """The aircraft of a label in the ``[[plant]]`` tables of a scenario; None for another plant."""
    for table in tables:
        if plant_label(table.get("kind", ""), table.get("aircraft"), table.get("name")) == label:
            return table.get("aircraft")
    kind, _, aircraft = label.partition(":")
    return aircraft or None if kind == "jsbsim" else None


TurnLaw: TypeAlias = Literal["paper", "exact"]

StopStatus: TypeAlias = Literal[
    "diverged", "ground_contact", "left_envelope", "law_failed", "plant_failed", "not_arrived"
]

# Signals every plant shows first, in this order: SI, rad, position in local NED from the start.
COMMON_SIGNALS = ("chi", "gamma", "phi", "n_z", "V_a", "north", "east", "down")


def places(names: Sequence[str]) -> Any:
    """The place of each name, as its attribute; Numba compiles it as a constant."""
    return namedtuple("Places", names)(*range(len(names)))


@dataclass(frozen=True, slots=True)
class Stop:
    """Why a flight ended before its time.

    Attributes
    ----------
    status : str
        Such as ``diverged``, ``ground_contact`` or ``left_envelope``.
    reason : str
        A sentence with time and numbers.

    Examples
    --------
    >>> ft.loop.Stop("ground_contact", "t = 3.2 s: h = 0 m").status
    'ground_contact'
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
    follows_at_once : bool, optional
        True if roll and load factor are their commands, so that a law has nothing to feed back.

    Examples
    --------
    >>> plant = ft.loop.PointMassPlant()
    >>> plant.start(ft.loop.FlightCondition(V_a=25.0))
    >>> plant.signals[: len(ft.loop.COMMON_SIGNALS)] == ft.loop.COMMON_SIGNALS
    True
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

        Notes
        -----
        A plant that takes the longitudinal load factor n_x (1, thrust minus drag over weight) has
        limits of three commands, gets that command after the duration, and shows `N_X_SIGNALS`.
        """
        ...


def follows_at_once(plant: Plant) -> bool:
    """Whether roll and load factor of a plant are their commands, as it says of itself."""
    return bool(getattr(plant, "follows_at_once", False))


# Of a plant that takes n_x: the one flown, and the least and largest that its engines give now.
N_X_SIGNALS = ("n_x", "n_x_min", "n_x_max")


class WrappedPlant:
    """A plant flown as it is, for a subclass that shows `further` signals behind those of it."""

    def __init__(self, plant: Plant, further: tuple[str, ...]) -> None:
        self.kind, self.signals, self.limits = plant.kind, plant.signals + further, plant.limits
        # Bound once: it is called at every sample.
        self.plant, self._observe = plant, plant.observe

    # No plant keeps a function of itself: such a cycle would keep JSBSim until Python looks for it.
    @property
    def n_z_followed(self) -> Callable[[], float] | None:
        """Only aircraft with an inner loop have it, for laws that feed the load factor back."""
        return getattr(self.plant, "n_z_followed", None)

    def start(self, condition: FlightCondition) -> None:
        """Put the aircraft into `condition` at t = 0, as the plant does."""
        self.plant.start(condition)

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float, *n_x: float) -> Stop | None:
        """Fly `duration` seconds with the command held, as the plant does."""
        return self.plant.advance(phi_cmd, n_z_cmd, duration, *n_x)


# Names of course and flight-path angle over ground where `chi` and `gamma` are through the air.
OVER_GROUND = ("chi_ground", "gamma_ground")

_CHI, _GAMMA = COMMON_SIGNALS.index("chi"), COMMON_SIGNALS.index("gamma")
_MOTION = ("V_g", "wind_north", "wind_east", "wind_down")


class AirPathPlant(WrappedPlant):
    """A plant whose `chi` and `gamma` are those of its velocity through the air."""

    # Its controller steers that path, and its errors are errors of it; position stays that over
    # ground. ``docs/weather.md`` tells where this makes a wind the same as a rate of the path.
    def __init__(self, plant: Plant) -> None:
        super().__init__(plant, OVER_GROUND)
        self.follows_at_once = follows_at_once(plant)
        self._motion = itemgetter(*map(plant.signals.index, _MOTION))
        self._chi = math.nan

    def start(self, condition: FlightCondition) -> None:
        """Put the aircraft into `condition` at t = 0, as the plant does."""
        super().start(condition)
        self._chi = condition.chi

    def observe(self) -> tuple[float, ...]:
        """Return the values of `signals` now, SI and radians; `chi` is continuous."""
        signals = self._observe()
        chi, gamma = signals[_CHI], signals[_GAMMA]
        V_g, w_north, w_east, w_down = self._motion(signals)
        north, east = V_g * math.cos(chi) - w_north, V_g * math.sin(chi) - w_east
        up = V_g * math.tan(gamma) + w_down
        self._chi += math.remainder(math.atan2(east, north) - self._chi, math.tau)
        return (self._chi, math.atan2(up, math.hypot(north, east)), *signals[2:], chi, gamma)


class GuardedPlant:
    """A plant that ends the flight where it raises or shows a value that is not finite."""

    def __init__(self, plant: Plant, name: str) -> None:
        self._plant, self._name = plant, name
        self.kind, self.signals, self.limits = plant.kind, tuple(plant.signals), plant.limits
        self.follows_at_once = follows_at_once(plant)
        if self.signals[: len(COMMON_SIGNALS)] != COMMON_SIGNALS:
            raise InputError(f"`signals` must begin with {COMMON_SIGNALS}, got {self.signals}.")
        self._t, self._stop, self._last = 0.0, None, ()

    @classmethod
    def made(
        cls, label: str, maker: Callable[..., Plant] | None, parameters: Mapping[str, Any]
    ) -> "GuardedPlant":
        """A fresh plant of a class of the user's; ScenarioError if it cannot be made."""
        name = f"plant {label}"
        if maker is None:
            raise InputError(f"`{name}` must be loaded before it is flown.")
        try:
            return cls(maker(**parameters), name)
        except FAILURES as error:
            raise ScenarioError(failure(name, error, 0.0)) from error

    def start(self, condition: FlightCondition) -> None:
        """Start the plant, or raise TrimError if it cannot, for whatever reason."""
        self._t, self._stop, self._last = 0.0, None, ()
        try:
            self._plant.start(condition)
        except FlightTuneError:
            raise
        except FAILURES as error:
            raise TrimError(failure(self._name, error, 0.0)) from error

    def observe(self) -> tuple[float, ...]:
        """Values of `signals`; the last ones, and the end of the flight, where there are none."""
        try:
            signals = tuple(map(float, self._plant.observe()))
            if len(signals) != len(self.signals) or not all(map(math.isfinite, signals)):
                raise ValueError(f"`observe` must return {len(self.signals)} finite numbers")
        except FAILURES as error:
            reason = failure(self._name, error, self._t)
            if not self._last:
                raise TrimError(reason) from error
            self._stop = Stop("plant_failed", reason)
            return self._last
        self._last = signals
        return signals

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float, *n_x: float) -> Stop | None:
        """Fly on; return why the flight ended, if it did."""
        if self._stop is not None:
            return self._stop
        try:
            stop = self._plant.advance(phi_cmd, n_z_cmd, duration, *n_x)
        except FAILURES as error:
            return Stop("plant_failed", failure(self._name, error, self._t))
        self._t += duration
        return stop


class PlantKind(NamedTuple):
    """One kind of plant that a scenario can name."""

    keys: frozenset[str] = frozenset()  # keys of ``[[plant]]`` that only this kind takes
    required: tuple[str, ...] = ()  # keys that it cannot do without
    # How a point mass of the kind turns, as `turn_rates` has it; None where none models it
    turn: TurnLaw | None = None
    # Its model in a tube, in words; None where its flights cannot be enclosed
    enclosed: str | None = None
    batched: bool = False  # whether the compiled kernel flies it


_LAGS = tuple(
    f"{channel}_{key}"
    for channel in ("roll", "n_z", "n_x")
    for key in ("lag_rad_s", "delay_s", "damping")
)

PLANT_KINDS: Mapping[str, PlantKind] = MappingProxyType(
    {
        "kinematic": PlantKind(turn="paper", enclosed="the paper's law", batched=True),
        "point_mass": PlantKind(turn="exact", enclosed="the exact point mass"),
        "point_mass_lag": PlantKind(
            keys=frozenset({*_LAGS, "identified"}),
            turn="exact",
            enclosed="the exact point mass behind lags",
        ),
        "jsbsim": PlantKind(
            keys=frozenset({"aircraft", "throttle_max", "throttle_max_from_s", "airframe"}),
            required=("aircraft",),
            turn="exact",
            enclosed="the exact point mass behind the identified lag",
        ),
        "python": PlantKind(
            keys=frozenset({"module", "class_", "parameters", "sha256"}), required=("name",)
        ),
    }
)
