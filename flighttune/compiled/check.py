# SPDX-License-Identifier: LGPL-2.1-or-later
"""The check flight: JSBSim and the compiled step fly the same, and every property is compared."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flighttune.base.bits import same_bits
from flighttune.base.errors import FlightTuneError
from flighttune.base.words import told_apart
from flighttune.compiled.aircraft import CompiledStep, Start
from flighttune.compiled.dynamics import Doubles, FlightDynamics
from flighttune.compiled.properties import INERTIAL_VELOCITY
from flighttune.compiled.rigid_body import ACCELERATION_1, INERTIAL_ACCELERATION
from flighttune.compiled.step import place_of

# Length of the flight and the shortest that counts, s.
DURATION, _SHORTEST = 20.0, 2.0

# Time between two looks at what the step takes for constant, s.
_LOOK = 0.5


class Unchecked(Exception):
    """Why an aircraft with these numbers cannot be flown to check its step."""


@dataclass(frozen=True, kw_only=True)
class CheckFlight:
    """A flight that has started in JSBSim, for `DURATION`.

    Attributes
    ----------
    fdm : FlightDynamics
        The aircraft.
    levers : sequence of str
        Properties of its commands.
    commands : callable
        Values of the commands at a time of the flight, s.
    advance : callable
        Flies a step with these values in JSBSim, and says whether the flight goes on.
    start : callable
        The start for the compiled step, after which JSBSim cannot fly.
    """

    fdm: FlightDynamics
    levers: Sequence[str]
    commands: Callable[[float], Sequence[float]]
    advance: Callable[[Sequence[float]], bool]
    start: Callable[[], Start]


def check_flight(step: CompiledStep, flights: Iterable[Iterable[Callable[[], CheckFlight]]]) -> str:
    """Fly both and compare every property; what differs first, empty if nothing does.

    Each flight may be flown in several ways, of which a later one is gentler or begins elsewhere.
    The first that does not end early is enough. Raises `Unchecked` if all are too short.
    """
    for ways in flights:
        if difference := _checked(step, ways):
            return difference
    return ""


def _checked(step: CompiledStep, ways: Iterable[Callable[[], CheckFlight]]) -> str:
    longest, why = 0.0, ""
    for started in ways:
        try:
            first, second = started(), started()
            expected, moved = _flown_by_jsbsim(step, first)
            difference = _compared(step, second, expected, moved)
        except FlightTuneError as error:
            why = why or f"there is no flight to check it in: {error}"
            continue
        if difference:
            return difference
        longest = max(longest, len(expected) / first.fdm.rate)
        if longest >= DURATION:
            return ""
    if longest < _SHORTEST:
        raise Unchecked(why or f"the check flights left the envelope after {longest:.2g} s at most")
    return ""


def start_difference(step: CompiledStep, by_jsbsim: Start, compiled: Start, rate: float) -> str:
    """The first number that differs between two starts, `rate` (1/s) steps; empty if none does."""
    numbers = _start_numbers(step, compiled, rate)
    for name, value in _start_numbers(step, by_jsbsim, rate).items():
        if differ(value, numbers[name]):
            wanted, got = told_apart(value, numbers[name])
            return f"`{name}` differs at a start: {wanted} by JSBSim, {got} compiled"
    return ""


def differ(a: float, b: float) -> bool:
    """Whether numbers of a start differ; a sum of zeros may have either sign before a step."""
    return not (a == b or (math.isnan(a) and math.isnan(b)))


def _start_numbers(step: CompiledStep, start: Start, rate: float) -> dict[str, float]:
    """States and parameters at a start; the acceleration before it by the velocity it leads to."""
    numbers = dict(zip(step.names.states, start.states.tolist(), strict=True))
    numbers |= dict(zip(step.names.parameters, start.parameters.tolist(), strict=True))
    vectors = INERTIAL_VELOCITY, INERTIAL_ACCELERATION, ACCELERATION_1
    for v, a, before in zip(*vectors, strict=True):
        if before in numbers:
            change = 1.5 * numbers[a] - 0.5 * numbers[before]
            numbers[before] = numbers[v] + 1.0 / rate * change
    return numbers


def _shown(step: CompiledStep, fdm: FlightDynamics) -> list[int]:
    """Places of the properties that JSBSim shows too."""
    return [i for i, name in enumerate(step.names.properties) if fdm.shows(name)]


def _flown_by_jsbsim(step: CompiledStep, flight: CheckFlight) -> tuple[Doubles, dict[str, float]]:
    """Rows of the properties after each step; what JSBSim moved of the parameters, and when."""
    fdm = flight.fdm
    read = [fdm.reader(step.names.properties[i]) for i in _shown(step, fdm)]
    constant = {
        name: fdm.reader(name)
        for name in step.names.parameters
        if not name.startswith("_") and name not in flight.levers and fdm.shows(name)
    }
    before = [value() for value in constant.values()]
    moved: dict[str, float] = {}
    rows = np.empty((round(DURATION * fdm.rate), len(read)))
    look = max(1, round(_LOOK * fdm.rate))
    for k, row in enumerate(rows):
        going = flight.advance(flight.commands(k / fdm.rate))
        row[:] = [value() for value in read]
        if k % look == 0 or k == len(rows) - 1 or not going:
            same = same_bits([value() for value in constant.values()], before)
            moved = {
                name: k / fdm.rate for name, kept in zip(constant, same, strict=True) if not kept
            }
        if moved or not going:
            return rows[: k + 1], moved
    return rows, moved


def _compared(
    step: CompiledStep, flight: CheckFlight, expected: Doubles, moved: dict[str, float]
) -> str:
    if moved:
        name, t = next(iter(moved.items()))
        return f"`{name}`, taken for constant, is moved by JSBSim by t = {t:.3f} s"
    places = _shown(step, flight.fdm)
    actual = _flown_compiled(step, flight, len(expected))[:, places]
    same = same_bits(actual, expected)
    names = [step.names.properties[i] for i in places]
    return "" if same.all() else _difference(names, expected, actual, same)


def _flown_compiled(step: CompiledStep, flight: CheckFlight, steps: int) -> Doubles:
    """Rows of all properties after each step of the compiled flight."""
    names, rate = step.names, flight.fdm.rate
    start = flight.start()
    shown = np.empty(len(names.signals) + len(names.properties))
    rows = np.empty((steps, len(names.properties)))
    stream = step.normals(start.random, steps)
    levers = [place_of(names.parameters, name) for name in flight.levers]
    used = [i for i, place in enumerate(levers) if place >= 0]
    for k, row in enumerate(rows):
        values = flight.commands(k / rate)
        for i in used:
            start.parameters[levers[i]] = values[i]
        step.fly(start.states, start.parameters, 1, stream[k : k + 1], shown)
        row[:] = shown[len(names.signals) :]
    return rows


def _difference(names: Sequence[str], expected: Doubles, actual: Doubles, same: Any) -> str:
    """The property that differs first, and the largest relative difference of any."""
    first = int(np.argmin(same.all(axis=1)))
    j = int(np.argmin(same[first]))
    with np.errstate(all="ignore"):
        size = np.abs(expected).max(axis=0, initial=0.0)
        relative = np.abs(actual - expected).max(axis=0) / np.where(size > 0.0, size, 1.0)
    worst = int(np.argmax(np.nan_to_num(relative, nan=np.inf)))
    wanted, got = told_apart(float(expected[first, j]), float(actual[first, j]))
    return (
        f"`{names[j]}` differs first, in step {first + 1}: {wanted} by JSBSim, {got} compiled; "
        f"most differs `{names[worst]}`, by {relative[worst]:.1e} of its largest value; "
        f"{int((~same.all(axis=0)).sum())} of {len(names)} properties differ"
    )
