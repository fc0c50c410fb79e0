"""A law of the user's in the loop: limits on what it commands, and an end where it fails."""

import math
import textwrap
import time
from collections.abc import Iterable, Sequence
from typing import Any, Protocol

from flighttune.control.controller import Controller, FlightCondition, Measured, ReferenceSample
from flighttune.control.exact_law import ExactLaw
from flighttune.control.gains import PIGains
from flighttune.control.limits import CommandLimiter, Limits
from flighttune.control.linear_model import LinearModel
from flighttune.control.mimo_pi import MimoPI
from flighttune.errors import InputError
from flighttune.plants.guarded import FAILURES, failure

BEHIND = 5.0
"""By how much the steps of a law may take longer than the flight they fly, s."""


LONGEST = 40
"""Characters of what a law returned that are repeated."""


class LawError(Exception):
    """A law raised, or what it commands cannot be flown; the message names law and time."""


class Limiter(Protocol):
    """What the loop records of the limits: the same lists at every sample."""

    @property
    def u_unsat(self) -> Iterable[float]:
        """Commands before the limits."""
        ...

    @property
    def limited(self) -> Iterable[float]:
        """0 free, 1 held by a magnitude limit, 2 held by a rate limit."""
        ...


class LimitedLaw(Controller, Protocol):
    """A controller that applies its limits itself."""

    @property
    def limiter(self) -> Limiter:
        """Of the commands it returns."""
        ...


class GuardedLaw:
    """A law in limits that ends the flight, in one line, where it fails.

    Parameters
    ----------
    law : Controller
    limits : Limits
        Of (phi, n_z). They hold for whatever the law commands, also where it has a limiter of its
        own, whose commands before the limits are then the ones recorded.
    name : str
        In messages.
    """

    def __init__(self, law: Controller, limits: Limits, name: str = "law") -> None:
        self._law, self._name = law, name
        self.dt: float = law.dt
        self.signals = {str(name): str(unit) for name, unit in law.signals.items()}
        self._limits = CommandLimiter(limits, self.dt)
        self.limiter: Limiter = self._limits
        self._width = 2 + len(self.signals)
        self._spent = 0.0

    def start(self, condition: FlightCondition) -> None:
        """Start the law and the limits from the roll and load factor of `condition`."""
        self._limits.start((condition.phi, condition.n_z_start))
        self._spent = 0.0
        try:
            self._law.start(condition)
        except FAILURES as error:
            raise self._failed(error, 0.0) from error
        self.limiter = getattr(self._law, "limiter", self._limits)

    def step(self, measured: Measured, reference: ReferenceSample, t: float) -> Sequence[float]:
        """Return the commands of the law after the limits, and what it wants recorded.

        Raises
        ------
        LawError
            If the law raises, returns other than its commands and signals as finite numbers, or
            takes longer than the flight.
        """
        began = time.perf_counter()
        try:
            returned: object = self._law.step(measured, reference, t)
        except FAILURES as error:
            raise self._failed(error, t) from error
        self._spent += time.perf_counter() - began
        values = _numbers(returned)
        if values is None or len(values) != self._width:
            names = ", ".join(("phi_cmd", "n_z_cmd", *self.signals))
            got = textwrap.shorten(repr(returned), LONGEST) if values is None else len(values)
            raise LawError(
                f"{self._name} at t = {t:.2f} s: `step` must return {self._width} numbers "
                f"({names}), got {got}."
            )
        for name, value in zip(("phi_cmd", "n_z_cmd"), values, strict=False):
            if not math.isfinite(value):
                raise LawError(
                    f"{self._name} at t = {t:.2f} s: `{name}` must be finite, got {value}."
                )
        if self._spent > t + BEHIND:
            raise LawError(
                f"{self._name} at t = {t:.2f} s: its steps must not take {BEHIND:g} s longer than "
                f"the flight, got {self._spent:.1f} s."
            )
        return (*self._limits.limit(*values[:2]), *values[2:])

    def linear(self) -> tuple[LinearModel, PIGains] | None:
        """Model and gains of the law, as its ``linear`` returns them; None where it has none.

        Raises
        ------
        LawError
            If it raises.
        """
        linear = getattr(self._law, "linear", None)
        try:
            return None if linear is None else linear()
        except FAILURES as error:
            raise self._failed(error, 0.0) from error

    def _failed(self, error: BaseException, t: float) -> LawError:
        return LawError(failure(self._name, error, t))


def _numbers(returned: Any) -> list[float] | None:
    """What a law returned as numbers; None where it is something else."""
    try:
        return [float(value) for value in returned]
    except (TypeError, ValueError):
        return None


def limited_law(law: Controller, limits: Limits | None) -> LimitedLaw:
    """The law as the loop flies it: those of flighttune limit their own commands.

    Raises
    ------
    InputError
        If `limits` is given for one of them.
    """
    if not isinstance(law, (MimoPI, ExactLaw, GuardedLaw)):
        return GuardedLaw(law, Limits.none(2) if limits is None else limits)
    if limits is not None:
        raise InputError("`limits` must be given to the controller, which applies them itself.")
    return law
