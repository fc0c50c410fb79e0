"""Interface between a law and the rest of the program, and the list of laws.

No code above this package depends on the kind of law. A law is one class in one file of
`flighttune.control.laws`. An ability that its class lacks is refused by name: a law that does not
state `by_gains` has no linear loop, no R_K and no certificate.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.words import pick
from flighttune.control import exact_law, inner_loop, mimo_pi
from flighttune.control.controller import Controller, GuardedLaw, LawSetup, SelfLimiting
from flighttune.control.gains import COMMANDS, RATES, PIGains, command_gains, rate_gains
from flighttune.control.linear_model import LinearModel, kinematic_model


class Trim(NamedTuple):
    """Steady wings-level flight about which a law is linearised."""

    V_a: float  # m/s
    gamma: float  # rad
    g: float  # m/s^2
    # m/s: design airspeed of gains that the controller scales by airspeed
    schedule_speed: float | None = None
    airspeed: bool = False  # whether the airspeed is a channel


class SampledController(NamedTuple):
    """A law as a tube computes it from sample to sample."""

    channels: tuple[mimo_pi.ChannelLaw, ...]
    conditional: bool  # whether there is anti-windup
    # Whether ``cos(gamma_ref)/cos(phi)`` is added to the load-factor command
    feed_forward: bool = False
    # Options of a law whose channels command rates, which it inverts for roll and load factor
    inverts: exact_law.RateLaw | None = None

    @property
    def feeds_back(self) -> bool:
        """Whether roll and load factor are fed back too."""
        return self.inverts is not None and any(self.inverts.feedback)


class OuterLoop(NamedTuple):
    """A law as JSBSim flies it by itself."""

    # Template of `flighttune.outputs.exports` whose components replace the paper's law
    components: str | None
    rows: tuple[str, str, str]  # names of the properties on which its gains act
    values: Mapping[str, float]  # settings by property, besides gains and limits
    # Whether it follows the rates of the reference, or its planned commands
    takes_rates: bool = False
    takes_plan: bool = False


@dataclass(frozen=True, kw_only=True)
class Law(ABC):
    """A law of a scenario: its name there, and its options as fields."""

    name: str  # in the scenario: ``NAME:GAINS`` is a gain set flown by this law
    takes_gains: bool = True  # else it is flown once per plant, for all gain sets

    kind: ClassVar[str]  # value of the key ``kind`` of ``[[law]]`` for the class
    # Further keys of ``[[law]]``, and required keys; fields of the class are options
    keys: ClassVar[frozenset[str]] = frozenset()
    required: ClassVar[tuple[str, ...]] = ()
    named_alone: ClassVar[bool] = True  # whether a scenario can name the kind without a table
    inputs: ClassVar[tuple[str, str]] = COMMANDS  # channels on which its gains act, or `RATES`
    # Whether gains and `linear_model` describe its flight. Otherwise the law has no claim and no
    # R_K, and its runs have no gains.
    by_gains: ClassVar[bool] = False
    # Whether its integrals add the mean of two errors; else each error after the command of its
    # sample
    trapezoidal: ClassVar[bool] = True
    same_everywhere: ClassVar[bool] = False  # is its linear model the same over an envelope
    batched: ClassVar[bool] = False  # whether the compiled kernel flies its controllers
    # Kind of plant for which its linear model is exact
    plant: ClassVar[str] = "kinematic"

    @abstractmethod
    def make(self, setup: LawSetup, /) -> Controller:
        """Make the controller of a flight."""

    def controller(self, setup: LawSetup, /) -> SelfLimiting:
        """Controller in the limits of the flight; LawError if a user's law cannot be made."""
        flown_law = self.make(setup)
        if isinstance(flown_law, SelfLimiting):
            return flown_law
        return GuardedLaw(flown_law, setup.limits, f"law {self.name}")

    def linear_model(self, trim: Trim, /) -> LinearModel:
        """Error dynamics on which its gains act, from `inputs` to the errors of course and path."""
        if self.inputs == RATES:  # the same at every condition
            return exact_law.rate_model(airspeed=trim.airspeed)
        return kinematic_model(V_a=trim.V_a, gamma=trim.gamma, g=trim.g, airspeed=trim.airspeed)

    def loop(
        self, model: LinearModel, gains: PIGains, _setup: LawSetup, /
    ) -> tuple[LinearModel, PIGains] | None:
        """The linear loop of a flight: `model` closed by `gains`, or None without a linear law."""
        return (model, gains) if self.by_gains else None

    def state_scaling(self, model: LinearModel, lags: Sequence[inner_loop.InnerLag]) -> FloatArray:
        """Units of the states behind an inner loop, in which gains are tuned, shape (n,)."""
        return inner_loop.inner_loop_scaling(model, lags)

    @property
    def tuned_as(self) -> str:
        """Kind of law for which its gains are tuned."""
        return self.kind

    def gains_from(self, gains: PIGains, *, V_a: float, g: float) -> PIGains:
        """Gains of any law as gains of this law: the same loop about level flight."""
        mapped = rate_gains if self.inputs == RATES else command_gains
        return mapped(gains, V_a=V_a, g=g)

    def command_per_rate(self, V_a: float, g: float) -> float:
        """Size of its first input for a turn of one rad/s from level flight."""
        return 1.0 if self.inputs == RATES else V_a / g

    def sampled(self, _setup: LawSetup, /) -> SampledController | None:
        """The controller as a tube encloses it; None if tubes do not know the law."""
        return None

    def outer_loop(self, _setup: LawSetup, /) -> OuterLoop | None:
        """The controller for JSBSim alone; None if the law cannot be exported."""
        return None

    def in_c(self, _setup: LawSetup, /) -> mimo_pi.MimoPI | exact_law.ExactLaw | None:
        """The controller for the export in C; None if the law has no such form."""
        return None

    def refusal(self, ability: str, purpose: str) -> InputError:
        """An error for a law that lacks the method `ability`, with the laws that have it."""
        able = (
            k for k, law in law_kinds().items() if getattr(law, ability) != getattr(Law, ability)
        )
        return InputError(
            f"`gains` must be flown by the law {' or '.join(able)} to be {purpose}, got the law "
            f"{self.name!r}."
        )

    def names_of(self, gains: Sequence[str]) -> tuple[str, ...]:
        """Names of gain sets flown with it: unchanged for the paper's law, else ``LAW:GAINS``."""
        return tuple(gains) if self.name == DEFAULT else tuple(f"{self.name}:{n}" for n in gains)


def pi_settings(setup: LawSetup, law: str) -> dict[str, Any]:
    """Settings of a setup for both built-in laws; InputError without gains."""
    if setup.gains is None:
        raise InputError(f"`gains` must be given to fly {law}.")
    return pick(setup, "gains limits dt anti_windup tracking_time g")


# Law of a scenario without ``[[law]]``, and of gain sets without a law before the colon.
DEFAULT = "paper"


def split_name(name: str, laws: Collection[str] = ()) -> tuple[str, str]:
    """Law and gain set of a name such as ``exact:tuned``, among the laws of a scenario."""
    law, _, gains = name.rpartition(":")
    # without a law before the colon: the only law, or the paper's
    return law or (DEFAULT if DEFAULT in laws or len(laws) != 1 else next(iter(laws))), gains


@cache
def law_kinds() -> Mapping[str, type[Law]]:
    """Every class of law by its kind: the paper's law, then the others in order of kind."""
    folder = import_module("flighttune.control.laws")
    classes = [
        value
        for module in iter_modules(folder.__path__, f"{folder.__name__}.")
        for value in vars(import_module(module.name)).values()
        if isinstance(value, type) and issubclass(value, Law) and value.__module__ == module.name
    ]
    classes.sort(key=lambda law: (law.kind != DEFAULT, law.kind))
    return MappingProxyType({law.kind: law for law in classes})


def plain_laws() -> tuple[str, ...]:
    """Kinds of law that a scenario can name without a table."""
    return tuple(kind for kind, law in law_kinds().items() if law.named_alone)


def made_law(kind: str, name: str | None = None, **options: Any) -> Law:
    """A law of some kind; options that are None or unknown to it are left out."""
    if (law := law_kinds().get(kind)) is None:
        raise InputError(f"`law` must be of kind {', '.join(law_kinds())}, got {kind!r}.")
    fields = law.__dataclass_fields__
    used = {key: value for key, value in options.items() if key in fields and value is not None}
    return law(name=name or kind, **used)
