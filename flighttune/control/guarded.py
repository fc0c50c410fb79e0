"""A law of the user's in the loop: limits on what it commands, and an end where it fails."""

import math
import textwrap
import time
import traceback
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.control.controller import (
    Controller,
    FlightCondition,
    Measured,
    ReferenceSample,
    SelfLimiting,
)
from flighttune.control.gains import PIGains
from flighttune.control.limits import CommandLimiter, Limits
from flighttune.control.linear_model import LinearModel

# Exceptions that end a flight only: a user's code must not end the program.
FAILURES = (Exception, SystemExit)


# Wall time by which a law may fall behind real time, s.
MAX_LAG_S = 5.0

# Characters of a returned value that a message repeats.
MAX_SHOWN = 40


def failure(name: str, error: BaseException, t: float | None) -> str:
    """Source, time (s; None before a flight) and reason of an exception, in one line."""
    when = "" if t is None else f" at t = {t:.2f} s"
    said = _shown(error, str, 2**15)
    return f"{name}{when}: {type(error).__name__}: {said}{_place(error)}"


def _shown(value: object, text: Callable[[object], str] = repr, most: int = MAX_SHOWN) -> str:
    """A stranger's object as a message repeats it in one line; its type, if its text raises."""
    try:
        return textwrap.shorten(text(value), most)
    except FAILURES:  # also of a whole number with thousands of digits
        return f"a value of type {type(value).__name__}"


def _place(error: BaseException) -> str:
    """Line, file and function of the user's in which an exception arose; empty if in none."""
    places = [
        (frame.f_code, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if not frame.f_globals.get("__name__", "").startswith("flighttune.")
        and not frame.f_code.co_filename.startswith("<frozen")
    ]
    for code, line in reversed(places):  # what the user's code called is a library's
        if code.co_filename == places[0][0].co_filename:
            function = code.co_qualname.rpartition("<locals>.")[2]
            of = "" if function == "<module>" else f" of {function}"
            return f" (line {line}{of} in {Path(code.co_filename).name})"
    return ""


def _number(value: Any) -> float:
    """A number as a law returns it; TypeError for what `float` would take besides numbers."""
    if isinstance(value, str | bytes | bytearray | bool | np.bool_ | np.complexfloating):
        raise TypeError
    return float(value)


class LawError(Exception):
    """A law raised, or what it commands cannot be flown; the message names law and time."""


class GuardedLaw(SelfLimiting):
    """A law in limits that ends the flight, in one line, where it fails."""

    def __init__(self, law: Controller, limits: Limits, name: str = "law") -> None:
        self._law, self._name = law, name
        self.dt: float = law.dt
        self.signals = {str(name): str(unit) for name, unit in law.signals.items()}
        # The limits of (phi, n_z), or (phi, n_z, n_x), hold for whatever the law commands, also
        # where it has a limiter of its own, whose commands before the limits are then the ones
        # recorded.
        self._m, self._limits = len(limits.lower), CommandLimiter(limits, self.dt)
        self._recorded: Any = self._limits
        self._spent = 0.0

    @property
    def limiter(self) -> Any:
        """Commands before the limits, and which limit holds: as the law itself says, if it does."""
        return self._recorded

    def start(self, condition: FlightCondition) -> None:
        """Start the law and the limits from the roll and load factor of `condition`."""
        self._limits.start(condition.commands(self._m))
        self._spent = 0.0
        try:
            self._law.start(condition)
        except FAILURES as error:
            raise self._failed(error, 0.0) from error
        self._recorded = getattr(self._law, "limiter", self._limits)
        if not isinstance(self._recorded, CommandLimiter):
            shown_value = _shown(self._recorded)
            raise LawError(f"{self._name}: `limiter` must be a CommandLimiter, got {shown_value}.")

    def step(self, measured: Measured, reference: ReferenceSample, t: float) -> Sequence[float]:
        """Commands of the law after the limits; LawError if it fails or takes too long."""
        began = time.perf_counter()
        try:
            returned: object = self._law.step(measured, reference, t)
        except FAILURES as error:
            raise self._failed(error, t) from error
        self._spent += time.perf_counter() - began
        when, m = f"{self._name} at t = {t:.2f} s", self._m
        names = *("phi_cmd", "n_z_cmd", "n_x_cmd")[:m], *self.signals
        try:
            if isinstance(returned, bytes | bytearray):  # which would give whole numbers
                raise TypeError
            # One more than wanted tells that there are too many: an iterator may have no end.
            first = islice(returned, len(names) + 1)  # type: ignore[call-overload]
            values = [_number(value) for value in first]
        except (TypeError, ValueError, OverflowError):
            values = []
        if len(values) != len(names):
            count = "more" if len(values) > len(names) else len(values)
            count = count if values else _shown(returned)
            expected = f"{len(names)} numbers ({', '.join(names)})"
            raise LawError(f"{when}: `step` must return {expected}, got {count}.")
        for name, value in zip(names[:m], values, strict=False):
            if not math.isfinite(value):
                raise LawError(f"{when}: `{name}` must be finite, got {value}.")
        if self._spent > t + MAX_LAG_S:
            raise LawError(
                f"{when}: its steps must not take {MAX_LAG_S:g} s longer than the flight, "
                f"got {self._spent:.1f} s."
            )
        return (*self._limits.limit(*values[:m]), *values[m:])

    def linear(self) -> tuple[LinearModel, PIGains] | None:
        """Model and gains of the law's ``linear``, None without one; LawError if it fails."""
        linear = getattr(self._law, "linear", None)
        try:
            returned = None if linear is None else linear()
            if returned is None:
                return None
            model, gains = returned
        except FAILURES as error:
            raise self._failed(error, 0.0) from error
        if not (isinstance(model, LinearModel) and isinstance(gains, PIGains)):
            got = _shown(returned)
            raise LawError(
                f"{self._name}: `linear` must return a LinearModel and PIGains, got {got}."
            )
        return model, gains

    def _failed(self, error: BaseException, t: float) -> LawError:
        return LawError(failure(self._name, error, t))
