# SPDX-License-Identifier: LGPL-2.1-or-later
"""Sums of integrators, which JSBSim hides, from what it shows of some steps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from flighttune.compiled.components import (
    ZERO_TRIGGER,
    channels_of,
    execution_rate,
    inputs_of,
    integrand,
    integrator_kind,
    name_of,
)
from flighttune.compiled.dynamics import FlightDynamics
from flighttune.compiled.functions import is_number
from flighttune.compiled.motion import neighbours

# Doubles that are tried on each side of a guess that is sure up to rounding, and of one that is not
_TRIED, _FAR = 64, 2048


@dataclass(frozen=True)
class Integrator:
    """A PID, whose sum JSBSim hides."""

    name: str
    gains: Mapping[str, str]  # number or property by ``kp``, ``ki`` and ``kd``
    fades: bool  # whether all gains can be taken away
    source: str
    trigger: str
    slope: str  # property of the slope of its input; empty if it computes that
    kind: str
    standard: bool  # whether the proportional gain multiplies all
    rate: int  # steps from one run to the next

    def reads(self, fdm: FlightDynamics) -> list[str]:
        """Properties that it reads and shows."""
        names = self.name, self.source.lstrip("-"), self.trigger, self.slope, *self.gains.values()
        return [name for name in names if name and fdm.shows(name)]

    def _gain(self, tag: str, row: Mapping[str, float]) -> float:
        text = self.gains.get(tag, "0")
        return row[text] if text in row else float(text)

    def _past(self, rows: Sequence[Mapping[str, float]], dt: float) -> "_Past":
        k_i = self._gain("ki", rows[0])
        sign = -1.0 if self.source.startswith("-") else 1.0
        inputs = [sign * row[self.source.lstrip("-")] for row in rows]
        changes = [0.0]
        for row, before, x in zip(rows[1:], inputs[:-1], inputs[1:], strict=True):
            stays = bool(self.trigger) and abs(row[self.trigger]) >= ZERO_TRIGGER
            changes.append(k_i * dt * (0.0 if stays else integrand(self.kind, x, before)))
        slopes = [0.0, *((b - a) / dt for a, b in pairwise(inputs))]
        if self.slope:
            slopes = [row[self.slope] for row in rows]
        return _Past(inputs, changes, slopes, [row[self.name] for row in rows])

    def settled(self, rows: Sequence[Mapping[str, float]], last: float | None, dt: float) -> float:
        """The sum before the steps whose properties are `rows`, at whose end it is `last`."""
        rows, dt = rows[:: self.rate], dt * self.rate
        past = self._past(rows, dt)
        k_p, k_i, k_d = (self._gain(tag, rows[0]) for tag in ("kp", "ki", "kd"))
        of_input, of_all = (1.0, k_p or 1.0) if self.standard else (k_p, 1.0)

        def shown(x: float, total: Any, slope: float) -> Any:
            output = of_input * x + total + k_d * slope
            return of_all * output if self.standard else output

        at = 1 if k_d else 0  # the slope at the start is not known
        # It is empty while disengaged, and runs once or twice with the loop engaged.
        once = 0.0 + k_i * dt * past.inputs[0]  # a sum that begins at 0 does not become -0
        likely = [once, once + once, 0.0]
        for guess in likely:
            total, exact = guess, True
            for k, (x, change, slope, y) in enumerate(zip(*past, strict=True)):
                total += change
                exact = exact and (k < at or shown(x, total, slope) == y)
            if exact and last in (None, total):
                return guess
        near = past.shown[at] / of_all - of_input * past.inputs[at]
        near -= k_d * past.slopes[at] + sum(past.changes[: at + 1])
        guesses = [*likely, *neighbours(once, _TRIED)]
        if last is not None:
            guesses += neighbours(last - sum(past.changes), _TRIED)
        further = near + math.ulp(near) * np.arange(-_FAR, _FAR + 1)
        sums = totals = np.concatenate((guesses, further))
        left = np.arange(len(sums))
        # Those remain that give what JSBSim shows, for as long as one does.
        for k, (x, change, slope, y) in enumerate(zip(*past, strict=True)):
            totals = totals + change
            same = shown(x, totals, slope) == y
            if same.any() and k >= at:
                left, totals = left[same], totals[same]
        if last is not None and (totals == last).any():
            left = left[totals == last]
        return float(sums[left[0] if left[0] < len(likely) else left[len(left) // 2]])


class _Past(NamedTuple):
    """Inputs and changes of an integrator in each run."""

    inputs: list[float]
    changes: list[float]  # of its sum
    slopes: list[float]
    shown: list[float]


def integrators_of(fdm: FlightDynamics, root: Element) -> list[Integrator]:
    """The PIDs of all channels."""
    found = []
    pids = ((channel, pid) for channel in channels_of(root) for pid in channel.findall("pid"))
    for channel, element in pids:
        texts = {tag: (element.findtext(tag) or "").strip() for tag in ("kp", "ki", "kd")}
        gains = {tag: text for tag, text in texts.items() if text}
        numbers = [float(text) for text in gains.values() if is_number(text)]
        if not all(is_number(text) or fdm.has(text) for text in gains.values()):
            continue
        (source,) = inputs_of(element)
        found.append(
            Integrator(
                name_of(element),
                gains,
                not any(numbers),
                source,
                (element.findtext("trigger") or "").strip(),
                (element.findtext("pvdot") or "").strip(),
                integrator_kind(element),
                element.get("type") == "standard",
                execution_rate(channel),
            )
        )
    return found
