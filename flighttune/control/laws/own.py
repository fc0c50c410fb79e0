"""A user's law: a class from Python, or from a file that a scenario names."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from flighttune.base.errors import InputError
from flighttune.control import controller as controllers
from flighttune.control.gains import PIGains
from flighttune.control.law import Law
from flighttune.control.linear_model import LinearModel


@dataclass(frozen=True, kw_only=True)
class Own(Law):
    """A law with its own behaviour, which alone decides how to use gains."""

    parameters: Mapping[str, Any] = field(default_factory=dict)  # for `maker`, after the `LawSetup`
    # Whether it flies by the gains of its setup: it is then flown with every gain set
    takes_gains: bool = False
    # Called for every flight; None before the class is loaded
    maker: Callable[..., controllers.Controller] | None = None

    kind: ClassVar[str] = "python"
    keys: ClassVar[frozenset[str]] = frozenset(
        {"module", "class_", "parameters", "sha256", "takes_gains"}
    )
    named_alone: ClassVar[bool] = False

    def names_of(self, gains: Sequence[str]) -> tuple[str, ...]:
        """Names of its flights: with every gain set if it flies by the gains, else the first."""
        return super().names_of(gains if self.takes_gains else gains[:1])

    def make(self, setup: controllers.LawSetup, /) -> controllers.Controller:
        """Make the controller of a flight."""
        if self.maker is None:
            raise InputError(f"`{self.name}` must be loaded before it is flown.")
        return self.maker(setup, **self.parameters)

    def controller(self, setup: controllers.LawSetup, /) -> controllers.GuardedLaw:
        """Make a controller that ends its flight, with one line of reason, if it fails."""
        name = f"law {self.name}"
        try:
            user_law = self.make(setup)
            guarded = controllers.GuardedLaw(user_law, setup.limits, name)
        except controllers.FAILURES as error:
            raise controllers.LawError(controllers.failure(name, error, 0.0)) from error
        if guarded.dt != setup.dt:
            raise controllers.LawError(
                f"{name}: `dt` must be that of the flight, {setup.dt:g} s, got {user_law.dt}."
            )
        if wrong := [name for name in guarded.signals if not name.isidentifier()]:
            raise controllers.LawError(
                f"{name}: `signals` must have names like those of Python, got {wrong}."
            )
        return guarded

    def loop(
        self, _model: LinearModel, _gains: PIGains, setup: controllers.LawSetup, /
    ) -> tuple[LinearModel, PIGains] | None:
        """Result of its ``linear()``, None without the method or law; InputError on failure."""
        try:
            controller = self.controller(setup)
        except controllers.LawError:
            return None  # its flights report the failure
        try:
            return controller.linear()
        except controllers.LawError as error:
            raise InputError(str(error)) from error

    @property
    def tuned_as(self) -> str:
        """The paper's law: gains act on roll and load factor, and no more is known."""
        return "paper"
